"""The progress bar of a design."""

from __future__ import annotations

import sys
import time

_WIDTH = 24
_DELAY = 0.5


def _interactive() -> bool:
    try:
        if sys.stderr.isatty():
            return True
    except (AttributeError, ValueError):
        return False
    return "ipykernel" in sys.modules


class Bar:
    """A line on the error stream, drawn again in place."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._length = 0

    def __call__(self, done: int, total: int, at_least: int) -> None:
        seconds = time.monotonic() - self._start
        if seconds < _DELAY:
            return
        filled = _WIDTH * done // total if total else 0
        line = f"design [{'#' * filled}{'.' * (_WIDTH - filled)}] {done}/{total or '?'} rows, M̃ ≥ {at_least}, {seconds:.0f} s"
        sys.stderr.write("\r" + line.ljust(self._length))
        sys.stderr.flush()
        self._length = len(line)

    def close(self) -> None:
        if self._length:
            sys.stderr.write("\r" + " " * self._length + "\r")
            sys.stderr.flush()


def bar(forced: bool) -> Bar | None:
    """A bar when it is asked for, or when someone is there to see it."""
    return Bar() if forced or _interactive() else None
