"""Geometry, statics and dynamics of cable-suspended parallel robots."""

from .dynamics import GRAVITY, required_wrench, static_wrench
from .errors import ForwardKinematicsError, InvalidInputError, KinematicsError, RobotFileError
from .forward_kinematics import ForwardKinematicsSolution, forward_kinematics, solve_forward_kinematics
from .inverse_kinematics import Cables, inverse_kinematics
from .pose import Acceleration, Pose, Twist
from .rigid_body import Payload, RigidBody, combine
from .robot import Robot
from .tensions import TensionResult, distribute_tensions
from .winch import Motor, Winch

__all__ = [
    "GRAVITY",
    "Acceleration",
    "Cables",
    "ForwardKinematicsError",
    "ForwardKinematicsSolution",
    "InvalidInputError",
    "KinematicsError",
    "Motor",
    "Payload",
    "Pose",
    "RigidBody",
    "Robot",
    "RobotFileError",
    "TensionResult",
    "Twist",
    "Winch",
    "combine",
    "distribute_tensions",
    "forward_kinematics",
    "inverse_kinematics",
    "required_wrench",
    "solve_forward_kinematics",
    "static_wrench",
]
