"""The player of trajectories as a component: it moves nothing without a supervisor that lives."""

import numpy as np
import pytest

from cspr_control.components.component import Remark
from cspr_control.components.trajectory import TrajectoryComponent
from cspr_control.reference.player import SECOND
from cspr_control.reference.point_to_point import PointToPoint
from cspr_kinematics import Pose
from cspr_msgs_py.vocabulary import Level, RobotState, TrajectoryPhase
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import PoseSample, SignOfLife, Status

PERIOD = 0.004
BEGIN = 50.0


class Rig:
    """A component whose robot is enabled, and a supervisor that lives unless it is killed."""

    def __init__(self, robot, settings):
        self.component = TrajectoryComponent(robot, settings, PERIOD)
        self.now = BEGIN
        self.lives = True
        self.limits = settings.limits
        self.remarks = []
        self.component.on_platform_pose(BEGIN, PoseSample(0, robot.home.position, robot.home.quaternion))
        self.component.on_robot_state(BEGIN, Status("supervisor", Level.OK, RobotState.ENABLED.value))
        self.run(0.1)

    def run(self, duration):
        for _ in range(round(duration / PERIOD)):
            self.now += PERIOD
            if self.lives:
                self.component.on_supervisor_alive(self.now, SignOfLife(0))
            still = np.zeros(8)
            states = JointStateSample(round(self.now * SECOND), still, still, still)
            outputs = self.component.on_motor_states(self.now, states)
            self.remarks += [output.text for output in outputs if isinstance(output, Remark)]

    def play(self):
        def away(here):
            return PointToPoint(
                here, Pose(here.position + np.array([0.3, 0.0, 0.0]), here.rotation), self.limits
            )

        return self.component.play(self.now, away)[0]

    @property
    def phase(self):
        return self.component.player.phase


@pytest.fixture
def rig(robot, settings):
    return Rig(robot, settings)


def test_nothing_starts_without_a_supervisor(rig):
    rig.lives = False
    rig.run(0.25)
    refused = rig.play()
    assert not refused.accepted
    assert "no sign of life of the supervisor" in refused.message
    rig.lives = True
    rig.run(PERIOD)
    assert rig.play().accepted


def test_what_moves_comes_to_rest_when_the_supervisor_ends(rig):
    assert rig.play().accepted
    rig.run(2.0)
    rig.lives = False
    rig.run(0.19)
    assert rig.phase is TrajectoryPhase.RUNNING
    rig.run(0.02)
    assert rig.phase is TrajectoryPhase.STOPPING
    rig.run(1.0)
    assert rig.phase is TrajectoryPhase.HOLD
    assert "given up: no sign of life of the supervisor" in rig.remarks[0]
