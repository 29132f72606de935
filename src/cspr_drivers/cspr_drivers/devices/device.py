"""A device on the bus as the master sees it: its objects by SDO, its NMT state, heartbeat and emergencies."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping
from queue import Empty
from typing import Any

import can
import canopen
from canopen.sdo.exceptions import SdoError

from cspr_drivers.bus.can_bus import CanPort
from cspr_drivers.canopen.nmt import NmtCommand, NmtState, nmt_state_text
from cspr_drivers.canopen.object_entry import Parameter, Setting
from cspr_drivers.clock import Clock
from cspr_drivers.config.timeouts import Timeouts
from cspr_drivers.errors import DeviceError

# For a request that does no harm when the device has carried it out and only the answer was lost.
_ATTEMPTS = 2

# Abort codes with which a device says that it does not have an object (CiA 301, section 7.2.4.3.17).
_ABSENT = (0x0602_0000, 0x0609_0011)

# Bytes of every SDO message, the first one of those that abort a transfer, and the command specifiers of requests that
# go on with one, segment by segment (CiA 301, section 7.2.4.3).
_SDO_SIZE, _ABORTED, _SEGMENT = 8, 0x80, (0, 3)
_SEGMENTS = 16  # of an object: those of a driver have a few bytes; what does not come to an end is no content


class _SdoClient(canopen.sdo.SdoClient):  # type: ignore[misc]  # canopen's classes count as untyped
    """An SDO client that waits for answers by the clock of the machine."""

    def __init__(self, node_id: int, clock: Clock, timeout: float) -> None:
        super().__init__(0x600 + node_id, 0x580 + node_id, canopen.ObjectDictionary())
        self._clock = clock
        self._timeout = timeout
        self._segments = 0

    def request_response(self, request: bytes) -> bytes:
        """Return the answer to a request, as canopen's own client does; refuse an object without end."""
        self._segments = self._segments + 1 if request[0] >> 5 in _SEGMENT else 0
        if self._segments > _SEGMENTS:
            self.abort()
            raise SdoError(f"its content has more than {7 * _SEGMENTS} bytes")
        answer: bytes = super().request_response(request)
        return answer

    def read_response(self) -> bytes:
        """Return the answer to a request, as canopen's own client does; refuse one that is cut off."""
        try:
            answer: bytes = self._clock.take(self.responses, self._timeout)
        except Empty:
            raise _NoAnswer from None
        if len(answer) < _SDO_SIZE:
            raise SdoError(f"it answers with {_content(answer)}, not {_SDO_SIZE}")
        if answer[0] == _ABORTED:
            raise canopen.SdoAbortedError(int.from_bytes(answer[4:], "little"))
        return answer


