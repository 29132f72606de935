"""Faults of the emulated machine by name: what an engineer would do with pliers, a hot-air gun and a lever.

What each fault ends in is in docs/operation.md, and what it costs in height in its section "What each fault does".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Protocol

from cspr_drivers.errors import DriverError
from cspr_drivers.simulation.bus.bus_timing import BusDisturbance
from cspr_drivers.simulation.devices.canopen_codes import EmergencyCode
from cspr_drivers.simulation.devices.drive import DriveEmulator
from cspr_drivers.simulation.devices.encoder import Encoder
from cspr_drivers.simulation.devices.load_cell import LoadCellEmulator
from cspr_drivers.simulation.plant.shared import SharedPlant
from cspr_kinematics.configuration.structure import did_you_mean

_DRIFT = 200.0  # N/s: some fifth of a tension each second
_SHIFT = 60.0  # N
_WEAK_BRAKE = 0.05  # share of the holding torque
_ENCODER_DRIFT = 2.0  # rad/s
_ENCODER_STEP = 5  # revolutions
_SLACK = 0.05  # m paid out by a cable that slips off its drum's groove


class FaultTarget(Enum):
    """What a fault is injected into; the value is how targets are called."""

    MOTOR = "motor_K"
    CABLE = "cable_K"
    BUS = "a bus of can.yaml"
    ROBOT = "robot"


class InjectedFault(Enum):
    """Faults by name, which is the value, and with their meaning in words."""

    DRIVE_SILENT = "drive_silent", "its bus connector is unplugged"
    DRIVE_NO_FEEDBACK = "drive_no_feedback", "it sends no TPDOs; all else goes on"
    DRIVE_NO_HEARTBEAT = "drive_no_heartbeat", "it sends no heartbeat; all else goes on"
    DRIVE_RESET = "drive_reset", "its supply fails for a moment, and it boots"
    DRIVE_FAULT = "drive_fault", "overtemperature of its power stage: fault"
    DRIVE_EMERGENCY = "drive_emergency", "it reports undervoltage by EMCY and goes on"
    DRIVE_WRONG_MODE = "drive_wrong_mode", "it leaves cyclic synchronous torque mode on its own"
    DRIVE_RUNAWAY = "drive_runaway", "it applies its full torque, paying out"
    DRIVE_PULLING = "drive_pulling", "it applies three fifths of its torque, winding in"
    WINCH_BLOCKED = "winch_blocked", "the brake holds although the drive says that it is open"
    ENCODER_FROZEN = "encoder_frozen", "the encoder shows the same angle for ever"
    ENCODER_DRIFT = "encoder_drift", f"the encoder turns against its shaft at {_ENCODER_DRIFT:g} rad/s"
    ENCODER_JUMP = (
        "encoder_jump",
        f"its position value steps by {_ENCODER_STEP} revolutions, its motor does not",
    )
    ENCODER_WRAP = "encoder_wrap", "its position counter goes once round its 32 bits: no fault of anything"
    SHORT_SDO = "short_sdo", "it boots, as after a failure of its supply, and its SDO answers are cut off"
    DUPLICATE_NODE = "duplicate_node", "another drive with its node id answers as well"
    BRAKE_WEAK = "brake_weak", "the brake holds a twentieth of its torque from the next time it closes"
    BRAKE_SLIP = "brake_slip", "the brake holds no more than a twentieth of its torque, closed or not"
    LOAD_CELL_SILENT = "load_cell_silent", "its amplifier is unplugged"
    LOAD_CELL_SATURATED = "load_cell_saturated", "its amplifier reports overload"
    LOAD_CELL_STUCK = "load_cell_stuck", "its value no longer changes"
    LOAD_CELL_DRIFTING = "load_cell_drifting", f"its zero drifts by {_DRIFT:g} N per second"
    LOAD_CELL_OFFSET = "load_cell_offset", f"it shows {_SHIFT:g} N more than before"
    LOAD_CELL_ZERO = "load_cell_zero", "it shows 0 N and its noise"
    LOAD_CELL_GAIN = "load_cell_gain", "it shows a tenth less than before"
    LOAD_CELL_DOUBLED = "load_cell_doubled", "another amplifier with its node id answers as well"
    CABLE_SLACK = "cable_slack", f"{1e3 * _SLACK:g} mm of cable slip off the drum"
    BUS_CUT = "bus_cut", "its cable is cut: no frame passes"
    BUS_OFF = "bus_off", "the driver's controller goes off the bus"
    BUS_DOWN = "bus_down", "the driver's interface is taken down"
    BUS_REMOVED = "bus_removed", "the driver's interface is unplugged"
    BUS_BABBLING = "bus_babbling", "a node fills the bus with frames of high priority"
    BUS_ERROR_FRAMES = "bus_error_frames", "every frame is destroyed by an error frame"
    PLATFORM_CAUGHT = "platform_caught", "it hangs on an obstacle that does not give way"
    EMERGENCY_STOP = "emergency_stop", "the emergency stop chain is open"
    SUPERVISOR_KILLED = "supervisor_killed", "the supervisor ends, or the drives' driver no longer hears it"

    meaning: str

    def __new__(cls, name: str, meaning: str) -> InjectedFault:
        """Make the name the value of a fault."""
        fault = object.__new__(cls)
        fault._value_ = name
        fault.meaning = meaning
        return fault

    @property
    def target(self) -> FaultTarget:
        """What the fault is injected into."""
        return _TARGETS.get(self.value.split("_", maxsplit=1)[0], FaultTarget.ROBOT)


_TARGETS = {
    "drive": FaultTarget.MOTOR,
    "winch": FaultTarget.MOTOR,
    "brake": FaultTarget.MOTOR,
    "encoder": FaultTarget.MOTOR,
    "duplicate": FaultTarget.MOTOR,
    "short": FaultTarget.MOTOR,
    "load": FaultTarget.CABLE,
    "cable": FaultTarget.CABLE,
    "bus": FaultTarget.BUS,
}


_FLAGS: dict[InjectedFault, tuple[str, float]] = {
    InjectedFault.DRIVE_SILENT: ("disconnected", True),
    InjectedFault.DRIVE_NO_FEEDBACK: ("pdos_missing", True),
    InjectedFault.DRIVE_NO_HEARTBEAT: ("heartbeat_missing", True),
    InjectedFault.DUPLICATE_NODE: ("doubled", True),
    InjectedFault.LOAD_CELL_DOUBLED: ("doubled", True),
    InjectedFault.LOAD_CELL_SILENT: ("disconnected", True),
    InjectedFault.LOAD_CELL_SATURATED: ("saturated", True),
    InjectedFault.LOAD_CELL_STUCK: ("stuck", True),
    InjectedFault.LOAD_CELL_OFFSET: ("shift", _SHIFT),
    InjectedFault.LOAD_CELL_ZERO: ("gain_loss", 1.0),
    InjectedFault.LOAD_CELL_GAIN: ("gain_loss", 0.1),
}
# Those at which the drive gives the plant another torque at once.
_TORQUES: dict[InjectedFault, tuple[str, float]] = {
    InjectedFault.DRIVE_WRONG_MODE: ("mode_is_lost", True),
    InjectedFault.DRIVE_RUNAWAY: ("runs_away", 1.0),
    InjectedFault.DRIVE_PULLING: ("runs_away", -0.6),
    InjectedFault.WINCH_BLOCKED: ("blocked", True),
}
_ENCODERS: dict[InjectedFault, tuple[str, float]] = {
    InjectedFault.ENCODER_FROZEN: ("frozen", True),
    InjectedFault.ENCODER_DRIFT: ("drift", _ENCODER_DRIFT),
}

WITHOUT_DEVICES = {
    *_ENCODERS,
    InjectedFault.LOAD_CELL_STUCK,
    InjectedFault.LOAD_CELL_OFFSET,
    InjectedFault.LOAD_CELL_ZERO,
    InjectedFault.LOAD_CELL_GAIN,
    InjectedFault.CABLE_SLACK,
    InjectedFault.PLATFORM_CAUGHT,
}
"""What the plant alone can have: faults of cables, of what encoders and load cells show, and of the platform's way."""


