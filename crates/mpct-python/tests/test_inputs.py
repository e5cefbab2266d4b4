"""What is accepted as numbers, and how the rest is refused."""

import numpy as np
import pytest
from conftest import academic_problem

import mpct

A = np.array([[1.0, 1.0], [0.0, 1.0]])
B = np.array([[0.0, 0.5], [1.0, 0.5]])


def read_only(a):
    a = np.array(a, dtype=float)
    a.flags.writeable = False
    return a


ACCEPTED = {
    "list": lambda a: np.asarray(a).tolist(),
    "tuple": lambda a: tuple(map(tuple, a)) if np.ndim(a) == 2 else tuple(a),
    "float32": lambda a: np.asarray(a, dtype=np.float32),
    "float16": lambda a: np.asarray(a, dtype=np.float16),
    "big endian": lambda a: np.asarray(a, dtype=">f8"),
    "fortran": lambda a: np.asfortranarray(a, dtype=float),
    "strided": lambda a: np.repeat(np.asarray(a, dtype=float), 2, axis=-1)[..., ::2],
    "reversed": lambda a: np.asarray(a, dtype=float)[..., ::-1].copy()[..., ::-1],
    "read-only": read_only,
    "unmasked": lambda a: np.ma.masked_array(a, mask=False),
}


@pytest.mark.parametrize("form", ACCEPTED)
def test_accepted(form, controller):
    convert = ACCEPTED[form]
    plant = mpct.Plant(convert(A), convert(B))
    np.testing.assert_array_equal(plant.A, A)
    np.testing.assert_array_equal(plant.B, B)
    x, set_point = [0.5, 0.25], [2.0, 0.5]
    controller.reset()
    expected = controller.step(x, set_point).u
    controller.reset()
    np.testing.assert_array_equal(controller.step(convert(x), convert(set_point)).u, expected)


@pytest.mark.parametrize("dtype", [int, np.int8, np.uint16, np.int64])
def test_integers(dtype, controller):
    assert controller.step(np.array([0, 1], dtype=dtype), np.array([2, 0], dtype=dtype)).u.shape == (2,)


