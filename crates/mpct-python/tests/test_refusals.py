"""Wrong arguments at every entry: each is refused by name, and nothing hangs or panics."""

import pickle
import re
import sys

import numpy as np
import pytest
from conftest import academic_problem

import mpct

A, B = [[1, 1], [0, 1]], [[0, 0.5], [1, 0.5]]
NAN, INF = float("nan"), float("inf")
PROBLEM = academic_problem()
DESIGN = PROBLEM.design()
CONTROLLER = DESIGN.controller()
RUN = mpct.simulate(CONTROLLER, [0, 0], [2, 0.5], 20)
DOMAIN = mpct.DomainOfAttraction(CONTROLLER)
OUTLINE = DESIGN.terminal_set_outline()
SETTING = mpct.Simulation([0, 0], [2, 0.5], 5)


class Evil:
    def __array__(self, *_, **__):
        raise RuntimeError("no array")


def simulate(x0=(0, 0), set_points=(0, 0), steps=5, **options):
    return mpct.simulate(CONTROLLER, x0, set_points, steps, **options)


def campaign(runs=None, **options):
    return mpct.campaign(PROBLEM, {"scaling": [0.5]} if runs is None else runs, **{"processes": 1, **options})


def without_terminal_constraint(**options):
    return academic_problem(formulation="no_terminal_constraint", **options).design().controller()


