"""The commissioning of a new robot, end to end against the emulated devices on the virtual bus.

The machine is a bench: every winch turns by itself, and weights are hung on its cable by hand.
"""

import copy
import itertools
import json
import shutil
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import can
import numpy as np
import pytest
import yaml
from canopen.objectdictionary import UNSIGNED8, ODVariable

from cspr_drivers.bus.opening import open_ports
from cspr_drivers.commission.calibration import CalibrationError, calibrate
from cspr_drivers.commission.findings import CellFindings, Findings, FindingsFile, WinchFindings
from cspr_drivers.commission.found_devices import FoundDevice
from cspr_drivers.commission.master_heartbeat import master_heartbeat
from cspr_drivers.commission.operator import QUESTIONS, Operator
from cspr_drivers.commission.program import commission, main
from cspr_drivers.commission.single_drive import SingleDrive
from cspr_drivers.commission.walk import Walk
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.devices.device import CanopenDevice
from cspr_drivers.drives.master import DriveMaster
from cspr_drivers.errors import BusError, ConfigurationError, DriverError
from cspr_drivers.simulation.robot_emulator import RobotEmulator
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import Payload
from cspr_msgs_py.vocabulary import DriverState

ROOT = Path(__file__).parents[3]
CHANNELS = itertools.count()
PAY_OUT = 0.05 / 30.0  # m/rad: drum radius over gear ratio in robot.yaml
M = 8
HOME_TENSIONS = [300.0 + 20.0 * place for place in range(M)]  # N
QUICK = partial(Walk, hold_time=0.3, scale_way=0.5)


class WinchBench:
    """Eight winches without a platform: shafts with inertia, friction and brake, weights on their cables."""

    INERTIA, FRICTION, HOLDING = 1.5e-3, 0.05, 12.0  # kg m^2, N m, N m

    def __init__(self):
        self.time = 0.0
        self.payload = Payload.none()
        self.angles, self.speeds, self.torques = np.zeros(M), np.zeros(M), np.zeros(M)
        self.damping, self.pulls = np.zeros(M), np.zeros(M)
        self.closed = np.ones(M, dtype=bool)
        self.holding = np.full(M, self.HOLDING)
        self.turned = []  # winches in the order in which they were seen to turn
        self.largest_torque = 0.0
        self.opened_together = 0

    def advance(self, time):
        while self.time < time - 1e-9:
            step = min(0.001, time - self.time)
            drive = self.torques - self.damping * self.speeds + PAY_OUT * self.pulls
            limit = self.FRICTION + np.where(self.closed, self.holding, 0.0)
            free = self.speeds + step * drive / self.INERTIA
            brake = step * limit / self.INERTIA
            self.speeds = np.sign(free) * np.maximum(0.0, abs(free) - brake)
            self.angles = self.angles + step * self.speeds
            self.time += step
            for winch in np.flatnonzero(abs(self.speeds) > 1.0):
                if not self.turned or self.turned[-1] != winch:
                    self.turned.append(int(winch))

    def set_payload(self, payload):
        self.payload = payload

    def set_torque(self, index, torque):
        self.torques[index] = torque
        self.largest_torque = max(self.largest_torque, abs(torque))

    def set_damping(self, index, gain):
        self.damping[index] = gain

    def set_brake(self, index, closed):
        self.closed[index] = closed
        self.opened_together = max(self.opened_together, int((~self.closed).sum()))

    def platform_position(self):
        return np.zeros(3)

    def platform_quaternion(self):
        return np.array([0.0, 0.0, 0.0, 1.0])

    def motor_angles(self):
        return self.angles.copy()

    def motor_speeds(self):
        return self.speeds.copy()

    def motor_torques(self):
        return self.torques.copy()

    def tensions(self):
        return self.pulls.copy()


