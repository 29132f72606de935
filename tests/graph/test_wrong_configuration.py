"""A machine as it is, and a configuration with one wrong entry: what finds it, and what is said."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

from cspr_control.closed_loop.loop import ClosedLoop
from cspr_control.closed_loop.robot import SimulatedRobot
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.closed_loop.simulated_time import SimulatedTime
from cspr_control.errors import ControlError
from cspr_control.parameters.control_settings import control_settings
from cspr_control.supervision.verified_configuration import VerifiedConfiguration
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.drives.home_position import with_home
from cspr_kinematics import Robot
from cspr_msgs_py.vocabulary import RobotState

CONFIG = Path(__file__).parents[2] / "config"
CAN = CONFIG / "can.yaml"
ROBOT = CONFIG / "robot.yaml"

Change = Callable[[dict[str, Any]], object]


def put(*path: Any, value: Any) -> Change:
    """Return the change of one value of a file."""

    def change(entries: Any) -> None:
        for key in path[:-1]:
            entries = entries[key]
        entries[path[-1]] = value

    return change


def interchange(key: str, i: int, j: int) -> Change:
    """Return the exchange of two entries of a list, counted from 1."""

    def change(entries: dict[str, Any]) -> None:
        each = entries[key]
        each[i - 1], each[j - 1] = each[j - 1], each[i - 1]

    return change


class Wrong(NamedTuple):
    """A wrong entry: of robot.yaml, or of can.yaml."""

    robot: Change | None = None
    can: Change | None = None


WRONG = {
    "nothing": Wrong(),
    "gear_ratio 27 for 30": Wrong(robot=put("winch", "gear_ratio", value=27.0)),
    "gear_ratio 300 for 30": Wrong(robot=put("winch", "gear_ratio", value=300.0)),
    "drum_radius doubled": Wrong(robot=put("winch", "drum_radius", value=0.1)),
    "platform.mass 15 kg": Wrong(robot=put("platform", "mass", value=15.3)),
    "platform.mass 600 kg": Wrong(robot=put("platform", "mass", value=600.0)),
    "home 0.3 m too high": Wrong(robot=put("home", "position", value=[0.0, 0.0, 1.3])),
    "home 0.3 m too low": Wrong(robot=put("home", "position", value=[0.0, 0.0, 0.7])),
    "home turned by 10 degrees": Wrong(robot=put("home", "euler", value=[0.175, 0.0, 0.0])),
    "exit point 3 10 cm off": Wrong(robot=put("exit_points", 2, 1, value=1.5)),
    "exit points 1 and 2 interchanged": Wrong(robot=interchange("exit_points", 1, 2)),
    "exit points 1 and 5 interchanged": Wrong(robot=interchange("exit_points", 1, 5)),
    "anchor points 1 and 2 interchanged": Wrong(robot=interchange("anchor_points", 1, 2)),
    "load cells 3 and 4 interchanged": Wrong(can=interchange("load_cells", 3, 4)),
    "load cells 1 and 5 interchanged": Wrong(can=interchange("load_cells", 1, 5)),
    "scale of load cell 3 1.3": Wrong(can=put("load_cells", 2, "scale", value=1.3)),
    "scale of all load cells 1.3": Wrong(can=lambda can: [cell.update(scale=1.3) for cell in can["load_cells"]]),
    "drives 3 and 4 interchanged": Wrong(can=interchange("drives", 3, 4)),
    "drives 1 and 5 interchanged": Wrong(can=interchange("drives", 1, 5)),
    "polarity of motor_3": Wrong(can=put("drives", 2, "polarity", value=-1)),
    "polarity of all motors": Wrong(
        can=lambda can: [drive.update(polarity=-drive["polarity"]) for drive in can["drives"]]
    ),
}  # fmt: skip


def changed(path: Path, change: Change | None) -> dict[str, Any]:
    """Return the content of a file with a wrong entry."""
    entries = copy.deepcopy(yaml.safe_load(path.read_text(encoding="utf-8")))
    if change is not None:
        change(entries)
    return entries


def believing(wrong: Wrong, payload: float, **supervisor: float) -> ClosedLoop[SimulatedRobot]:
    """Return the closed loop of a machine with a load, kg, whose controllers believe something wrong."""
    scenario = Scenario(payload=payload, config=CONFIG, parameters={"supervisor": supervisor})
    robot = Robot.from_mapping(changed(ROBOT, wrong.robot))
    buses = CanConfig.from_text(yaml.safe_dump(changed(CAN, wrong.can)), CAN)
    time = SimulatedTime()
    machine = SimulatedRobot(
        time, scenario.read_buses(), scenario.read_machine(), CONFIG / "eds", believed=buses
    )
    settings = control_settings(robot, scenario.read_parameters())
    return ClosedLoop(robot, settings, machine, scenario.reaction_time)


def enabling(wrong: Wrong, payload: float, **supervisor: float) -> str:
    """Enable a robot as an operator does; return what is said of it, or nothing if it holds its pose for a second."""
    loop = believing(wrong, payload, **supervisor)
    try:
        loop.begin()
        loop.time.wait(0.5)
        decision = loop.order("/supervisor/enable")
        if not decision.accepted:
            return decision.message
        loop.time.wait(1.5)
        assert (loop.state is RobotState.ENABLED) is not bool(loop.cause)
        return loop.cause
    finally:
        loop.machine.close()


@pytest.mark.parametrize(
    ("name", "payload", "words"),
    [
        ("nothing", 0.0, ""),
        ("nothing", 200.0, ""),
        ("platform.mass 600 kg", 0.0, r"the load cells carry 15[34]\.\d kg where it should be between 600.0 kg"),
        ("platform.mass 600 kg", 200.0, r"the load cells carry 35[23]\.\d kg"),
        ("platform.mass 15 kg", 200.0, "it should be between 15.3 kg and 315.3 kg"),
        ("home 0.3 m too high", 0.0, r"the load cells carry 13[67]\.\d kg where it should be between 153.0 kg"),
        ("exit point 3 10 cm off", 200.0, "a force along y"),
        ("anchor points 1 and 2 interchanged", 200.0, "a moment about z"),
        ("load cells 3 and 4 interchanged", 200.0, "a moment about z"),
        ("scale of load cell 3 1.3", 0.0, "a force along y"),
        ("scale of all load cells 1.3", 0.0, r"torque fits no tension: motor_\d holds"),
        ("polarity of all motors", 0.0, r"holds -3\d\d N by its torque.*and so do the others"),
        ("polarity of motor_3", 0.0, r"motor_3 winds in and its cable has lost \d+ N: is its polarity "),
    ],
)  # fmt: skip
def test_a_wrong_entry_is_found_when_the_robot_is_enabled(name: str, payload: float, words: str) -> None:
    said = enabling(WRONG[name], payload)
    assert re.search(words, said), said
    assert bool(words) is bool(said)


@pytest.mark.parametrize(
    "name", ["exit points 1 and 5 interchanged", "gear_ratio 300 for 30", "drum_radius doubled"]
)
def test_a_robot_that_its_own_motion_contradicts_is_not_even_started(name: str) -> None:
    with pytest.raises(ControlError):
        believing(WRONG[name], 0.0)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nothing", ""),
        ("platform.mass 15 kg", r"the load cells carry 153\.\d kg where it should be 15.3 kg, platform and"),
        ("home 0.3 m too low", r"the load cells carry 167\.\d kg where it should be 153.0 kg"),
        ("scale of all load cells 1.3", r"the load cells carry 200\.\d kg"),
    ],
)  # fmt: skip
def test_a_load_that_is_declared_leaves_no_room_for_a_wrong_mass(name: str, words: str) -> None:
    said = enabling(WRONG[name], 0.0, declared_load=0.0)
    assert re.search(words, said), said
    assert bool(words) is bool(said)


@pytest.mark.parametrize(
    ("name", "payload", "words"),
    [
        ("nothing", 0.0, "^verified$"),
        ("nothing", 200.0, "^verified$"),
        ("exit point 3 10 cm off", 0.0, "^verified; angles and tensions fit the robot .* less well .*: calibrate"),
        ("gear_ratio 27 for 30", 0.0, "^wrong configuration: torques tell 0.90 .* a gear_ratio of 30 would fit"),
        ("exit points 1 and 2 interchanged", 0.0, r"verification: .*exit points 1 and 2 interchanged \(robot"),
        ("anchor points 1 and 2 interchanged", 0.0, r"verification: .*anchor points 1 and 2 interchanged \(robot"),
        ("load cells 3 and 4 interchanged", 0.0, r"^wrong .*load cells 3 and 4 interchanged \(can.yaml\)"),
        ("load cells 1 and 5 interchanged", 0.0, r"^wrong .*load cells 1 and 5 interchanged \(can.yaml\)"),
        ("drives 3 and 4 interchanged", 0.0, r"verification: .*drives 3 and 4 interchanged \(can.yaml\)"),
        ("drives 1 and 5 interchanged", 0.0, r"verification: .*drives 1 and 5 interchanged \(can.yaml\)"),
        ("polarity of motor_3", 0.0, r"verification: .*polarity of motor_3 \(can.yaml\)"),
        ("platform.mass 15 kg", 0.0, "^refused: the load cells carry"),
        ("platform.mass 600 kg", 0.0, "^refused: the load cells carry"),
        ("home 0.3 m too low", 0.0, "^refused: the load cells carry"),
    ],
)  # fmt: skip
def test_a_verification_names_what_is_wrong(name: str, payload: float, words: str) -> None:
    loop = believing(WRONG[name], payload, declared_load=payload, following_error=10.0)
    supervisor = loop.supervisor
    try:
        loop.begin()
        loop.time.wait(0.5)
        decision = loop.order("/supervisor/verify")
        said = decision.message
        if decision.accepted:
            begin = loop.machine.plant.platform_position()
            loop.wait_until(lambda: not supervisor.verifying, 60.0, lambda: "the verification does not end")
            said = loop.cause or supervisor.remark
            assert not any(device.automaton.brake_open for device in loop.machine.devices)
            assert (
                np.abs(loop.machine.plant.platform_position() - begin).max() < 0.12
            )  # m, wherever it was stopped
        assert re.search(words, said), said
    finally:
        loop.machine.close()


def test_what_was_verified_may_be_enabled_until_something_changes(tmp_path: Path) -> None:
    loop = believing(WRONG["nothing"], 0.0, declared_load=0.0)
    try:
        supervision = loop.graph.components["supervisor"]
        supervision._record = VerifiedConfiguration(tmp_path / "verified.json", loop.robot)
        loop.begin()
        loop.time.wait(0.5)
        assert "no verification is on record" in loop.order("/supervisor/enable").message
        assert loop.order("/supervisor/verify").accepted
        loop.wait_until(lambda: not loop.supervisor.verifying, 60.0, lambda: "the verification does not end")
        assert loop.supervisor.remark == "verified"
        loop.enable()
        assert loop.order("/supervisor/stop").accepted
        loop.wait_for(RobotState.DISABLED, 5.0)
        moved = with_home(loop.machine.drives.config, [1000] * 8)
        loop.machine.drives._cycle.set_home([1000] * 8)
        assert moved.fingerprint == loop.machine.drives.config.fingerprint
        loop.time.wait(1.1)
        refused = loop.order("/supervisor/enable").message
        assert (
            "can.yaml or the home pose changed since the last verification: call /supervisor/verify"
            in refused
        )
    finally:
        loop.machine.close()


def test_a_verification_needs_the_load_to_be_declared() -> None:
    loop = believing(WRONG["nothing"], 0.0)
    try:
        loop.begin()
        loop.time.wait(0.1)
        assert "declare the load first" in loop.order("/supervisor/verify").message
    finally:
        loop.machine.close()
