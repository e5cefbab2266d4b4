"""The exceptions of the package."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class _Error(ValueError):
    kind: str
    """Which error it is, in lower case with underscores."""
    message: str
    """What is wrong, with the numbers that say how to mend it."""
    fields: dict[str, Any]
    """What the error says besides; each entry is an attribute, too."""

    def __init__(self, message: str, kind: str = "other", fields: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.kind = kind
        self.fields = dict(fields or {})

    def __getattr__(self, name: str) -> Any:
        if name != "fields" and name in self.__dict__.get("fields", {}):
            return self.fields[name]
        raise AttributeError(f"{type(self).__name__} {self.__dict__.get('kind', '')!r} has no attribute {name!r}")

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.fields})

    def __reduce__(self) -> tuple[type, tuple[str, str, dict[str, Any]]]:
        return type(self), (self.message, self.kind, self.fields)


class DesignError(_Error):
    """A problem is stated wrongly or cannot be designed.

    Attributes
    ----------
    kind : str
        "shape", "not_finite", "out_of_range", "not_symmetric", "not_positive_definite", "origin_not_interior",
        "not_stabilizable", "not_schur", "unbounded", "horizon_not_determined", "interrupted" or "solver".
    message : str
        What is wrong.
    fields : dict
        What the kind says besides, such as ``what``, ``expected``, ``found``, ``row``; each is an attribute, too.
    """


class StepError(_Error):
    """A step of a controller failed.

    Attributes
    ----------
    kind : str
        "state_not_finite", "set_point_not_finite", "wrong_length", "infeasible", "iteration_limit" or
        "initial_state".
    message : str
        What is wrong.
    fields : dict
        What the kind says besides, such as ``expected`` and ``found``; each is an attribute, too. From `simulate`,
        ``step`` is the step that failed and ``run`` the run before it.
    """


class FileError(_Error):
    """A problem file was refused.

    Attributes
    ----------
    kind : str
        "unreadable", "too_large", "not_text", "syntax", "unknown_key", "missing_key", "wrong_type", "ragged" or
        "csv".
    message : str
        What is wrong.
    fields : dict
        What the kind says besides, such as ``key``, ``line``, ``expected``, ``found``; each is an attribute, too.
    """


for _class in (DesignError, StepError, FileError):
    _class.__module__ = "mpct"
