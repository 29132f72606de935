"""A CANopen device without an application: NMT slave, SDO server, PDOs, heartbeat, emergency (CiA 301)."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import can
import canopen
from canopen.objectdictionary import ODVariable
from canopen.sdo import SdoAbortedError

from cspr_drivers.canopen.frame_table import NMT_COB_ID, FunctionCode, cob_id
from cspr_drivers.canopen.nmt import NmtCommand, NmtState
from cspr_drivers.errors import FrameError
from cspr_drivers.simulation.devices.canopen_codes import EmergencyCode, SdoAbort
from cspr_drivers.simulation.devices.error_log import ErrorLog
from cspr_drivers.simulation.devices.heartbeat import HeartbeatConsumer, HeartbeatProducer
from cspr_drivers.simulation.devices.pdo_configuration import Direction, PdoConfiguration, find_object
from cspr_drivers.simulation.devices.process_data import ReceivePdo, TransmitPdo
from cspr_drivers.simulation.plant.shared import SharedPlant

_EMERGENCY_FRAME = struct.Struct("<HB5x")  # error code, error register, manufacturer's field

# Error behaviour, object 1029h:01: NMT state after a communication error; 1 leaves it as it is.
_STATE_AFTER_ERROR = {0: NmtState.PRE_OPERATIONAL, 2: NmtState.STOPPED}

_NMT_STATES = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
    NmtCommand.RESET_NODE: NmtState.PRE_OPERATIONAL,
    NmtCommand.RESET_COMMUNICATION: NmtState.PRE_OPERATIONAL,
}


class EmulatedNode(canopen.LocalNode):  # type: ignore[misc]  # canopen's classes count as untyped
    """Base of the emulated devices.

    The device lives by frames and ticks: frames come from the canopen network it is added to and take the
    lock of the shared plant; `sync` and `tick` are called by the owner of the clock, with the lock held. Its
    objects are stored values, or live ones: those for which `readers` or `writers` hold a function.

    Parameters
    ----------
    node_id
        CANopen node id.
    eds
        File of its object dictionary.
    machine
        The machine that the device is a part of.
    nameplate
        Values of objects, by index and subindex, in which this device differs from its EDS file.

    Attributes
    ----------
    nmt_state
        Present NMT state.
    readers, writers
        Functions of the live objects, by index and subindex.
    disconnected, pdos_missing, heartbeat_missing, sdo_cut, doubled
        Injected faults: the device is off the bus and neither hears nor is heard, it sends no TPDOs, or no
        heartbeat; its SDO answers end after two bytes; another one with its node id answers each SYNC after it, and
        always the same.
    """

    def __init__(
        self,
        node_id: int,
        eds: Path,
        machine: SharedPlant,
        nameplate: Mapping[tuple[int, int], int],
    ) -> None:
        super().__init__(node_id, str(eds))
        self.nmt_state = NmtState.BOOT_UP
        self.disconnected = self.pdos_missing = self.heartbeat_missing = self.sdo_cut = False
        self.sdo.send_response = self._answer_sdo
        self._machine = machine
        self._nameplate = dict(nameplate)
        self._errors = ErrorLog()
        self._heartbeat = HeartbeatProducer()
        self._master = HeartbeatConsumer()
        self._pdo_configuration = PdoConfiguration(self.object_dictionary, self.value)
        self._receive_pdos: dict[int, ReceivePdo] = {}
        self._transmit_pdos: list[TransmitPdo] = []
        self._of_the_other: list[bytes] = []  # what a second device with this node id answers
        self._request_time = 0.0  # plant time of the SDO request being served
        self.readers: dict[tuple[int, int], Callable[[], int]] = {
            (0x1001, 0): lambda: self._errors.register,
            (0x1003, 0): lambda: len(self._errors.history),
            (0x1016, 1): lambda: self._master.value,
            (0x1017, 0): lambda: self._heartbeat.milliseconds,
        }
        self.add_read_callback(self._read_live)
        for place in range(len(self.object_dictionary[0x1003]) - 1):
            self.readers[0x1003, place + 1] = partial(self._past_error, place)
        self.writers: dict[tuple[int, int], Callable[[int], None]] = {
            (0x1003, 0): self._clear_error_history,
            (0x1016, 1): self._watch_heartbeat,
            (0x1017, 0): self._heartbeat.produce,
        }

    # What an application adds

    @property
    def mapping_locked(self) -> bool:
        """Whether the state of the application forbids a change of PDO mappings."""
        return False

    def latch(self) -> None:
        """Take the measured values that the next TPDOs carry; the plant stands at their time."""

    def applied(self, time: float) -> None:
        """Act on the objects of an RPDO, or the one of an SDO request, now that all of them are written."""

    def connection_lost(self, code: EmergencyCode, time: float) -> None:
        """React to a silent master; called again at every tick while its heartbeat is missing."""

    def restart(self, time: float) -> None:
        """Take the live objects of the application to their values after power-on."""

    # Object dictionary

    def value(self, index: int, subindex: int = 0) -> int:
        """Return the present value of an object that is a number."""
        return int(self._find_object(index, subindex).decode_raw(self.get_data(index, subindex)))

    def _read_live(self, index: int, subindex: int, od: ODVariable) -> int | None:
        """Return the value of a live object; canopen asks for it before it looks for a stored one."""
        reader = self.readers.get((index, subindex))
        return None if reader is None else reader()

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        """Write an object as an SDO client asks, or refuse with `canopen.SdoAbortedError`."""
        entry: ODVariable = self._find_object(index, subindex)
        if check_writable and not entry.writable:
            raise SdoAbortedError(SdoAbort.READ_ONLY)
        if 8 * len(data) > len(entry):
            raise SdoAbortedError(SdoAbort.DATA_TOO_LONG)
        if 8 * len(data) < len(entry):
            raise SdoAbortedError(SdoAbort.DATA_TOO_SHORT)
        value = int(entry.decode_raw(bytes(data)))
        if entry.max is not None and value > entry.max:
            raise SdoAbortedError(SdoAbort.VALUE_TOO_HIGH)
        if entry.min is not None and value < entry.min:
            raise SdoAbortedError(SdoAbort.VALUE_TOO_LOW)
        self._pdo_configuration.check(index, subindex, value, self.mapping_locked)
        self._writer(index, subindex)(value)
        if self._pdo_configuration.covers(index):
            self._install_pdos()
        self.applied(self._request_time)

    def _find_object(self, index: int, subindex: int) -> ODVariable:
        return find_object(self.object_dictionary, index, subindex)

    def _reader(self, index: int, subindex: int) -> Callable[[], int]:
        return self.readers.get((index, subindex)) or (lambda: self.value(index, subindex))

    def _writer(self, index: int, subindex: int) -> Callable[[int], None]:
        return self.writers.get((index, subindex)) or (lambda value: self._store(index, subindex, value))

    def _store(self, index: int, subindex: int, value: int) -> None:
        data = bytes(self._find_object(index, subindex).encode_raw(value))
        self.data_store.setdefault(index, {})[subindex] = data

    # Network and NMT

    def associate_network(self, network: canopen.Network) -> None:
        """Join a network as `canopen.LocalNode` does, but serve NMT and SDO by this device's own state."""
        super().associate_network(network)
        network.unsubscribe(NMT_COB_ID, self.nmt.on_command)
        network.unsubscribe(self.sdo.rx_cobid, self.sdo.on_request)
        network.subscribe(NMT_COB_ID, self._on_nmt)
        network.subscribe(self.sdo.rx_cobid, self._on_sdo)

    def power_on(self) -> None:
        """Boot: announce the device and wait, pre-operational, for a master."""
        with self._machine.lock:
            self._boot(first_kept_index=0x10000)

    def _boot(self, first_kept_index: int) -> None:
        self.nmt_state = NmtState.BOOT_UP
        for index in [index for index in self.data_store if index < first_kept_index]:
            del self.data_store[index]
        for (index, subindex), value in self._nameplate.items():
            self._store(index, subindex, value)
        self._heartbeat.produce(0)
        self._watch_heartbeat(0)
        self._install_pdos()
        self._send(cob_id(FunctionCode.HEARTBEAT, self.id), bytes([NmtState.BOOT_UP]))
        self.nmt_state = NmtState.PRE_OPERATIONAL

    def _on_nmt(self, _can_id: int, data: bytearray, timestamp: float) -> None:
        with self._machine.lock:
            if (
                self.disconnected
                or len(data) < 2
                or data[0] not in _NMT_STATES
                or data[1] not in (0, self.id)
            ):
                return
            command = NmtCommand(data[0])
            time = self._machine.time_at(timestamp)
            state = _NMT_STATES[command]
            if self.nmt_state is NmtState.OPERATIONAL and state is not NmtState.OPERATIONAL:
                self.connection_lost(EmergencyCode.COMMUNICATION, time)
            self.nmt_state = state
            if command is NmtCommand.RESET_NODE:
                self.restart(time)
                self._boot(first_kept_index=0x10000)
            elif command is NmtCommand.RESET_COMMUNICATION:
                self._boot(first_kept_index=0x2000)

    def _send(self, can_id: int, data: bytes) -> None:
        if self.disconnected:
            return
        # As on a real bus: a frame that nobody takes is lost, and its producer carries on.
        with contextlib.suppress(can.CanError):
            self.network.send_message(can_id, data)

    def _on_sdo(self, can_id: int, data: bytearray, timestamp: float) -> None:
        with self._machine.lock:
            if self.nmt_state is not NmtState.STOPPED and len(data) == 8 and not self.disconnected:
                self._request_time = self._machine.time_at(timestamp)
                self._machine.advance(self._request_time)
                self.latch()
                self.sdo.on_request(can_id, data, timestamp)

    def _answer_sdo(self, answer: bytes) -> None:
        self._send(self.sdo.tx_cobid, answer[:2] if self.sdo_cut else answer)

    # Process data

    def _install_pdos(self) -> None:
        """Build the PDOs that the parameters now describe, and listen to those received."""
        for can_id in self._receive_pdos:
            self.network.unsubscribe(can_id, self._on_rpdo)
        self._receive_pdos = {
            pdo.cob_id: ReceivePdo(pdo, tuple(self._writer(o.index, o.subindex) for o in pdo.layout.objects))
            for pdo in self._pdo_configuration.active(Direction.RECEIVE)
        }
        for can_id in self._receive_pdos:
            self.network.subscribe(can_id, self._on_rpdo)
        self._transmit_pdos = [
            TransmitPdo(pdo, tuple(self._reader(o.index, o.subindex) for o in pdo.layout.objects))
            for pdo in self._pdo_configuration.active(Direction.TRANSMIT)
        ]

    def _on_rpdo(self, can_id: int, data: bytearray, timestamp: float) -> None:
        machine = self._machine
        time = machine.time_at(timestamp)
        if machine.arrive(time, partial(self._receive, can_id, data, time)) >= machine.inputs_at_once:
            with machine.lock:
                machine.apply_arrived(time)

    def _receive(self, can_id: int, data: bytearray, time: float) -> None:
        pdo = self._receive_pdos.get(can_id)
        if pdo is None or self.nmt_state is not NmtState.OPERATIONAL or self.disconnected:
            return
        try:
            values = pdo.receive(data, time)
        except FrameError:
            self.emergency(EmergencyCode.PDO_LENGTH)
            return
        for writer, value in zip(pdo.writers, values, strict=True):
            try:
                writer(value)
            except SdoAbortedError:
                self.emergency(EmergencyCode.PROTOCOL)
        self.applied(time)

    def sync(self) -> None:
        """Answer a SYNC; the plant stands at its time."""
        if self.nmt_state is NmtState.OPERATIONAL:
            self.latch()
            self.answer()

    def answer(self) -> None:
        """Send what was latched at the last SYNC."""
        if self.nmt_state is not NmtState.OPERATIONAL:
            return
        answers = [pdo.on_sync() for pdo in self._transmit_pdos if pdo.synchronous]
        for message in answers:
            self._transmit(message)
        for message, data in zip(answers, self._of_the_other, strict=False):
            message.assign(data)
            self._transmit(message)

    @property
    def doubled(self) -> bool:
        """Whether another device with this node id answers as well."""
        return bool(self._of_the_other)

    @doubled.setter
    def doubled(self, doubled: bool) -> None:
        synchronous = [pdo for pdo in self._transmit_pdos if pdo.synchronous] if doubled else []
        self._of_the_other = [bytes(pdo.on_sync().data) for pdo in synchronous]

    def _transmit(self, message: can.Message | None) -> None:
        if message is None or self.disconnected or self.pdos_missing:
            return
        with contextlib.suppress(can.CanError), self.network.send_lock:
            self.network.bus.send(message)

    # Time

    def tick(self, time: float, supervise: bool = True) -> None:
        """Do what is due at a plant time, s: heartbeat, watch over the master, event-driven TPDOs.

        Parameters
        ----------
        time
            Present plant time.
        supervise
            Whether silence of the master counts; not when the caller was held up, as frames may wait unread.
        """
        if self._heartbeat.due(time) and not self.heartbeat_missing:
            self._send(cob_id(FunctionCode.HEARTBEAT, self.id), bytes([self.nmt_state]))
        if supervise:
            self._supervise(time)
        events = [pdo for pdo in self._transmit_pdos if not pdo.synchronous]
        if events and self.nmt_state is NmtState.OPERATIONAL:
            self.latch()
            for pdo in events:
                self._transmit(pdo.on_event(time))

    def _supervise(self, time: float) -> None:
        if self._master.missing(time):
            self.connection_lost(EmergencyCode.HEARTBEAT, time)
            if self.nmt_state is NmtState.OPERATIONAL:
                self.nmt_state = _STATE_AFTER_ERROR.get(self.value(0x1029, 1), self.nmt_state)
        for pdo in self._receive_pdos.values():
            if pdo.overdue(time):
                self.connection_lost(EmergencyCode.RPDO_TIMEOUT, time)

    def _watch_heartbeat(self, value: int) -> None:
        node_id, milliseconds = value >> 16, value & 0xFFFF
        if node_id > 127:
            raise SdoAbortedError(SdoAbort.INVALID_VALUE)
        if self._master.node_id:
            self.network.unsubscribe(FunctionCode.HEARTBEAT + self._master.node_id, self._on_heartbeat)
        self._master.watch(node_id, milliseconds)
        if self._master.node_id:
            self.network.subscribe(FunctionCode.HEARTBEAT + self._master.node_id, self._on_heartbeat)

    def _on_heartbeat(self, _can_id: int, _data: bytearray, timestamp: float) -> None:
        if self.disconnected:
            return
        with self._machine.lock:
            self._master.received(self._machine.time_at(timestamp))

    # Errors

    def emergency(self, code: EmergencyCode) -> None:
        """Report an error by an emergency frame, and keep it in the error history."""
        if self._errors.report(code):
            self._send_emergency(code)

    def errors_over(self) -> None:
        """Report that no error is present."""
        if self._errors.over():
            self._send_emergency(EmergencyCode.NO_ERROR)

    def _send_emergency(self, code: EmergencyCode) -> None:
        if self.nmt_state in (NmtState.OPERATIONAL, NmtState.PRE_OPERATIONAL):
            frame = _EMERGENCY_FRAME.pack(code, self._errors.register)
            self._send(cob_id(FunctionCode.EMERGENCY, self.id), frame)

    def _past_error(self, place: int) -> int:
        if place >= len(self._errors.history):
            raise SdoAbortedError(SdoAbort.NO_DATA)
        return self._errors.history[place]

    def _clear_error_history(self, value: int) -> None:
        if value:
            raise SdoAbortedError(SdoAbort.INVALID_VALUE)
        self._errors.history = []
