"""Tensions that hold the platform still."""

from __future__ import annotations

from cspr_kinematics.dynamics.dynamics import static_wrench
from cspr_kinematics.dynamics.rope_weight import rope_wrench
from cspr_kinematics.kinematics.inverse import inverse_kinematics
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.rigid_body import Payload
from cspr_kinematics.robot.robot import Robot
from cspr_kinematics.tensions.distribute import distribute_tensions
from cspr_kinematics.tensions.result import TensionResult


def holding_tensions(robot: Robot, pose: Pose, payload: Payload | None = None) -> TensionResult:
    """Return the least tensions within the robot's limits that hold it still, ropes included.

    Parameters
    ----------
    robot : Robot
    pose : Pose
        One pose or a batch.
    payload : Payload, optional
        What the platform carries.

    Raises
    ------
    CableReachError
        If a cable has no path or no direction at a pose.
    SingularWrenchMatrixError
        If no tensions at all hold the platform at a pose.
    """
    cables = inverse_kinematics(robot, pose)
    wrench = static_wrench(robot, pose, payload) + rope_wrench(robot, cables)
    return distribute_tensions(cables.wrench_matrix, wrench, robot.tension_min, robot.tension_max, "closest")
