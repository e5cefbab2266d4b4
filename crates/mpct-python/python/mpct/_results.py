"""What analyses answer: plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ._errors import argument

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class AdmissibleSetPoint:
    """The admissible steady state closest to a set-point. Made by `Design.closest_admissible`.

    Attributes
    ----------
    state : ndarray, shape (n,)
        Its state.
    input : ndarray, shape (m,)
        Its input.
    parameter : ndarray, shape (m,)
        θ.
    offset_cost : float
        Weighted squared distance from the set-point.
    admissible : bool
        Whether the set-point itself is admissible.
    limiting : list of str
        The constraint rows that are active there.
    """

    state: NDArray[np.float64]
    input: NDArray[np.float64]
    parameter: NDArray[np.float64]
    offset_cost: float
    admissible: bool
    limiting: list[str]


@dataclass(frozen=True, eq=False)
class Assumption:
    """What a check of the assumptions finds. Made by `Problem.check`.

    Attributes
    ----------
    spectral_radius : float
        That of A + B K.
    steady_state_basis : ndarray, shape (n + m, m)
        M_θ.
    """

    spectral_radius: float
    steady_state_basis: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ImplicitTerminalCost:
    """The terminal cost of remark 2. Made by `Design.implicit_terminal_cost`.

    Attributes
    ----------
    epsilon : float
        The smallest ε.
    weight : ndarray, shape (n, n)
        P_ε.
    """

    epsilon: float
    weight: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Constraints C x + D u ≤ 1 around the operating point. Made by `Problem.constraint_rows`.

    Attributes
    ----------
    C : ndarray, shape (p, n)
        Rows of the states.
    D : ndarray, shape (p, m)
        Rows of the inputs.
    scale : ndarray, shape (p,)
        The room of each row at the operating point; a row times its scale is the row as it was stated.
    source : list of str
        Where each row comes from, such as ``state_upper[0]``.
    """

    C: NDArray[np.float64]
    D: NDArray[np.float64]
    scale: NDArray[np.float64]
    source: list[str]

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.source)


@dataclass(frozen=True, eq=False)
class MaximalAdmissibleSet:
    """The explicit terminal set {(x, θ) : G (x, θ) ≤ g} without redundant rows. Made by `Design.maximal_admissible_set`.

    Attributes
    ----------
    G : ndarray, shape (rows, n + m) for tracking, (rows, n) for regulation
        Its rows; x is measured from the operating point.
    g : ndarray, shape (rows,)
        Right-hand sides.
    states : int
        n; the columns after it are those of θ.
    origin : list of tuple
        For each row the constraint and the step of the terminal law that it comes from; None in place of the step for a
        row of θ ∈ λΘ.
    """

    G: NDArray[np.float64]
    g: NDArray[np.float64]
    states: int
    origin: list[tuple[str, int | None]]

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.g)

    def contains(self, x: Any, theta: Any = (), tolerance: float = 1e-9) -> bool:
        """Whether (x, θ) lies in the set.

        Parameters
        ----------
        x : array_like, shape (n,)
            State, measured from the operating point.
        theta : array_like, shape (m,)
            θ; empty for regulation.
        tolerance : float, default 1e-9
            A row may be violated by this; right-hand sides are 1.

        Returns
        -------
        bool
        """
        from ._convert import as_floats

        z = np.concatenate([np.ravel(as_floats(x, "x")), np.ravel(as_floats(list(theta), "theta"))])
        if len(z) != self.G.shape[1]:
            raise argument("x, theta", f"{self.G.shape[1]} numbers together", str(len(z)))
        return bool(np.all(self.G @ z <= self.g + tolerance))


@dataclass(frozen=True, eq=False)
class Polygon:
    """A set in two coordinates.

    Attributes
    ----------
    coordinates : tuple of int
        The two states.
    vertices : ndarray, shape (k, 2)
        Vertices, counter-clockwise. Each is a point of the set.
    gap : float
        How far the set may reach beyond an edge, as a share of its half-widths.
    queries : int
        Support queries made.
    area : float
        Area inside the vertices.
    """

    coordinates: tuple[int, int]
    vertices: NDArray[np.float64]
    gap: float
    queries: int
    area: float

    def contains(self, point: Any) -> bool:
        """Whether a point lies inside or on the polygon.

        Parameters
        ----------
        point : array_like, shape (2,)
            The point.

        Returns
        -------
        bool
        """
        from ._convert import as_floats

        p = as_floats(point, "point")
        if p.shape != (2,):
            raise argument("point", "two numbers", f"an array of shape {p.shape}")
        edges = np.roll(self.vertices, -1, axis=0) - self.vertices
        to = p - self.vertices
        return bool(np.all(edges[:, 0] * to[:, 1] - edges[:, 1] * to[:, 0] >= 0.0))

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draws the polygon.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; new axes unless stated.
        **style
            Of `matplotlib.axes.Axes.fill`.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from .plots import polygon

        return polygon(self, ax=ax, **style)