# What is called, and what the message must say. TypeErrors of Python's own carry the name of the argument in a note.
REFUSED = [
    (lambda: mpct.Plant(), "missing.*'A'"),
    (lambda: mpct.Plant(None, None), "A: expected matrices A and B"),
    (lambda: mpct.Plant([], []), r"A: expected a matrix.*shape \(0,\)"),
    (lambda: mpct.Plant(np.zeros((0, 0)), np.zeros((0, 0))), "plant.A: expected a square matrix"),
    (lambda: mpct.Plant(np.eye(2), np.zeros((2, 0))), "plant.B: expected 2 rows"),
    (lambda: mpct.Plant(1.0, 1.0), r"A: expected a matrix.*shape \(\)"),
    (lambda: mpct.Plant(np.zeros((2, 2, 2)), B), r"shape \(2, 2, 2\)"),
    (lambda: mpct.Plant(np.zeros((2, 3)), B), "2 x 3"),
    (lambda: mpct.Plant(Evil(), B), "no array"),
    (lambda: mpct.Plant("A", "B"), "A: expected real numbers"),
    (lambda: academic_problem().replace(Q=1) and mpct.Plant(np.full((2, 2), 1e308), [[1, 2, 3]]), "plant.B"),
    (lambda: mpct.Plant(A, B, sampling_time="1s"), "sampling_time"),
    (lambda: mpct.Plant(A, B, sampling_time=NAN), "plant.sampling_time"),
    (lambda: mpct.Plant(A, B, operating_point=[0, 0]), "operating_point state: expected a vector"),
    (lambda: mpct.Plant(A, B, operating_point=3.0), r"operating_point: expected a pair \(state, input\)"),
    (lambda: mpct.Plant(A, B, operating_point=([0, 0], [0, 0], [0])), "operating_point.*found 3 items"),
    (lambda: mpct.Plant(A, B, operating_point=([NAN, 0], [0, 0])), "operating_point.state.*NaN"),
    (lambda: mpct.Plant(A, B, state_names="ab"), "state_names: expected a list of texts, found 'ab'"),
    (lambda: mpct.Plant(A, B, input_units=[1, 2]), "input_units: expected a list of texts"),
    (lambda: mpct.Plant(A, B, state_names=["a"]), "plant.state_names: expected 2 texts, found 1"),
    (lambda: mpct.Plant(A, B, state_names=["\ud800", "b"]), "state_names: expected a list of texts"),
    (lambda: mpct.Plant(A, B, 1.0), "positional"),
    (lambda: mpct.Plant.continuous(A, B), "dt: expected the sampling time"),
    (lambda: mpct.Plant.continuous(A, B, 1e300), "without overflow"),
    (lambda: mpct.Plant.continuous(A, B, "x"), "dt"),
    (lambda: mpct.Problem(None, Q=1, R=1, O=1), "plant"),
    (lambda: academic_problem(Q=None), "Q: expected real numbers"),
    (lambda: academic_problem(Q=INF), "weights.Q.*inf"),
    (lambda: academic_problem(Q=np.ones((2, 2, 2))), "Q: expected a matrix"),
    (lambda: academic_problem(Q=[]), "weights.Q: expected a scalar, 2 numbers"),
    (lambda: academic_problem(Q=True), "Q: expected real numbers.*bool"),
    (lambda: academic_problem(horizon=2.5), "horizon: expected a whole number >= 0, found 2.5"),
    (lambda: academic_problem(horizon=True), "horizon: expected a whole number >= 0, found True"),
    (lambda: academic_problem(horizon=None), "horizon: expected a whole number"),
    (lambda: academic_problem(horizon=2**80), "horizon: expected a whole number >= 0, found 1208925819614629174706176"),
    (lambda: academic_problem(horizon=2**62), "at most 10000"),
    (lambda: academic_problem(scaling="a"), "scaling"),
    (lambda: academic_problem(mixed="abc"), "mixed: expected a tuple"),
    (lambda: academic_problem(mixed=([[1, 1, 1]], None, [1])), r"mixed\[0\].C: expected 1 x 2"),
    (lambda: academic_problem(mixed=([[1, 1]], None, 1.0)), r"mixed\[0\] d: expected a vector"),
    (lambda: academic_problem(formulation=None), "formulation"),
    (lambda: academic_problem(formulation="expl"), "formulation: expected 'implicit' or"),
    (lambda: without_terminal_constraint(horizon_extension=-1), "horizon_extension: expected a whole number"),
    (lambda: without_terminal_constraint(horizon_extension=10**12), "fewer steps than the terminal horizon"),
    (lambda: without_terminal_constraint(horizon_extension=1, gamma=NAN), "gamma"),
    (lambda: academic_problem(name=3), "name"),
    (lambda: mpct.Problem.read("/"), "cannot read /"),
    (lambda: mpct.Problem.read(3), "path"),
    (lambda: mpct.Problem.from_toml(""), "missing key `plant`"),
    (lambda: mpct.Problem.from_toml("a=" + "[" * 100_000), "recursion"),
    (lambda: PROBLEM.replace(lambda_=3), "lambda_"),
    (lambda: PROBLEM.qp([NAN, 0], [0, 0]), "state is not finite"),
    (lambda: PROBLEM.closest_admissible([0]), "expected 2 numbers, found 1"),
    (lambda: PROBLEM.closest_admissible([1e300, 1e300]), "solver failure"),
    (lambda: PROBLEM.design(condition=1), "condition"),
    (lambda: PROBLEM.design(max_horizon=0), "max_horizon"),
    (lambda: PROBLEM.design(max_horizon=2**70), "max_horizon: expected a whole number"),
    (lambda: PROBLEM.design(time_limit=INF), "time_limit"),
    (lambda: PROBLEM.design(progress=3), "progress: expected a function"),
    (lambda: PROBLEM.design_all("ab"), "scalings"),
    (lambda: PROBLEM.design_all([[0.5]]), "scalings: expected a vector"),
    (lambda: mpct.Design(), "cannot create"),
    (lambda: mpct.Controller(), "cannot create"),
    (lambda: type("Mine", (mpct.Design,), {}), "base type"),
    (lambda: DESIGN.terminal_set_outline((0, 0)), "coordinates: expected different"),
    (lambda: DESIGN.terminal_set_outline((0, 1, 2)), "coordinates: expected two states.*3 items"),
    (lambda: DESIGN.terminal_set_outline((0.5, 1)), "coordinates: expected a whole number"),
    (lambda: DESIGN.terminal_set_outline(None), "coordinates: expected two states"),
    (lambda: DESIGN.controller("x"), "formulation"),
    (lambda: DESIGN.controller("no_terminal_constraint"), "horizon_extension"),
    (lambda: DESIGN.maximal_admissible_set().contains([0], [0]), "expected 4 numbers together, found 2"),
    (lambda: CONTROLLER.step(), "missing"),
    (lambda: CONTROLLER.step((i for i in (0, 0)), [0, 0]), "x: expected real numbers"),
    (lambda: CONTROLLER.step([10**400, 0], [0, 0]), "x: expected real numbers"),
    (lambda: CONTROLLER.step([1e308, -1e308], [0, 0]), "without a checked answer|outside the domain"),
    # One that stepped before may answer with its candidate.
    (lambda: DESIGN.controller().step([0, 0], [1e308, -1e308]), "without a checked answer"),
    (lambda: CONTROLLER.step([0, 0], [0, 0], [NAN, 0]), "set-point is not finite"),
    (lambda: CONTROLLER.step([], []), "0 entries, and needs 2"),
    (lambda: CONTROLLER.step(np.zeros(2, dtype=[("a", "f8")]), [0, 0]), "x: expected real numbers"),
    (lambda: CONTROLLER.set_limits(iterations="3"), "iterations: expected a whole number"),
    (lambda: CONTROLLER.set_limits(iterations=2**70), "iterations: expected a whole number"),
    (lambda: CONTROLLER.set_limits(seconds=NAN), "seconds: expected a number of seconds"),
    (lambda: mpct.simulate(None, [0, 0], [0, 0], 3), "Controller"),
    (lambda: simulate(steps=True), "steps: expected a whole number"),
    (lambda: simulate(set_points={0: [0, 0]}), "set_points"),
    (lambda: simulate(set_points=[[0, 0], [1, 1]]), r"set_points\[0\]: expected a vector"),
    (lambda: simulate(set_points=[(0.0, [0, 0])]), "a step >= 0, found 0.0"),
    (lambda: simulate(set_points=[(5, [0, 0]), (3, [0, 0])]), "3 after 5"),
    (lambda: simulate(disturbance=0.1), "disturbance: expected a vector"),
    (lambda: simulate(disturbance=[-1, 0]), "a number >= 0, found -1"),
    (lambda: simulate(disturbance=[0.1, 0.1], seed=2**64), "seed"),
    (lambda: mpct.ProblemFile(3), "problem: expected a Problem, found 3"),
    (lambda: mpct.ProblemFile(PROBLEM, 3), "simulation: expected a Simulation, found 3"),
    (lambda: mpct.ProblemFile(PROBLEM).write("/nonexistent/x.toml"), "No such file"),
    (lambda: RUN.plot(states=[7]), "states: expected a list of numbers from 0 to 1, or of names among x1, x2, found 7"),
    (lambda: RUN.plot(inputs=[-1]), "inputs: expected a list of numbers from 0 to 1"),
    (lambda: RUN.plot(states=0), "states: expected a list of numbers"),
    (lambda: RUN.plot(states=[], inputs=[]), "a signal to draw"),
    (lambda: RUN.report(3), "path: expected a path, found 3"),
    (lambda: RUN.report(controller=DESIGN), "controller: expected a Controller, found Design"),
    (lambda: pickle.loads(pickle.dumps(RUN)).report(), "controller: expected the controller that ran, found none"),
    (lambda: RUN.report(None, mpct.example("drone").problem.design().controller()), "run: expected one with 12 states and 4 inputs"),
    (lambda: RUN.picture("a.jpg"), "path: expected a file that ends in .svg or .png, found a.jpg"),
    (lambda: RUN.picture(DESIGN), r"path: expected a path, found Design"),
    (lambda: mpct.reproduce("short", png=True), "folder: expected a folder for the pictures"),
    (lambda: mpct.plots.sets({}), "outlines: expected outlines in the same two states"),
    (lambda: mpct.plots.sets({"a": OUTLINE}, states=[[1]]), "states: expected rows of more than 1 numbers"),
    (lambda: mpct.DomainOfAttraction(mpct.example("carts", 2).problem.design().controller()).volume(), "1 to 3|states"),
    (lambda: RUN.picture(None, "x1"), "signals: expected a list of names, found 'x1'"),
    (lambda: RUN.picture(None, ["x9"]), 'no state or input is called "x9"; known names: x1'),
    (lambda: mpct.DomainOfAttraction(DESIGN), "Controller"),
    (lambda: DOMAIN.contains([NAN, 0]), "NaN"),
    (lambda: DOMAIN.reach([0, 0]), "an entry that is not 0"),
    (lambda: DOMAIN.reach([1, 0], [9, 9]), "a state in the domain of attraction"),
    (lambda: DOMAIN.projection((0, 1), NAN), "tolerance"),
    (lambda: OUTLINE.contains([0, 0, 0]), r"point: expected two numbers, found an array of shape \(3,\)"),
    (lambda: OUTLINE.contains(0.0), "point: expected two numbers"),
    (lambda: mpct.AlphaBounds(None, [0, 0]), "Design"),
    (lambda: mpct.AlphaBounds(DESIGN, [0, 0]), "no_terminal_constraint"),
    (lambda: mpct.StabilityRegion(CONTROLLER, [0, 0], "x"), "scope"),
    (lambda: mpct.scaling_need(None, [0, 0]), "Problem"),
    (lambda: mpct.scaling_need(PROBLEM, [0, 0], [1]), "expected 2 numbers, found 1"),
    (lambda: mpct.scaling_advice(PROBLEM, 3), "set_points: expected a list, found 3"),
    (lambda: mpct.scaling_advice(PROBLEM, [1.0, 2.0]), r"set_points\[0\]: expected a vector"),
    (lambda: mpct.scaling_advice(PROBLEM, [[0, 0]], []), "inputs: expected 1 of them"),
    (lambda: mpct.performance(None), "run: expected a Run, found None"),
    (lambda: mpct.performance(RUN, mpct.example("drone").problem), "12 states and 4 inputs"),
    (lambda: mpct.compare(RUN, None), "second: expected a Run, found None"),
    (lambda: mpct.verify(3), "certificate: expected a text or a path"),
    (lambda: mpct.verify(b"{}"), "certificate: expected a text or a path"),
    (lambda: mpct.verify("{"), "not a certificate"),
    (lambda: mpct.verify('{"a":' + "[" * 100_000), "not a certificate"),
    (lambda: mpct.verify("/nonexistent"), "No such file"),
    (lambda: mpct.example("carts", 0), "expected 1 to 100000"),
    (lambda: mpct.example("carts", -1), "count: expected a whole number"),
    (lambda: mpct.example("carts", 10**9), "expected 1 to 100000"),
    (lambda: mpct.example("carts", 2.0), "count: expected a whole number"),
    (lambda: mpct.reproduce(3), "extent"),
    (lambda: mpct.sweep(None, [0.9]), "problem: expected a Problem, found None"),
    (lambda: mpct.sweep(PROBLEM, 0.9), "scalings: expected a list of numbers, found 0.9"),
    (lambda: mpct.sweep(PROBLEM, "0.9"), "scalings: expected a list of numbers, found '0.9'"),
    (lambda: mpct.sweep(PROBLEM, ["a"]), "scalings: expected real numbers"),
    (lambda: mpct.sweep(PROBLEM, [0.9], simulation=3), "simulation: expected a Simulation, found 3"),
    (lambda: mpct.campaign(None, {}), "problem: expected a Problem"),
    (lambda: campaign(3), "runs: expected a dictionary of lists"),
    (lambda: campaign([{"name": lambda: 0}]), r"runs\[0\]: expected values that can be pickled"),
    (lambda: campaign(processes="2"), "processes: expected a whole number"),
    (lambda: campaign(processes=1.5), "processes: expected a whole number"),
    (lambda: campaign(simulation=3), "simulation: expected a Simulation"),
    (lambda: campaign(condition="quick"), "condition: expected 'exact' or 'sufficient', found 'quick'"),
    (lambda: campaign(max_horizon=0), "max_horizon"),
    (lambda: campaign(time_limit="x"), "time_limit: expected a number of seconds"),
    (lambda: campaign(client=3), "client: expected a distributed.Client|need distributed"),
    (lambda: campaign(results=3), "results: expected the path of a file"),
    (lambda: campaign(results="/"), "results: expected a file, found the folder"),
    (lambda: campaign(progress=3), "progress: expected a function"),
    (lambda: campaign(start_method=3), "start_method"),
]


