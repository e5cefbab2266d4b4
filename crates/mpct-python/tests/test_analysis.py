"""Analyses: sets, scaling, performance, certificates, the formulation without terminal constraint."""

import pickle

import numpy as np
import pytest
from conftest import academic_problem

import mpct


def section_3_5(**options):
    chosen = {"formulation": "no_terminal_constraint", "horizon_extension": 2, "gamma": 20.0, "horizon": 3, **options}
    return academic_problem(**chosen)


def test_domain_of_attraction(controller):
    domain = mpct.DomainOfAttraction(controller)
    inside, outside = domain.contains([-3, 3]), domain.contains([3, 3])
    assert inside.inside and inside.slack >= -1e-8 and inside.candidate.shape == (controller.variables,)
    assert not outside.inside and outside.gap > 0 and outside.radius > 1 and outside.rows[0][1] > 0
    reach = domain.reach([1, 0])
    assert reach.distance == pytest.approx(3) and reach.at_most >= reach.distance
    np.testing.assert_allclose(reach.state, [reach.distance, 0])
    polygon = domain.projection()
    assert polygon.contains([0, 0]) and not polygon.contains([3, 3])
    for vertex in polygon.vertices:
        assert domain.contains(0.999 * vertex).inside and not domain.contains(1.01 * vertex).inside
    section = domain.section([0, 0])
    assert section.area == pytest.approx(polygon.area, rel=1e-4)
    again = pickle.loads(pickle.dumps(domain))
    assert again.contains([-3, 3]).inside
    with pytest.raises(mpct.DesignError) as error:
        domain.projection((0, 0))
    assert error.value.kind == "out_of_range"


def test_volumes(controller):
    domain = mpct.DomainOfAttraction(controller)
    assert domain.origin.tolist() == [0, 0]
    found = domain.volume()
    assert found.dimension == 2 and found.value == pytest.approx(domain.projection().area, rel=1e-6) and found.gap <= 1e-6
    # Three states that do not act on each other: the volume is the product of the lengths.
    rows = np.diag([0.5, 0.8, 0.9])
    problem = mpct.Problem(mpct.Plant(rows, np.eye(3)), state=(-1, [1, 2, 3]), input=(-5, 5), Q=1, R=1, O=1e3, horizon=3)
    box = mpct.DomainOfAttraction(problem.design().controller()).volume()
    assert box.dimension == 3 and box.value == pytest.approx(2 * 3 * 4, rel=1e-5) and box.vertices >= 8
    single = mpct.Problem(mpct.Plant([[0.5]], [[1.0]]), state=(-1, 2), input=(-5, 5), Q=1, R=1, O=1e3)
    assert mpct.DomainOfAttraction(single.design().controller()).volume().value == pytest.approx(3)


def test_reach_and_volume_of_a_stability_region():
    controller = section_3_5(alpha=1.0).design().controller()
    region = mpct.StabilityRegion(controller, [0.5, 0], "throughout_region")
    outline = region.projection()
    assert region.volume().value == pytest.approx(outline.area, rel=1e-3)
    centre = np.array([0.5, 0])
    for start in (None, [0.4, 0.05]):
        direction = np.array([1.0, -0.3])
        reach = region.reach(direction, start)
        begin = centre if start is None else np.array(start)
        np.testing.assert_allclose(reach.state, begin + reach.distance * direction, atol=1e-12)
        assert reach.distance <= reach.at_most
        # Just before it the state is inside, just after it outside.
        assert region.contains(begin + 0.999 * reach.distance * direction).inside
        assert not region.contains(begin + 1.001 * reach.at_most * direction).inside
    with pytest.raises(mpct.DesignError, match="inside the stability region"):
        region.reach([1, 0], [2.9, 2.9])


def test_proof_of_a_step_that_is_infeasible(controller):
    state, set_point = [2.9, 2.9], [0, 0]
    assert controller.infeasibility_proof() == []
    with pytest.raises(mpct.StepError) as error:
        controller.step(state, set_point)
    assert error.value.kind == "infeasible"
    proof = controller.infeasibility_proof()
    _, _, G, b = controller.qp(state, set_point)
    rows, names, y = zip(*proof)
    y = np.array(y)
    assert (y >= 0).all() and b[list(rows)] @ y < 0
    np.testing.assert_allclose(y @ G[list(rows)], 0, atol=1e-9 * np.abs(y).max() * np.abs(G).max())
    assert all(" at step " in name or name.endswith("of the scaled equilibria") for name in names)
    controller.step([0, 0], set_point)
    assert controller.infeasibility_proof() == []


