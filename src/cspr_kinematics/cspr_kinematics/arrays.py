"""Checked, immutable float arrays: what every public constructor and function does with its input."""

from __future__ import annotations

import math
import sys
from collections.abc import Sized
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_kinematics.errors import InvalidInputError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
_DOUBLE = np.dtype(np.float64)


class ReadOnlyArrays:
    """Base class of immutable objects: keeps the arrays of copies read-only, which numpy does not.

    Kernels are compiled for read-only arrays and would be compiled again for the writable ones of a copy.
    """

    def __setstate__(self, state: dict[str, object]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        self.__dict__.update(state)

    def _set(self, **attributes: object) -> None:
        """Set attributes of a frozen dataclass; for its constructor alone."""
        self.__dict__.update(attributes)


def checked(name: str, value: ArrayLike, *last_axes: int) -> FloatArray:
    """Return `value` as a finite float array whose last axes have the given sizes.

    Parameters
    ----------
    name : str
        Name of the quantity, for the error.
    value : array_like
        What the caller passed.
    *last_axes : int
        Required sizes of the last axes; any number of batch axes may precede them.

    Raises
    ------
    InvalidInputError
        If the value is not numeric, not finite, or has another shape.
    """
    array = as_floats(name, value, *last_axes)
    if not is_finite(array):
        raise InvalidInputError(name, value, "not finite")
    return array


def is_finite(array: FloatArray) -> bool:
    """Return whether all numbers are finite."""
    # takes a fifth of the time of the full test, which is needed only when the squares overflow
    return math.isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def single(name: str, value: ArrayLike, *shape: int) -> FloatArray:
    """Return `value` as a finite array of exactly this shape, a copy that cannot be written.

    Raises
    ------
    InvalidInputError
        If the value is not numeric, not finite, or has another shape.
    """
    array = checked(name, value, *shape)
    if array.ndim != len(shape):
        needed = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise InvalidInputError(name, value, f"shape {array.shape} where ({needed}) is needed")
    return frozen(array)


def for_each_cable(name: str, value: ArrayLike, m: int) -> FloatArray:
    """Return one number for each of m cables, (m,), from a number for all or m of them; a copy that cannot be written.

    Raises
    ------
    InvalidInputError
        If the value is not numeric, not finite, or has another shape.
    """
    array = checked(name, value)
    if array.ndim > 1:
        raise InvalidInputError(name, value, f"shape {array.shape} where () or ({m},) is needed")
    if array.ndim == 1:
        require_one_for_each_cable(name, array, m)
    return frozen(np.broadcast_to(array, (m,)))


def require_one_for_each_cable(name: str, values: Sized, m: int) -> None:
    """Refuse a list that does not have one entry for each of m cables.

    Raises
    ------
    InvalidInputError
        Saying how many there are, and how many are needed.
    """
    if len(values) != m:
        raise InvalidInputError(
            name, values, f"has {len(values)} elements where {m} are needed, one for each cable"
        )


def as_floats(name: str, value: ArrayLike, *last_axes: int) -> FloatArray:
    """Return `value` as a float array, finite or not; for callers that check that themselves.

    Raises
    ------
    InvalidInputError
        If the value is not numeric, or has another shape.
    """
    try:
        array = np.asarray(value)
        if array is not value or array.dtype != _DOUBLE:
            array = _real_numbers(value, array)
        if not array.flags.aligned:  # such as a view of a message's bytes; BLAS may crash on one
            array = array.copy()
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInputError(name, value, f"not an array of numbers ({error})") from error
    if array.ndim < len(last_axes) or array.shape[array.ndim - len(last_axes) :] != last_axes:
        wanted = ", ".join(["...", *map(str, last_axes)])
        raise InvalidInputError(name, value, f"shape {array.shape} where ({wanted}) is needed")
    return array


def _real_numbers(value: ArrayLike, array: NDArray[Any]) -> FloatArray:
    """Return `array`, which was made of `value`, in double precision; missing values as not-a-number.

    numpy itself would parse text, drop imaginary parts, and ignore the mask of a masked array.
    """
    if array.dtype.kind not in "fiubO":
        raise TypeError(f"of type {array.dtype}")
    if isinstance(value, np.ma.MaskedArray):
        return np.asarray(np.ma.filled(value.astype(np.float64), np.nan))
    return array.astype(np.float64, copy=False)


def frozen(array: FloatArray) -> FloatArray:
    """Return a contiguous, read-only copy of `array`."""
    copy = array.copy()
    copy.setflags(write=False)
    return copy


def checked_number(name: str, value: float) -> float:
    """Return `value` as a finite float.

    Raises
    ------
    InvalidInputError
        If the value is not a finite number.
    """
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInputError(name, value, "not a number") from error
    if not math.isfinite(number):
        raise InvalidInputError(name, value, "not finite")
    return number


def positive_number(name: str, value: float) -> float:
    """Return `value` as a finite float above zero; raises InvalidInputError for any other."""
    number = checked_number(name, value)
    if number <= 0.0:
        raise InvalidInputError(name, value, "must be positive")
    return number


def non_negative_number(name: str, value: float) -> float:
    """Return `value` as a finite float, zero or more; raises InvalidInputError for any other."""
    number = checked_number(name, value)
    if number < 0.0:
        raise InvalidInputError(name, value, "must not be negative")
    return number


def positive_integer(name: str, value: int) -> int:
    """Return `value`, a whole number, one or more, that fits into 64 bits; raises InvalidInputError for any other."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 1 <= value <= sys.maxsize:
        raise InvalidInputError(name, value, f"must be a whole number from 1 to {sys.maxsize}")
    return int(value)


def broadcast_batch(**batches: tuple[int, ...]) -> tuple[int, ...]:
    """Broadcast the batch axes of several named quantities against each other.

    Raises
    ------
    InvalidInputError
        If they do not fit together.
    """
    shapes = list(batches.values())
    if shapes.count(shapes[0]) == len(shapes):
        return shapes[0]
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError as error:
        raise InvalidInputError("batch axes", batches, "do not broadcast against each other") from error
