"""Objects pickle."""

import copy
import pickle
import re

import numpy as np
import pytest

import mpct


def test_pickle(problem, design, controller):
    plant = mpct.Plant.continuous(
        [[0, 1], [0, 0.1]], [[0], [1 / 3]], 0.1, operating_point=([1, 0], [-0.0]), state_names=["a", "b"], input_units=["N"]
    )
    for thing in (plant, problem):
        assert pickle.loads(pickle.dumps(thing)) == thing
        assert copy.deepcopy(thing) == thing
    again = pickle.loads(pickle.dumps(design))
    assert again.terminal_horizon == 5
    np.testing.assert_array_equal(again.gain, design.gain)
    x, set_point = [0.5, 0.1], [2, 0.5]
    controller.reset()
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(controller)).step(x, set_point).u, controller.step(x, set_point).u)
    with pytest.raises(mpct.StepError) as error:
        controller.step([0], set_point)
    restored = pickle.loads(pickle.dumps(error.value))
    assert (restored.kind, restored.found, str(restored)) == (error.value.kind, 1, str(error.value))


def test_pickle_of_runs_and_files(problem, controller):
    run = mpct.simulate(controller, [0, 0], [(0, [2, 0.5]), (5, [1, 0], [0, 0])], 10)
    again = pickle.loads(pickle.dumps(run))
    for name in ("x", "u", "cost", "admissible", "final_state"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    assert again.problem == problem and again.status == run.status
    file = mpct.ProblemFile(problem, mpct.Simulation([0, 0], [(0, [2, 0.5])], 10, [0.1, 0.1], 3))
    assert pickle.loads(pickle.dumps(file)).to_toml() == file.to_toml()


def test_pickle_of_what_is_answered(design, controller):
    step = controller.step([0.5, 0.1], [2, 0.5])
    again = pickle.loads(pickle.dumps(step))
    assert repr(again) == repr(step) and again.offset_cost == step.offset_cost and again.violation == step.violation
    for name in ("u", "artificial_state", "artificial_input", "predicted_states", "predicted_inputs"):
        np.testing.assert_array_equal(getattr(again, name), getattr(step, name))
    closest = design.closest_admissible([5, 1])
    assert repr(pickle.loads(pickle.dumps(closest))) == repr(closest)
    outline = design.terminal_set_outline()
    assert pickle.loads(pickle.dumps(outline)).area == outline.area


def test_every_class_pickles(problem, design, controller):
    region = problem.replace(formulation="no_terminal_constraint", horizon_extension=2, gamma=20, horizon=3).design()
    run = mpct.simulate(controller, [0, 0], [2, 0.5], 20)
    advice = mpct.scaling_advice(problem, [[2.85, 0]])
    figures = mpct.performance(run)
    domain = mpct.DomainOfAttraction(controller)
    setting = mpct.Simulation([0, 0], [(0, [2, 0.5])], 5)
    known = [
        problem.plant, problem, design, controller, controller.step([0, 0], [2, 0.5]), run, setting, domain, advice, figures,
        mpct.AlphaBounds(region, [0.5, 0]), mpct.StabilityRegion(region.controller(), [0.5, 0], "throughout_region"),
        mpct.StabilityRegion(region.controller(), [0.5, 0], "throughout_region").contains([0.1, 0]),
        problem.closest_admissible([5, 1]), problem.check(), problem.constraint_rows(), design.maximal_admissible_set(),
        design.implicit_terminal_cost(), design.terminal_set_outline(), domain.contains([9, 9]), domain.reach([1, 0]),
        domain.volume(), controller.runtime_tables(),
        mpct.campaign(problem, {"scaling": [0.5, 1.5]}, processes=1), mpct.ProblemFile(problem, setting),
        mpct.compare(run, run)[0], figures.margins[0], figures.settling[0], advice.set_points[0],
        mpct.sweep(problem, [0.5], simulation=setting)[0], mpct.verify(design.certificate()),
    ]  # fmt: skip
    known += [error("said", "kind", {"row": 1, "help": "this"}) for error in vars(mpct).values() if is_error(error)]
    exported = {thing for name in mpct.__all__ if isinstance(thing := getattr(mpct, name), type)}
    assert {type(thing) for thing in known} == exported
    for thing in known:
        # What takes long is designed again, and its times differ.
        shown = [re.sub(r"(linear_programs|seconds)=[^,)]*", "", repr(t)) for t in (thing, pickle.loads(pickle.dumps(thing)))]
        assert shown[0] == shown[1] or " object at " in shown[0]


def is_error(thing):
    return isinstance(thing, type) and issubclass(thing, mpct.Error)
