"""Brakes that the host commands, in simulated time: proven before the torque goes, or the drives hold the load."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cspr_control.closed_loop.run import closed_loop
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.reference.point_to_point import PointToPoint
from cspr_drivers.canopen.cia402 import State
from cspr_kinematics import Pose
from cspr_msgs_py.vocabulary import DriverState, RobotState

CONFIG = Path(__file__).parents[2] / "config"
MOTOR = 2
LARGEST_DROP = 0.02  # m


class Bench:
    def __init__(self, config):
        self.loop = loop = closed_loop(Scenario(payload=200.0, config=config))
        self.plant = loop.machine.plant
        loop.begin()
        loop.time.wait(1.0)
        loop.enable()
        loop.time.wait(0.5)
        self.heights = [self.height]
        self.closed_at = None
        self.lowest_torque = np.inf
        loop.machine.on_tick = self.look

    @property
    def height(self):
        return self.plant.platform_position()[2]

    @property
    def drop(self):
        return self.heights[0] - min(self.heights)

    def look(self):
        self.heights.append(self.height)
        if self.closed_at is None and not any(device.brake_open for device in self.loop.machine.devices):
            self.closed_at = self.loop.time.monotonic()

    def stop(self):
        """Stop as the operator does; return the time until all brakes are closed, s."""
        begin, self.closed_at = self.loop.time.monotonic(), None
        assert self.loop.order("/supervisor/stop").accepted
        self.loop.wait_until(lambda: self.closed_at is not None, 2.0, lambda: "brakes are open")
        return self.closed_at - begin

    def until(self, state):
        self.loop.wait_until(lambda: self.loop.state is state, 2.0, lambda: f"it is {self.loop.state}")

    @property
    def in_operation(self):
        return [device.automaton.state is State.OPERATION_ENABLED for device in self.loop.machine.devices]


@pytest.fixture
def config(tmp_path):
    """The shipped configuration, with brakes that the host commands."""
    directory = tmp_path / "config"
    shutil.copytree(CONFIG, directory)
    text = (directory / "can.yaml").read_text()
    (directory / "can.yaml").write_text(f"{text}\nbrake_output: {{bit: 0, closed: 1}}\n")
    return directory


@pytest.fixture
def bench(config):
    bench = Bench(config)
    yield bench
    bench.loop.machine.close()


def test_brakes_that_hold_are_proven_and_the_stop_is_not_delayed(bench):
    plain = Bench(CONFIG)
    without = plain.stop()
    plain.loop.machine.close()
    assert bench.stop() <= without + 0.004
    assert all(bench.in_operation)
    bench.until(RobotState.DISABLED)
    assert bench.loop.machine.drives.snapshot().brake_proof == "all brakes have held"
    assert bench.drop < 1e-4
    assert not any(bench.in_operation)
    bench.loop.enable()
    bench.loop.time.wait(0.5)
    assert bench.loop.state is RobotState.ENABLED


def test_a_brake_that_slips_leaves_the_drives_holding_until_the_load_is_let_down(bench):
    loop = bench.loop
    loop.machine.faults.inject(loop.machine.faults.read("brake_slip motor_3"))
    bench.stop()
    bench.until(RobotState.HELD_BY_DRIVES)
    loop.time.wait(3.0)
    assert loop.state is RobotState.HELD_BY_DRIVES
    assert "brake slips: the drives hold the load" in loop.cause
    assert "motor_3" in loop.cause
    assert all(bench.in_operation)
    assert bench.drop < 0.002
    assert not loop.order("/supervisor/reset").accepted
    loop.machine.devices[4].writers[0x605A, 0](1)  # a setting that is changed now must not let the load go
    assert loop.order("/supervisor/enable").accepted
    loop.wait_for(RobotState.ENABLED, 2.0)
    assert loop.cause == ""
    loop.time.wait(1.0)
    assert loop.state is RobotState.ENABLED
    down = np.array([0.0, 0.0, -0.1])
    loop.play(lambda here: PointToPoint(here, Pose(here.position + down, here.rotation), loop.player.limits))
    loop.wait_until(lambda: loop.player.phase.at_rest, 5.0, lambda: "it moves")
    loop.machine.faults.clear()
    bench.stop()
    bench.until(RobotState.DISABLED)


def test_all_brakes_that_slip_cost_less_height_than_is_allowed(bench):
    for motor in range(8):
        bench.plant.weaken_brake(motor, 0.09)
    bench.stop()
    bench.until(RobotState.HELD_BY_DRIVES)
    bench.loop.time.wait(2.0)
    assert bench.drop < LARGEST_DROP
    assert all(bench.in_operation)


def test_a_second_stop_tests_again(bench):
    loop = bench.loop
    bench.plant.weaken_brake(MOTOR, 0.05)
    bench.stop()
    bench.until(RobotState.HELD_BY_DRIVES)
    assert loop.order("/supervisor/stop").message == "testing the brakes again"
    loop.time.wait(0.01)
    bench.until(RobotState.HELD_BY_DRIVES)
    assert all(bench.in_operation)
    assert bench.drop < 0.003


def test_held_by_drives_nothing_but_the_operator_takes_the_torque(bench):
    loop = bench.loop
    bench.plant.weaken_brake(MOTOR, 0.05)
    bench.stop()
    bench.until(RobotState.HELD_BY_DRIVES)
    loop.machine.faults.inject(loop.machine.faults.read("supervisor_killed"))
    loop.tampering[0] = lambda torque: None  # a controller that has ended
    loop.machine.faults.inject(loop.machine.faults.read("drive_no_feedback motor_6"))
    loop.time.wait(3.0)
    state, cause, _ = loop.machine.drives.states()
    assert state is DriverState.HELD_BY_DRIVES
    assert cause.startswith("brake slips under its load: motor_3")
    assert "motor_6: silent" in cause
    assert all(bench.in_operation)
    assert bench.drop < 0.003
    loop.machine.drives.quick_stop("quick stop commanded")
    loop.time.wait(1.0)
    state, cause, _ = loop.machine.drives.states()
    assert state is DriverState.FAULT
    assert not any(bench.in_operation)


def test_torque_that_is_gone_stays_gone_and_the_slip_is_watched(bench):
    loop = bench.loop
    bench.plant.weaken_brake(MOTOR, 0.05)
    loop.machine.call("/can_drives/quick_stop")
    loop.time.wait(1.0)
    assert loop.state is RobotState.FAULT
    assert "quick stop commanded; then brake slips: motor_3 has turned by" in loop.cause
    loop.time.wait(3.0)
    assert not any(bench.in_operation)


def test_after_a_controlled_fault_the_robot_is_held_by_drives_with_both_causes(bench):
    loop = bench.loop
    bench.plant.weaken_brake(MOTOR, 0.05)
    loop.machine.faults.inject(loop.machine.faults.read("load_cell_silent cable_5"))
    bench.until(RobotState.HELD_BY_DRIVES)
    assert "load cell not plausible: cable_5" in loop.cause
    assert "then brake slips: the drives hold the load" in loop.cause