@pytest.mark.parametrize("call, message", REFUSED)
def test_refused(call, message):
    with pytest.raises(Exception) as caught:
        call()
    error = caught.value
    assert "Panic" not in type(error).__name__
    told = "\n".join([str(error), *getattr(error, "__notes__", [])])
    # Python 3.10 has no notes.
    if sys.version_info >= (3, 11) or type(error) is not TypeError:
        assert re.search(message, told, re.DOTALL), told
    # What the package raises itself is its own, and keeps what it says in a pickle.
    if isinstance(error, mpct.Error):
        assert str(pickle.loads(pickle.dumps(error))) == str(error)
    else:
        assert isinstance(error, (TypeError, OSError, ImportError)) or isinstance(error, RuntimeError) and message == "no array"


def test_set_points_in_other_forms():
    expected = mpct.simulate(CONTROLLER, [0, 0], [(0, [2, 0.5]), (3, [1, 0])], 6)
    for form in ([[0, [2, 0.5]], [3, [1, 0]]], ((0, [2, 0.5]), (3, np.array([1, 0])))):
        np.testing.assert_array_equal(mpct.simulate(CONTROLLER, [0, 0], form, 6).x, expected.x)
    one = mpct.simulate(CONTROLLER, [0, 0], (0, [2, 0.5]), 6)
    np.testing.assert_array_equal(one.x, mpct.simulate(CONTROLLER, [0, 0], [2, 0.5], 6).x)


