"""Geometry, statics and dynamics of cable-suspended parallel robots."""

from cspr_kinematics.dynamics.dynamics import GRAVITY, balance_regressor, required_wrench, static_wrench
from cspr_kinematics.errors import (
    CableReachError,
    ConfigurationFileError,
    ForwardKinematicsError,
    InvalidInputError,
    KinematicsError,
    SingularWrenchMatrixError,
)
from cspr_kinematics.kinematics.accuracy import pose_covariance
from cspr_kinematics.kinematics.forward import (
    ForwardKinematicsSolution,
    ForwardKinematicsStatus,
    forward_kinematics,
    solve_forward_kinematics,
)
from cspr_kinematics.kinematics.inverse import Cables, cable_lengths, inverse_kinematics
from cspr_kinematics.motion.motion import Motion, PoseSpline, motion_from_euler, motion_from_quaternion
from cspr_kinematics.motion.pose import Acceleration, Pose, Twist
from cspr_kinematics.robot.cable_paths import home_lengths
from cspr_kinematics.robot.pulleys import Pulleys
from cspr_kinematics.robot.rigid_body import Payload, RigidBody
from cspr_kinematics.robot.robot import Robot
from cspr_kinematics.robot.winch import Motor, Winch
from cspr_kinematics.tensions._bounded import TensionStatus
from cspr_kinematics.tensions.blend import TensionBlend
from cspr_kinematics.tensions.distribute import Method, bounded_methods, distribute_tensions
from cspr_kinematics.tensions.result import TensionResult
from cspr_kinematics.workspace.feasibility import Feasibility, Task, assess_task, largest_acceleration
from cspr_kinematics.workspace.interference import Interference, NearestPair, cable_interference
from cspr_kinematics.workspace.workspace import Workspace, explore_workspace
from cspr_kinematics.workspace.wrench_set import WrenchSet, available_wrenches

__all__ = [
    "GRAVITY",
    "Acceleration",
    "CableReachError",
    "Cables",
    "ConfigurationFileError",
    "Feasibility",
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
    "distribute_tensions",
    "explore_workspace",
    "forward_kinematics",
    "home_lengths",
    "inverse_kinematics",
    "largest_acceleration",
    "motion_from_euler",
    "motion_from_quaternion",
    "pose_covariance",
    "required_wrench",
    "solve_forward_kinematics",
    "static_wrench",
]
