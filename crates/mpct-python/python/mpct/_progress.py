"""Progress bars."""

from __future__ import annotations

import html
import sys
import time
from collections.abc import Callable
from typing import Any

from ._errors import argument_type

_WIDTH = 24
_DELAY = 0.5
_PERIOD = 0.1


def _in_notebook() -> bool:
    """Whether the code runs in a kernel; tools that talk to kernels import the same modules."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def _interactive() -> bool:
    try:
        return sys.stderr.isatty() or _in_notebook()
    except (AttributeError, ValueError):
        return False


class Line:
    """A line on the error stream, drawn again in place."""

    def __init__(self) -> None:
        self._length = 0

    def draw(self, name: str, share: float, told: str) -> None:
        filled = int(_WIDTH * share)
        line = f"{name} [{'#' * filled}{'.' * (_WIDTH - filled)}] {told}"
        sys.stderr.write("\r" + line.ljust(self._length))
        sys.stderr.flush()
        self._length = len(line)

    def clear(self) -> None:
        sys.stderr.write("\r" + " " * self._length + "\r")
        sys.stderr.flush()


class Output:
    """An output of a notebook's cell, changed in place."""

    def __init__(self) -> None:
        self._handle: Any = None

    def draw(self, name: str, share: float, told: str) -> None:
        bar = f'<progress value="{share:.4f}" max="1"></progress>'
        self._show({"text/plain": f"{name}: {told}", "text/html": f"{name} {bar} {html.escape(told)}"})

    def clear(self) -> None:
        self._show({"text/plain": "", "text/html": ""})

    def _show(self, data: dict[str, str]) -> None:
        from IPython.display import display

        if self._handle is None:
            self._handle = display(data, raw=True, display_id=True)
        else:
            self._handle.update(data, raw=True)


class Bar:
    """Tells how far long work is, where someone looks: after a while, and not too often."""

    def __init__(self, name: str, text: str) -> None:
        self._name, self._text = name, text
        self._start = time.monotonic()
        self._drawn = self._start + _DELAY - _PERIOD
        self._place: Line | Output | None = None

    def __call__(self, done: int, total: int, extra: int) -> None:
        now = time.monotonic()
        if now - self._drawn < _PERIOD:
            return
        self._drawn = now
        if self._place is None:
            self._place = Output() if _in_notebook() else Line()
        told = self._text.format(done=done, total=total or "?", extra=extra)
        self._place.draw(self._name, done / total if total else 0.0, f"{told}, {now - self._start:.0f} s")

    def close(self) -> None:
        if self._place is not None:
            self._place.clear()


def bar(forced: bool) -> Bar | None:
    """The bar of a design, when it is asked for or someone is there to see it."""
    return Bar("design", "{done}/{total} rows, M̃ ≥ {extra}") if forced or _interactive() else None


def watcher(
    progress: Callable[[int, int, int], object] | bool | None, name: str, text: str
) -> Callable[[int, int, int], object] | None:
    """Who is told of progress: what was handed in, a bar, or nobody."""
    if progress is None or progress is True:
        return Bar(name, text) if progress or _interactive() else None
    if progress is False:
        return None
    if not callable(progress):
        raise argument_type("progress", "a function of three numbers, True, False or None", repr(progress))
    return progress
