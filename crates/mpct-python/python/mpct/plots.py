"""Plots with matplotlib: trajectories and sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ._convert import listed
from ._errors import argument

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from ._mpct import Design, Problem
    from ._results import Polygon
    from ._run import Run

__all__ = ["polygon", "sets", "terminal_set", "trajectories"]


MOST = 8
"""Signals of a kind that are drawn unless others are named: more do not fit one figure."""


def _pyplot() -> Any:
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install matplotlib") from error
    return pyplot


def _label(names: Sequence[str], units: Sequence[str], symbol: str, i: int) -> str:
    name = names[i] if i < len(names) and names[i] else f"${symbol}_{{{i + 1}}}$"
    unit = f" [{units[i]}]" if i < len(units) and units[i] else ""
    return name + unit


def _chosen(
    what: str, chosen: Sequence[int | str] | None, count: int, symbol: str, known: Sequence[str]
) -> list[int]:
    if chosen is None:
        return list(range(min(count, MOST)))
    # Without names they are called as in reports.
    names = list(known) or [f"{symbol}{i + 1}" for i in range(count)]
    expected = f"a list of numbers from 0 to {count - 1}, or of names among {', '.join(names[:40])}"
    found = []
    for item in listed(chosen, what, expected):
        if isinstance(item, str) and item in names:
            found.append(names.index(item))
        elif isinstance(item, (int, np.integer)) and not isinstance(item, bool) and 0 <= item < count:
            found.append(int(item))
        else:
            raise argument(what, expected, repr(item))
    return found


def trajectories(
    run: Run,
    *,
    states: Sequence[int | str] | None = None,
    inputs: Sequence[int | str] | None = None,
    figure: Figure | None = None,
) -> Figure:
    """Draws a closed loop over time, with constraints, set-points and artificial steady states.

    Parameters
    ----------
    run : Run
        The closed loop.
    states, inputs : sequence of int or str, optional
        Which to draw, by number or name; the first eight of each unless stated.
    figure : matplotlib.figure.Figure, optional
        Where to draw; a new figure unless stated.

    Returns
    -------
    matplotlib.figure.Figure
    """
    plant = run.problem.plant if run.problem is not None else None
    x, u, artificial_x, artificial_u, points = (
        np.asarray(values) for values in (run.x, run.u, run.artificial_state, run.artificial_input, run.setpoint)
    )
    states = _chosen("states", states, x.shape[1], "x", plant.state_names if plant is not None else [])
    inputs = _chosen("inputs", inputs, u.shape[1], "u", plant.input_names if plant is not None else [])
    rows = len(states) + len(inputs)
    if rows == 0 or len(run) == 0:
        raise argument("states, inputs", "a signal to draw, over at least one step", "none")
    if figure is None:
        figure = _pyplot().figure(figsize=(7.0, 1.2 + 1.3 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    dt = plant.sampling_time if plant is not None else None
    time = np.arange(len(run)) * (dt or 1.0)

    def draw(ax: Axes, values: Any, artificial: Any, set_point: Any, limits: Any, label: str, steps: bool) -> None:
        style: dict[str, Any] = {"drawstyle": "steps-post"} if steps else {}
        if set_point is not None:
            ax.plot(time, set_point, color="tab:red", linestyle="--", label="set-point", drawstyle="steps-post")
        ax.plot(time, artificial, color="tab:green", linestyle=":", label="artificial", **style)
        ax.plot(time, values, color="tab:blue", label="closed loop", **style)
        for limit in limits:
            if np.isfinite(limit):
                ax.axhline(limit, color="0.4", linewidth=0.8)
        ax.set_ylabel(label)
        ax.grid(True, alpha=0.3)

    for ax, i in zip(axes, states):
        limits = [side[i] for side in run.problem.state] if run.problem is not None else []
        label = _label(plant.state_names, plant.state_units, "x", i) if plant is not None else f"$x_{{{i + 1}}}$"
        draw(ax, x[:, i], artificial_x[:, i], points[:, i], limits, label, False)
    for ax, i in zip(axes[len(states) :], inputs):
        limits = [side[i] for side in run.problem.input] if run.problem is not None else []
        label = _label(plant.input_names, plant.input_units, "u", i) if plant is not None else f"$u_{{{i + 1}}}$"
        draw(ax, u[:, i], artificial_u[:, i], None, limits, label, True)
    axes[0].legend(loc="best", fontsize="small")
    axes[-1].set_xlabel("time [s]" if dt else "step")
    return figure


def polygon(outline: Polygon, *, ax: Axes | None = None, **style: Any) -> Axes:
    """Draws a set in two coordinates.

    Parameters
    ----------
    outline : Polygon
        The set.
    ax : matplotlib.axes.Axes, optional
        Where to draw; new axes unless stated.
    **style
        Of `matplotlib.axes.Axes.fill`.

    Returns
    -------
    matplotlib.axes.Axes
    """
    if ax is None:
        ax = _pyplot().subplots()[1]
    ax.fill(outline.vertices[:, 0], outline.vertices[:, 1], **{"alpha": 0.4, **style})
    i, j = outline.coordinates
    ax.set_xlabel(ax.get_xlabel() or f"$x_{{{i + 1}}}$")
    ax.set_ylabel(ax.get_ylabel() or f"$x_{{{j + 1}}}$")
    ax.grid(True, alpha=0.3)
    return ax


def sets(
    outlines: Mapping[str, Polygon],
    problem: Problem | None = None,
    *,
    states: ArrayLike = (),
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draws the outlines of several sets in the same two states, to compare them.

    Parameters
    ----------
    outlines : dict of Polygon
        The outlines, by the names that the legend has.
    problem : Problem, optional
        For the names of the states and their limits.
    states : array_like, shape (k, n), optional
        States that are marked.
    ax : matplotlib.axes.Axes, optional
        Where to draw; new axes unless stated.
    **style
        Of `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes
    """
    pairs = {tuple(outline.coordinates) for outline in outlines.values()}
    if len(pairs) != 1:
        raise argument("outlines", "outlines in the same two states", ", ".join(map(str, sorted(pairs))) or "none")
    i, j = pairs.pop()
    if ax is None:
        ax = _pyplot().subplots()[1]
    for k, (name, outline) in enumerate(outlines.items()):
        # Sets that coincide are all seen: later lines are narrower and dashed.
        line: dict[str, Any] = {"linewidth": max(1.2, 3.0 - 0.9 * k), "linestyle": ("-", "--", "-.", ":")[k % 4], **style}
        closed = np.vstack([outline.vertices, outline.vertices[:1]])
        ax.plot(closed[:, 0], closed[:, 1], label=name, **line)
    marked = np.asarray(states, dtype=float)
    if marked.size:
        marked = np.atleast_2d(marked)
        if marked.ndim != 2 or marked.shape[1] <= max(i, j):
            raise argument("states", f"rows of more than {max(i, j)} numbers", f"an array of shape {marked.shape}")
        ax.plot(marked[:, i], marked[:, j], "ko", label="state")
    names, units = (problem.plant.state_names, problem.plant.state_units) if problem is not None else ([], [])
    if problem is not None:
        for draw, k in ((ax.axvline, i), (ax.axhline, j)):
            for side in problem.state:
                if np.isfinite(side[k]):
                    draw(side[k], color="0.4", linewidth=0.8)
    ax.set_xlabel(_label(names, units, "x", i))
    ax.set_ylabel(_label(names, units, "x", j))
    ax.grid(True, alpha=0.3)
    ax.legend(loc="best", fontsize="small")
    return ax


def terminal_set(
    design: Design, coordinates: tuple[int, int] = (0, 1), *, ax: Axes | None = None, **style: Any
) -> Axes:
    """Draws the projection of the terminal set onto two states.

    Parameters
    ----------
    design : Design
        The design.
    coordinates : tuple of two int, default (0, 1)
        The states.
    ax : matplotlib.axes.Axes, optional
        Where to draw; new axes unless stated.
    **style
        Of `matplotlib.axes.Axes.fill`.

    Returns
    -------
    matplotlib.axes.Axes
    """
    plant = design.problem.plant
    outline = design.terminal_set_outline(coordinates)
    if ax is None:
        ax = _pyplot().subplots()[1]
    ax.set_xlabel(_label(plant.state_names, plant.state_units, "x", coordinates[0]))
    ax.set_ylabel(_label(plant.state_names, plant.state_units, "x", coordinates[1]))
    return polygon(outline, ax=ax, **style)
