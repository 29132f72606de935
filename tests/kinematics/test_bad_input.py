"""Whatever is passed for an array or a number: an error of the package with the data, or a finite result."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cspr_kinematics import (
    Acceleration,
    CableProperties,
    CableReachError,
    ForwardKinematicsError,
    InvalidInputError,
    KinematicsError,
    Motor,
    Payload,
    Pose,
    PoseSpline,
    Pulleys,
    RigidBody,
    Robot,
    SingularWrenchMatrixError,
    Task,
    TensionBlend,
    Twist,
    Winch,
    assess_task,
    available_wrenches,
    bounded_methods,
    cable_interference,
    cable_lengths,
    distribute_tensions,
    explore_workspace,
    forward_kinematics,
    home_lengths,
    inverse_kinematics,
    motion_from_euler,
    motion_from_quaternion,
    pose_covariance,
    required_wrench,
    solve_forward_kinematics,
    static_wrench,
)

HUGE = 10**400
NO_NUMBERS: list[Any] = [
    None,
    "abc",
    ["1", "2", "3"],
    b"x",
    {},
    object(),
    [None] * 3,
    [[1.0, 2.0], [3.0]],
    HUGE,
    [HUGE, 0, 0],
    1j,
    np.array([1.0 + 2.0j, 0.0, 0.0]),
    np.datetime64("2024-02-29"),
    np.ma.masked_array([1.0, 2.0, 3.0], [False, True, False]),
    np.ma.masked_array([1, 2, 3], [False, True, False]),
    [math.nan] * 3,
    [math.inf, 0.0, 0.0],
]
ZERO, UNIT = np.zeros(3), np.eye(3)
REST = Twist.zero(), Acceleration.zero()


def calls(robot: Robot) -> dict[str, Callable[[Any], object]]:
    """A function of each argument of the public interface that is an array or a number."""
    home, spline = robot.home, PoseSpline(np.arange(5.0), Pose(np.zeros((5, 3)), UNIT))
    w, lengths = static_wrench(robot, home), robot.winch.home_lengths
    A, points = inverse_kinematics(robot, home).wrench_matrix, (robot.exit_points, robot.anchor_points)
    body = robot.platform
    limits = 50.0, 3000.0
    still = [ZERO] * 3
    turned = [[0.0, 0.0, 0.0, 1.0], np.zeros(4), np.zeros(4)]
    return {
        "Pose.position": lambda x: Pose(x, UNIT),
        "Pose.rotation": lambda x: Pose(ZERO, x),
        "Pose.from_euler": lambda x: Pose.from_euler(ZERO, x, 0.0, 0.0),
        "Pose.from_quaternion": lambda x: Pose.from_quaternion(ZERO, x),
        "Twist": lambda x: Twist(x, ZERO),
        "Acceleration": lambda x: Acceleration(ZERO, x),
        "Payload.mass": lambda x: Payload(x, ZERO),
        "Payload.center_of_mass": lambda x: Payload(1.0, x),
        "RigidBody.mass": lambda x: RigidBody(x, ZERO, body.inertia),
        "RigidBody.inertia": lambda x: RigidBody(1.0, ZERO, x),
        "RigidBody.from_inertial_parameters": RigidBody.from_inertial_parameters,
        "Motor": lambda x: Motor(x, 1.0, 1.0, 0.0, 0.0),
        "Winch": lambda x: Winch(x, 30.0, lengths),
        "Winch.motor_angle": robot.winch.motor_angle,
        "Winch.tension": robot.winch.tension,
        "CableProperties.axial_stiffness": CableProperties,
        "CableProperties.damping_time": lambda x: CableProperties(1e6, x),
        "CableProperties.mass_per_metre": lambda x: CableProperties(mass_per_metre=x),
        "Robot.measured_home_tensions": lambda x: dataclasses.replace(
            robot, measured_home_tensions=_required(x)
        ),
        "Robot.length_uncertainty": lambda x: dataclasses.replace(robot, length_uncertainty=_required(x)),
        "Robot.cable_lengths": robot.cable_lengths,
        "Robot.motor_angles": lambda x: robot.motor_angles(lengths, _required(x)),
        "Pulleys.radius": Pulleys,
        "Pulleys.swivel_axis": lambda x: Pulleys(0.05, x),
        "Robot.tension_min": lambda x: dataclasses.replace(robot, tension_min=x),
        "Robot.workspace_min": lambda x: dataclasses.replace(robot, workspace_min=x),
        "Robot.with_geometry": lambda x: robot.with_geometry(exit_points=_required(x)),
        "home_lengths": lambda x: home_lengths(points[0], x, home),
        "static_wrench": lambda x: static_wrench(robot, home, None, _required(x)),
        "required_wrench": lambda x: required_wrench(robot, home, *REST, None, _required(x)),
        "tensions.wrench_matrix": lambda x: distribute_tensions(x, w, *limits),
        "tensions.wrench": lambda x: distribute_tensions(A, x, *limits),
        "tensions.t_min": lambda x: distribute_tensions(A, w, x, 3000.0, "closest"),
        "tensions.t_max": lambda x: distribute_tensions(A, w, 50.0, x, "closest"),
        "tensions.threads": lambda x: distribute_tensions(A, w, *limits, "closest", threads=x),
        "TensionBlend.slew": lambda x: TensionBlend("closest", slew=x),
        "forward.lengths": lambda x: forward_kinematics(robot, x),
        "forward.deviation": lambda x: forward_kinematics(
            robot, lengths, home, length_deviation=_required(x)
        ),
        "forward.max_iterations": lambda x: forward_kinematics(robot, lengths, home, max_iterations=x),
        "solve_forward.deviation": lambda x: solve_forward_kinematics(
            robot, lengths, home, length_deviation=_required(x)
        ),
        "pose_covariance": lambda x: pose_covariance(robot, home, x),
        "Task.payload": lambda x: Task(0.0, x),
        "Task.acceleration": lambda x: Task(linear_acceleration=x),
        "assess_task.lever": lambda x: assess_task(robot, home, lever=x),
        "available_wrenches.matrix": lambda x: available_wrenches(x, *limits),
        "available_wrenches.limit": lambda x: available_wrenches(A, x, 3000.0),
        "WrenchSet.margin": available_wrenches(A, *limits).margin,
        "explore_workspace.lower": lambda x: explore_workspace(robot, lower=_required(x), spacing=1.0),
        "explore_workspace.spacing": lambda x: explore_workspace(robot, spacing=x),
        "explore_workspace.orientations": lambda x: explore_workspace(robot, spacing=1.0, orientations=x),
        "interference.box_size": lambda x: cable_interference(robot, home, box_size=_required(x)),
        "interference.anchor_zone": lambda x: cable_interference(robot, home, anchor_zone=x),
        "motion_from_euler": lambda x: motion_from_euler(x, ZERO, ZERO, *still),
        "motion_from_quaternion": lambda x: motion_from_quaternion(*still, x, *turned[1:]),
        "PoseSpline": lambda x: PoseSpline(x, Pose(np.zeros((5, 3)), UNIT)),
        "PoseSpline call": spline,
    }


def _required(value: Any) -> Any:
    """For an argument that may be left out, in place of None."""
    return "left out" if value is None else value


def test_what_is_no_number_is_refused(robot: Robot) -> None:
    for name, call in calls(robot).items():
        for value in NO_NUMBERS:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                try:
                    message = f"taken: {call(value)!r}"
                except KinematicsError as error:
                    message = str(error)
            assert not message.startswith("taken"), f"{name} takes {value!r}"
            assert "\n" not in message, name
            assert len(message) < 700, name


def test_missing_values_are_not_what_stands_under_the_mask(robot: Robot) -> None:
    whole = np.ma.masked_array([1.0, 2.0, 3.0], [False] * 3)
    np.testing.assert_array_equal(Twist(whole, ZERO).linear, [1.0, 2.0, 3.0])
    with pytest.raises(InvalidInputError, match="not finite"):
        Twist(np.ma.masked_array([1.0, 2.0, 3.0], [False, True, False]), ZERO)


@pytest.mark.parametrize("dtype", [np.float32, np.float16, ">f8", np.int64, np.uint8, object])
def test_other_types_of_numbers_count_as_what_they_are(robot: Robot, dtype: Any) -> None:
    A = np.asarray(inverse_kinematics(robot, robot.home).wrench_matrix, dtype=dtype)
    w = np.array([0, 0, 100, 0, 0, 0], dtype=dtype)
    if np.linalg.matrix_rank(A.astype(float)) == 6:
        given, double = (distribute_tensions(a, x, 50, 3000) for a, x in ((A, w), (A.astype(float), w * 1.0)))
        np.testing.assert_array_equal(given.tensions, double.tensions)
    np.testing.assert_array_equal(Twist(w[:3], w[3:]).linear, [0.0, 0.0, 100.0])


def test_numbers_that_are_not_aligned_count_as_what_they_are(robot: Robot) -> None:
    """As numpy shows the doubles of a message, which lie four bytes off."""
    message = bytes(4) + np.array([0.1, -0.2, 1.3, 0.0, 0.0, 0.6, 0.8]).tobytes()
    position, quaternion = np.frombuffer(message, float, 3, 4), np.frombuffer(message, float, 4, 28)
    assert not position.flags.aligned
    pose = Pose.from_quaternion(position, quaternion)
    np.testing.assert_array_equal(pose.position, [0.1, -0.2, 1.3])
    np.testing.assert_allclose(pose.quaternion, [0.0, 0.0, 0.6, 0.8])
    assert pose.position.flags.aligned


@pytest.mark.parametrize("size", [1e150, 1e200, 1e308])
def test_numbers_too_large_to_reckon_with(any_robot: Robot, size: float) -> None:
    """Squares and products of what is passed overflow: nothing that is not finite comes back in silence."""
    robot, home, m = any_robot, any_robot.home, any_robot.number_of_cables
    A, w = inverse_kinematics(robot, home).wrench_matrix, static_wrench(robot, home)
    huge = np.full(6, size)
    fast, strong = Twist(ZERO, huge[:3]), Acceleration(huge[:3], ZERO)

    def closest(wrench: np.ndarray) -> tuple[Any, ...]:
        return distribute_tensions(A, wrench, robot.tension_min, robot.tension_max, "closest")

    attempts: list[Callable[[], tuple[Any, ...]]] = [
        lambda: closest(required_wrench(robot, home, fast, REST[1])),
        lambda: closest(required_wrench(robot, home, REST[0], strong)),
        lambda: closest(required_wrench(robot, home, *REST, external_wrench=huge)),
        lambda: closest(required_wrench(robot, home, *REST, Payload(size, [0.1, 0.0, 0.0]))),
        lambda: (inverse_kinematics(robot, Pose(huge[:3], UNIT)).lengths,),
        lambda: (cable_lengths(robot, Pose(-huge[:3], UNIT)),),
        lambda: (forward_kinematics(robot, np.full(m, size)).position,),
    ]
    for method in ("minimum_norm", *bounded_methods(m)):
        for wrench, low, high in ((huge, 0.0, 3000.0), (w, -size, size)):
            attempts.append(
                lambda method=method, wrench=wrench, low=low, high=high: distribute_tensions(
                    A, wrench, low, high, method
                )
            )
    for attempt in attempts:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                result = attempt()
            except (InvalidInputError, ForwardKinematicsError, SingularWrenchMatrixError):
                continue
        assert all(np.isfinite(array).all() for array in result)


def test_a_pose_beyond_the_range_of_numbers_names_its_cable(robot_with_pulleys: Robot) -> None:
    far = Pose([[0.0, 0.0, 1.0], [1e200, 0.0, 1.0]], UNIT)
    with pytest.raises(CableReachError, match=r"cable 1: its length exceeds .*\[1\]") as caught:
        inverse_kinematics(robot_with_pulleys, far)
    assert caught.value.index == (1,)