REFUSED = {
    "masked": (np.ma.masked_array([0.0, 0.0], mask=[True, False]), ValueError, "1 entries are masked"),
    "object": (np.array([0.0, None], dtype=object), TypeError, "dtype object"),
    "complex": (np.array([0.0, 1j]), TypeError, "dtype complex128"),
    "bool": ([True, False], TypeError, "dtype bool"),
    "bytes": (b"00", TypeError, "dtype"),
    "dictionary": ({0: 1.0, 1: 2.0}, TypeError, "dtype object"),
    "text": ("0 0", TypeError, "dtype"),
    "dates": (np.array(["2020-01-01", "2020-01-02"], dtype="M8[D]"), TypeError, "dtype datetime64"),
    "matrix": ([[0.0, 0.0]], ValueError, r"expected a vector, found an array of shape \(1, 2\)"),
    "number": (0.0, ValueError, r"expected a vector, found an array of shape \(\)"),
    "ragged": ([[0.0], [0.0, 1.0]], ValueError, "expected an array of numbers"),
    "none": (None, TypeError, "dtype object"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case, controller):
    value, error, message = REFUSED[case]
    with pytest.raises(error, match=message) as caught:
        controller.step(value, [0, 0])
    assert "x:" in str(caught.value)
    with pytest.raises(error, match=message):
        controller.step([0, 0], value)
    with pytest.raises(error):
        mpct.simulate(controller, value, [0, 0], 3)


def test_step_errors(controller):
    for value in (np.nan, np.inf):
        with pytest.raises(mpct.StepError) as error:
            controller.step([0, value], [0, 0])
        assert (error.value.kind, error.value.index) == ("state_not_finite", 1)
        with pytest.raises(mpct.StepError) as error:
            controller.step([0, 0], [value, 0])
        assert error.value.kind == "set_point_not_finite"
    with pytest.raises(mpct.StepError) as error:
        controller.step([0, 0, 0], [0, 0])
    assert (error.value.kind, error.value.expected, error.value.found) == ("wrong_length", 2, 3)
    with pytest.raises(mpct.StepError) as error:
        controller.step([100, 100], [0, 0])
    assert error.value.kind == "infeasible" and error.value.gap > 0
    assert str(error.value) == f"{error.value.message}\nhelp: {error.value.help}"
    assert "longer horizon" in error.value.help
    with pytest.raises(AttributeError):
        error.value.nothing


def test_simulation_errors(controller):
    with pytest.raises(mpct.StepError) as error:
        mpct.simulate(controller, [10, 0], [0, 0], 3)
    assert (error.value.kind, error.value.row) == ("initial_state", "state_upper[0]")
    with pytest.raises(mpct.StepError) as error:
        mpct.simulate(controller, [0, 0], [2, 0.5], 500, disturbance=[1.5, 1.5])
    assert error.value.step == len(error.value.run)
    with pytest.raises(mpct.DesignError, match="steps"):
        mpct.simulate(controller, [0, 0], [0, 0], 0)
    with pytest.raises(mpct.DesignError, match="step after"):
        mpct.simulate(controller, [0, 0], [(5, [0, 0]), (5, [1, 0])], 9)
    with pytest.raises(ValueError, match="step >= 0"):
        mpct.simulate(controller, [0, 0], [(-1, [0, 0])], 9)
    with pytest.raises(TypeError, match="from_step"):
        mpct.simulate(controller, [0, 0], [(0, [0, 0]), [1, 2]], 9)


def test_plant_errors():
    with pytest.raises(mpct.DesignError) as error:
        mpct.Plant(A, [[1.0], [2.0], [3.0]])
    assert error.value.kind == "shape" and "3" in error.value.found
    with pytest.raises(mpct.DesignError) as error:
        mpct.Plant([[1, np.nan], [0, 1]], B)
    assert (error.value.kind, error.value.row, error.value.column) == ("not_finite", 0, 1)
    with pytest.raises(ValueError, match="B: expected a matrix"):
        mpct.Plant(A, [1.0, 2.0])
    with pytest.raises(mpct.DesignError):
        mpct.Plant.continuous(A, B, -1.0)


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({"Q": -1}, "not_positive_definite"),
        ({"Q": [[1, 2], [0, 1]]}, "not_symmetric"),
        ({"Q": [1, 2, 3]}, "shape"),
        ({"R": float("nan")}, "not_finite"),
        ({"scaling": 1.0}, "out_of_range"),
        ({"scaling": float("nan")}, "out_of_range"),
        ({"horizon": 0}, "out_of_range"),
        ({"gain": [[1.0, 2.0]]}, "shape"),
    ],
)
def test_problem_errors(options, kind):
    with pytest.raises(mpct.DesignError) as error:
        academic_problem(**options)
    assert error.value.kind == kind


def test_limits_errors():
    plant = mpct.Plant(A, B)
    weights = {"Q": 1, "R": 1, "O": 1}
    with pytest.raises(TypeError, match="pair"):
        mpct.Problem(plant, state=3, **weights)
    with pytest.raises(TypeError, match="pair"):
        mpct.Problem(plant, state=([1, 1], [2, 2], [3, 3]), **weights)
    with pytest.raises(mpct.DesignError):
        mpct.Problem(plant, state=(-np.ones(3), np.ones(3)), **weights)
    with pytest.raises(mpct.DesignError):
        mpct.Problem(plant, state=(np.nan, 1), **weights)
    with pytest.raises(mpct.DesignError) as error:
        mpct.Problem(plant, state=(1, 3), **weights)
    assert error.value.kind == "origin_not_interior" and error.value.row == "state_lower[0]"
    half = mpct.Problem(plant, state=(None, 3), input=(-2, 2), **weights)
    assert np.isneginf(half.state[0]).all()
    with pytest.raises(ValueError, match="task"):
        mpct.Problem(plant, state=(-1, 1), task="follow", **weights)