class Person(Operator):
    """Somebody who looks at the bench and tells what is to be seen there, and hangs weights on it."""

    def __init__(self, bench, machine, wait_until, **answers):
        self.bench = bench
        self.machine = machine
        self.wait_until = wait_until
        self.answers = answers
        self.lines = []
        self.asked = []
        self.stop_at = None
        self._angles = bench.angles.copy()

    def tell(self, text):
        self.lines.append(text)

    def refuse(self, key, problem):
        pytest.fail(f"{key}: {problem}")

    def ask(self, key, question, default):
        self.asked.append(key)
        if key == self.stop_at:
            raise KeyboardInterrupt
        step, _, place = key.partition(".")
        if key in self.answers:
            return self.answers[key]
        act = getattr(self, "_" + step.replace("-", "_"), None)
        return default if act is None else act(place)

    def _turn(self, place):
        self._angles = self.bench.angles.copy()
        return "yes"

    def _winch(self, place):
        return str(1 + int(np.argmax(abs(self.bench.angles - self._angles))))

    def _way(self, place):
        moved = self.bench.angles - self._angles
        return "paid-out" if moved[np.argmax(abs(moved))] > 0.0 else "taken-up"

    def _mark(self, place):
        self._angles = self.bench.angles.copy()
        return "yes"

    def _measured(self, place):
        way = self.bench.angles[int(place) - 1] - self._angles[int(place) - 1]
        return f"{1e3 * PAY_OUT * way:.1f}"

    def _pull(self, place):
        return self._pull_with(int(place), 100.0)

    def _slack(self, place):
        return self._pull_with(1, 0.0)

    def _pull_with(self, cable, force):
        """Pull on one cable alone, and look up when that has been measured."""
        pulls = np.zeros(M)
        pulls[cable - 1] = force
        return self._pull_with_all(pulls)

    def _pull_with_all(self, pulls):
        self.bench.pulls = pulls
        self.wait_until(lambda: self.machine.newest_measurement.tensions == self.bench.pulls.tolist())
        return "yes"

    def _weights(self, place):
        return "20 40 80"

    def _hang(self, place):
        cable, _, number = place.partition(".")
        return self._pull_with(int(cable), 9.81 * (20.0, 40.0, 80.0)[int(number) - 1])

    def _taken_off(self, place):
        return self._pull_with(int(place), 0.0)

    def _home(self, place):
        self.bench.angles[:] = np.linspace(-3.0, 3.0, M)  # carried there by hand
        return self._pull_with_all(np.array(HOME_TENSIONS))


@pytest.fixture
def content():
    """The shipped configuration on a virtual bus of its own."""
    content = yaml.safe_load((ROOT / "config" / "can.yaml").read_text())
    content["buses"]["main"].update(interface="virtual", channel=f"commission-{next(CHANNELS)}")
    content["timeouts"].update(sdo=0.15, heartbeat_consumer=0.6, enable=5.0, stop=5.0)
    return content


def swapped(content):
    """Return the machine as it is wired: nodes of winches 1 and 3 swapped, 5 the other way round, another encoder."""
    true = copy.deepcopy(content)
    drives, cells = true["drives"], true["load_cells"]
    for key in ("node_id", "identity"):
        drives[0][key], drives[2][key] = drives[2][key], drives[0][key]
        cells[1][key], cells[6][key] = cells[6][key], cells[1][key]
    drives[4]["polarity"] = -drives[4]["polarity"]
    drives[5]["encoder_increments"] = 65536
    drives[6]["home_counts"] = 2**31 - 1  # its counter goes round at the home pose
    drives[7]["home_counts"] = 4711
    cells[3]["scale"] = 2.5
    for place, device in enumerate((*drives, *cells)):
        device["identity"]["serial_number"] = 9000 + place
    return true


class Rig:
    """The machine as it is, the file as it was before, and a person."""

    def __init__(self, directory, believed, true, wait_until):
        self.path = directory / "can.yaml"
        text = (ROOT / "config" / "can.yaml").read_text()
        bus = believed["buses"]["main"]
        text = text.replace("interface: socketcan", "interface: virtual").replace(
            "channel: can0", f"channel: {bus['channel']}"
        )
        for key, value in believed["timeouts"].items():
            text = _with_value(text, key, value)
        self.path.write_text(text)
        assert yaml.safe_load(text)["timeouts"] == believed["timeouts"]
        self.bench = WinchBench()
        simulation = SimulationConfig.from_yaml(ROOT / "config" / "simulation.yaml")
        cells = replace(simulation.load_cells, noise_std=0.5, gain_error=np.zeros(M), offset=np.full(M, 12.0))
        self.emulator = RobotEmulator(
            CanConfig.from_mapping(true, "true"),
            replace(simulation, load_cells=cells),
            self.bench,
            ROOT / "config" / "eds",
        )
        self.person = Person(self.bench, self.emulator.machine, wait_until)

    def walk(self, **options):
        return commission(self.path, ROOT / "config" / "robot.yaml", self.person, 0.1, walk=QUICK, **options)

    def brakes_open(self):
        return int((~self.bench.closed).sum())


def _with_value(text, key, value):
    lines = [
        f"  {key}: {value}" if line.strip().startswith(f"{key}:") and line.startswith("  ") else line
        for line in text.splitlines()
    ]
    return "\n".join(lines) + "\n"


@pytest.fixture
def rig(tmp_path, content, wait_until):
    rig = Rig(tmp_path, content, swapped(content), wait_until)
    yield rig
    rig.emulator.close()


