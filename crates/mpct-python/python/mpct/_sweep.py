"""Designs of one problem for several scalings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from ._errors import DesignError
from ._mpct import Design, Problem


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
    error : DesignError or None
        Why it failed.
    """

    scaling: float
    terminal_horizon: int | None
    rows: int | None
    linear_programs: int | None
    seconds: float | None
    design: Design | None
    error: DesignError | None


SweepPoint.__module__ = "mpct"


def sweep(
    problem: Problem,
    scalings: Iterable[float],
    *,
    condition: str = "exact",
    max_horizon: int = 5000,
    time_limit: float | None = None,
) -> list[SweepPoint]:
    """Designs a problem for several scalings λ.

    Parameters
    ----------
    problem : Problem
        The problem; its own scaling is left out.
    scalings : iterable of float
        Values of λ in (0, 1).
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
    problems = [problem.replace(scaling=float(scaling)) for scaling in scalings]
    points = []
    for scaled in problems:
        try:
            d = scaled.design(condition=condition, max_horizon=max_horizon, time_limit=time_limit, progress=False)
        except DesignError as error:
            points.append(SweepPoint(scaled.scaling, None, None, None, None, None, error))
        else:
            points.append(
                SweepPoint(scaled.scaling, d.terminal_horizon, d.rows, d.linear_programs, d.seconds, d, None)
            )
    return points
