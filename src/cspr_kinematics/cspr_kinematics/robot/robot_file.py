"""Reading a robot description: YAML into checked numbers, with file, key and value in every error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.errors import ConfigurationFileError, InvalidInputError


class Section:
    """One mapping of a robot description, which knows its file and dotted path.

    Parameters
    ----------
    source : str
        The file, for errors.
    content : object
        What stands there; must be a mapping with the given keys and no others.
    keys : tuple of str
        The keys it must have.
    path : str
        Dotted path of the mapping, empty for the whole description.
    optional : tuple of str
        The keys it may have besides.

    Raises
    ------
    ConfigurationFileError
        From the constructor and every method, if what is found is not what is needed.
    """

    def __init__(
        self,
        source: str,
        content: object,
        keys: tuple[str, ...],
        path: str = "",
        optional: tuple[str, ...] = (),
    ) -> None:
        self.source = source
        self.path = path
        if not isinstance(content, Mapping):
            raise ConfigurationFileError(
                source, path or None, content, f"must be a mapping with the keys {', '.join(keys)}"
            )
        self._content = content
        for key in content:
            if key not in keys and key not in optional:
                known = ", ".join((*keys, *optional))
                raise self.error(str(key), content[key], f"unknown key; known are {known}")
        for key in keys:
            if key not in content:
                raise self.error(key, None, "missing key")

    def error(self, key: str, value: object, reason: str) -> ConfigurationFileError:
        """Return the error that names `key` of this section."""
        return ConfigurationFileError(self.source, f"{self.path}.{key}" if self.path else key, value, reason)

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def section(self, key: str, keys: tuple[str, ...], optional: tuple[str, ...] = ()) -> Section:
        """Return the mapping under `key`."""
        path = f"{self.path}.{key}" if self.path else key
        return Section(self.source, self._content[key], keys, path, optional)

    def text(self, key: str) -> str:
        """Return the non-empty string under `key`."""
        value = self._content[key]
        if not isinstance(value, str) or not value.strip():
            raise self.error(key, value, "must be a non-empty text")
        return value

    def number(self, key: str) -> float:
        """Return the finite number under `key`."""
        return self._number(key, self._content[key])

    def array(self, key: str, *shape: int | None) -> FloatArray:
        """Return the array under `key`; None in `shape` stands for any count of at least one."""
        return np.array(self._array(key, self._content[key], shape), dtype=np.float64)

    def array_or_row(self, key: str, count: int, *shape: int) -> FloatArray:
        """Return `count` arrays of a shape under `key`, or the one that stands there for all of them."""
        value = self._content[key]
        rows = value
        for _ in shape:
            rows = rows[0] if isinstance(rows, list | tuple | np.ndarray) and len(rows) else None
        if isinstance(rows, list | tuple | np.ndarray):
            return self.array(key, count, *shape)
        return self.array(key, *shape)

    @contextmanager
    def constructing(self) -> Iterator[None]:
        """Turn an InvalidInputError of a constructor into one that names file and key."""
        try:
            yield
        except InvalidInputError as error:
            raise self.error(error.name, error.value, error.reason) from error

    def _array(self, key: str, value: object, shape: tuple[int | None, ...]) -> object:
        if not shape:
            return self._number(key, value)
        count, *inner = shape
        if not isinstance(value, list | tuple | np.ndarray):
            raise self.error(key, value, "must be a list" if count is None else f"must be a list of {count}")
        if len(value) == 0 or (count is not None and len(value) != count):
            needed = "at least one" if count is None else str(count)
            raise self.error(key, value, f"has {len(value)} elements where {needed} must stand")
        return [self._array(f"{key}[{i}]", element, tuple(inner)) for i, element in enumerate(value)]

    def _number(self, key: str, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
            hint = ""
            if isinstance(value, str) and _reads_as_number(value):
                hint = "; without quotes, and with a point before an exponent: 1.0e-3"
            raise self.error(key, value, f"must be a number{hint}")
        try:
            number = float(value)
        except OverflowError:  # a whole number that is too large
            number = np.inf
        if not np.isfinite(number):
            raise self.error(key, value, "must be finite")
        return number


def _reads_as_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
