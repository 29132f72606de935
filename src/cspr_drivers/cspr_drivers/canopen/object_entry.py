"""A value of an object of a device: to be written, or to be found there."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """A value of an object.

    Attributes
    ----------
    index, subindex, bits, signed
        Place and type of the object.
    value
        The value.
    meaning
        Name of the object, for messages.
    mask
        Bits of the object that must agree with `value` when it is checked.
    repeatable
        Whether writing it twice does what writing it once does, so that a request without an answer may be
        repeated.
    """

    index: int
    subindex: int
    bits: int
    value: int
    meaning: str
    signed: bool = False
    mask: int = -1
    repeatable: bool = True

    @property
    def data(self) -> bytes:
        """The value as it is transferred."""
        return self.value.to_bytes(self.bits // 8, "little", signed=self.signed)

    def decode(self, data: bytes) -> int:
        """Return the number in the object's content."""
        return int.from_bytes(data, "little", signed=self.signed)

    def agrees(self, found: int) -> bool:
        """Return whether a number agrees with the value."""
        return found & self.mask == self.value & self.mask

    def shown(self, value: int) -> str:
        """Return a number for messages, such as ``402 (0x192)``."""
        return f"{value} (0x{value & (1 << self.bits) - 1:X})"

    def __str__(self) -> str:
        return f"{self.index:04X}h:{self.subindex:02X} ({self.meaning})"


@dataclass(frozen=True)
class Setting:
    """Objects that are set together.

    Attributes
    ----------
    result
        What must be found once they are set.
    writes
        What is written, in this order, when `result` is not found.
    """

    result: tuple[Parameter, ...]
    writes: tuple[Parameter, ...]

    @staticmethod
    def of(parameter: Parameter) -> Setting:
        """Return the setting of a single object."""
        return Setting((parameter,), (parameter,))
