"""Faults of the emulated machine by name: what an engineer would do with pliers, a hot-air gun and a lever.

What each fault ends in is in docs/operation.md, and what it costs in height in its section "What each fault does".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial

from cspr_drivers.errors import DriverError
from cspr_drivers.simulation.bus.bus_timing import BusDisturbance, Disturbable
from cspr_drivers.simulation.devices.canopen_codes import EmergencyCode
from cspr_drivers.simulation.devices.drive import DriveEmulator
from cspr_drivers.simulation.devices.load_cell import LoadCellEmulator
from cspr_drivers.simulation.devices.node import EmulatedNode
from cspr_drivers.simulation.plant.shared import SharedPlant

_DRIFT = 200.0  # N/s: some fifth of a tension each second
_WEAK_BRAKE = 0.05  # share of the holding torque
_SLACK = 0.05  # m paid out by a cable that slips off its drum's groove


class FaultTarget(Enum):
    """What a fault is injected into; the value is how targets are called."""

    MOTOR = "motor_K"
    CABLE = "cable_K"
    BUS = "a bus of can.yaml"
    ROBOT = "robot"


class InjectedFault(Enum):
    """Faults by name; the value is the name."""

    DRIVE_SILENT = "drive_silent"
    DRIVE_NO_FEEDBACK = "drive_no_feedback"
    DRIVE_NO_HEARTBEAT = "drive_no_heartbeat"
    DRIVE_RESET = "drive_reset"
    DRIVE_FAULT = "drive_fault"
    DRIVE_EMERGENCY = "drive_emergency"
    DRIVE_WRONG_MODE = "drive_wrong_mode"
    DRIVE_RUNAWAY = "drive_runaway"
    DRIVE_PULLING = "drive_pulling"
    WINCH_BLOCKED = "winch_blocked"
    BRAKE_WEAK = "brake_weak"
    LOAD_CELL_SILENT = "load_cell_silent"
    LOAD_CELL_SATURATED = "load_cell_saturated"
    LOAD_CELL_STUCK = "load_cell_stuck"
    LOAD_CELL_DRIFTING = "load_cell_drifting"
    CABLE_SLACK = "cable_slack"
    BUS_CUT = "bus_cut"
    BUS_OFF = "bus_off"
    BUS_DOWN = "bus_down"
    BUS_REMOVED = "bus_removed"
    BUS_BABBLING = "bus_babbling"
    BUS_ERROR_FRAMES = "bus_error_frames"
    PLATFORM_CAUGHT = "platform_caught"
    EMERGENCY_STOP = "emergency_stop"

    @property
    def target(self) -> FaultTarget:
        """What the fault is injected into."""
        return _TARGETS.get(self.value.split("_", maxsplit=1)[0], FaultTarget.ROBOT)

    @property
    def meaning(self) -> str:
        """The fault in words."""
        return _MEANINGS[self]


_TARGETS = {
    "drive": FaultTarget.MOTOR,
    "winch": FaultTarget.MOTOR,
    "brake": FaultTarget.MOTOR,
    "load": FaultTarget.CABLE,
    "cable": FaultTarget.CABLE,
    "bus": FaultTarget.BUS,
}

_MEANINGS = {
    InjectedFault.DRIVE_SILENT: "its bus connector is unplugged",
    InjectedFault.DRIVE_NO_FEEDBACK: "it sends no TPDOs; all else goes on",
    InjectedFault.DRIVE_NO_HEARTBEAT: "it sends no heartbeat; all else goes on",
    InjectedFault.DRIVE_RESET: "its supply fails for a moment, and it boots",
    InjectedFault.DRIVE_FAULT: "overtemperature of its power stage: fault",
    InjectedFault.DRIVE_EMERGENCY: "it reports undervoltage by EMCY and goes on",
    InjectedFault.DRIVE_WRONG_MODE: "it leaves cyclic synchronous torque mode by itself",
    InjectedFault.DRIVE_RUNAWAY: "it applies all its torque, to pay out",
    InjectedFault.DRIVE_PULLING: "it applies three fifths of its torque, to take in",
    InjectedFault.WINCH_BLOCKED: "the brake holds although the drive says that it is open",
    InjectedFault.BRAKE_WEAK: "the brake holds a twentieth of its torque from the next time it closes",
    InjectedFault.LOAD_CELL_SILENT: "its amplifier is unplugged",
    InjectedFault.LOAD_CELL_SATURATED: "its amplifier reports overload",
    InjectedFault.LOAD_CELL_STUCK: "its value no longer changes",
    InjectedFault.LOAD_CELL_DRIFTING: f"its zero drifts by {_DRIFT:g} N a second",
    InjectedFault.CABLE_SLACK: f"{1e3 * _SLACK:g} mm of cable slip off the drum",
    InjectedFault.BUS_CUT: "its cable is cut: no frame passes",
    InjectedFault.BUS_OFF: "the driver's controller goes off the bus",
    InjectedFault.BUS_DOWN: "the driver's interface is taken down",
    InjectedFault.BUS_REMOVED: "the driver's interface is unplugged",
    InjectedFault.BUS_BABBLING: "a node fills the bus with frames of high priority",
    InjectedFault.BUS_ERROR_FRAMES: "every frame is destroyed by an error frame",
    InjectedFault.PLATFORM_CAUGHT: "it hangs on an obstacle that does not give way",
    InjectedFault.EMERGENCY_STOP: "the emergency stop chain is open",
}


@dataclass(frozen=True)
class FaultOrder:
    """A fault and where: for a motor or a cable its index from 0, for a bus its name."""

    fault: InjectedFault
    place: int | str = 0


class FaultInjector:
    """Puts faults into emulated devices, their machine and their buses, and takes them away again.

    Parameters
    ----------
    drives, load_cells
        The devices.
    machine
        What they share.
    buses
        The buses by name.
    """

    def __init__(
        self,
        drives: Sequence[DriveEmulator],
        load_cells: Sequence[LoadCellEmulator],
        machine: SharedPlant,
        buses: Mapping[str, Disturbable],
    ) -> None:
        self._drives = drives
        self._load_cells = load_cells
        self._machine = machine
        self._buses = buses
        self._remedies: list[Callable[[], None]] = []

    def read(self, text: str) -> FaultOrder:
        """Return what a text such as ``drive_silent motor_3`` orders.

        Raises
        ------
        DriverError
            In one line: what is wrong, and what there is.
        """
        name, _, place = text.strip().partition(" ")
        place = place.strip()
        try:
            fault = InjectedFault(name)
        except ValueError:
            names = ", ".join(known.value for known in InjectedFault)
            raise DriverError(f"there is no fault '{name}'; there are {names}") from None
        if fault.target is FaultTarget.ROBOT:
            places: dict[str, int | str] = {"": 0, "robot": 0}
        elif fault.target is FaultTarget.BUS:
            if not self._buses:
                raise DriverError(
                    f"{name}: only the simulated buses of one process can be disturbed, not SocketCAN"
                )
            places = {bus: bus for bus in self._buses}
        else:
            prefix = fault.target.value.removesuffix("K")
            places = {f"{prefix}{index + 1}": index for index in range(len(self._drives))}
        if place not in places:
            known = ", ".join(filter(None, places))
            raise DriverError(
                f"{name}: there is no '{place}' it could happen to; say '{name} PLACE' with one of {known}"
            )
        return FaultOrder(fault, places[place])

    def inject(self, order: FaultOrder) -> None:
        """Inject a fault now; unless it is momentary, it lasts until `clear`."""
        with self._machine.lock:
            if order.fault.target is FaultTarget.BUS:
                self._disturb(order.fault, str(order.place))
            elif order.fault.target is FaultTarget.CABLE:
                self._harm_cable(order.fault, int(order.place))
            elif order.fault.target is FaultTarget.MOTOR:
                self._harm_drive(order.fault, int(order.place))
            elif order.fault is InjectedFault.PLATFORM_CAUGHT:
                self._machine.advance(self._machine.now())
                self._machine.plant.catch_platform(True)
                self._remedies.append(lambda: self._machine.plant.catch_platform(False))
            else:
                self._remedies.append(partial(self._stop_by_emergency, False))
                self._stop_by_emergency(True)

    def clear(self) -> None:
        """Repair everything; what stays latched in devices stays latched."""
        with self._machine.lock:
            remedies, self._remedies = self._remedies, []
            for remedy in reversed(remedies):
                remedy()

    def _harm_drive(self, fault: InjectedFault, index: int) -> None:
        drive = self._drives[index]
        match fault:
            case InjectedFault.DRIVE_SILENT:
                self._set(drive, "disconnected")
            case InjectedFault.DRIVE_NO_FEEDBACK:
                self._set(drive, "pdos_missing")
            case InjectedFault.DRIVE_NO_HEARTBEAT:
                self._set(drive, "heartbeat_missing")
            case InjectedFault.DRIVE_RESET:
                drive.power_cycle()
            case InjectedFault.DRIVE_FAULT:
                drive.fail(EmergencyCode.OVERTEMPERATURE)
            case InjectedFault.DRIVE_EMERGENCY:
                self._set(drive, "warning")
                drive.emergency(EmergencyCode.UNDERVOLTAGE)
                self._remedies.append(drive.errors_over)
            case InjectedFault.BRAKE_WEAK:
                plant = self._machine.plant
                plant.weaken_brake(index, _WEAK_BRAKE)
                self._remedies.append(lambda: plant.weaken_brake(index, 1.0))
            case _:
                name, value = {
                    InjectedFault.DRIVE_WRONG_MODE: ("mode_is_lost", True),
                    InjectedFault.DRIVE_RUNAWAY: ("runs_away", 1.0),
                    InjectedFault.DRIVE_PULLING: ("runs_away", -0.6),
                    InjectedFault.WINCH_BLOCKED: ("blocked", True),
                }[fault]
                self._remedies.append(drive.apply_faults)
                self._set(drive, name, value)
                drive.apply_faults()

    def _harm_cable(self, fault: InjectedFault, index: int) -> None:
        cell = self._load_cells[index]
        match fault:
            case InjectedFault.LOAD_CELL_SILENT:
                self._set(cell, "disconnected")
            case InjectedFault.LOAD_CELL_SATURATED:
                self._set(cell, "saturated")
            case InjectedFault.LOAD_CELL_STUCK:
                self._set(cell, "stuck")
            case InjectedFault.LOAD_CELL_DRIFTING:
                cell.drift(_DRIFT)
                self._remedies.append(lambda: cell.drift(0.0))
            case _:
                plant = self._machine.plant
                self._machine.advance(self._machine.now())
                plant.slip_cable(index, _SLACK)
                self._remedies.append(lambda: plant.slip_cable(index, -_SLACK))

    def _disturb(self, fault: InjectedFault, name: str) -> None:
        bus = self._buses[name]
        bus.disturb(BusDisturbance[fault.value.removeprefix("bus_").upper()])
        self._remedies.append(lambda: bus.disturb(BusDisturbance.NONE))

    def _stop_by_emergency(self, active: bool) -> None:
        for drive in self._drives:
            drive.set_emergency_stop(active)

    def _set(self, device: EmulatedNode, name: str, value: float = True) -> None:
        setattr(device, name, value)
        self._remedies.append(lambda: setattr(device, name, type(value)(0)))
