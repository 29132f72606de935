"""Which devices are on the buses, and what they report about themselves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import can

from cspr_drivers.bus.can_bus import CanPort
from cspr_drivers.canopen import cia402, cia404
from cspr_drivers.canopen.frame_table import FunctionCode, cob_id
from cspr_drivers.canopen.object_entry import Parameter
from cspr_drivers.config.identity import Identity
from cspr_drivers.devices.device import CanopenDevice
from cspr_drivers.errors import BusError, DeviceError

_UPLOAD_DEVICE_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")  # CiA 301, section 7.2.4.3.5, of 1000h
_PAUSE = 0.001  # s between two requests, so that no send buffer overflows


@dataclass(frozen=True)
class FoundDevice:
    """A device as it was found.

    Attributes
    ----------
    bus, node_id
        Where.
    profile
        Number of its CiA profile: 402 for drives, 404 for load-cell amplifiers.
    identity
        Content of its identity object.
    """

    bus: str
    node_id: int
    profile: int
    identity: Identity

    def __str__(self) -> str:
        kind = {cia402.DEVICE_PROFILE: "drive", cia404.DEVICE_PROFILE: "load-cell amplifier"}.get(
            self.profile, f"device of profile {self.profile}"
        )
        who = self.identity
        return (
            f"{kind} at node {self.node_id} on {self.bus}: vendor 0x{who.vendor_id:X}, product "
            f"0x{who.product_code:X}, revision 0x{who.revision_number:X}, serial number {who.serial_number}"
        )


def scan(port: CanPort, master_node_id: int, wait: float) -> list[FoundDevice]:
    """Ask every node id for its device type, and who answers for its identity.

    Parameters
    ----------
    port
        The bus.
    master_node_id
        Node id of the driver, which is not asked.
    wait
        Time for the answers, s.

    Raises
    ------
    BusError
        If the bus takes no frames: nobody is there to acknowledge them, or it is not wired.
    """
    nodes = [node for node in range(1, 128) if node != master_node_id]
    answered: set[int] = set()
    for node in nodes:
        identifier = cob_id(FunctionCode.SDO_RESPONSE, node)
        port.network.subscribe(identifier, lambda number, *_: answered.add(number & 0x7F))
    try:
        for node in nodes:
            frame = can.Message(
                arbitration_id=cob_id(FunctionCode.SDO_REQUEST, node),
                data=_UPLOAD_DEVICE_TYPE,
                is_extended_id=False,
            )
            if not port.send(frame):
                raise BusError(f"CAN bus {port.name} takes no frames: {port.last_problem}")
            port.clock.sleep(_PAUSE)
        port.clock.sleep(wait)
    finally:
        for node in nodes:
            port.network.unsubscribe(cob_id(FunctionCode.SDO_RESPONSE, node))
    return list(_described(port, sorted(answered), wait))


def _described(port: CanPort, nodes: list[int], timeout: float) -> Iterator[FoundDevice]:
    for node in nodes:
        device = CanopenDevice(f"node {node} on {port.name}", port, node, timeout)
        try:
            profile = device.read(Parameter(0x1000, 0, 32, 0, "device type")) & 0xFFFF
            values = [
                device.read_if_present(Parameter(0x1018, subindex, 32, 0, "identity")) or 0
                for subindex in range(1, 5)
            ]
        except DeviceError:
            continue  # it fell silent meanwhile
        finally:
            device.release()
        yield FoundDevice(port.name, node, profile, Identity(*values))
