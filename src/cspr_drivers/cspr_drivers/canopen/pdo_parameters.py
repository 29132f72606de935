"""Parameters of PDOs in the order in which CiA 301, section 7.5.2.36, has them written.

A PDO is taken out of use while its mapping changes: COB-ID not valid, number of objects zero, the objects, their
number; then what governs its transmission; then the COB-ID again, valid.
"""

from __future__ import annotations

from collections.abc import Collection

from cspr_drivers.canopen.frame_table import PdoLayout, TransmissionType
from cspr_drivers.canopen.object_entry import Parameter, Setting

RPDO = 0x1400  # communication parameter of the first one; mapping parameters stand 200h above
TPDO = 0x1800

NOT_VALID = 1 << 31  # bits of the COB-ID entry (CiA 301, sections 7.5.2.35 and 7.5.2.37)
NO_REMOTE_REQUEST = 1 << 30  # TPDO only

DEFAULT_PDOS = 4  # of each direction, with COB-IDs of the predefined connection set

_MAPPING = 0x200


def pdo_setting(
    communication: int,
    identifier: int,
    transmission: TransmissionType,
    layout: PdoLayout,
    event_timer: int | None = None,
) -> Setting:
    """Return how a PDO is set up.

    Parameters
    ----------
    communication
        Index of its communication parameter.
    identifier
        Its COB-ID.
    transmission
        Its transmission type.
    layout
        Its objects.
    event_timer
        Subindex 5, ms; `None` leaves it as it is.
    """
    remote = NO_REMOTE_REQUEST if communication >= TPDO else 0
    mapping = communication + _MAPPING
    valid = Parameter(communication, 1, 32, remote | identifier, "COB-ID of the PDO", mask=~NO_REMOTE_REQUEST)
    objects = tuple(
        Parameter(mapping, place, 32, value, f"mapped object {place}")
        for place, value in enumerate(layout.mapping, start=1)
    )
    count = Parameter(mapping, 0, 8, len(layout.objects), "number of mapped objects")
    how: tuple[Parameter, ...] = (Parameter(communication, 2, 8, transmission, "transmission type"),)
    if event_timer is not None:
        how += (Parameter(communication, 5, 16, event_timer, "event timer, ms"),)
    return Setting(
        result=(valid, *how, count, *objects),
        writes=(
            Parameter(communication, 1, 32, NOT_VALID | remote | identifier, "COB-ID of the PDO, not valid"),
            Parameter(mapping, 0, 8, 0, "number of mapped objects"),
            *objects,
            count,
            *how,
            valid,
        ),
    )


def default_pdos(in_use: Collection[int]) -> tuple[Parameter, ...]:
    """Return the COB-ID entries of the default PDOs that are not in use; all of them must be not valid.

    Parameters
    ----------
    in_use
        Indices of the communication parameters of those that are.
    """
    return tuple(
        Parameter(communication, 1, 32, NOT_VALID, "COB-ID of an unused PDO", mask=NOT_VALID)
        for base in (RPDO, TPDO)
        for communication in range(base, base + DEFAULT_PDOS)
        if communication not in in_use
    )


def out_of_use(entry: Parameter, found: int) -> Setting:
    """Return how to disable a PDO whose COB-ID entry holds `found`: only bit 31 may change."""
    write = Parameter(entry.index, entry.subindex, entry.bits, found | NOT_VALID, entry.meaning)
    return Setting((entry,), (write,))
