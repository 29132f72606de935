"""Load cells that are wrong, told from a push and from each other; the sound tensions come from the balance at rest."""

import numpy as np
import pytest

from cspr_control.estimation.cell_monitor import CellMonitor, CellMonitorSettings, CellObservation
from cspr_control.estimation.motor_tensions import MotorTensions, MotorView
from cspr_kinematics import Payload, Pose, distribute_tensions, inverse_kinematics, static_wrench

PERIOD = 0.004
SETTINGS = CellMonitorSettings(
    cell_tolerance=18.0,
    cell_confirmation=0.02,
    cell_recovery=1.0,
    stuck_time=1.0,
    slack_tension=25.0,
)
POSES = [Pose.from_euler([0, 0, 1.0], 0, 0, 0), Pose.from_euler([1.2, 0.6, 0.4], 0.05, -0.05, 0.08)]
LOOK_ALIKES = {0: 5, 5: 0, 1: 4, 4: 1, 2: 7, 7: 2, 3: 6, 6: 3}


class Cells:
    """A platform that hangs still, its cells and motors, and the monitor that is told of them."""

    def __init__(self, robot, rng, pose=POSES[0], push=(0, 0, 0, 0, 0, 0), stiction=0.0):
        self.monitor = CellMonitor(robot.number_of_cables, SETTINGS, 0.02)
        self.time = 50.0
        self._rng = rng
        self._matrix = inverse_kinematics(robot, pose).wrench_matrix
        self._weight = static_wrench(robot, pose, Payload(100.0, [0, 0, 0]))
        wrench = self._weight - np.asarray(push, dtype=float)
        limits = robot.tension_min, robot.tension_max
        self.sound = distribute_tensions(self._matrix, wrench, *limits, "closest").tensions.copy()
        self._motors = self.sound + stiction

    def run(self, duration, wrong=lambda tensions: tensions, following=True, noise=2.0):
        """Let time pass; return when a cell was first left out, s after the begin, or None."""
        begin, found = self.time, None
        for _ in range(round(duration / PERIOD)):
            self.time += PERIOD
            read = wrong(self.sound + noise * self._rng.standard_normal(len(self.sound)))
            self.monitor.observe_readings(self.time, read)
            motors = MotorView(self._motors, np.full(len(read), 8.0**2)) if following else None
            residual = self._matrix @ read - self._weight
            seen = CellObservation(-self._matrix.T, residual, read, motors)
            verdict = self.monitor.update(self.time, seen)
            if verdict.excluded is not None and found is None:
                found = self.time - begin
        return found


def change(cell, to):
    def wrong(tensions):
        tensions[cell] = to(tensions[cell])
        return tensions

    return wrong


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("cell", range(8))
@pytest.mark.parametrize(
    "error", [lambda t: t + 60.0, lambda t: t - 60.0, lambda t: 0.0, lambda t: 0.85 * t, lambda t: t + 150.0]
)
def test_the_wrong_cell_is_found_within_a_tenth_of_a_second(robot, rng, pose, cell, error):
    cells = Cells(robot, rng, pose)
    assert cells.run(2.0) is None
    found = cells.run(0.2, change(cell, error))
    assert cells.monitor.verdict.excluded == cell
    assert found <= 0.1
    assert f"cable_{cell + 1} reads" in cells.monitor.verdict.cause


@pytest.mark.parametrize("cell", range(8))
def test_a_stuck_cell_is_found_after_its_time(robot, rng, cell):
    cells = Cells(robot, rng)
    stuck = cells.sound[cell]
    found = cells.run(1.5, change(cell, lambda t: stuck))
    assert cells.monitor.verdict.excluded == cell
    assert SETTINGS.stuck_time <= found <= SETTINGS.stuck_time + 0.1


@pytest.mark.parametrize(
    "push", [(60, 0, 0, 0, 0, 0), (0, -170, 0, 0, 0, 0), (40, 40, 0, 0, 0, 8), (0, 0, 300, 30, 0, 0)]
)
def test_a_push_excludes_no_cell_and_delays_no_estimate(robot, rng, push):
    cells = Cells(robot, rng, push=push)
    cells.run(0.05)
    assert cells.run(2.0) is None
    assert not cells.monitor.verdict.suspicion


def test_two_cells_of_like_columns_are_told_apart_by_their_motors(robot, rng):
    # the columns of the balance alone leave a few degrees between them
    for cell, other in LOOK_ALIKES.items():
        cells = Cells(robot, rng)
        cells.run(0.5, change(cell, lambda t: t + 60.0))
        assert cells.monitor.verdict.excluded == cell != other


def test_without_torque_nobody_is_blamed(robot, rng):
    cells = Cells(robot, rng)
    assert cells.run(2.0, change(3, lambda t: t + 60.0), following=False) is None


def test_a_truly_slack_cable_is_no_wrong_cell(robot, rng):
    cells = Cells(robot, rng)
    cells.sound[2] = cells._motors[2] = (
        0.0  # what the others then carry does not balance with straight cables
    )
    assert cells.run(1.0) is None


def test_single_noisy_cycles_after_gaps_blame_nobody(robot, rng):
    """What the second difference of one cycle leaves is several times the tolerance."""
    cells = Cells(robot, rng)
    for _ in range(100):
        cells.monitor.forget()
        assert cells.run(0.04, noise=20.0) is None


def test_a_cell_is_believed_again_only_at_rest_and_after_a_while(robot, rng):
    cells = Cells(robot, rng)
    cells.run(0.3, change(4, lambda t: t + 100.0))
    cells.run(3.0)
    assert cells.monitor.verdict.excluded == 4, "it moves under control"
    cells.run(0.5 * SETTINGS.cell_recovery, following=False)
    assert cells.monitor.verdict.excluded == 4
    cells.run(SETTINGS.cell_recovery, following=False)
    assert cells.monitor.verdict.excluded is None


def test_motors_know_the_tension_of_a_turning_winch(robot, rng):
    """Of a motor that follows q = sin, against the balance of its shaft with the true acceleration."""
    motor, ratio = robot.motor, robot.winch.transmission_ratio
    tensions = np.linspace(300.0, 1000.0, 8)
    for periods in (np.full(400, PERIOD), PERIOD * rng.uniform(0.5, 1.5, 400)):  # in time, and late or early
        view, time, found = MotorTensions(robot), 0.0, 0
        for period in periods:
            time += period
            angle, speed, acceleration = 20 * np.sin(4 * time), 80 * np.cos(4 * time), -320 * np.sin(4 * time)
            friction = motor.coulomb_friction * np.sign(speed) + motor.viscous_friction * speed
            torque = motor.inertia * acceleration - ratio * tensions + friction
            seen = view.update(np.full(8, angle), torque, period)
            if seen is not None and abs(speed) > 10.0:
                found += 1
                assert np.abs(seen.tensions - tensions).max() < 3.0
                assert np.sqrt(seen.variance).max() < 30.0
        assert found > 300
        view.clear()
        assert view.update(np.zeros(8), np.zeros(8), PERIOD) is None
