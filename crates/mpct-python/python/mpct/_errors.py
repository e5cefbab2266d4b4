"""The exceptions of the package: one class for each error enum of the library, and one for arguments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class Error(ValueError):
    """What every error of the package is.

    Attributes
    ----------
    kind : str
        Which error it is, in lower case with underscores.
    message : str
        What is wrong, with the numbers that say how to mend it.
    fields : dict
        What the error says besides, such as ``what``, ``expected``, ``found``, ``row``; each is an attribute, too.
    help : str or None
        What would help, when there is more to say. It is a field, too, and follows the message when printed.
    """

    kind: str
    message: str
    fields: dict[str, Any]
    help: str | None

    def __init__(self, message: str, kind: str = "other", fields: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.kind = kind
        self.fields = dict(fields or {})
        self.help = self.fields.get("help")

    def __str__(self) -> str:
        return self.message if self.help is None else f"{self.message}\nhelp: {self.help}"

    def __getattr__(self, name: str) -> Any:
        if name != "fields" and name in self.__dict__.get("fields", {}):
            return self.fields[name]
        raise AttributeError(f"{type(self).__name__} {self.__dict__.get('kind', '')!r} has no attribute {name!r}")

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.fields})

    def __reduce__(self) -> tuple[type, tuple[str, str, dict[str, Any]]]:
        return type(self), (self.message, self.kind, self.fields)


class DesignError(Error):
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


class StepError(Error):
    """A step of a controller failed.

    Attributes
    ----------
    kind : str
        "state_not_finite", "set_point_not_finite", "wrong_length", "infeasible" or "iteration_limit".
    message : str
        What is wrong.
    fields : dict
        What the kind says besides, such as ``expected`` and ``found``; each is an attribute, too.
    """


class SimulationError(StepError):
    """A closed loop did not reach its end.

    Attributes
    ----------
    kind : str
        "initial_state", "interrupted", or the kind of the step that failed (see `StepError`).
    message : str
        What is wrong.
    fields : dict
        ``row`` and ``violation`` for "initial_state". For a step that failed, what that step says, ``step`` (its
        number) and ``run`` (the run before it). Each is an attribute, too.
    """


class FileError(Error):
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


class VerifyError(Error):
    """A certificate was refused.

    Attributes
    ----------
    kind : str
        "unreadable", "digest" or "refused".
    message : str
        What is wrong.
    fields : dict
        Empty.
    """


class ArgumentError(Error):
    """An argument is none of the values expected.

    Attributes
    ----------
    kind : str
        "argument".
    message : str
        What is wrong.
    fields : dict
        ``what``, ``expected``, ``found``; each is an attribute, too.
    """


class ArgumentTypeError(ArgumentError, TypeError):
    """An argument is of another type than the ones expected; also a `TypeError`.

    Attributes
    ----------
    kind : str
        "argument".
    message : str
        What is wrong.
    fields : dict
        ``what``, ``expected``, ``found``; each is an attribute, too.
    """


def argument(what: str, expected: str, found: str) -> ArgumentError:
    """An `ArgumentError` to raise."""
    return ArgumentError(
        f"{what}: expected {expected}, found {found}", "argument", {"what": what, "expected": expected, "found": found}
    )


def argument_type(what: str, expected: str, found: str) -> ArgumentTypeError:
    """An `ArgumentTypeError` to raise."""
    return ArgumentTypeError(
        f"{what}: expected {expected}, found {found}", "argument", {"what": what, "expected": expected, "found": found}
    )


CLASSES = (Error, DesignError, StepError, SimulationError, FileError, VerifyError, ArgumentError, ArgumentTypeError)
for _class in CLASSES:
    _class.__module__ = "mpct"
