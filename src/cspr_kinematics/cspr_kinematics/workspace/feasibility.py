"""What payload the robot can hold and accelerate at a pose, within the tension limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import (
    BoolArray,
    FloatArray,
    ReadOnlyArrays,
    non_negative_number,
    positive_number,
    single,
)
from cspr_kinematics.compiled import in_batch, kernel_input
from cspr_kinematics.dynamics.dynamics import required_wrench, static_wrench
from cspr_kinematics.dynamics.rope_weight import rope_wrench
from cspr_kinematics.errors import InvalidInputError
from cspr_kinematics.kinematics.inverse import inverse_kinematics
from cspr_kinematics.motion.pose import Acceleration, Pose, Twist
from cspr_kinematics.robot.rigid_body import Payload
from cspr_kinematics.robot.robot import Robot
from cspr_kinematics.workspace._wrench_set import grid_batch
from cspr_kinematics.workspace.wrench_set import tension_limits


@dataclass(frozen=True, eq=False)
class Task(ReadOnlyArrays):
    """What must be possible at a pose: a range of payloads, each with any acceleration from rest within a box.

    Attributes
    ----------
    payload_min, payload_max : float
        Range of the payload's mass, kg.
    center_of_mass : numpy.ndarray, shape (3,)
        Of the payload, in platform axes from the platform's origin, m.
    linear_acceleration, angular_acceleration : numpy.ndarray, shape (3,)
        Largest accelerations of the platform along and about the axes of base, in both directions and all at
        the same time, m/s^2 and rad/s^2.

    Raises
    ------
    InvalidInputError
        If a payload is negative, the range is not in order, an acceleration is negative, or a value is not
        finite or has another shape.
    """

    payload_min: float
    payload_max: float
    center_of_mass: FloatArray
    linear_acceleration: FloatArray
    angular_acceleration: FloatArray

    def __init__(
        self,
        payload_min: float = 0.0,
        payload_max: float = 0.0,
        center_of_mass: ArrayLike = (0.0, 0.0, 0.0),
        linear_acceleration: ArrayLike = (0.0, 0.0, 0.0),
        angular_acceleration: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        least = non_negative_number("payload_min", payload_min)
        most = non_negative_number("payload_max", payload_max)
        if least > most:
            raise InvalidInputError("payload_min", payload_min, f"must not exceed payload_max = {most}")
        self._set(payload_min=least, payload_max=most)
        for name, value in (
            ("center_of_mass", center_of_mass),
            ("linear_acceleration", linear_acceleration),
            ("angular_acceleration", angular_acceleration),
        ):
            vector = single(name, value, 3)
            if name != "center_of_mass" and vector.min() < 0.0:
                raise InvalidInputError(name, value, "must not be negative; it applies in both directions")
            self._set(**{name: vector})


@dataclass(frozen=True, eq=False)
class Feasibility(ReadOnlyArrays):
    """Whether a task is possible at one pose or a batch of poses; arrays are read-only.

    Attributes
    ----------
    margin : numpy.ndarray, shape (...)
        Shortest additional wrench, N (moments divided by the lever), that makes part of the task
        impossible. Negative if part of it is impossible already; -inf at a singular pose.
    payload_min, payload_max : numpy.ndarray, shape (...)
        Smallest and largest payload that can be held with every acceleration of the task, regardless of the
        task's own range, kg. NaN where there is none. The smallest is not zero where the empty platform is too
        light to keep the cables at their lower limits.
    """

    margin: FloatArray
    payload_min: FloatArray
    payload_max: FloatArray

    @property
    def feasible(self) -> BoolArray:
        """Whether the whole task is possible, shape (...)."""
        return np.asarray(self.margin >= 0.0)


def assess_task(robot: Robot, pose: Pose, task: Task | None = None, *, lever: float = 1.0) -> Feasibility:
    """Return the margin with which `task` is possible at `pose`, ropes included, and the range of possible payloads.

    Parameters
    ----------
    robot : Robot
        Its `tension_min` and `tension_max` are the limits.
    pose : Pose
        One pose or a batch.
    task : Task, optional
        By default, holding the empty platform at rest.
    lever : float
        Length at which a moment counts as a force in the margin, m.

    Raises
    ------
    InvalidInputError
        If the lever is not positive, or a cable has no direction at a pose.
    """
    task = Task() if task is None else task
    moment_scale = np.ones(6)
    moment_scale[3:] = 1.0 / positive_number("lever", lever)
    batch, m = pose.batch_shape, robot.number_of_cables
    count = math.prod(batch)
    cables = inverse_kinematics(robot, pose)
    A = cables.wrench_matrix * moment_scale[:, None]
    wrench, per_kg, box, box_per_kg = _task_wrenches(robot, pose, task)
    wrench = wrench + rope_wrench(robot, cables)
    low, high = tension_limits(robot.tension_min, robot.tension_max, m)
    margin, payloads = np.empty(count), np.empty((count, 2))
    grid_batch(
        kernel_input(A, count, 6, m),
        low,
        high,
        kernel_input(wrench * moment_scale, count, 6),
        kernel_input(per_kg * moment_scale, count, 6),
        kernel_input(box * moment_scale, count, 6, 6),
        kernel_input(box_per_kg * moment_scale, count, 6, 6),
        task.payload_min,
        task.payload_max,
        margin,
        payloads,
    )
    smallest, largest = np.maximum(payloads[:, 0], 0.0), payloads[:, 1]
    none = ~(largest >= 0.0)
    smallest[none] = np.nan
    largest = np.where(none, np.nan, largest)
    return Feasibility(*(in_batch(array, batch) for array in (margin, smallest, largest)))


def _task_wrenches(
    robot: Robot, pose: Pose, task: Task
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the wrench at rest (..., 6), its change per kg of payload, and both of the box (..., 6, 6).

    All wrenches are linear in the mass of a payload with a fixed centre of mass, and in the acceleration.
    """
    kilogram = Payload(1.0, task.center_of_mass)
    rest = static_wrench(robot, pose)
    per_kg = static_wrench(robot, pose, kilogram) - rest
    batch = pose.batch_shape
    box, box_per_kg = np.zeros((*batch, 6, 6)), np.zeros((*batch, 6, 6))
    largest = np.concatenate((task.linear_acceleration, task.angular_acceleration))
    still = Twist(np.zeros((*batch, 3)), np.zeros((*batch, 3)))
    for axis in np.flatnonzero(largest):
        vector = np.zeros((*batch, 6))
        vector[..., axis] = largest[axis]
        acceleration = Acceleration(vector[..., :3], vector[..., 3:])
        box[..., axis, :] = required_wrench(robot, pose, still, acceleration) - rest
        loaded = required_wrench(robot, pose, still, acceleration, kilogram) - rest - per_kg
        box_per_kg[..., axis, :] = loaded - box[..., axis, :]
    return rest, per_kg, box, box_per_kg
