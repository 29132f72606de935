"""Geometry, statics and dynamics of cable-suspended parallel robots."""

from .cable_paths import home_lengths
from .dynamics import GRAVITY, balance_regressor, required_wrench, static_wrench
from .energy import cable_power, inertia_matrix, kinetic_energy, potential_energy, wrench_power
from .errors import (
    CableReachError,
    ForwardKinematicsError,
    InvalidInputError,
    KinematicsError,
    RobotFileError,
    SingularWrenchMatrixError,
)
from .feasibility import Feasibility, Task, assess_task, largest_acceleration
from .feedforward_tensions import FeedforwardTensions, feedforward_tensions
from .forward_kinematics import (
    ForwardKinematicsSolution,
    ForwardKinematicsStatus,
    forward_kinematics,
    solve_forward_kinematics,
)
from .interference import Interference, NearestPair, cable_interference
from .inverse_kinematics import Cables, cable_lengths, inverse_kinematics
from .kernels.tension_kernels import TensionStatus
from .motion import Motion, PoseSpline, motion_from_euler, motion_from_quaternion
from .pose import Acceleration, Pose, Twist
from .pose_accuracy import pose_covariance
from .pulleys import Pulleys
from .rigid_body import Payload, RigidBody, combine
from .robot import Robot
from .tension_blend import TensionBlend
from .tension_result import TensionResult
from .tensions import Method, bounded_methods, distribute_tensions
from .winch import Motor, Winch
from .workspace import Workspace, explore_workspace
from .wrench_set import WrenchSet, available_wrenches

__all__ = [
    "GRAVITY",
    "Acceleration",
    "CableReachError",
    "Cables",
    "Feasibility",
    "FeedforwardTensions",
    "ForwardKinematicsError",
    "ForwardKinematicsSolution",
    "ForwardKinematicsStatus",
    "Interference",
    "InvalidInputError",
    "KinematicsError",
    "Method",
    "Motion",
    "Motor",
    "NearestPair",
    "Payload",
    "Pose",
    "PoseSpline",
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
    "bounded_methods",
    "cable_interference",
    "cable_lengths",
    "cable_power",
    "combine",
    "distribute_tensions",
    "explore_workspace",
    "feedforward_tensions",
    "forward_kinematics",
    "home_lengths",
    "inertia_matrix",
    "inverse_kinematics",
    "kinetic_energy",
    "largest_acceleration",
    "motion_from_euler",
    "motion_from_quaternion",
    "pose_covariance",
    "potential_energy",
    "required_wrench",
    "solve_forward_kinematics",
    "static_wrench",
    "wrench_power",
]
