"""Closed loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from . import _mpct
from ._atomic import write_atomically
from ._convert import instance, listed
from ._errors import argument, argument_type
from ._mpct import Controller, Plant, Problem

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray

    SetPoints = Union[ArrayLike, Sequence[tuple[int, ArrayLike]], Sequence[tuple[int, ArrayLike, ArrayLike]]]


@dataclass(eq=False, repr=False)
class Run:
    """A closed loop, in physical coordinates. Made by `simulate`.

    Attributes
    ----------
    x : ndarray, shape (steps, n)
        State before the input of the step acts.
    u : ndarray, shape (steps, m)
        Input.
    artificial_state : ndarray, shape (steps, n)
        Artificial steady state.
    artificial_input : ndarray, shape (steps, m)
        Artificial steady input.
    setpoint : ndarray, shape (steps, n)
        State of the set-point.
    cost, offset_cost : ndarray, shape (steps,)
        Cost of the prediction, and its offset part.
    admissible : ndarray of bool, shape (steps,)
        Whether the set-point is admissible.
    status : list of str
        "optimal" or "candidate".
    iterations : ndarray of int, shape (steps,)
        Iterations of the solver.
    solve_seconds : ndarray, shape (steps,)
        Time of each step.
    final_state : ndarray, shape (n,)
        State after the last input.
    cumulative_cost : float
        Sum of the stage costs and of the offset cost over the run.
    worst_violation : float
        Largest violation of a constraint, in the units of its row; 0 when there is none.
    problem : Problem or None
        The problem, for plots and names of columns.
    reason : list of str or None
        Why a step returned the candidate, as `Step.reason`; None for an optimum. None in place of the list when not known.
    controller : Controller or None
        The controller that ran, for reports and pictures. A pickle leaves it out.
    """

    x: NDArray[np.float64]
    u: NDArray[np.float64]
    artificial_state: NDArray[np.float64]
    artificial_input: NDArray[np.float64]
    setpoint: NDArray[np.float64]
    cost: NDArray[np.float64]
    offset_cost: NDArray[np.float64]
    admissible: NDArray[np.bool_]
    status: list[str]
    iterations: NDArray[np.int64]
    solve_seconds: NDArray[np.float64]
    final_state: NDArray[np.float64]
    cumulative_cost: float
    worst_violation: float
    problem: Problem | None = field(default=None)
    reason: list[str | None] | None = field(default=None)
    controller: Controller | None = field(default=None)

    def __getstate__(self) -> dict[str, Any]:
        # A controller that is read from a pickle is designed again, which takes longer than runs are worth.
        return {**self.__dict__, "controller": None}

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.x)

    def __repr__(self) -> str:
        return (
            f"Run(steps={len(self)}, cumulative_cost={self.cumulative_cost:.6e}, "
            f"worst_violation={self.worst_violation:.3e}, seconds={float(np.sum(self.solve_seconds)):.3f})"
        )

    def to_dataframe(self) -> pandas.DataFrame:
        """The run as a table, one step a row.

        Returns
        -------
        pandas.DataFrame
            Its columns are those of the command's CSV file: ``x[0]``, …, ``u[0]``, …, ``artificial_state[0]``, ….
        """
        try:
            import pandas
        except ImportError as error:
            raise ImportError("Run.to_dataframe needs pandas: pip install pandas") from error
        columns: dict[str, Any] = {}
        for name in ("x", "u", "artificial_state", "artificial_input", "setpoint"):
            for i, values in enumerate(np.asarray(getattr(self, name)).T):
                columns[f"{name}[{i}]"] = values
        for name in ("cost", "offset_cost", "admissible", "status", "iterations", "solve_seconds"):
            columns[name] = getattr(self, name)
        return pandas.DataFrame(columns, index=pandas.RangeIndex(len(self), name="k"))

    def plot(self, **options: Any) -> Figure:
        """Draws states and inputs with constraints and set-points.

        Parameters
        ----------
        **options
            Those of `mpct.plots.trajectories`.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from .plots import trajectories

        return trajectories(self, **options)

    def _disturbed(self, plant: Plant) -> bool:
        shapes = [np.shape(values) for values in (self.x, self.u, self.final_state)]
        if shapes != [(len(self), plant.states), (len(self), plant.inputs), (plant.states,)]:
            return False  # the report says what does not fit
        x, u = (values - at for values, at in zip((self.x, self.u), plant.operating_point, strict=True))
        after = np.vstack([x[1:], self.final_state - plant.operating_point[0]])
        # A run without disturbance follows the model but for the rounding of one product.
        return bool(np.abs(after - x @ plant.A.T - u @ plant.B.T).max() > 1e-9 * (1.0 + np.abs(after).max()))

    def report(self, path: str | PathLike[str] | None = None, controller: Controller | None = None) -> str:
        """The report of the command: one HTML page with the guarantees, the margins of their proofs and all plots.

        It needs no network.

        Parameters
        ----------
        path : str or os.PathLike, optional
            Where to write it.
        controller : Controller, optional
            The controller that ran. A run of `simulate` knows it; one out of a pickle or put together by hand does not.

        Returns
        -------
        str
            The page.
        """
        controller = self._controller(controller)
        _is_path(path)
        page = _mpct._report(self, controller, self._disturbed(controller.design.problem.plant))
        if path is not None:
            write_atomically(path, page.encode())
        return page

    def picture(
        self,
        path: str | PathLike[str] | None = None,
        signals: Sequence[str] = (),
        controller: Controller | None = None,
    ) -> str:
        """Some states and inputs in one picture, as the command draws them.

        Parameters
        ----------
        path : str or os.PathLike, optional
            Where to write it: as PNG when the name ends in ``.png``, as SVG when it ends in ``.svg`` or has no ending.
        signals : sequence of str, optional
            Names of states and inputs; the first four states and two inputs unless stated.
        controller : Controller, optional
            The controller that ran, as in `report`.

        Returns
        -------
        str
            The picture as SVG.
        """
        controller = self._controller(controller)
        _is_path(path)
        svg, data = _mpct._picture(self, controller, listed(signals, "signals", "a list of names"), path)
        if path is not None and data is not None:
            write_atomically(path, data)
        return svg

    def _controller(self, controller: Controller | None) -> Controller:
        if len(self) == 0:
            raise argument("run", "a run of at least one step", "none")
        if controller is None:
            controller = self.controller
        if controller is None:
            raise argument("controller", "the controller that ran", "none, and the run does not know it")
        instance(controller, Controller, "controller")
        return controller