class FaultyCell(Protocol):
    """What faults change in a load cell: whether its value stays, N that it shows too much, and a share too little."""

    stuck: bool
    shift: float
    gain_loss: float


@dataclass(frozen=True)
class FaultOrder:
    """A fault and where: for a motor or a cable its index from 0, for a bus its name."""

    fault: InjectedFault
    place: int | str = 0


@dataclass
class FaultInjector:
    """Puts faults into emulated devices, their machine and their buses, and takes them away again.

    Parameters
    ----------
    drives, load_cells
        The devices; without drives the plant is alone, and has only the faults `WITHOUT_DEVICES`.
    machine
        What they share.
    buses
        What disturbs each bus from now on, by its name.
    kill_supervisor
        Ends the supervisor, and returns what starts another; None where there is none within reach.
    encoders
        Of the motors; those of the drives, where there are drives.
    """

    drives: Sequence[DriveEmulator]
    load_cells: Sequence[LoadCellEmulator] | Sequence[FaultyCell]
    machine: SharedPlant
    buses: Mapping[str, Callable[[BusDisturbance], None]]
    kill_supervisor: Callable[[], Callable[[], None]] | None = None
    encoders: Sequence[Encoder] = ()
    _remedies: list[Callable[[], None]] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.encoders = [drive.encoder for drive in self.drives] or self.encoders

    def read(self, text: str) -> FaultOrder:
        """Return what a text such as ``drive_silent motor_3`` orders.

        Raises
        ------
        DriverError
            In one line: what is wrong, and what there is.
        """
        name, _, place = text.strip().partition(" ")
        place = place.strip()
        known = {fault.value: fault for fault in InjectedFault}
        if name not in known:
            problem = f"there is no fault '{name}'{did_you_mean(name, known)}"
            none = "no fault is named, such as drive_silent motor_3;"
            raise DriverError(f"{problem if name else none} `cspr closed_loop --help` lists them")
        fault = known[name]
        if not self.drives and fault not in WITHOUT_DEVICES:
            raise DriverError(f"{name} needs devices that can have it")
        if fault is InjectedFault.SUPERVISOR_KILLED and self.kill_supervisor is None:
            raise DriverError(f"{name}: there is no supervisor within reach")
        if fault.target is FaultTarget.ROBOT:
            places: dict[str, int | str] = {"": 0, "robot": 0}
        elif fault.target is FaultTarget.BUS:
            if not self.buses:
                raise DriverError(
                    f"{name}: only the simulated buses of one process can be disturbed, not SocketCAN"
                )
            places = {bus: bus for bus in self.buses}
        else:
            prefix = fault.target.value.removesuffix("K")
            devices = self.encoders if fault.target is FaultTarget.MOTOR else self.load_cells
            places = {f"{prefix}{index + 1}": index for index in range(len(devices))}
        if place not in places:
            raise DriverError(
                f"{name}: '{place}' is not a valid place; use '{name} PLACE' with one of "
                f"{', '.join(filter(None, places))}"
            )
        return FaultOrder(fault, places[place])

    def inject(self, order: FaultOrder) -> None:
        """Inject a fault now; unless it is momentary, it lasts until `clear`."""
        with self.machine.lock:
            fault, place = order.fault, order.place
            if fault.target is FaultTarget.BUS:
                disturb = self.buses[str(place)]
                disturb(BusDisturbance[fault.value.removeprefix("bus_").upper()])
                self._remedies.append(partial(disturb, BusDisturbance.NONE))
            elif fault in _FLAGS:
                named = self.drives if fault.target is FaultTarget.MOTOR else self.load_cells
                self._set(named[int(place)], *_FLAGS[fault])
            elif fault in _TORQUES:
                self._set_and_apply(self.drives[int(place)], int(place), *_TORQUES[fault])
            elif fault in _ENCODERS:
                self._set_and_apply(self.encoders[int(place)], int(place), *_ENCODERS[fault])
            elif (repair := self._harm(fault, int(place))) is not None:
                self._remedies.append(repair)

    def clear(self) -> None:
        """Repair everything; what stays latched in devices stays latched."""
        with self.machine.lock:
            remedies, self._remedies = self._remedies, []
            for remedy in reversed(remedies):
                remedy()

    def _harm(self, fault: InjectedFault, index: int) -> Callable[[], None] | None:
        """Inject a fault that is more than a flag of a device; return what repairs it, `None` if it is momentary."""
        machine, plant = self.machine, self.machine.plant
        match fault:
            case InjectedFault.DRIVE_RESET:
                self.drives[index].power_cycle()
            case InjectedFault.SHORT_SDO:
                self._set(self.drives[index], "sdo_cut", True)
                self.drives[index].power_cycle()
            case InjectedFault.DRIVE_FAULT:
                self.drives[index].fail(EmergencyCode.OVERTEMPERATURE)
            case InjectedFault.DRIVE_EMERGENCY:
                drive = self.drives[index]
                self._set(drive, "warning", True)
                drive.emergency(EmergencyCode.UNDERVOLTAGE)
                return drive.errors_over
            case InjectedFault.ENCODER_JUMP:
                drive = self.drives[index]
                drive.shift_counter(_ENCODER_STEP)
                return partial(drive.shift_counter, -_ENCODER_STEP)
            case InjectedFault.ENCODER_WRAP:
                self.drives[index].turn_counter_round()
            case InjectedFault.BRAKE_WEAK:
                plant.weaken_brake(index, _WEAK_BRAKE)
                return partial(plant.weaken_brake, index, 1.0)
            case InjectedFault.BRAKE_SLIP:
                self._weaken_brake(index, _WEAK_BRAKE)
                return partial(self._weaken_brake, index, 1.0)
            case InjectedFault.LOAD_CELL_DRIFTING:
                cell = self.load_cells[index]
                assert isinstance(cell, LoadCellEmulator)  # `read` refuses it for others
                cell.drift(_DRIFT)
                return partial(cell.drift, 0.0)
            case InjectedFault.CABLE_SLACK:
                machine.advance(machine.now())
                plant.slip_cable(index, _SLACK)
                return partial(plant.slip_cable, index, -_SLACK)
            case InjectedFault.PLATFORM_CAUGHT:
                machine.advance(machine.now())
                plant.catch_platform(True)
                return partial(plant.catch_platform, False)
            case InjectedFault.EMERGENCY_STOP:
                self._stop_by_emergency(True)
                return partial(self._stop_by_emergency, False)
            case InjectedFault.SUPERVISOR_KILLED:
                assert self.kill_supervisor is not None  # `read` refuses it otherwise
                return self.kill_supervisor()
        return None

    def _weaken_brake(self, index: int, share: float) -> None:
        self.machine.advance(self.machine.now())
        self.machine.plant.weaken_brake(index, share)
        self.drives[index].apply_brake()

    def _stop_by_emergency(self, active: bool) -> None:
        for drive in self.drives:
            drive.set_emergency_stop(active)

    def _set_and_apply(self, device: object, motor: int, name: str, value: float) -> None:
        """Change something from which a drive's torque follows."""
        apply = [drive.apply_faults for drive in self.drives[motor : motor + 1]]
        self._remedies += apply
        self._set(device, name, value)
        for follow in apply:
            follow()

    def _set(self, device: object, name: str, value: float) -> None:
        setattr(device, name, value)
        self._remedies.append(lambda: setattr(device, name, type(value)(0)))