def test_tables_for_the_runtime(controller):
    tables = controller.runtime_tables()
    assert (tables.states, tables.inputs, tables.horizon, tables.rows) == (2, 2, 10, controller.rows)
    assert tables.numbers.size > controller.variables * controller.rows and tables.workspace_len > 0


def test_phases_of_a_design(design):
    assert set(design.phases) == {"law", "steady_states", "rows", "programs"}
    assert 0 < sum(design.phases.values()) <= 1.5 * design.seconds


def test_plots_of_sets(problem, design):
    outlines = {f: mpct.DomainOfAttraction(design.controller(f)).projection() for f in ("implicit", "explicit")}
    regulation = problem.replace(task="regulation").design().controller()
    outlines["regulation"] = mpct.DomainOfAttraction(regulation).projection()
    assert outlines["regulation"].area < outlines["implicit"].area == pytest.approx(outlines["explicit"].area)
    ax = mpct.plots.sets(outlines, problem, states=[[1, 0], [0, 1]])
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["implicit", "explicit", "regulation", "state"]
    assert len(ax.lines) == 3 + 1 + 4
    from matplotlib import pyplot

    pyplot.close("all")


def test_many_carts():
    """Beyond a hundred variables plants of many subsystems have an online solver of their own."""
    file = mpct.example("carts", 60)
    problem = file.problem
    controller = problem.design().controller()
    assert controller.variables == 60 * (problem.horizon + 1) and controller.runtime_tables() is None
    setting = file.simulation
    run = mpct.simulate(controller, setting.x0, setting.set_points, 6)
    A, B = problem.plant.A, problem.plant.B
    np.testing.assert_allclose(run.x[1:], run.x[:-1] @ A.T + run.u[:-1] @ B.T, atol=1e-9)
    assert set(run.status) == {"optimal"} and run.worst_violation < 1e-8
    assert "<svg" in run.report()
    # The program that other solvers get has the same optimum.
    x = run.x[3]
    H, f, G, b = problem.qp(x, run.setpoint[3])
    assert H.shape == (controller.variables,) * 2 and G.shape == (controller.rows, controller.variables)
    step = controller.step(x, run.setpoint[3])
    design = controller.design
    basis = design.steady_state_basis
    Mx, Mu = np.split(basis, [problem.plant.states])
    theta = np.linalg.lstsq(basis, np.concatenate([step.artificial_state, step.artificial_input]), rcond=None)[0]
    N = problem.horizon
    law = design.gain @ step.predicted_states[:N].T + ((Mu - design.gain @ Mx) @ theta)[:, None]
    z = np.concatenate([(step.predicted_inputs.T - law).T.ravel(), theta])
    assert (G @ z - b).max() < 1e-7
    # No feasible direction is better: the gradient is a combination of active rows, with multipliers of one sign.
    from scipy.optimize import nnls

    active = G[G @ z >= b - 1e-7]
    gradient = H @ z + f
    residual = nnls(active.T, -gradient)[1] if len(active) else np.linalg.norm(gradient)
    assert residual < 1e-5 * np.linalg.norm(f)


