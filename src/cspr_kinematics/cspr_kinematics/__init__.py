"""Geometry, statics and dynamics of cable-suspended parallel robots."""

from .dynamics import GRAVITY, balance_regressor, required_wrench, static_wrench
from .errors import (
    CableReachError,
    ForwardKinematicsError,
    InvalidInputError,
    KinematicsError,
    RobotFileError,
    SingularWrenchMatrixError,
)
from .forward_kinematics import (
    ForwardKinematicsSolution,
    ForwardKinematicsStatus,
    forward_kinematics,
    pose_covariance,
    solve_forward_kinematics,
)
from .inverse_kinematics import Cables, cable_lengths, inverse_kinematics
from .pose import Acceleration, Pose, Twist
from .pulleys import Pulleys
from .rigid_body import Payload, RigidBody, combine
from .robot import Robot, home_lengths
from .tensions import TensionResult, distribute_tensions
from .winch import Motor, Winch

__all__ = [
    "GRAVITY",
    "Acceleration",
    "CableReachError",
    "Cables",
    "ForwardKinematicsError",
    "ForwardKinematicsSolution",
    "ForwardKinematicsStatus",
    "InvalidInputError",
    "KinematicsError",
    "Motor",
    "Payload",
    "Pose",
    "Pulleys",
    "RigidBody",
    "Robot",
    "RobotFileError",
    "SingularWrenchMatrixError",
    "TensionResult",
    "Twist",
    "Winch",
    "balance_regressor",
    "cable_lengths",
    "combine",
    "distribute_tensions",
    "forward_kinematics",
    "home_lengths",
    "inverse_kinematics",
    "pose_covariance",
    "required_wrench",
    "solve_forward_kinematics",
    "static_wrench",
]
