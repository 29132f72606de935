"""Reading a configuration mapping key by key, with errors that name file, key and value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cspr_drivers.errors import ConfigurationError
from cspr_kinematics.configuration.yaml_file import read_yaml
from cspr_kinematics.errors import ConfigurationFileError


def configuration_error(source: str, key: str, value: object, problem: str) -> ConfigurationError:
    """Return the error of one value; `key` is its path in the file, `value` is `None` when there is none."""
    place = f"{source}: {key}" if key else source
    shown = "" if value is None else f" = {value!r}"
    return ConfigurationError(f"{place}{shown}: {problem}")


class ConfigSection:
    """One mapping of a configuration file.

    Each key is taken once by the method for its type; `finish` then refuses keys that nobody asked for.

    Parameters
    ----------
    source
        File that the mapping comes from, for messages.
    path
        Path of the mapping inside the file, empty at the top.
    content
        What was found there.

    Raises
    ------
    ConfigurationError
        If `content` is not a mapping. Every method raises it for a missing key or a value that is not
        allowed.
    """

    def __init__(self, source: str, path: str, content: object) -> None:
        self.source = source
        self.path = path
        if not isinstance(content, Mapping):
            raise configuration_error(source, path, content, "must be a mapping of keys to values")
        self._content = content
        self._taken: set[str] = set()

    @staticmethod
    def from_yaml(path: str | Path) -> ConfigSection:
        """Return the top-level mapping of a YAML file."""
        try:
            return ConfigSection(str(path), "", read_yaml(path))
        except ConfigurationFileError as error:
            raise ConfigurationError(str(error)) from None

    def __contains__(self, name: str) -> bool:
        return name in self._content

    def key(self, name: str) -> str:
        """Return the path of a key of this section."""
        return f"{self.path}.{name}" if self.path else name

    def error(self, name: str, problem: str) -> ConfigurationError:
        """Return the error for the value of a key."""
        return configuration_error(self.source, self.key(name), self._content.get(name), problem)

    def number(self, name: str, minimum: float = -math.inf, above: float = -math.inf) -> float:
        """Return a finite number, at least `minimum` and greater than `above`."""
        value = self._take(name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not _is_finite(value):
            raise self.error(name, "must be a finite number")
        if value < minimum:
            raise self.error(name, f"must be at least {minimum:g}")
        if value <= above:
            raise self.error(name, f"must be greater than {above:g}")
        return float(value)

    def integer(self, name: str, minimum: int, maximum: int) -> int:
        """Return a whole number in a closed interval."""
        value = self._take(name)
        if isinstance(value, bool) or not isinstance(value, int) or not minimum <= value <= maximum:
            raise self.error(name, f"must be a whole number from {minimum} to {maximum}")
        return value

    def text(self, name: str) -> str:
        """Return a text that is not empty."""
        value = self._take(name)
        if not isinstance(value, str) or not value:
            raise self.error(name, "must be a text")
        return value

    def choice(self, name: str, allowed: Sequence[str | int]) -> str | int:
        """Return one of the allowed values."""
        value = self._take(name)
        for entry in allowed:
            if type(value) is type(entry) and value == entry:
                return entry
        raise self.error(name, "must be one of " + ", ".join(map(str, allowed)))

    def texts(self, name: str) -> tuple[str, ...]:
        """Return a list of texts."""
        value = self._take(name)
        if not isinstance(value, list) or not all(isinstance(entry, str) for entry in value):
            raise self.error(name, "must be a list of texts")
        return tuple(value)

    def section(self, name: str) -> ConfigSection:
        """Return the mapping below a key."""
        return ConfigSection(self.source, self.key(name), self._take(name))

    def section_or_none(self, name: str) -> ConfigSection | None:
        """Return the mapping below a key, `None` when the key holds null."""
        value = self._take(name)
        return None if value is None else ConfigSection(self.source, self.key(name), value)

    def array(self, name: str, *shape: int) -> NDArray[np.float64]:
        """Return finite numbers as a read-only array of the given shape."""
        value = self._take(name)
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise self.error(name, f"must be numbers of shape {shape}") from None
        if array.shape != shape or not np.isfinite(array).all():
            raise self.error(name, f"must be finite numbers of shape {shape}")
        array.setflags(write=False)
        return array

    def array_or_row(self, name: str, count: int, *shape: int) -> NDArray[np.float64]:
        """Return `count` arrays of a shape, or the one that stands there for all of them."""
        value = self._content.get(name)
        for _ in shape:
            value = value[0] if isinstance(value, list) and value else None
        return self.array(name, count, *shape) if isinstance(value, list) else self.array(name, *shape)

    def sections(self, name: str, may_be_empty: bool = False) -> tuple[ConfigSection, ...]:
        """Return the mappings of a list, in its order."""
        value = self._take(name)
        if not isinstance(value, list) or not (value or may_be_empty):
            raise self.error(name, "must be a list" if may_be_empty else "must be a list that is not empty")
        return tuple(
            ConfigSection(self.source, f"{self.key(name)}[{place}]", entry)
            for place, entry in enumerate(value)
        )

    def names(self) -> tuple[str, ...]:
        """Return the keys of this section, for sections whose keys are names."""
        for name in self._content:
            if not isinstance(name, str) or not name:
                raise configuration_error(self.source, self.path, name, "keys must be texts")
        return tuple(self._content)

    def finish(self) -> None:
        """Refuse keys that were not taken."""
        for name in self._content:
            if name not in self._taken:
                known = ", ".join(sorted(self._taken))
                raise configuration_error(
                    self.source, self.key(str(name)), self._content[name], f"unknown key; known here: {known}"
                )

    def _take(self, name: str) -> object:
        if name not in self._content:
            raise configuration_error(self.source, self.key(name), None, "is missing")
        self._taken.add(name)
        return self._content[name]


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that is too large
        return False