def known(content):
    """Return what a walk has found out of a machine before its last step."""
    config = CanConfig.from_mapping(content, "true")
    return Findings(
        {
            place: WinchFindings(
                FoundDevice(drive.bus, drive.node_id, 402, drive.identity),
                drive.units.encoder_increments,
                drive.units.rated_torque,
                drive.units.polarity,
                scale_checked=True,
                brake_holds=True,
            )
            for place, drive in enumerate(config.drives, start=1)
        },
        {
            place: CellFindings(FoundDevice(cell.bus, cell.node_id, 404, cell.identity), True, 1.25, 0.5, 0.1)
            for place, cell in enumerate(config.load_cells, start=1)
        },
    )


def test_a_machine_that_is_wired_otherwise_is_found_as_it_is(rig, content, wait_until):
    before = rig.path.read_text()
    with drivers(rig.path) as master:
        wait_until(lambda: "serial number" in (master.enable() or ""))

    walked = rig.walk()
    assert set(walked.winches) == set(walked.cells) == set(range(1, M + 1))

    true = swapped(content)
    found = yaml.safe_load(rig.path.read_text())
    for drive, truth in zip(found["drives"], true["drives"], strict=True):
        for key in ("node_id", "polarity", "encoder_increments", "rated_torque", "torque_limit", "identity"):
            assert drive[key] == truth[key], (key, drive, truth)
    config = CanConfig.from_yaml(rig.path)
    truth = CanConfig.from_mapping(true, "true")
    # the home pose, where the person has carried the platform
    for drive, real, angle in zip(config.drives, truth.drives, np.linspace(-3.0, 3.0, M), strict=True):
        assert drive.units.angle(real.units.counts(angle)) == pytest.approx(0.0, abs=1e-3)
    for cell, real in zip(config.load_cells, truth.load_cells, strict=True):
        assert cell.node_id == real.node_id
        assert cell.identity == real.identity
        assert cell.units.scale == pytest.approx(real.units.scale, rel=0.01)
        assert abs(cell.units.offset) < 3.0
    tensions = [cell.home_tension for _, cell in sorted(walked.cells.items())]
    np.testing.assert_allclose(tensions, HOME_TENSIONS, atol=6.0)
    shown = next(line for line in rig.person.lines if line.startswith("home_tensions: "))
    np.testing.assert_allclose(yaml.safe_load(shown)["home_tensions"], tensions, atol=0.06)
    # all else is as it was, comments too, and the old file is kept
    kept = list(rig.path.parent.glob("can.yaml.2*"))
    assert [path.read_text() for path in kept] == [before]
    for section in ("buses", "pdo", "timeouts", "rate"):
        assert found[section] == yaml.safe_load(before)[section]
    assert "# One entry per motor, in the order of the cables in robot.yaml." in rig.path.read_text()
    diff = next(line for line in rig.person.lines if line.startswith("---"))
    assert "+  - {bus: main, node_id: 3, polarity: 1" in diff
    assert not rig.path.with_name("can.yaml.commission").exists()
    assert {key.partition(".")[0] for key in rig.person.asked} < set(QUESTIONS)
    # never more than one brake, never more torque than a tenth of 5 N m
    assert rig.bench.opened_together == 1
    assert rig.bench.largest_torque <= 0.5
    assert rig.brakes_open() == 0

    # and now the drivers take the machine
    with drivers(rig.path) as master:
        wait_until(lambda: master.states()[0] is DriverState.DISABLED)


@contextmanager
def drivers(path):
    """Run the driver of the drives with a configuration."""
    config = CanConfig.from_yaml(path)
    ports = open_ports(config)
    master = DriveMaster(config, ports, lambda states: None, lambda line: None)
    master.start()
    try:
        yield master
    finally:
        master.stop()
        ports.close()


def test_ctrl_c_closes_the_brake_and_the_walk_goes_on_from_there(rig, content, wait_until):
    file = FindingsFile(rig.path.with_name("can.yaml.commission"))
    findings = known(swapped(content))
    rig.person.stop_at = "winch.node-2"
    with pytest.raises(KeyboardInterrupt):
        rig.walk()
    wait_until(lambda: rig.brakes_open() == 0)
    assert list(file.load().winches) == [3]  # node 1 is at winch 3

    # one winch further on: only what is missing is asked
    del findings.winches[5]
    findings.winches[1].scale_checked = False
    findings.cells = {}
    file.save(findings)
    rig.person.asked = []
    rig.person.stop_at = "pull.2"
    with pytest.raises(KeyboardInterrupt):
        rig.walk()
    wait_until(lambda: rig.brakes_open() == 0)
    assert [key for key in rig.person.asked if key.startswith(("winch", "measured"))] == [
        "winch.node-5",
        "measured.1",
        "measured.5",
    ]
    assert file.load().winches[5].polarity == -1
    assert list(file.load().cells) == [1]
    assert "polarity: 1, encoder_increments: 131072, home_counts: 0" in rig.path.read_text()


