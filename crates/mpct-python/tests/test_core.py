"""Problems, designs, controllers and closed loops give what the paper and the Rust library give."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import academic_problem, threads_agree

import mpct

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


TEN_LINES = """
import mpct
plant = mpct.Plant(A, B)                       # numpy; or Plant.continuous(A, B, dt), or a control.StateSpace
problem = mpct.Problem(plant, state=(lo, hi), input=(lo, hi), Q=10, R=100, O=1e4, horizon=10, scaling=0.9)
design = problem.design()                      # progress bar in terminals and notebooks; repr says M̃, ρ, rows, seconds
controller = design.controller()
step = controller.step(x, set_point)           # step.u, step.artificial_state, step.cost, step.admissible, …
run = mpct.simulate(controller, x0, set_points, steps=210)
run.plot(); run.to_dataframe()
"""


def test_ten_lines():
    known = {
        "A": np.array([[1, 1], [0, 1]]),
        "B": np.array([[0, 0.5], [1, 0.5]]),
        "lo": [-3, -3],
        "hi": [3, 3],
        "x": np.zeros(2),
        "x0": np.zeros(2),
        "set_point": [2, 0.5],
        "set_points": [(0, [2, 0.5]), (50, [-2, -0.5]), (100, [1, 0.25]), (150, [5, 1])],
    }
    exec(TEN_LINES, known)
    step, run = known["step"], known["run"]
    assert step.admissible and step.u.shape == (2,) and step.artificial_state.shape == (2,) and step.cost > 0
    assert len(run.plot().axes) == 4
    frame = run.to_dataframe()
    assert frame.shape == (210, 16) and frame.index.name == "k"
    assert not run.admissible[-1] and run.admissible[:150].all()
    assert run.worst_violation < 1e-8
    np.testing.assert_allclose(run.x[49], [2, 0.5], atol=1e-3)


def test_terminal_horizon_of_the_paper(design):
    assert design.terminal_horizon == 5
    assert max(step for _, step in design.spent_steps) <= 6
    assert len(design.spent_steps) == 8
    for part in ("M̃=5", "ρ=", "rows=", "seconds="):
        assert part in repr(design)


def test_sufficient_condition_is_not_shorter(problem, design):
    assert problem.design(condition="sufficient").terminal_horizon >= design.terminal_horizon


def test_design_satisfies_its_equations(problem, design):
    A, B, K, P = problem.plant.A, problem.plant.B, design.gain, design.terminal_weight
    closed = A + B @ K
    assert design.spectral_radius == pytest.approx(max(abs(np.linalg.eigvals(closed))), rel=1e-9)
    residual = closed.T @ P @ closed - P + problem.Q + K.T @ problem.R @ K
    np.testing.assert_allclose(residual, 0, atol=1e-8 * np.abs(P).max())
    M = design.steady_state_basis
    np.testing.assert_allclose(np.hstack([A - np.eye(2), B]) @ M, 0, atol=1e-12)


def test_terminal_set_is_invariant_and_admissible(problem, design):
    G, g = design.terminal_set()
    assert G.shape[1] == 4 and g.shape == (len(G),)
    A, B, K = problem.plant.A, problem.plant.B, design.gain
    Mx, Mu = np.split(design.steady_state_basis, [2])
    L = Mu - K @ Mx
    random = np.random.default_rng(0)
    for _ in range(200):
        z = random.normal(size=4)
        z /= np.max(G @ z / g)
        x, theta = z[:2], z[2:]
        u = K @ x + L @ theta
        assert (np.abs(x) <= 3 + 1e-9).all() and (np.abs(u) <= 2 + 1e-9).all()
        assert (G @ np.concatenate([A @ x + B @ u, theta]) <= g + 1e-9).all()


@pytest.mark.parametrize("formulation", ["implicit", "explicit"])
def test_closed_loop_follows_the_model(problem, design, formulation):
    controller = design.controller(formulation)
    A, B = problem.plant.A, problem.plant.B
    run = mpct.simulate(controller, [0, 0], [2, 0.5], steps=30)
    np.testing.assert_allclose(run.x[1:], run.x[:-1] @ A.T + run.u[:-1] @ B.T, atol=1e-12)
    controller.reset()
    x = np.zeros(2)
    for k in range(30):
        step = controller.step(x, [2, 0.5])
        np.testing.assert_array_equal(step.u, run.u[k])
        np.testing.assert_array_equal(x, run.x[k])
        assert step.cost == run.cost[k]
        assert step.predicted_states.shape == (11, 2) and step.predicted_inputs.shape == (10, 2)
        np.testing.assert_allclose(step.predicted_states[0], x, atol=1e-12)
        np.testing.assert_array_equal(step.predicted_inputs[0], step.u)
        x = A @ x + B @ step.u
        np.testing.assert_allclose(step.predicted_states[1], x, atol=1e-9)
    np.testing.assert_allclose(run.final_state, x, atol=1e-12)


def test_qp_has_the_step_as_its_optimum(design, controller):
    x, set_point = np.array([1.0, -0.5]), np.array([2.0, 0.5])
    H, f, G, b = controller.qp(x, set_point)
    assert H.shape == (controller.variables,) * 2 and G.shape == (controller.rows, controller.variables)
    np.testing.assert_allclose(H, H.T)
    step = controller.step(x, set_point)
    # Around the optimum no feasible point is better: the unconstrained optimum bounds the value from below.
    Mx, Mu = np.split(design.steady_state_basis, [2])
    theta = np.linalg.lstsq(np.vstack([Mx, Mu]), np.concatenate([step.artificial_state, step.artificial_input]), rcond=None)[0]
    law = design.gain @ step.predicted_states[:10].T + ((Mu - design.gain @ Mx) @ theta)[:, None]
    z = np.concatenate([(step.predicted_inputs.T - law).T.ravel(), theta])
    assert (G @ z <= b + 1e-6).all()
    gradient = H @ z + f
    active = G[G @ z >= b - 1e-6]
    if len(active):
        multipliers = np.linalg.lstsq(active.T, -gradient, rcond=None)[0]
        gradient = gradient + active.T @ multipliers
    np.testing.assert_allclose(gradient, 0, atol=1e-5 * np.abs(f).max())


def test_closest_admissible(design):
    closest = design.closest_admissible([5, 1])
    assert not closest.admissible and closest.limiting
    assert closest.offset_cost > 0
    assert design.closest_admissible([2, 0.5]).admissible
    assert "limiting" in repr(closest)


def test_limits_and_reset(controller):
    controller.step([0, 0], [2, 0.5])
    controller.set_limits(iterations=50, seconds=1.0)
    controller.reset()
    step = controller.step([0, 0], [2, 0.5])
    assert (step.status, step.reason) == ("optimal", None)
    controller.set_limits(iterations=0)
    step = controller.step([0, 0], [-2, 0.5])
    if step.status == "candidate":
        assert step.reason == "iteration_limit"
    # A run keeps the reasons too; the limits outlive the reset at its start.
    run = mpct.simulate(controller, [0, 0], [(0, [2, 0.5]), (5, [-2, -0.5])], 10)
    assert [r is None for r in run.reason] == [s == "optimal" for s in run.status]
    assert set(run.reason) <= {None, "iteration_limit"}
    controller.set_limits()
    with pytest.raises(ValueError, match="seconds >= 0"):
        controller.set_limits(seconds=-1)


def test_plant_in_continuous_time_and_models():
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    plant = mpct.Plant.continuous(A, B, 0.1)
    np.testing.assert_allclose(plant.A, [[1, 0.1], [0, 1]], atol=1e-15)
    np.testing.assert_allclose(plant.B, [[0.005], [0.1]], atol=1e-15)
    assert plant.sampling_time == 0.1
    discrete = SimpleNamespace(A=A, B=B, C=np.eye(2), D=np.zeros((2, 1)), dt=0.5)
    assert mpct.Plant(discrete).sampling_time == 0.5
    assert mpct.Plant(SimpleNamespace(A=A, B=B, dt=True)).sampling_time is None
    model = SimpleNamespace(A=A, B=B, dt=0)
    assert mpct.Plant.continuous(model, dt=0.1) == plant
    with pytest.raises(ValueError, match="continuous time"):
        mpct.Plant(model)
    with pytest.raises(ValueError, match="discrete time"):
        mpct.Plant.continuous(discrete, dt=0.1)
    with pytest.raises(TypeError, match="state-space model"):
        mpct.Plant(A)


def test_python_control_model():
    control = pytest.importorskip("control")
    system = control.ss([[1.0, 1.0], [0.0, 1.0]], [[0.0, 0.5], [1.0, 0.5]], np.eye(2), np.zeros((2, 2)), 1.0)
    plant = mpct.Plant(system)
    np.testing.assert_array_equal(plant.A, [[1, 1], [0, 1]])
    assert plant.sampling_time == 1.0


def test_problem_files(problem, tmp_path):
    read = mpct.Problem.read(EXAMPLES / "academic.toml")
    assert read.design().terminal_horizon == 5
    assert read.name == "academic"
    path = tmp_path / "problem.toml"
    path.write_text(problem.to_toml(), encoding="utf-8")
    assert mpct.Problem.read(str(path)) == problem
    with pytest.raises(mpct.FileError) as error:
        mpct.Problem.read(tmp_path / "none.toml")
    assert error.value.kind == "unreadable" and "none.toml" in error.value.path
    with pytest.raises(mpct.FileError) as error:
        mpct.Problem.from_toml(problem.to_toml().replace("state_upper", "state_uper"))
    assert (error.value.kind, error.value.key) == ("unknown_key", "constraints.state_uper")
    with pytest.raises(mpct.DesignError):
        mpct.Problem.from_toml(problem.to_toml().replace("scaling = 0.9", "scaling = 1.9"))


def test_sweep(problem):
    points = mpct.sweep(problem, [0.5, 0.9, 0.99])
    assert [p.scaling for p in points] == [0.5, 0.9, 0.99]
    assert points[1].terminal_horizon == 5
    horizons = [p.terminal_horizon for p in points]
    assert horizons == sorted(horizons)
    short = mpct.sweep(problem, [0.99], max_horizon=2)[0]
    assert short.terminal_horizon is None and short.error.kind == "horizon_not_determined"


def test_disturbance_is_seeded(controller):
    runs = [mpct.simulate(controller, [0, 0], [1, 0.25], 20, disturbance=[0.01, 0.01], seed=s) for s in (1, 1, 2)]
    np.testing.assert_array_equal(runs[0].x, runs[1].x)
    assert not np.array_equal(runs[0].x, runs[2].x)


def test_mixed_rows_and_regulation():
    p = academic_problem(mixed=([[1, 1]], [[0, 0]], [2.5]), task="regulation")
    assert p.rows == 9
    d = p.design()
    run = mpct.simulate(d.controller(), [2, 0.2], [0, 0], 40)
    assert (run.x.sum(axis=1) <= 2.5 + 1e-8).all()
    np.testing.assert_allclose(run.final_state, 0, atol=1e-2)
    assert d.terminal_set()[0].shape[1] == 2


def test_simulation_of_problem_files(problem, tmp_path):
    simulation = mpct.Simulation([0, 0], [(0, [2, 0.5]), (5, [1, 0], [0, 0.5])], 10, [0.1, 0.2], 3)
    file = mpct.ProblemFile(problem, simulation)
    path = tmp_path / "problem.toml"
    file.write(path)
    file.write(path)
    read = mpct.ProblemFile.read(path)
    assert read.problem == problem and read.to_toml() == file.to_toml()
    assert (read.simulation.steps, read.simulation.seed) == (10, 3)
    np.testing.assert_array_equal(read.simulation.disturbance, [0.1, 0.2])
    assert read.simulation.set_points[1][0] == 5 and len(read.simulation.set_points[1]) == 3
    assert mpct.ProblemFile(problem).simulation is None
    assert mpct.ProblemFile.parse(problem.to_toml()).simulation is None
    assert [p.name for p in tmp_path.iterdir()] == ["problem.toml"]


def test_mixed_blocks():
    blocks = [([[1, 1]], None, [2.5]), (None, np.eye(2), [1.5, 1.5])]
    problem = academic_problem(mixed=blocks)
    assert problem.rows == 11 and len(problem.mixed) == 2
    np.testing.assert_array_equal(problem.mixed[0][1], [[0, 0]])
    assert academic_problem(mixed=blocks[0]).rows == 9
    assert mpct.Problem.from_toml(problem.to_toml()) == problem
    narrow = problem.replace(input=(-1, 1))
    assert narrow.mixed[1][2].tolist() == [1.5, 1.5] and narrow.state[1].tolist() == [3, 3]
    for wrong in (3, [[1, 2, 3]], (np.eye(2), [1])):
        with pytest.raises(mpct.ArgumentTypeError, match="mixed"):
            academic_problem(mixed=wrong)


def test_ellipsoids():
    plant = mpct.Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0, 0.5], [1.0, 0.5]])
    discs = {"state_ellipsoid": 1 / 9, "input_ellipsoid": [0.25, 0.25]}
    problem = mpct.Problem(plant, **discs, Q=10, R=100, O=1e4)
    # The horizon that polygons with 128 sides have too.
    assert problem.rows == 0 and problem.design().terminal_horizon == 5
    assert mpct.Problem.from_toml(problem.to_toml()) == problem
    narrow = problem.replace(input=(-1, 1))
    assert narrow.rows == 4 and narrow.to_toml().count("[[constraints.ellipsoid]]") == 2
    step = problem.design().controller().step([-2, 2], [2, 0.5])
    assert np.linalg.norm(step.u) <= 2 and step.admissible
    with pytest.raises(NotImplementedError, match="cones"):
        problem.qp([0, 0], [2, 0.5])
    with pytest.raises(mpct.DesignError, match="eigenvalue"):
        mpct.Problem(plant, state_ellipsoid=[1, -1], Q=10, R=100, O=1e4)


def test_replace_changes_what_is_named(problem):
    changed = problem.replace(Q=[1, 2], R=5, O_input=1.0, horizon=4, name="other")
    np.testing.assert_array_equal(changed.Q, np.diag([1.0, 2.0]))
    assert (changed.horizon, changed.name, changed.scaling) == (4, "other", problem.scaling)
    np.testing.assert_array_equal(changed.O, problem.O)
    assert problem.replace() == problem
    gained = problem.replace(gain=problem.design().gain)
    assert gained.gain.shape == (2, 2)


def test_problem_qp_is_that_of_its_controller(problem, controller):
    for mine, its in zip(problem.qp([0.5, 0], [2, 0.5]), controller.qp([0.5, 0], [2, 0.5])):
        np.testing.assert_array_equal(mine, its)
    with pytest.raises(mpct.StepError):
        problem.qp([0.5], [2, 0.5])
    assert threads_agree(lambda: problem.replace().qp([0.5, 0], [2, 0.5])[1].tolist())


def test_python_control_models_of_all_kinds():
    control = pytest.importorskip("control")
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    continuous = control.ss(A, B, np.eye(2), np.zeros((2, 1)))
    with pytest.raises(mpct.ArgumentError, match="continuous time"):
        mpct.Plant(continuous)
    sampled = mpct.Plant.continuous(continuous, dt=0.1)
    np.testing.assert_allclose(sampled.A, control.c2d(continuous, 0.1).A, atol=1e-14)
    assert mpct.Plant(control.c2d(continuous, 0.1)).sampling_time == pytest.approx(0.1)
    assert mpct.Plant(control.ss(A, B, np.eye(2), np.zeros((2, 1)), True)).sampling_time is None
    with pytest.raises(mpct.ArgumentTypeError, match="state-space model"):
        mpct.Plant(control.tf([1], [1, 1], 0.1))
