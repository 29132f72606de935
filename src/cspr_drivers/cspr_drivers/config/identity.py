"""Identity of a device (CiA 301, object 1018h), by which a node id cannot be mistaken for another device."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers.config.config_section import ConfigSection

_LARGEST = 2**32 - 1


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

    vendor_id: int
    product_code: int
    revision_number: int
    serial_number: int

    @property
    def objects(self) -> dict[tuple[int, int], int]:
        """Its values by index and subindex."""
        values = (self.vendor_id, self.product_code, self.revision_number, self.serial_number)
        return {(0x1018, subindex): value for subindex, value in enumerate(values, start=1)}


def read_identity(device: ConfigSection) -> Identity | None:
    """Return the identity in the entry of a device; `None` when it is null: the device is not known yet.

    Raises
    ------
    ConfigurationError
        If the key is missing, or one of its values is.
    """
    section = device.section_or_none("identity")
    if section is None:
        return None
    identity = Identity(
        vendor_id=section.integer("vendor_id", 0, _LARGEST),
        product_code=section.integer("product_code", 0, _LARGEST),
        revision_number=section.integer("revision_number", 0, _LARGEST),
        serial_number=section.integer("serial_number", 0, _LARGEST),
    )
    section.finish()
    return identity
