"""Identity of a device (CiA 301, object 1018h), by which a node id cannot be mistaken for another device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

_Word = Annotated[int, Meta(ge=0, le=2**32 - 1)]


@dataclass(frozen=True)
class Identity:
    """Content of the identity object.

    Attributes
    ----------
    vendor_id, product_code, serial_number
        Subindices 1, 2 and 4.
    revision_number
        Subindex 3. Its high word is the major revision, which changes with the behaviour on the bus; the low
        word, the minor revision, is of no consequence.
    """

    vendor_id: _Word
    product_code: _Word
    revision_number: _Word
    serial_number: _Word

    @property
    def objects(self) -> dict[tuple[int, int], int]:
        """Its values by index and subindex."""
        values = (self.vendor_id, self.product_code, self.revision_number, self.serial_number)
        return {(0x1018, subindex): value for subindex, value in enumerate(values, start=1)}