class _NoAnswer(canopen.SdoCommunicationError):  # type: ignore[misc]
    """No answer came in time."""


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
        Called in the receiving thread when it restarts, and with error code, error register and the
        manufacturer's five bytes of each emergency message.

    Attributes
    ----------
    clock
        Clock of the machine, as of the bus.

    Raises
    ------
    DeviceError
        From all methods that read, write or send a command: if the device does not answer, refuses, or answers with
        other than the bytes that the object has, or the bus does not take the frame.
    """

    def __init__(
        self,
        name: str,
        port: CanPort,
        node_id: int,
        sdo_timeout: float,
        on_boot: Callable[[], None] = lambda: None,
        on_emergency: Callable[[int, int, bytes], None] | None = None,
    ) -> None:
        self.name = name
        self.clock = port.clock
        self._heartbeat = self.clock.monotonic()
        self._started: float | None = None
        self._nmt_state: int | None = None
        self._on_boot = on_boot
        self._sdo_timeout = sdo_timeout
        # Objects are addressed by index, so the master needs no object dictionary of the device.
        self._node = canopen.RemoteNode(node_id, canopen.ObjectDictionary())
        self._node.sdo = _SdoClient(node_id, port.clock, sdo_timeout)
        self._node.sdo_channels[:] = [self._node.sdo]
        self._network = port.network
        self._network.add_node(self._node)
        self._node.nmt.add_heartbeat_callback(self._heard)
        self._on_emergency = on_emergency
        self._node.emcy.add_callback(self._emergency)

    def release(self) -> None:
        """Stop listening to the device."""
        if self._network.nodes.get(self._node.id) is self._node:
            del self._network[self._node.id]

    # Objects

    def read(self, parameter: Parameter) -> int:
        """Return the number in an object; the parameter's value does not matter."""
        data = self._transfer(parameter, "read", _ATTEMPTS, self._node.sdo.upload)
        # Some devices answer with 4 bytes whatever the object has.
        if not parameter.bits <= 8 * len(data) <= 32:
            raise DeviceError(
                self.name, f"{parameter} read: its content is {_content(data)}, not {parameter.bits // 8}"
            )
        return parameter.decode(data)

    def read_if_present(self, parameter: Parameter) -> int | None:
        """Return the number in an object, `None` if the device has no such object."""
        try:
            return self.read(parameter)
        except DeviceError as error:
            if isinstance(error.__cause__, canopen.SdoAbortedError) and error.__cause__.code in _ABSENT:
                return None
            raise

    def check(self, expected: Iterable[Parameter], error: type[DeviceError] = DeviceError) -> None:
        """Read objects and raise `error`, such as WrongDeviceError, with both values, if one is not as expected."""
        for parameter in expected:
            found = self.read(parameter)
            if not parameter.agrees(found):
                raise error(
                    self.name,
                    f"{parameter} is {parameter.shown(found)}, expected {parameter.shown(parameter.value)}",
                )

    def differing(self, settings: Iterable[Setting]) -> list[Setting]:
        """Return the settings of which some object does not have its value yet."""
        return [s for s in settings if not all(entry.agrees(self.read(entry)) for entry in s.result)]

    def write(self, parameter: Parameter) -> None:
        """Write an object."""
        attempts = _ATTEMPTS if parameter.repeatable else 1
        self._transfer(parameter, f"= {parameter.value}", attempts, self._node.sdo.download, parameter.data)

    def set(self, settings: Iterable[Setting]) -> None:
        """Write settings in order, and read each back; raises DeviceError also if one is not kept."""
        for setting in settings:
            for parameter in setting.writes:
                self.write(parameter)
            self.check(setting.result)

    def wait_for(self, expected: Parameter) -> None:
        """Read an object until it has a value, for as long as an SDO answer may take; raises as `check` after that."""
        deadline = self.clock.monotonic() + self._sdo_timeout
        while True:
            try:
                self.check((expected,))
            except DeviceError:
                if self.clock.monotonic() > deadline:
                    raise
                self.clock.sleep(0.01)
            else:
                return

    # Network management

    def command(self, command: NmtCommand) -> None:
        """Send an NMT command; it is not confirmed, but the heartbeat shows its effect."""
        self._started = None
        try:
            self._node.nmt.send_command(command)
        except can.CanError as error:
            raise DeviceError(self.name, f"cannot be sent an NMT command: {error}") from None

    def start(self) -> None:
        """Send the command to start, and count the heartbeat's age from now on."""
        self._heartbeat = self.clock.monotonic()
        self.command(NmtCommand.START)
        self._started = self.clock.monotonic()

    def leave_stopped(self) -> None:
        """Let a stopped device answer SDO requests again (CiA 301, section 7.3.2.2.4)."""
        if self._nmt_state == NmtState.STOPPED:
            self.command(NmtCommand.ENTER_PRE_OPERATIONAL)

    def heartbeat_age(self, now: float) -> float:
        """Return the time since the last heartbeat, s."""
        return now - self._heartbeat

    def problem(self, now: float, times: Timeouts) -> str:
        """Return, in words, that the device is silent or has left NMT operational; empty when all is well."""
        age = self.heartbeat_age(now)
        if age > times.heartbeat_consumer:
            return f"no heartbeat for {1e3 * age:.0f} ms"
        started, state = self._started, self._nmt_state
        if started is None or state is None or state == NmtState.OPERATIONAL:
            return ""
        if self._heartbeat < started + times.heartbeat_producer:
            return ""  # it may be older than the start
        return f"left NMT operational, it is {nmt_state_text(state)}"

    @property
    def nmt_state(self) -> str:
        """NMT state of the last heartbeat, in words."""
        return nmt_state_text(self._nmt_state)

    def _heard(self, state: int) -> None:
        self._heartbeat = self.clock.monotonic()
        self._nmt_state = state
        if state == NmtState.BOOT_UP:
            self._started = None
            self._on_boot()

    def _emergency(self, emergency: canopen.emcy.EmcyError) -> None:
        self._node.emcy.reset()  # canopen keeps all of them forever
        if self._on_emergency is not None:
            self._on_emergency(emergency.code, emergency.register, emergency.data)

    # Transfers

    def _transfer(
        self, parameter: Parameter, what: str, attempts: int, transfer: Callable[..., Any], *data: bytes
    ) -> Any:
        while True:
            attempts -= 1
            try:
                return transfer(parameter.index, parameter.subindex, *data)
            except canopen.SdoAbortedError as error:
                problem = f"refuses {parameter} {what}: {abort_text(error.code)}"
                raise DeviceError(self.name, problem) from error
            except SdoError as error:
                if isinstance(error, canopen.SdoCommunicationError) and attempts:
                    continue
                problem = (
                    "does not answer" if isinstance(error, _NoAnswer) else f"{parameter} {what}: {error}"
                )
                raise DeviceError(self.name, problem) from error
            except can.CanError as error:
                raise DeviceError(self.name, f"cannot be reached: {error}") from None


def _content(data: bytes) -> str:
    """Return bytes for messages, such as ``2 bytes (43 41)``."""
    number = f"{len(data)} byte{'' if len(data) == 1 else 's'}"
    return f"{number} ({data.hex(' ')})" if data else number


def leave_operational(devices: Iterable[CanopenDevice]) -> None:
    """Let devices leave NMT operational, as far as the bus takes frames; they notice the missing heartbeat anyway."""
    with contextlib.suppress(DeviceError):
        for device in devices:
            device.command(NmtCommand.ENTER_PRE_OPERATIONAL)


def in_words(problems: Mapping[str, str]) -> str:
    """Return what is wrong with which device; those with the same problem together."""
    names: dict[str, list[str]] = {}
    for name, problem in problems.items():
        names.setdefault(problem, []).append(name)
    return "; ".join(f"{', '.join(concerned)}: {problem}" for problem, concerned in names.items())


def abort_text(code: int) -> str:
    """Return an SDO abort code in words."""
    words = canopen.SdoAbortedError.CODES.get(code, "abort code of the manufacturer")
    return f"{words} (abort code 0x{code:08X})"
