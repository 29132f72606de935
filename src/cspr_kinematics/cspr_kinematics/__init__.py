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
from .feasibility import Feasibility, Task, assess_task, largest_acceleration
from .forward_kinematics import (
    ForwardKinematicsSolution,
    ForwardKinematicsStatus,
    forward_kinematics,
    pose_covariance,
    solve_forward_kinematics,
)
from .interference import Interference, NearestPair, cable_interference
from .inverse_kinematics import Cables, cable_lengths, inverse_kinematics
from .kernels.tension_kernels import TensionStatus
from .pose import Acceleration, Pose, Twist
from .pulleys import Pulleys
from .rigid_body import Payload, RigidBody, combine
from .robot import Robot, home_lengths
from .tension_blend import TensionBlend
from .tension_result import TensionResult
from .tensions import distribute_tensions
from .winch import Motor, Winch
from .workspace import Workspace, explore_workspace
from .wrench_set import WrenchSet, available_wrenches

__all__ = [
    "GRAVITY",
    "Acceleration",
    "CableReachError",
    "Cables",
    "Feasibility",
    "ForwardKinematicsError",
    "ForwardKinematicsSolution",
    "ForwardKinematicsStatus",
    "Interference",
    "InvalidInputError",
    "KinematicsError",
    "Motor",
    "NearestPair",
    "Payload",
    "Pose",
    "Pulleys",
    "RigidBody",
    "Robot",
    "RobotFileError",
    "SingularWrenchMatrixError",
    "Task",
    "TensionBlend",
    "TensionResult",
    "TensionStatus",
    "Twist",
    "Winch",
    "Workspace",
    "WrenchSet",
    "assess_task",
    "available_wrenches",
    "balance_regressor",
    "cable_interference",
    "cable_lengths",
    "combine",
    "distribute_tensions",
    "explore_workspace",
    "forward_kinematics",
    "home_lengths",
    "inverse_kinematics",
    "largest_acceleration",
    "pose_covariance",
    "required_wrench",
    "solve_forward_kinematics",
    "static_wrench",
]
