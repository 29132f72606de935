"""Poses from lengths: of how many the answer is wrong and passes for right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.platform_rows import Row
from benchmarks.problems import CONFIG
from cspr_kinematics import ForwardKinematicsStatus, Pose, Robot, cable_lengths, solve_forward_kinematics

SMALL_FRAME = Path(__file__).parents[1] / "tests" / "kinematics" / "robot" / "ten_cables.yaml"
COUNT = 300
_SPREAD = 0.2  # rad, standard deviation of the rotation about each axis
_SLACK = 0.15  # m
_TURNED, _AWAY = np.radians(1.0), 1e-3  # rad and m: exact lengths leave none of it


def exact_lengths(name: str) -> list[Row]:
    """Look from the home pose for poses whose lengths are exact, of a platform that is small beside its cables."""
    robot = Robot.from_yaml(SMALL_FRAME)
    pose = _poses(robot, _SPREAD)
    found = solve_forward_kinematics(robot, cable_lengths(robot, pose), robot.home)
    turned = Rotation.from_matrix(found.pose.rotation @ np.swapaxes(pose.rotation, 1, 2)).magnitude()
    away = np.linalg.norm(found.pose.position - pose.position, axis=1)
    wrong = found.converged & ((turned > _TURNED) | (away > _AWAY))
    refused = f"{(~found.converged).sum()} refused"
    note = f"{refused}, {(found.status == ForwardKinematicsStatus.AMBIGUOUS).sum()} of them as ambiguous"
    return [Row(name, f"wrong pose accepted, of {COUNT}", int(wrong.sum()), 0, note=note)]


def slack_cable(name: str) -> list[Row]:
    """Look from the true pose of the shipped robot for one that fits while a cable is slack."""
    robot = Robot.from_yaml(CONFIG / "robot.yaml")
    pose = _poses(robot, 0.0)
    lengths = np.array(cable_lengths(robot, pose))
    cable = np.random.default_rng(1).integers(robot.number_of_cables, size=COUNT)
    lengths[np.arange(COUNT), cable] += _SLACK
    found = solve_forward_kinematics(robot, lengths, pose)
    named = (found.slack.argmax(axis=1) == cable) & (found.status == ForwardKinematicsStatus.SLACK_CABLE)
    note = f"the right cable named for {named.sum()}"
    return [Row(name, f"accepted as a pose, of {COUNT}", int(found.converged.sum()), 0, note=note)]


def _poses(robot: Robot, spread: float) -> Pose:
    """Return `COUNT` poses anywhere in the workspace, turned at random."""
    rng = np.random.default_rng(0)
    position = rng.uniform(robot.workspace_min, robot.workspace_max, (COUNT, 3))
    return Pose(position, Rotation.from_rotvec(spread * rng.standard_normal((COUNT, 3))).as_matrix())
