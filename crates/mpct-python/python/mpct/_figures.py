"""Figures of problems and runs: scaling advice, performance, certificates, case studies."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _mpct
from ._atomic import write_atomically
from ._convert import instance, listed
from ._errors import VerifyError, argument, argument_type
from ._files import ProblemFile
from ._mpct import Problem
from ._results import Verified
from ._run import Run

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class ScalingNeed:
    """What one set-point needs of the scaling λ.

    Attributes
    ----------
    set_point : ndarray, shape (n,)
        State of the set-point.
    equilibrium : bool
        Whether it is an equilibrium of the plant; if not, no λ admits it.
    attainable : bool
        Whether some λ < 1 admits it.
    needed : float
        The smallest λ that admits it, or its closest equilibrium when it is none.
    limiting : list of str
        The rows that are active for that λ.
    grow_by : float
        By how much λ would have to grow; 0 when it is large enough.
    closest : ndarray, shape (n,)
        The closest admissible state for the problem's λ.
    offset_cost : float
        Its weighted distance.
    """

    set_point: NDArray[np.float64]
    equilibrium: bool
    attainable: bool
    needed: float
    limiting: list[str]
    grow_by: float
    closest: NDArray[np.float64]
    offset_cost: float


@dataclass(frozen=True, eq=False)
class ScalingAdvice:
    """The smallest λ that admits a list of set-points, and what it costs.

    Attributes
    ----------
    set_points : list of ScalingNeed
        Set-point by set-point.
    scaling, terminal_horizon : float, int
        λ of the problem, and its M̃.
    advised_scaling, advised_terminal_horizon : float, int
        The smallest λ that admits every set-point that some λ admits, and its M̃.
    """

    set_points: list[ScalingNeed]
    scaling: float
    terminal_horizon: int
    advised_scaling: float
    advised_terminal_horizon: int


def _need(plain: dict[str, Any]) -> ScalingNeed:
    return ScalingNeed(**{**plain, "set_point": np.array(plain["set_point"]), "closest": np.array(plain["closest"])})


def scaling_need(problem: Problem, set_point: ArrayLike, input: ArrayLike | None = None) -> ScalingNeed:
    """The smallest λ that admits a set-point.

    Parameters
    ----------
    problem : Problem
        The problem.
    set_point : array_like, shape (n,)
        State of the set-point.
    input : array_like, shape (m,), optional
        Input of the set-point; that of the operating point unless stated.

    Returns
    -------
    ScalingNeed

    Examples
    --------
    >>> import mpct
    >>> need = mpct.scaling_need(mpct.example("academic").problem, [2.85, 0])
    >>> round(need.needed, 6), need.limiting[0]
    (0.95, 'state_upper[0]')
    """
    return _need(_mpct._scaling_need(problem, set_point, input))


def scaling_advice(
    problem: Problem,
    set_points: Iterable[ArrayLike],
    inputs: Iterable[ArrayLike | None] | None = None,
    *,
    condition: Literal["exact", "sufficient"] = "exact",
    max_horizon: int = 5000,
    time_limit: float | None = None,
) -> ScalingAdvice:
    """The smallest λ that admits several set-points, and the terminal horizon it costs.

    Parameters
    ----------
    problem : Problem
        The problem.
    set_points : iterable of array_like, shape (n,)
        States of the set-points.
    inputs : iterable of array_like, shape (m,), optional
        Inputs of the set-points, one for each; None for that of the operating point.
    condition, max_horizon, time_limit
        As in `Problem.design`.

    Returns
    -------
    ScalingAdvice
    """
    instance(problem, Problem, "problem")
    states = listed(set_points, "set_points")
    given: list[Any] = [None] * len(states) if inputs is None else listed(inputs, "inputs")
    if len(given) != len(states):
        raise argument("inputs", f"{len(states)} of them, one for each set-point", str(len(given)))
    pairs = list(zip(states, given, strict=True))
    plain = _mpct._scaling_advice(problem, pairs, condition, max_horizon, time_limit)
    return ScalingAdvice(**{**plain, "set_points": [_need(need) for need in plain["set_points"]]})


@dataclass(frozen=True, eq=False)
class Settling:
    """Settling after one set-point.

    Attributes
    ----------
    from_step : int
        First step of the set-point.
    set_point : ndarray, shape (n,)
        Its state.
    steps : int or None
        Steps until the state stays close; None when it does not.
    """

    from_step: int
    set_point: NDArray[np.float64]
    steps: int | None


@dataclass(frozen=True)
class ConstraintMargin:
    """The room left to a constraint over a run.

    Attributes
    ----------
    row : str
        The constraint.
    margin : float
        The smallest room, in the unit of the row.
    share : float
        The same as a share of the room at the operating point.
    step : int
        The step at which it was smallest.
    """

    row: str
    margin: float
    share: float
    step: int


@dataclass(frozen=True, eq=False)
class Performance:
    """Figures of a closed loop. Made by `performance`.

    Attributes
    ----------
    steps : int
        Steps of the run.
    cumulative_cost : float
        Vcc of section 4.1 of the paper.
    cumulative_offset_cost : float
        Its offset part.
    settling : list of Settling
        Set-point by set-point.
    margins : list of ConstraintMargin
        Row by row, smallest share first.
    input_energy, input_movement : ndarray, shape (m,)
        Σ (u_k − u_op)² and Σ (u_k − u_{k−1})².
    mean_solve_seconds, median_solve_seconds, max_solve_seconds : float
        Times of a step.
    """

    steps: int
    cumulative_cost: float
    cumulative_offset_cost: float
    settling: list[Settling]
    margins: list[ConstraintMargin]
    input_energy: NDArray[np.float64]
    input_movement: NDArray[np.float64]
    mean_solve_seconds: float
    median_solve_seconds: float
    max_solve_seconds: float


def _problem_of(run: Run, problem: Problem | None, what: str = "run") -> Problem:
    instance(run, Run, what)
    known = problem if problem is not None else run.problem
    if known is None:
        raise argument("problem", "the problem of the run", "none, and the run does not say it")
    return known


def performance(run: Run, problem: Problem | None = None) -> Performance:
    """Cost, settling, margins and actuator use of a closed loop.

    Parameters
    ----------
    run : Run
        The closed loop.
    problem : Problem, optional
        Its problem; that of the run unless stated.

    Returns
    -------
    Performance
    """
    plain = _mpct._performance(run, _problem_of(run, problem))
    known = {name: plain[name] for name in Performance.__dataclass_fields__}
    known["settling"] = [Settling(**{**s, "set_point": np.array(s["set_point"])}) for s in plain["settling"]]
    known["margins"] = [ConstraintMargin(**m) for m in plain["margins"]]
    for name in ("input_energy", "input_movement"):
        known[name] = np.array(plain[name])
    return Performance(**known)


@dataclass(frozen=True)
class ComparedFigure:
    """One figure of two runs. Made by `compare`.

    Attributes
    ----------
    what : str
        What it is, with its unit.
    first, second : float or None
        Of the two runs; None where a run has none.
    ratio : float or None
        second / first, where both are numbers and the first is not 0.
    """

    what: str
    first: float | None
    second: float | None
    ratio: float | None = field(init=False)

    def __post_init__(self) -> None:
        ratio = None if not self.first or self.second is None else self.second / self.first
        object.__setattr__(self, "ratio", ratio)


def compare(first: Run, second: Run) -> list[ComparedFigure]:
    """Two closed loops, figure by figure.

    Parameters
    ----------
    first, second : Run
        The closed loops.

    Returns
    -------
    list of ComparedFigure
    """
    plain = _mpct._compare(
        first, _problem_of(first, None, "first"), second, _problem_of(second, None, "second")
    )
    return [ComparedFigure(f["what"], f["first"], f["second"]) for f in plain]


def verify(certificate: str | PathLike[str], *, ignore_digest: bool = False) -> Verified:
    """Checks a certificate with code that shares nothing with the search.

    Parameters
    ----------
    certificate : str or os.PathLike
        The text that `Design.certificate` returns, or the path of a file that has it. A text that begins with ``{`` is
        a certificate.
    ignore_digest : bool, default False
        Check the claim even when the digest does not fit.

    Returns
    -------
    Verified

    Raises
    ------
    VerifyError
        When it is no certificate, was changed, or its claim does not follow.

    Examples
    --------
    >>> import mpct
    >>> design = mpct.example("academic").problem.design()
    >>> mpct.verify(design.certificate()).terminal_horizon
    5
    """
    if not (isinstance(certificate, str) and certificate.lstrip()[:1] == "{"):
        try:
            certificate = Path(certificate).read_text(encoding="utf-8")
        except TypeError:
            raise argument_type("certificate", "a text or a path", repr(certificate)[:200]) from None
        except UnicodeDecodeError as error:
            raise VerifyError(f"not a certificate: {error}", "unreadable") from None
    return _mpct._verify(certificate, ignore_digest)


def example(case: str = "academic", count: int = 10) -> ProblemFile:
    """The problem file of a case study of the paper.

    Parameters
    ----------
    case : {"academic", "carts", "drone"}
        The case study.
    count : int, default 10
        Number of carts.

    Returns
    -------
    ProblemFile

    Examples
    --------
    >>> import mpct
    >>> mpct.example("drone").problem.plant.states
    12
    """
    return ProblemFile.parse(_mpct._example(case, count))


def reproduce(
    extent: Literal["short", "standard", "full"] = "short",
    folder: str | PathLike[str] | None = None,
    png: bool = False,
) -> dict[str, Any]:
    """Section 4 of the paper: its tables and figures as plain data, and as files when a folder is stated.

    Parameters
    ----------
    extent : {"short", "standard", "full"}
        Seconds, minutes, or long.
    folder : str or os.PathLike, optional
        Where the files of ``mpct reproduce`` go: a page, all data, two tables. Made when it is missing.
    png : bool, default False
        Also write each figure as a PNG file.

    Returns
    -------
    dict
        What ``section-4.json`` has.
    """
    if png and folder is None:
        raise argument("folder", "a folder for the pictures", "none")
    if folder is not None:
        # A folder that cannot be made is told before the work, not after it.
        Path(folder).mkdir(parents=True, exist_ok=True)
    files = _mpct._reproduce(extent, png)
    if folder is not None:
        for name, data in files:
            write_atomically(Path(folder) / name, data)
    plain: dict[str, Any] = json.loads(dict(files)["section-4.json"])
    return plain


CLASSES = (ScalingNeed, ScalingAdvice, Settling, ConstraintMargin, Performance, ComparedFigure)
for _class in CLASSES:
    _class.__module__ = "mpct"
