"""Designs of one problem for several scalings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from ._convert import as_floats, instance, listed
from ._errors import DesignError, SimulationError
from ._mpct import Design, Problem
from ._run import Run, Simulation


class SweepPoint(NamedTuple):
    """One design of a sweep.

    Attributes
    ----------
    scaling : float
        λ.
    terminal_horizon : int or None
        M̃; None when the design failed.
    rows : int or None
        Constraint rows of the terminal set at each step.
    linear_programs : int or None
        Linear programs solved.
    seconds : float or None
        Time of the design.
    design : Design or None
        The design.
    error : DesignError or SimulationError or None
        Why it failed.
    run : Run or None
        The closed loop, when one was asked for.
    """

    scaling: float
    terminal_horizon: int | None
    rows: int | None
    linear_programs: int | None
    seconds: float | None
    design: Design | None
    error: DesignError | SimulationError | None
    run: Run | None

    @property
    def cumulative_cost(self) -> float | None:
        """Cost of the closed loop, when one was run."""
        return None if self.run is None else self.run.cumulative_cost


SweepPoint.__module__ = "mpct"


def sweep(
    problem: Problem,
    scalings: Iterable[float],
    *,
    simulation: Simulation | None = None,
    condition: Literal["exact", "sufficient"] = "exact",
    max_horizon: int = 5000,
    time_limit: float | None = None,
) -> list[SweepPoint]:
    """Designs a problem for several scalings λ. What does not depend on λ is computed once.

    Parameters
    ----------
    problem : Problem
        The problem; its own scaling is left out.
    scalings : iterable of float
        Values of λ in (0, 1).
    simulation : Simulation, optional
        A closed loop to run with each design, as the command does.
    condition, max_horizon, time_limit
        As in `Problem.design`, for each design.

    Returns
    -------
    list of SweepPoint
        In the order of ``scalings``. A design that fails is recorded and does not end the sweep.

    Raises
    ------
    DesignError
        When a scaling is not in (0, 1).

    Examples
    --------
    >>> import mpct
    >>> plant = mpct.Plant([[1, 1], [0, 1]], [[0, 0.5], [1, 0.5]])
    >>> problem = mpct.Problem(plant, state=(-3, 3), input=(-2, 2), Q=10, R=100, O=1e4)
    >>> [point.terminal_horizon for point in mpct.sweep(problem, [0.9])]
    [5]
    """
    instance(problem, Problem, "problem")
    if simulation is not None:
        instance(simulation, Simulation, "simulation")
    values = as_floats(listed(scalings, "scalings", "a list of numbers"), "scalings").ravel().tolist()
    for scaling in values:
        # A scaling that is none ends the sweep before the first is worked on.
        problem.replace(scaling=scaling)
    designs = problem.design_all(values, condition, max_horizon, time_limit, False) if values else []
    return [_point(scaling, design, simulation) for scaling, design in zip(values, designs, strict=True)]


def _point(scaling: float, design: Design | DesignError, simulation: Simulation | None) -> SweepPoint:
    if isinstance(design, DesignError):
        return SweepPoint(scaling, None, None, None, None, None, design, None)
    run, error = None, None
    if simulation is not None:
        try:
            run = simulation.run(design.controller())
        except SimulationError as failure:
            error = failure
    return SweepPoint(
        scaling, design.terminal_horizon, design.rows, design.linear_programs, design.seconds, design, error, run
    )
