"""A device on the bus as the master sees it: its objects by SDO, its NMT state, heartbeat and emergencies."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import Enum
from typing import TypeVar

import can
import canopen

from cspr_drivers import clock
from cspr_drivers.can_bus import CanPort
from cspr_drivers.device_parameters import Parameter
from cspr_drivers.errors import DeviceError

BOOT_UP = 0  # NMT state in the heartbeat of a device that has just started (CiA 301, section 7.2.8.3.3)


_T = TypeVar("_T")


class NmtCommand(Enum):
    """NMT commands in use; the value is canopen's name of the state they lead to."""

    START = "OPERATIONAL"
    ENTER_PRE_OPERATIONAL = "PRE-OPERATIONAL"


class CanopenDevice:
    """Master's end of one device.

    Parameters
    ----------
    name
        Name for messages, such as ``motor_3 (node 3 on main)``.
    port
        Bus that it is on.
    node_id
        Its node id.
    sdo_timeout
        Longest wait for an SDO answer, s.
    on_boot, on_emergency
        Called in the receiving thread when it restarts, and with the error code of each emergency message.
    """

    def __init__(
        self,
        name: str,
        port: CanPort,
        node_id: int,
        sdo_timeout: float,
        on_boot: Callable[[], None],
        on_emergency: Callable[[int], None] | None = None,
    ) -> None:
        self.name = name
        self._heartbeat = clock.monotonic()
        self._on_boot = on_boot
        # Objects are addressed by index, so the master needs no object dictionary of the device.
        self._node = canopen.RemoteNode(node_id, canopen.ObjectDictionary())
        port.network.add_node(self._node)
        self._node.sdo.RESPONSE_TIMEOUT = sdo_timeout
        self._node.nmt.add_heartbeat_callback(self._heard)
        self._on_emergency = on_emergency
        self._node.emcy.add_callback(self._emergency)

    def check(self, expected: Iterable[Parameter]) -> None:
        """Read objects and compare them.

        Raises
        ------
        DeviceError
            If the device does not answer, lacks an object, or one has another value than expected.
        """
        for parameter in expected:
            data = self._transfer(parameter, lambda p: self._node.sdo.upload(p.index, p.subindex), "read")
            if not parameter.agrees(data):
                found = int.from_bytes(data, "little", signed=parameter.signed)
                raise DeviceError(
                    self.name,
                    f"{parameter} is {found} (0x{found & 0xFFFFFFFF:X}), expected {parameter.value}",
                )

    def write(self, parameters: Iterable[Parameter]) -> None:
        """Write objects in order.

        Raises
        ------
        DeviceError
            If the device does not answer or refuses one.
        """
        for parameter in parameters:
            self._transfer(
                parameter,
                lambda p: self._node.sdo.download(p.index, p.subindex, p.data),
                f"= {parameter.value}",
            )

    def wait_for(self, expected: Parameter) -> None:
        """Read an object until it has a value, for as long as an SDO answer may take.

        Raises
        ------
        DeviceError
            As `check`, if it does not come to have it.
        """
        deadline = clock.monotonic() + self._node.sdo.RESPONSE_TIMEOUT
        while True:
            try:
                self.check((expected,))
            except DeviceError:
                if clock.monotonic() > deadline:
                    raise
                clock.sleep(0.01)
            else:
                return

    def command(self, command: NmtCommand) -> None:
        """Send an NMT command; it is not confirmed.

        Raises
        ------
        DeviceError
            If the bus does not take the frame.
        """
        try:
            self._node.nmt.state = command.value
        except can.CanError as error:
            raise DeviceError(self.name, f"cannot be sent an NMT command: {error}") from None

    def heartbeat_age(self, now: float) -> float:
        """Return the time since the last heartbeat, s."""
        return now - self._heartbeat

    def expect_heartbeat(self, now: float) -> None:
        """Count the heartbeat's age from `now`: the device has just been told to send it."""
        self._heartbeat = now

    def _heard(self, state: int) -> None:
        self._heartbeat = clock.monotonic()
        if state == BOOT_UP:
            self._on_boot()

    def _emergency(self, emergency: canopen.emcy.EmcyError) -> None:
        self._node.emcy.reset()  # canopen keeps all of them, for ever
        if self._on_emergency is not None:
            self._on_emergency(emergency.code)

    def _transfer(self, parameter: Parameter, transfer: Callable[[Parameter], _T], what: str) -> _T:
        try:
            return transfer(parameter)
        except canopen.SdoAbortedError as error:
            raise DeviceError(self.name, f"refuses {parameter} {what}: {abort_text(error.code)}") from None
        except canopen.SdoCommunicationError:
            raise DeviceError(self.name, "does not answer") from None
        except can.CanError as error:
            raise DeviceError(self.name, f"cannot be reached: {error}") from None


def abort_text(code: int) -> str:
    """Return an SDO abort code in words."""
    words = canopen.SdoAbortedError.CODES.get(code, "abort code of the manufacturer")
    return f"{words} (abort code 0x{code:08X})"
