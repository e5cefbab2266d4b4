"""Progress bars."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from ._errors import argument_type

_WIDTH = 24
_DELAY = 0.5
_PERIOD = 0.1


def _interactive() -> bool:
    try:
        if sys.stderr.isatty():
            return True
    except (AttributeError, ValueError):
        return False
    return "ipykernel" in sys.modules


class Bar:
    """A line on the error stream, drawn again in place."""

    def __init__(self, name: str, text: str) -> None:
        self._name, self._text = name, text
        self._start = time.monotonic()
        self._drawn = self._start + _DELAY - _PERIOD
        self._length = 0

    def __call__(self, done: int, total: int, extra: int) -> None:
        now = time.monotonic()
        if now - self._drawn < _PERIOD:
            return
        self._drawn = now
        filled = _WIDTH * done // total if total else 0
        told = self._text.format(done=done, total=total or "?", extra=extra)
        line = f"{self._name} [{'#' * filled}{'.' * (_WIDTH - filled)}] {told}, {now - self._start:.0f} s"
        sys.stderr.write("\r" + line.ljust(self._length))
        sys.stderr.flush()
        self._length = len(line)

    def close(self) -> None:
        if self._length:
            sys.stderr.write("\r" + " " * self._length + "\r")
            sys.stderr.flush()


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