def test_design_errors():
    with pytest.raises(mpct.DesignError) as error:
        mpct.Problem(mpct.Plant([[2.0]], [[0.0]]), state=(-1, 1), input=(-1, 1), Q=1, R=1, O=1).design()
    assert error.value.kind == "not_stabilizable" and error.value.modulus == pytest.approx(2)
    with pytest.raises(mpct.DesignError) as error:
        academic_problem(gain=[[0, 0], [0, 0]]).design()
    assert error.value.kind == "not_schur"
    with pytest.raises(ValueError, match="condition"):
        academic_problem().design(condition="quick")
    with pytest.raises(ValueError, match="time_limit"):
        academic_problem().design(time_limit=-1)


def test_whole_numbers(problem, controller):
    for build, what in [
        (lambda: academic_problem(horizon=-1), "horizon"),
        (lambda: problem.design(max_horizon=-5), "max_horizon"),
        (lambda: mpct.simulate(controller, [0, 0], [0, 0], -1), "steps"),
        (lambda: mpct.simulate(controller, [0, 0], [0, 0], 2.5), "steps"),
        (lambda: mpct.simulate(controller, [0, 0], [0, 0], 2**70), "steps"),
        (lambda: mpct.simulate(controller, [0, 0], [0, 0], 5, disturbance=[0, 0], seed=-1), "seed"),
        (lambda: mpct.DomainOfAttraction(controller).projection((0, -1)), "coordinates"),
        (lambda: controller.set_limits(iterations=-1), "iterations"),
    ]:
        with pytest.raises(mpct.ArgumentError, match=f"{what}: expected a whole number >= 0") as error:
            build()
        assert error.value.what == what
    assert mpct.simulate(controller, [0, 0], [0, 0], np.int64(3)).x.shape == (3, 2)


def test_no_set_point_is_the_operating_point(controller):
    expected = mpct.simulate(controller, [1, 0], [0, 0], 5)
    for none in (None, [], ()):
        np.testing.assert_array_equal(mpct.simulate(controller, [1, 0], none, 5).x, expected.x)


def test_every_error_is_of_the_package(controller):
    for error in (mpct.DesignError, mpct.StepError, mpct.SimulationError, mpct.FileError, mpct.VerifyError, mpct.ArgumentError):
        assert issubclass(error, mpct.Error) and issubclass(error, ValueError)
    assert issubclass(mpct.SimulationError, mpct.StepError)
    with pytest.raises(mpct.ArgumentTypeError) as error:
        controller.step(["a", "b"], [0, 0])
    assert isinstance(error.value, TypeError) and error.value.what == "x" and "dtype" in error.value.found
    with pytest.raises(mpct.ArgumentError) as error:
        controller.step([[0, 0]], [0, 0])
    assert (error.value.expected, error.value.found) == ("a vector", "an array of shape (1, 2)")


def test_sparse_matrices_and_numbers_in_lists(controller):
    scipy = pytest.importorskip("scipy.sparse")
    np.testing.assert_array_equal(mpct.Plant(scipy.csr_array(A), scipy.coo_matrix(B)).A, A)
    expected = controller.step(np.array([0.5, 0.0]), np.array([2.0, 0.5])).u
    for x in ([0.5, 0], (0.5, 0), [np.float32(0.5), 0], [np.float64(0.5), np.int8(0)]):
        np.testing.assert_allclose(controller.step(x, [2, 0.5]).u, expected, atol=1e-9)
    for x in ([0.5, None], [0.5, "0"], [0.5, [0]]):
        with pytest.raises(mpct.Error):
            controller.step(x, [2, 0.5])


def test_arguments_are_not_changed(controller):
    x, set_point = read_only([0.5, 0.0]), read_only([2.0, 0.5])
    step = controller.step(x, set_point)
    step.u[:] = 7
    assert not np.array_equal(step.u, [7, 7])
    np.testing.assert_array_equal(x, [0.5, 0.0])