def test_stability_region_of_the_paper():
    problem = academic_problem(formulation="no_terminal_constraint", horizon_extension=2, gamma=20, alpha=25)
    assert (problem.horizon_extension, problem.gamma, problem.alpha) == (2, 20.0, 25.0)
    design = problem.design()
    point = [-0.5688, -0.0523]
    bounds = mpct.AlphaBounds(design, point)
    assert bounds.largest() == pytest.approx(1.845, abs=1e-3)
    assert bounds.largest("throughout_region") > 25 > bounds.largest("every_equilibrium")
    assert 25 * bounds.stage_cost_ratio == pytest.approx(2.2253, abs=1e-4)
    assert bounds.limiting().startswith(("state", "input"))
    region = mpct.StabilityRegion(design.controller(), point, "throughout_region")
    assert region.alpha == 25 and region.level > 0 and region.scope == "throughout_region"
    found = region.contains([-0.5, 0])
    assert found.inside and found.cost <= found.level
    far = region.contains([30, 30])
    assert not far.inside and np.isinf(far.cost)
    assert region.section().contains([-0.5688, -0.0523])
    with pytest.raises(mpct.DesignError, match="alpha|α"):
        mpct.StabilityRegion(design.controller(), point)
    with pytest.raises(mpct.DesignError, match="no_terminal_constraint"):
        mpct.StabilityRegion(academic_problem().design().controller(), point)
    with pytest.raises(mpct.ArgumentError, match="scope"):
        bounds.largest("everywhere")


def test_choices_of_section_3_5():
    problem = section_3_5()
    assert mpct.Problem.from_toml(problem.to_toml()) == problem
    assert pickle.loads(pickle.dumps(problem)) == problem
    assert problem.replace(gamma=30).gamma == 30
    plain = problem.replace(formulation="implicit")
    assert plain.horizon_extension is None and plain == academic_problem(horizon=3)
    assert problem.design().controller("implicit").formulation == "implicit"
    with pytest.raises(mpct.ArgumentError, match="horizon_extension"):
        academic_problem(formulation="no_terminal_constraint")
    with pytest.raises(mpct.ArgumentError, match="beside it"):
        academic_problem(gamma=2)
    with pytest.raises(mpct.DesignError, match="gamma"):
        section_3_5(gamma=0.5)


def test_formulations_agree(design):
    steps = [design.controller(f).step([0.5, 0.2], [2, 0.5]) for f in ("implicit", "explicit")]
    np.testing.assert_allclose(steps[0].u, steps[1].u, atol=1e-8)
    assert steps[0].cost == pytest.approx(steps[1].cost)


def test_implicit_terminal_cost(problem, design):
    cost = design.implicit_terminal_cost()
    assert 0 < cost.epsilon < 0.2
    assert np.linalg.eigvalsh(cost.weight - design.terminal_weight).min() > -1e-9 * np.abs(cost.weight).max()
    changed = problem.replace(terminal_cost="implicit")
    assert changed.terminal_cost == "implicit" and changed != problem
    assert changed.design().controller().step([0, 0], [2, 0.5]).admissible


def test_terminal_set_in_two_states(design):
    outline = design.terminal_set_outline()
    rows, bounds = design.terminal_set()
    from matplotlib import pyplot

    # Each vertex extends to a point of the set: some θ satisfies the rows.
    from scipy.optimize import linprog

    for vertex in outline.vertices:
        rest = bounds + 1e-7 - rows[:, :2] @ vertex
        assert linprog(np.zeros(2), A_ub=rows[:, 2:], b_ub=rest, bounds=(None, None)).status == 0
    ax = mpct.plots.terminal_set(design)
    assert outline.plot(ax=ax, color="red") is ax
    assert len(ax.patches) == 2
    pyplot.close("all")


def test_scaling():
    problem = academic_problem()
    need = mpct.scaling_need(problem, [2.85, 0])
    assert need.needed == pytest.approx(0.95) and need.grow_by == pytest.approx(0.05) and need.attainable
    advice = mpct.scaling_advice(problem, [[2.85, 0], [2, 0.5], [5, 1]])
    assert [n.attainable for n in advice.set_points] == [True, True, False]
    assert advice.scaling == 0.9 and advice.terminal_horizon == 5
    assert advice.advised_scaling == pytest.approx(0.95, rel=1e-4) and advice.advised_terminal_horizon >= 5
    designed = problem.replace(scaling=advice.advised_scaling).design()
    assert designed.terminal_horizon == advice.advised_terminal_horizon
    assert designed.closest_admissible([2.85, 0]).admissible
    with pytest.raises(mpct.DesignError):
        mpct.scaling_advice(problem, [])