def test_a_drive_stops_when_the_walk_is_killed(rig):
    """Without a heartbeat of the program the drive closes its brake by itself."""
    config = CanConfig.from_yaml(rig.path)
    ports = open_ports(config)
    try:
        device = CanopenDevice("node 1", ports["main"], 1, 0.5, on_boot=lambda: None)
        with master_heartbeat(ports, config.master_node_id, 0.05):
            drive = SingleDrive(device, config, 0.1).__enter__()
            drive._release()
            assert rig.brakes_open() == 1
            time.sleep(0.2)
        deadline = time.monotonic() + 120.0
        while rig.brakes_open() and time.monotonic() < deadline:
            time.sleep(0.01)
        assert rig.brakes_open() == 0
    finally:
        ports.close()


def test_a_brake_that_slips_is_found(rig, content):
    findings = known(swapped(content))
    findings.winches[1].brake_holds = False
    FindingsFile(rig.path.with_name("can.yaml.commission")).save(findings)
    rig.bench.holding[0] = 0.5  # N m: 80 kg pull with 1.3 N m
    with pytest.raises(DriverError, match=r"winch 1: its closed brake slips by .* under 80 kg: repair it"):
        rig.walk()
    assert "polarity: 1, encoder_increments: 131072, home_counts: 0" in rig.path.read_text()


def test_a_rated_torque_in_another_unit_is_not_taken_for_mn_m(rig):
    rig.emulator.drives[0].readers[0x6076, 0] = lambda: 5_000_000  # uN m
    with pytest.raises(
        DriverError, match=r"node-3: torque_limit, 10 N m, must be from .*, 5000 N m: .* 6076h in mN m"
    ):
        rig.walk()
    assert rig.bench.opened_together == 0  # nothing has moved yet


def test_a_rated_torque_unlike_those_of_the_other_winches_is_doubted(rig, content):
    findings = known(swapped(content))
    del findings.winches[4]
    FindingsFile(rig.path.with_name("can.yaml.commission")).save(findings)
    rig.emulator.drives[3].readers[0x6076, 0] = lambda: 400  # 0.4 N m
    with pytest.raises(
        DriverError, match=r"node-4: rated_torque, 0\.4 N m, is more than 10 times off .*, 5 N m"
    ):
        rig.walk()
    assert rig.bench.opened_together == 0


def test_a_drive_that_reverses_its_positions_is_not_commissioned(rig):
    polarity = ODVariable("polarity", 0x607E)
    polarity.data_type, polarity.access_type = UNSIGNED8, "ro"
    rig.emulator.drives[0].object_dictionary.add_object(polarity)
    rig.emulator.drives[0].readers[0x607E, 0] = lambda: 0x80
    with pytest.raises(
        DriverError, match=r"607Eh:00 \(polarity\) is 128 \(0x80\), expected 0 \(0x0\): it reverses"
    ):
        rig.walk()


def test_a_device_that_is_missing_is_told(rig):
    rig.emulator.load_cells[2].nmt_state = type(rig.emulator.load_cells[2].nmt_state).STOPPED
    with pytest.raises(DriverError, match=r"7 load cells answer, 8 are in .*can\.yaml: check supply"):
        rig.walk()


def test_it_does_not_start_beside_a_driver(rig, content):
    bus = can.Bus(interface="virtual", channel=content["buses"]["main"]["channel"])
    stopping = threading.Event()

    def beat():
        while not stopping.wait(0.02):
            bus.send(can.Message(arbitration_id=0x77F, data=b"\x05", is_extended_id=False))

    thread = threading.Thread(target=beat)
    thread.start()
    try:
        with pytest.raises(BusError, match=r"a driver is active .*stop it first"):
            rig.walk()
    finally:
        stopping.set()
        thread.join()
        bus.shutdown()


