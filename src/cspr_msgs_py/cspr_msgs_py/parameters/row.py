"""One parameter of a node, as the table of parameters has it."""

import math
from dataclasses import dataclass, replace
from typing import Any

from cspr_msgs_py.errors import ParameterError

_WORDS = {float: "finite number", int: "whole number", bool: "truth value", str: "word"}


@dataclass(frozen=True)
class NodeParameter:
    """A parameter of a node.

    Attributes
    ----------
    name : str
        Its name; what belongs together has names with dots.
    default
        A bool, int, float, str or a list of floats or texts, which also sets the type. ``float`` or ``list`` itself
        (of floats) where the node takes the default from its robot or its buses.
    meaning, unit : str
        Shown by ``ros2 param describe``.
    minimum, maximum : float or None
        Inclusive range of a number, or of each one of a list; None for what has none.
    choices : tuple of str
        The words that it may be; empty for any.
    changeable : bool
        Whether it may change while the node runs, also in motion. Others keep their first value.
    stretch : int
        How it follows the computer's time when a simulated machine runs slower than that: 1 for a duration, which
        grows, -1 for a rate, which falls, 2 for a height that is lost meanwhile; 0 for what does not depend on the
        computer's clock.
    """

    name: str
    default: Any
    meaning: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    changeable: bool = False
    stretch: int = 0

    @property
    def is_list(self) -> bool:
        """Whether it is a list."""
        return self.default is list or isinstance(self.default, list)

    @property
    def kind(self) -> type:
        """The type of the value, or of a list's elements."""
        if self.default is list:
            return float
        like = self.default[0] if isinstance(self.default, list) else self.default
        return like if isinstance(like, type) else type(like)

    @property
    def description(self) -> str:
        """Meaning, choices and unit in one line."""
        choices = f": {', '.join(self.choices)}" if self.choices else ""
        return f"{self.meaning}{choices}" + (f" [{self.unit}]" if self.unit else "")

    def in_slow_motion(self, value: float, speed: float) -> float:
        """Return what `value` becomes when the simulated machine runs at `speed` of real time.

        Raises
        ------
        ParameterError
            As `checked`, also if it leaves the range by that.
        """
        slow = self.checked(value) / speed**self.stretch
        try:
            return float(self.checked(slow))
        except ParameterError as error:
            raise ParameterError(
                f"{self.name} is {value:g}, which a machine at {speed:g} of real time makes {slow:g}: {error}; take "
                "another value or a higher speed"
            ) from error

    def checked(self, value: Any) -> Any:
        """Return `value` if the parameter may have it.

        Raises
        ------
        ParameterError
            If it has another type, is not finite, lies outside the range or is none of the choices.
        """
        if self.is_list:
            values = None if isinstance(value, str) or not hasattr(value, "__iter__") else list(value)
            if values is None or not all(_is(self.kind, each) for each in values):
                raise ParameterError(self._refused(value, f"must be a list of {_WORDS[self.kind]}s"))
            for each in values:
                self._require_in_range(each)
            return values
        if not _is(self.kind, value):
            raise ParameterError(self._refused(value, f"must be a {_WORDS[self.kind]}"))
        if self.choices and value not in self.choices:
            raise ParameterError(self._refused(value, f"must be one of {', '.join(self.choices)}"))
        self._require_in_range(value)
        return self.kind(value)

    def _require_in_range(self, value: Any) -> None:
        if self.kind in (int, float):
            low = -math.inf if self.minimum is None else self.minimum
            high = math.inf if self.maximum is None else self.maximum
            if not low <= value <= high:
                raise ParameterError(
                    self._refused(value, f"must lie in [{low:g}, {high:g}] {self.unit}".rstrip())
                )

    def as_double(self, value: Any) -> Any:
        """Return a whole number as a double where that is needed, for people who need not write it as ROS does."""
        if self.is_list and isinstance(value, list):
            return [replace(self, default=self.kind).as_double(each) for each in value]
        whole = isinstance(value, int) and not isinstance(value, bool)
        return float(value) if self.kind is float and whole and abs(value) < 2**63 else value

    def _refused(self, value: Any, needed: str) -> str:
        doubles = self.as_double(value)
        remedy = "" if repr(doubles) == repr(value) else f"; write {shown(doubles)}"
        return f"{self.name} is {shown(value)}; it {needed}{remedy}"


def shown(value: Any) -> str:
    """Return a value for an error: numbers to six digits, nothing longer than a line."""
    if isinstance(value, list | tuple):
        text = f"[{', '.join(shown(each) for each in value[:10])}{', ...' if len(value) > 10 else ''}]"
    else:
        text = repr(value)
        if isinstance(value, float) and len(text) > 8:
            text = f"{value:.6g}"
    return text if len(text) <= 80 else f"{text[:77]}..."


def _is(kind: type, value: Any) -> bool:
    if kind is float:
        return isinstance(value, float) and math.isfinite(value)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