Run.__module__ = "mpct"


def from_arrays(arrays: Mapping[str, Any]) -> Run:
    return Run(**arrays)


def _is_path(path: Any) -> None:
    if path is not None and not isinstance(path, (str, PathLike)):
        raise argument_type("path", "a path", repr(path)[:200])


def _is_scheduled(item: Any) -> bool:
    """Whether it looks like (from_step, state): a number, then a list or an array."""
    has_length = [hasattr(part, "__len__") for part in item] if isinstance(item, (list, tuple)) else []
    return has_length in ([False, True], [False, True, True])


def schedule(set_points: Any) -> list[tuple[int, Any, Any]]:
    """Set-points as (from_step, state, input)."""
    if set_points is None or (isinstance(set_points, (list, tuple)) and not set_points):
        return []
    if isinstance(set_points, tuple) and _is_scheduled(set_points):
        set_points = [set_points]
    if isinstance(set_points, (list, tuple)) and any(isinstance(s, tuple) or _is_scheduled(s) for s in set_points):
        known = []
        for i, item in enumerate(set_points):
            if not (_is_scheduled(item) or isinstance(item, tuple) and len(item) in (2, 3)):
                raise argument_type(f"set_points[{i}]", "(from_step, state) or (from_step, state, input)", repr(item))
            if isinstance(item[0], bool) or not isinstance(item[0], (int, np.integer)) or item[0] < 0:
                raise argument(f"set_points[{i}]", "a step >= 0", repr(item[0]))
            known.append((int(item[0]), item[1], item[2] if len(item) == 3 else None))
        return known
    return [(0, set_points, None)]


@dataclass(frozen=True, eq=False)
class Simulation:
    """What to simulate.

    Attributes
    ----------
    x0 : array_like, shape (n,)
        State at step 0.
    set_points : array_like, shape (n,), or list of tuple
        One set-point, or a list of (from_step, state) or (from_step, state, input) by ascending step. An empty list or
        None stands for the operating point.
    steps : int
        Number of steps.
    disturbance : array_like, shape (n,), optional
        Largest disturbance of each state, uniformly distributed.
    seed : int
        The same seed gives the same disturbance.
    """

    x0: ArrayLike
    set_points: SetPoints
    steps: int
    disturbance: ArrayLike | None = None
    seed: int = 0

    def run(self, controller: Controller) -> Run:
        """Runs the closed loop with the model as plant.

        Parameters
        ----------
        controller : Controller
            The controller; it is reset first.

        Returns
        -------
        Run
        """
        return _mpct._simulate(controller, self)

    def _schedule(self) -> list[tuple[int, Any, Any]]:
        return schedule(self.set_points)


Simulation.__module__ = "mpct"


def simulate(
    controller: Controller,
    x0: ArrayLike,
    set_points: SetPoints,
    steps: int,
    *,
    disturbance: ArrayLike | None = None,
    seed: int = 0,
) -> Run:
    """Runs a closed loop with the model as plant.

    Parameters
    ----------
    controller : Controller
        The controller; it is reset first.
    x0 : array_like, shape (n,)
        State at step 0.
    set_points : array_like, shape (n,), or list of tuple
        One set-point, or a list of (from_step, state) or (from_step, state, input) by ascending step. An empty list or
        None stands for the operating point.
    steps : int
        Number of steps.
    disturbance : array_like, shape (n,), optional
        Largest disturbance of each state, uniformly distributed; none unless stated.
    seed : int, default 0
        The same seed gives the same disturbance.

    Returns
    -------
    Run

    Raises
    ------
    SimulationError
        When the initial state is outside the domain of attraction or a step fails; ``run`` of it is what was done.
    DesignError
        When lengths do not fit.

    Notes
    -----
    Other Python threads run meanwhile, and Ctrl-C ends the run.

    Examples
    --------
    >>> import mpct
    >>> plant = mpct.Plant([[1, 1], [0, 1]], [[0, 0.5], [1, 0.5]])
    >>> problem = mpct.Problem(plant, state=(-3, 3), input=(-2, 2), Q=10, R=100, O=1e4)
    >>> controller = problem.design().controller()
    >>> run = mpct.simulate(controller, [0, 0], [(0, [2, 0.5]), (50, [-2, -0.5])], steps=100)
    >>> len(run), run.worst_violation < 1e-8
    (100, True)
    """
    return Simulation(x0, set_points, steps, disturbance, seed).run(controller)