def test_pairs_in_other_forms():
    assert mpct.Plant(A, B, operating_point=[[0, 0], [0, 0]]) == mpct.Plant(A, B, operating_point=(np.zeros(2), [0, 0]))
    assert DESIGN.terminal_set_outline([0, np.int64(1)]).coordinates == (0, 1)
    assert mpct.Plant(A, B, state_names=("a", "b")).state_names == ["a", "b"]


def test_help_is_that_of_the_command():
    with pytest.raises(mpct.DesignError) as error:
        academic_problem(Q=[[1, 2], [0, 1]])
    assert error.value.help == "replace the weight W by (W + W.T) / 2" and str(error.value).endswith(error.value.help)
    with pytest.raises(mpct.SimulationError, match="help: start inside the constraints"):
        mpct.simulate(CONTROLLER, [10, 0], [0, 0], 3)
    with pytest.raises(mpct.DesignError) as error:
        academic_problem(scaling=2)
    assert error.value.help is None and str(error.value) == error.value.message


def test_plots_take_numbers_and_names():
    from matplotlib import pyplot

    labels = [ax.get_ylabel() for ax in RUN.plot(states=[1, "x1"], inputs=["u2"]).axes]
    assert labels == ["$x_{2}$", "$x_{1}$", "$u_{2}$"]
    run = mpct.simulate(mpct.example("drone").problem.design().controller(), np.zeros(12), np.zeros(12), 3)
    axes = run.plot(states=["pz"], inputs=["thrust"]).axes
    assert axes[0].get_ylabel().startswith("pz [m]") and axes[1].get_ylabel().startswith("thrust")
    pyplot.close("all")