def test_performance_and_compare():
    runs = []
    for weight in (100, 10):
        problem = academic_problem(R=weight)
        runs.append(mpct.simulate(problem.design().controller(), [0, 0], [(0, [2, 0.5]), (50, [-2, -0.5])], 100))
    figures = mpct.performance(runs[0])
    assert figures.cumulative_cost == runs[0].cumulative_cost and figures.steps == 100
    assert [s.from_step for s in figures.settling] == [0, 50] and figures.settling[0].steps < 50
    np.testing.assert_allclose(figures.input_energy, (runs[0].u ** 2).sum(axis=0))
    assert figures.margins[0].share <= figures.margins[-1].share
    assert figures.max_solve_seconds == runs[0].solve_seconds.max()
    compared = {f.what: f for f in mpct.compare(*runs)}
    cost = next(f for what, f in compared.items() if "cumulative cost" in what)
    assert (cost.first, cost.second) == (runs[0].cumulative_cost, runs[1].cumulative_cost)
    assert cost.ratio == cost.second / cost.first
    runs[0].problem = None
    with pytest.raises(mpct.ArgumentError, match="problem"):
        mpct.performance(runs[0])


def test_certificate(design, tmp_path):
    text = design.certificate()
    verified = mpct.verify(text)
    assert verified.terminal_horizon == 5 and verified.smallest_margin > 0 and "Verified" in str(verified)
    path = tmp_path / "certificate.json"
    path.write_text(text, encoding="utf-8")
    assert mpct.verify(path) == verified == mpct.verify(str(path))
    with pytest.raises(mpct.VerifyError) as error:
        mpct.verify(text.replace("0.9", "0.8", 1))
    assert error.value.kind == "digest"
    with pytest.raises(mpct.VerifyError) as error:
        mpct.verify("{}")
    assert error.value.kind == "unreadable"
    assert isinstance(error.value, mpct.Error)
    assert pickle.loads(pickle.dumps(error.value)).kind == "unreadable"


def test_check(problem, design):
    found = problem.check()
    assert found.spectral_radius == design.spectral_radius
    np.testing.assert_array_equal(found.steady_state_basis, design.steady_state_basis)
    assert not problem.closest_admissible([5, 1]).admissible


def test_design_all_equals_designs(problem):
    scalings = [0.99, 0.3, 0.9]
    for scaling, one in zip(scalings, problem.design_all(scalings)):
        alone = problem.replace(scaling=scaling).design()
        assert one.terminal_horizon == alone.terminal_horizon and one.problem == alone.problem
        np.testing.assert_array_equal(one.gain, alone.gain)
    broken = problem.design_all([0.9, 1.5])[1]
    assert isinstance(broken, mpct.DesignError) and broken.kind == "out_of_range"


def test_sweep_with_closed_loops(problem):
    simulation = mpct.Simulation([0, 0], [2, 0.5], 30)
    points = mpct.sweep(problem, [0.9, 0.5], simulation=simulation)
    alone = simulation.run(problem.design().controller())
    assert points[0].cumulative_cost == alone.cumulative_cost and points[1].run is not None
    far = mpct.sweep(problem, [0.9], simulation=mpct.Simulation([9, 9], [2, 0.5], 30))[0]
    assert far.terminal_horizon == 5 and far.error.kind == "initial_state" and far.cumulative_cost is None


def test_examples_and_reproduction():
    assert mpct.example("drone").problem.design().terminal_horizon == 92
    assert mpct.example("carts", 3).problem.plant.states == 6
    with pytest.raises(mpct.ArgumentError, match="'academic'"):
        mpct.example("train")
    with pytest.raises(mpct.ArgumentError, match="'short'"):
        mpct.reproduce("brief")


def test_pickle_of_sets():
    problem = section_3_5(alpha=1.0)
    design = problem.design()
    region = mpct.StabilityRegion(design.controller(), [0.5, 0], "throughout_region")
    bounds = mpct.AlphaBounds(design, [0.5, 0])
    assert repr(pickle.loads(pickle.dumps(region))) == repr(region)
    assert repr(pickle.loads(pickle.dumps(bounds))) == repr(bounds)
    membership = mpct.DomainOfAttraction(design.controller()).contains([9, 9])
    assert pickle.loads(pickle.dumps(membership)).gap == membership.gap
