"""The commissioning of a new robot: step by step, each result kept at once, so that it can be resumed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.canopen import cia402, cia404
from cspr_drivers.commission.calibration import CalibrationError, calibrate
from cspr_drivers.commission.findings import CellFindings, Findings, WinchFindings, commissioned
from cspr_drivers.commission.found_devices import FoundDevice, scan
from cspr_drivers.commission.load_cell import GLANCE, SingleLoadCell
from cspr_drivers.commission.operator import Operator, WalkStoppedError
from cspr_drivers.commission.single_drive import SingleDrive
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.config.plausible_torque import torque_doubt
from cspr_drivers.devices.device import CanopenDevice

_NUDGE = 0.5  # revolutions of the motor: some 5 mm of cable
_SCALE_TOLERANCE = 0.1  # of the cable's way: who measures 20 mm with a rule is off by one or two
_LARGEST_SLIP = 0.03  # rad of the motor that a closed brake may give way under a test weight
_CLEAR_PULL = 5.0  # N by which a pull must change a reading


@dataclass
class Walk:
    """All steps, in order.

    Parameters
    ----------
    config
        The present `can.yaml`: buses, number of winches, times.
    ports
        The open buses.
    transmission_ratio
        Cable per radian of the motor, m/rad.
    torque_limit
        Of a motor in the robot's description, N m, with which the rated torques of the drives are compared.
    torque_share
        Largest torque of any step, in units of the rated torque.
    ask
        Who is asked.
    findings
        What is known already; it is filled.
    keep
        Called whenever something new is known.
    scale_way
        Revolutions of the motor over which the cable is measured.
    hold_time
        For which a closed brake is watched under the largest test weight, s.
    """

    config: CanConfig
    ports: CanPorts
    transmission_ratio: float
    torque_limit: float
    torque_share: float
    ask: Operator
    findings: Findings
    keep: Callable[[Findings], None]
    scale_way: float = 2.0
    hold_time: float = 2.0
    _present: list[FoundDevice] = field(default_factory=list, init=False)
    _devices: dict[tuple[str, int], CanopenDevice] = field(default_factory=dict, init=False)

    def run(self) -> None:
        """Do what is not done yet.

        Raises
        ------
        WalkStoppedError
            If the operator wants to stop, or something is not there that must be.
        DeviceError
            If a device does not do what it should. What is known until then is kept.
        """
        self.find()
        self.identify_winches()
        self.check_scales()
        self.identify_cells()
        self.tare()
        self.weigh()
        self.take_home()

    # 1

    def find(self) -> None:
        """Find the nodes on all buses."""
        config = self.config
        self.ask.tell("1. Nodes on the bus")
        self._present = [
            device
            for port in self.ports
            for device in scan(port, config.master_node_id, max(0.5, 2.0 * config.timeouts.sdo))
        ]
        for device in self._present:
            self.ask.tell(f"   {device}")
        for device in self.findings.forget_missing(self._present):
            self.ask.tell(f"   no longer there, its findings are dropped: {device}")
        self._keep_commissioned()
        self.keep(self.findings)
        wanted = len(self._places)
        for profile, kind in ((cia402.DEVICE_PROFILE, "drives"), (cia404.DEVICE_PROFILE, "load cells")):
            count = len(self._of_profile(profile))
            if count != wanted:
                raise WalkStoppedError(
                    f"{count} {kind} answer, {wanted} are in {config.source}: check supply, termination, bit rate and "
                    "node ids; two devices with the same node id answer as one"
                )

    def _keep_commissioned(self) -> None:
        """Keep what the present file says about devices that are still the same."""
        said = commissioned(self.config, self._present)
        winches = {k: v for k, v in said.winches.items() if k not in self.findings.winches}
        cells = {k: v for k, v in said.cells.items() if k not in self.findings.cells}
        if not winches and not cells:
            return
        names = [*(f"winch {place}" for place in winches), *(f"cell {place}" for place in cells)]
        if self.ask.yes(
            "keep",
            f"   {', '.join(names)}: the same devices as in {self.config.source}. Keep what it says about them?",
        ):
            self.findings.winches |= winches
            self.findings.cells |= cells

    # 2

    def identify_winches(self) -> None:
        """Find out which drive turns which winch, and in which direction it counts."""
        left = self._unknown(cia402.DEVICE_PROFILE)
        if not left:
            return
        self._check_torques(left)
        self.ask.tell(
            "2. Winches. One at a time opens its brake and turns by half a revolution of the motor, with at most "
            f"{100 * self.torque_share:g} % of the rated torque. Keep clear of the cables."
        )
        self.ask.done("supported", "Let the platform rest on its supports, the cables just taut.")
        for device in left:
            self._identify_winch(device)

    def _check_torques(self, drives: list[FoundDevice]) -> None:
        """Refuse rated torques that cannot be true, before any motor has torque."""
        known = [winch.rated_torque for winch in self.findings.winches.values()]
        for device in drives:
            rated = self._drive(device).rated_torque
            if doubt := torque_doubt(rated, self.torque_limit, known):
                raise WalkStoppedError(f"{self._name(device)}: {doubt}")
            known.append(rated)

    def _identify_winch(self, device: FoundDevice) -> None:
        name = self._name(device)
        with self._drive(device) as drive:
            while True:
                self.ask.done(f"turn.{name}", f"   {name} turns next: watch the winches.")
                moved = drive.nudge(_NUDGE)
                free = [str(place) for place in self._places if place not in self.findings.winches]
                seen = self.ask.choice(f"winch.{name}", "   Which winch has turned?", [*free, "again"])
                if seen == "again":
                    drive.move(-moved)
                    continue
                way = self.ask.choice(f"way.{name}", "   Its cable was", ["paid-out", "taken-up"])
                break
            if not drive.move(-moved):
                self.ask.tell("   it did not come back: the load is more than the torque limit can lift")
            outwards = moved if way == "paid-out" else -moved
            self.findings.winches[int(seen)] = WinchFindings(
                device, drive.encoder_increments, drive.rated_torque, polarity=1 if outwards > 0 else -1
            )
        self.keep(self.findings)
        self.ask.tell(f"   winch {seen}: {name}, polarity {self.findings.winches[int(seen)].polarity:+d}")

    # 3

    def check_scales(self) -> None:
        """Compare the way of each cable with the one that encoder, gear and drum make it."""
        if all(winch.scale_checked for winch in self.findings.winches.values()):
            return
        way = 1e3 * self.transmission_ratio * 2.0 * math.pi * self.scale_way  # mm
        self.ask.tell(f"3. Encoder scale. Each cable is paid out by {way:.1f} mm and taken up again.")
        for place, winch in sorted(self.findings.winches.items()):
            if not winch.scale_checked:
                self._check_scale(place, winch, way)
                winch.scale_checked = True
                self.keep(self.findings)

    def _check_scale(self, place: int, winch: WinchFindings, way: float) -> None:
        with self._drive(winch.device) as drive:
            self.ask.done(f"mark.{place}", f"   Mark cable {place} where it can be measured.")
            begin = drive.position()
            drive.move(winch.polarity * round(self.scale_way * drive.encoder_increments))
            moved = drive.moved_since(begin)
            expected = way * winch.polarity * moved / (self.scale_way * drive.encoder_increments)
            measured = self.ask.number(f"measured.{place}", "   By how many mm was it paid out?", -1e4, 1e4)
            drive.move(-moved)
        if abs(measured - expected) > _SCALE_TOLERANCE * abs(expected):
            raise WalkStoppedError(
                f"cable {place}: {measured:g} mm measured, {expected:.1f} mm by the encoder "
                f"({winch.encoder_increments} increments per revolution, 608Fh) and winch in robot.yaml: correct 608Fh "
                "in the drive, or drum_radius and gear_ratio in robot.yaml"
            )

    # 4

    def identify_cells(self) -> None:
        """Find out which amplifier belongs to which cable."""
        if not self._unknown(cia404.DEVICE_PROFILE):
            return
        self.ask.tell("4. Load cells. Pull on one cable after the other, by hand.")
        for place in self._places:
            if place not in self.findings.cells:
                self._identify_cell(place)

    def _identify_cell(self, place: int) -> None:
        while True:
            free = self._unknown(cia404.DEVICE_PROFILE)
            before = [self._cell(device, place).reading(GLANCE) for device in free]
            self.ask.done(f"pull.{place}", f"   Pull on cable {place}, and go on pulling.")
            changes = [
                abs(self._cell(device, place).reading(GLANCE) - reading)
                for device, reading in zip(free, before, strict=True)
            ]
            largest = max(range(len(free)), key=lambda index: changes[index])
            names = [self._name(device) for device in free]
            if changes[largest] < _CLEAR_PULL:
                self.ask.tell(f"   no reading changed by {_CLEAR_PULL:g} N: pull harder")
                if not self.ask.yes(f"again.{place}", "   Try again?"):
                    raise WalkStoppedError(f"no load cell found for cable {place}")
                continue
            self.ask.tell(f"   {names[largest]} changed most, by {changes[largest]:.0f} N")
            chosen = self.ask.choice(f"cell.{place}", "   Its amplifier is", names, names[largest])
            self.findings.cells[place] = CellFindings(free[names.index(chosen)])
            self.keep(self.findings)
            return

    # 5

    def tare(self) -> None:
        """Take the zero of every load cell."""
        todo = [place for place, cell in sorted(self.findings.cells.items()) if not cell.tared]
        if not todo:
            return
        self.ask.tell("5. Tare")
        self.ask.done("slack", "   Let all cables hang slack.")
        for place in todo:
            cell = self.findings.cells[place]
            before = self._cell(cell.device, place).tare()
            cell.tared = True
            self.keep(self.findings)
            self.ask.tell(f"   cable {place}: zero was {before:+z.1f} N")

    # 6

    def weigh(self) -> None:
        """Calibrate every load cell with dead weights, and test every brake with the heaviest of them."""
        todo = [
            place
            for place in self._places
            if self.findings.cells[place].scale is None or not self.findings.winches[place].brake_holds
        ]
        if not todo:
            return
        self.ask.tell(
            "6. Dead weights. They calibrate the load cells; the brakes are tested with the heaviest."
        )
        masses = ""
        for place in todo:
            masses = self._weigh_cable(place, masses)
            self.keep(self.findings)

    def _weigh_cable(self, place: int, usual: str) -> str:
        """Return the weights that were hung on the cable, as they were typed."""
        cell, winch = self.findings.cells[place], self.findings.winches[place]
        question = f"   Which weights will hang on cable {place}, one after the other, kg?"
        masses = self.ask.numbers(f"weights.{place}", question, 0.1, 1e4, usual)
        heaviest = max(masses)
        single = self._cell(cell.device, place)
        readings = [single.reading()]
        slip = 0.0
        with self._drive(winch.device) as drive:  # it stays at rest, brake closed: this watches its position
            for number, mass in enumerate(masses, start=1):
                self.ask.done(
                    f"hang.{place}.{number}", f"   Hang {mass:g} kg, and nothing else, on cable {place}."
                )
                readings.append(single.reading())
                if mass == heaviest:
                    slip = max(slip, drive.slip(self.hold_time))
        self.ask.done(f"taken-off.{place}", f"   Take the weights off cable {place}.")
        try:
            fit = calibrate(readings, [0.0, *masses])
        except CalibrationError as error:
            raise WalkStoppedError(f"cable {place}: {error}") from None
        cell.scale, cell.offset, cell.rms_residual = fit.scale, fit.offset, fit.rms_residual
        self.ask.tell(
            f"   cable {place}: scale {fit.scale:.4f}, offset {fit.offset:+z.2f} N; residual {fit.rms_residual:.2f} N "
            f"(RMS), {fit.largest_residual:.2f} N at most"
        )
        if slip > _LARGEST_SLIP:
            raise WalkStoppedError(
                f"winch {place}: its closed brake slips by {slip:.2f} rad in {self.hold_time:g} s under {heaviest:g} "
                "kg: repair it before anything hangs on it"
            )
        winch.brake_holds = True
        self.ask.tell(f"   winch {place}: the brake holds {heaviest:g} kg")
        return " ".join(f"{mass:g}" for mass in masses)

    # 7

    def take_home(self) -> None:
        """Take the position values of the home pose, and the tensions there, which say how far cables are stretched."""
        if all(winch.home_counts is not None for winch in self.findings.winches.values()):
            return
        self.ask.tell("7. Home pose, where all motor angles are zero (home in robot.yaml).")
        self.ask.done("home", "   Bring the platform into its home pose, all cables taut, all brakes closed.")
        counts = {}
        for place, winch in sorted(self.findings.winches.items()):
            with self._drive(winch.device) as drive:
                counts[place] = drive.position()
        for place, value in counts.items():
            self.findings.winches[place].home_counts = value
        for place, cell in sorted(self.findings.cells.items()):
            if cell.scale is not None and cell.offset is not None:
                reading = self._cell(cell.device, place).reading()
                cell.home_tension = cell.scale * reading - cell.offset
        self.keep(self.findings)
        tensions = [cell.home_tension for _, cell in sorted(self.findings.cells.items())]
        shown = ", ".join("?" if tension is None else f"{tension:z.1f}" for tension in tensions)
        self.ask.tell("   Under these tensions; put them into robot.yaml, in place of those that it has:")
        self.ask.tell(f"home_tensions: [{shown}]")

    # The devices

    @property
    def _places(self) -> range:
        """Numbers of the winches, and of their cables."""
        return range(1, len(self.config.drives) + 1)

    def _of_profile(self, profile: int) -> list[FoundDevice]:
        return [device for device in self._present if device.profile == profile]

    def _unknown(self, profile: int) -> list[FoundDevice]:
        """Return the devices of which it is not known yet to which cable they belong."""
        known = [winch.device for winch in self.findings.winches.values()]
        known += [cell.device for cell in self.findings.cells.values()]
        return [device for device in self._of_profile(profile) if device not in known]

    def _name(self, device: FoundDevice) -> str:
        """Return a name for keys and choices; with one bus the node id is enough."""
        one = len(self.config.buses) == 1
        return f"node-{device.node_id}" if one else f"{device.bus}-node-{device.node_id}"

    def _device(self, found: FoundDevice) -> CanopenDevice:
        place = (found.bus, found.node_id)
        if place not in self._devices:
            self._devices[place] = CanopenDevice(
                f"node {found.node_id} on {found.bus}",
                self.ports[found.bus],
                found.node_id,
                self.config.timeouts.sdo,
            )
        return self._devices[place]

    def _drive(self, found: FoundDevice) -> SingleDrive:
        return SingleDrive(self._device(found), self.config, self.torque_share)

    def _cell(self, found: FoundDevice, place: int) -> SingleLoadCell:
        return SingleLoadCell(self._device(found), self.config.load_cells[place - 1])
