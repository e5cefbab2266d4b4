"""What is accepted as an array of numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._errors import argument, argument_type


def instance(value: Any, kind: type, what: str) -> None:
    """Refuses what is not an instance of a class."""
    if not isinstance(value, kind):
        name = kind.__name__
        raise argument_type(what, f"{'an' if name[0] in 'AEIOU' else 'a'} {name}", repr(value)[:200])


def listed(items: Any, what: str, expected: str = "a list") -> list[Any]:
    """The items of anything but a text that can be iterated over."""
    if isinstance(items, (str, bytes)):
        raise argument_type(what, expected, repr(items))
    try:
        return list(items)
    except TypeError:
        raise argument_type(what, expected, repr(items)[:200]) from None


def as_floats(value: Any, what: str) -> np.ndarray:
    """The value as a float64 array in row-major order; refuses what is not one of real numbers."""
    if isinstance(value, np.ma.MaskedArray):
        if np.ma.is_masked(value):
            raise argument(what, "a number in every entry", f"an array of which {np.ma.count_masked(value)} entries are masked")
        value = value.data
    elif hasattr(value, "toarray") and not isinstance(value, np.ndarray):
        value = value.toarray()  # a sparse matrix of SciPy
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise argument(what, "an array of numbers", f"one that numpy refuses: {error}") from None
    if array.size == 0 and array.dtype.kind == "f":
        pass
    elif array.dtype.kind not in "iuf":
        raise argument_type(what, "real numbers", f"an array of dtype {array.dtype}")
    return np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)