@dataclass(frozen=True, eq=False)
class Membership:
    """Whether a state is in a domain of attraction, and the proof. Made by `DomainOfAttraction.contains`.

    Attributes
    ----------
    inside : bool
        Whether it is.
    candidate : ndarray or None
        When inside: variables of the program that satisfy its rows.
    slack : float or None
        When inside: the smallest slack of a row there.
    gap : float or None
        When outside: by how much the rows contradict each other.
    radius : float or None
        When outside: the proof holds for all variables below this.
    rows : list of tuple or None
        When outside: the rows that take part, with their multipliers.
    """

    inside: bool
    candidate: NDArray[np.float64] | None = None
    slack: float | None = None
    gap: float | None = None
    radius: float | None = None
    rows: list[tuple[str, float]] | None = None


@dataclass(frozen=True, eq=False)
class Reach:
    """How far a set of states reaches. Made by `DomainOfAttraction.reach` and `StabilityRegion.reach`.

    Attributes
    ----------
    distance : float
        The largest multiple of the direction known to be inside.
    at_most : float
        Proved: no larger one is.
    state : ndarray, shape (n,)
        The state there.
    """

    distance: float
    at_most: float
    state: NDArray[np.float64]


@dataclass(frozen=True)
class Volume:
    """Length, area or volume of a set of states. Made by `DomainOfAttraction.volume` and `StabilityRegion.volume`.

    Attributes
    ----------
    value : float
        Of the hull of points of the set, in the product of the states' units.
    dimension : int
        Number of states, 1 to 3.
    gap : float
        How far the set may reach beyond a side of that hull, at most, as a share of the half-widths.
    vertices : int
        Points that span the hull.
    queries : int
        Support queries made.
    """

    value: float
    dimension: int
    gap: float
    vertices: int
    queries: int


@dataclass(frozen=True, eq=False)
class RuntimeTables:
    """The online program for the runtime. Made by `Controller.runtime_tables`.

    Attributes
    ----------
    states, inputs, horizon : int
        n, m and N.
    set_point : int
        Numbers of a set-point: state, then input.
    rows, input_rows : int
        Rows of the program, and of E in the limits E u ≤ 1 of the input; 0 when the tables do not know them.
    workspace_len, index_len : int
        Floats and indices of memory that the runtime needs.
    numbers : ndarray
        The tables; for small problems followed by the products of their rows.
    """

    states: int
    inputs: int
    horizon: int
    set_point: int
    rows: int
    input_rows: int
    workspace_len: int
    index_len: int
    numbers: NDArray[np.float64]


@dataclass(frozen=True)
class Attraction:
    """Whether a state is in a stability region. Made by `StabilityRegion.contains`.

    Attributes
    ----------
    inside : bool
        Whether cost ≤ level.
    cost : float
        V*(x) − V°; infinite where the program is infeasible.
    level : float
        (N + M̄) d + γ α.
    as_printed : float
        V*(x) − V_O*(x), the left-hand side as the paper prints it.
    """

    inside: bool
    cost: float
    level: float
    as_printed: float


@dataclass(frozen=True)
class Verified:
    """What a certificate proves. Made by `verify`.

    Attributes
    ----------
    problem : str
        Name of the problem.
    terminal_horizon : int
        M̃, or M for regulation.
    smallest_margin : float
        Smallest of 1 − (proved support)/(bound) over all rows.
    tightest_row : str
        The row with that margin.
    rows_rigorous, rows_to_tolerance : int
        Rows proved with bounds on every rounding error, and rows proved to 2e-9 of their bound.
    lyapunov_residual, steady_state_residual : float
        Bounds of the residuals of (3) and of the steady states.
    witness : float or None
        By how much a point shows that one step less is too few.
    statement : str
        All of it in words, as the command prints it.
    """

    problem: str
    terminal_horizon: int
    smallest_margin: float
    tightest_row: str
    rows_rigorous: int
    rows_to_tolerance: int
    lyapunov_residual: float
    steady_state_residual: float
    witness: float | None
    statement: str

    def __str__(self) -> str:
        return self.statement


CLASSES = (
    AdmissibleSetPoint,
    Assumption,
    Attraction,
    ConstraintRows,
    ImplicitTerminalCost,
    MaximalAdmissibleSet,
    Membership,
    Polygon,
    Reach,
    RuntimeTables,
    Verified,
    Volume,
)
for _class in CLASSES:
    _class.__module__ = "mpct"