def test_answers_come_from_a_file(rig, content, tmp_path, capsys):
    FindingsFile(rig.path.with_name("can.yaml.commission")).save(known(swapped(content)))
    answers = tmp_path / "answers.yaml"
    shutil.copy(ROOT / "config" / "robot.yaml", rig.path.with_name("robot.yaml"))
    numbers = tmp_path / "found" / "commission.json"
    arguments = ["--config", str(rig.path.parent), "--answers", str(answers), "--json", str(numbers)]
    answers.write_text("home: perhaps\n")
    assert main(arguments) == 1
    assert capsys.readouterr().err == f"commission: {answers}: home: 'perhaps': answer yes or no\n"
    answers.write_text("taken_off.3: yes\n")
    assert main(arguments) == 1
    assert (
        "taken_off.3 = True: unknown key; did you mean taken-off? Known here: again"
        in capsys.readouterr().err
    )
    answers.write_text("home: yes\nwrite: no\n")
    before = rig.path.read_text()
    assert main(arguments) == 1
    assert "can.yaml is unchanged; the findings are kept in" in capsys.readouterr().err
    assert rig.path.read_text() == before
    assert not numbers.exists()
    answers.write_text("write: yes\n")
    assert main(arguments) == 0
    found = json.loads(numbers.read_text(encoding="utf-8"))
    assert found["winches"]["1"]["device"]["node_id"] == 3
    assert (found["cells"]["1"]["scale"], found["cells"]["1"]["rms_residual"]) == (1.25, 0.1)
    assert "scale: 1.25, offset: 0.5" in rig.path.read_text()
    assert CanConfig.from_yaml(rig.path).drives[0].node_id == 3
    # the machine is the one that the file describes now: there is nothing to be done, unless that is wanted
    assert main(arguments) == 0
    assert "nothing changes: the file describes the robot as it is" in capsys.readouterr().out
    answers.write_text("keep: no\n")
    assert main(arguments) == 1
    assert (
        "winch.node-1 is missing:    Which winch has turned? (1/2/3/4/5/6/7/8/again)"
        in capsys.readouterr().err
    )
    assert rig.brakes_open() == 0


def test_a_person_at_the_terminal_is_asked_again_and_may_leave_at_any_time(rig, content, monkeypatch, capsys):
    file = FindingsFile(rig.path.with_name("can.yaml.commission"))
    file.save(known(swapped(content)))
    arguments = ["--config", str(rig.path), "--robot", str(ROOT / "config" / "robot.yaml")]
    prompts, typed = [], []

    def answer(prompt):
        prompts.append(prompt)
        if not typed:
            raise EOFError
        return typed.pop(0)

    monkeypatch.setattr("builtins.input", answer)
    typed += ["maybe", ""]  # go on with what is known? an empty line is yes; then the terminal is closed
    assert main(arguments) == 1
    said = capsys.readouterr()
    assert "'maybe': answer yes or no" in said.out
    assert said.err.startswith("commission: no answer to: Bring the platform into its home pose")
    assert len(file.load().winches) == M
    typed += ["y", "y", "y"]  # go on, home pose, write
    assert main(arguments) == 0
    assert prompts[-1].strip() == "Write it? [yes]"
    assert CanConfig.from_yaml(rig.path).drives[0].node_id == 3
    assert rig.brakes_open() == 0


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    for word in ("--answers", "--torque", "Ctrl-C", "dead weights", "examples:"):
        assert word in text


def test_calibration_is_the_line_of_least_squares():
    masses = np.array([0.0, 20.0, 40.0, 80.0])
    noise = np.array([0.4, -0.6, 0.5, -0.3])
    readings = (9.81 * masses + 7.0 + noise) / 1.25
    fit = calibrate(readings, masses)
    slope, intercept = np.polyfit(readings, 9.81 * masses, 1)
    assert fit.scale == pytest.approx(slope)
    assert fit.offset == pytest.approx(-intercept)
    residuals = 9.81 * masses - np.polyval([slope, intercept], readings)
    assert fit.rms_residual == pytest.approx(np.sqrt(np.mean(residuals**2)))
    assert fit.largest_residual == pytest.approx(abs(residuals).max())


@pytest.mark.parametrize(
    ("readings", "masses", "problem"),
    [
        ([0.0, 0.1], [0.0, 50.0], "the reading changes by 0.1 N with a load that changes by 490.5 N"),
        ([0.0, 196.2, 300.0], [0.0, 20.0, 40.0], "off the line, more than 1 %"),
        ([100.0], [50.0], "at least two different weights"),
    ],
)
def test_a_calibration_that_is_none_is_refused(readings, masses, problem):
    with pytest.raises(CalibrationError, match=problem):
        calibrate(readings, masses)


def test_findings_of_another_form_are_not_taken_up(rig):
    rig.path.with_name("can.yaml.commission").write_text('{"form": 99}')
    with pytest.raises(ConfigurationError, match=r"it has another format; start over with --restart"):
        rig.walk()
