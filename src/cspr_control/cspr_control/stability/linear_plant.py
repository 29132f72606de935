"""Platform, elastic cables and winches, linearised about rest at a pose with a payload (docs/stability.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from cspr_control.errors import StabilityError
from cspr_kinematics import (
    Acceleration,
    Method,
    Payload,
    Pose,
    Robot,
    Twist,
    distribute_tensions,
    inverse_kinematics,
    required_wrench,
    rope_wrench,
    static_wrench,
)

FloatArray = NDArray[np.float64]

_STEP = 1e-6  # m and rad, of the central differences of wrench matrix and weight


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """``xdot = F x + B tau`` about rest, with ``x = (xi, nu, q, qdot)`` and tensions ``t = t0 + C x``.

    xi (6,) displaces the platform: position, m, and rotation vector, rad, in base axes; nu is its twist. q (m,) are
    deviations of the motor angles, rad. Dry friction is left out: at rest it only helps, and it hides what would
    otherwise grow.

    Attributes
    ----------
    robot, pose, payload
        What was linearised.
    F, B
        (12 + 2 m, 12 + 2 m) and (12 + 2 m, m).
    C
        (m, 12 + 2 m), N.
    tensions
        t0, those with which the feed-forward holds the platform (m,), N.
    wrench_matrix
        A (6, m).
    tension_slope, weight_slope
        (6, 6): what a displacement changes in the wrench of constant tensions, and in what holds weight and ropes.
    mass_matrix
        H (6, 6) of platform and payload about the platform's origin.
    axial_stiffness
        Of the cables from drum to anchor point (m,), N/m.
    """

    robot: Robot
    pose: Pose
    payload: Payload
    F: FloatArray
    B: FloatArray
    C: FloatArray
    tensions: FloatArray
    wrench_matrix: FloatArray
    tension_slope: FloatArray
    weight_slope: FloatArray
    mass_matrix: FloatArray
    axial_stiffness: FloatArray

    @property
    def motors(self) -> slice:
        """Where q stands in x."""
        return slice(12, 12 + self.robot.number_of_cables)

    def held_stiffness(self, kp: float) -> FloatArray:
        """Return the stiffness (6, 6) against displacements, the springs of the controllers in series with the cables.

        The Hessian of the potential that PD controllers give the platform: where it is positive definite, rest is a
        strict minimum. It is symmetric where the tensions hold the weight, but for rounding.
        """
        r = self.robot.winch.transmission_ratio
        extension = 1.0 + self.tensions / self.robot.cables.axial_stiffness
        series = 1.0 / (1.0 / self.axial_stiffness + extension * r * r / kp)
        stiffness = (self.wrench_matrix * series) @ self.wrench_matrix.T
        stiffness += self.weight_slope - self.tension_slope
        return np.asarray(0.5 * (stiffness + stiffness.T))

    def between(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return ``(P, G)`` of ``x(t + time) = P x(t) + G tau`` under a constant torque, exactly; time in s."""
        n, m = self.B.shape
        both = np.zeros((n + m, n + m))
        both[:n, :n], both[:n, n:] = self.F, self.B
        both = expm(both * time)
        return both[:n, :n], both[:n, n:]


def linear_plant(robot: Robot, pose: Pose, payload: Payload, method: Method = "closest") -> LinearPlant:
    """Linearise a robot at rest.

    Parameters
    ----------
    robot
        With elastic cables: its `cables` have a finite stiffness.
    pose
        Where it hangs.
    payload
        What it carries.
    method
        By which the wrench is distributed over the cables.

    Raises
    ------
    StabilityError
        If a cable is inextensible: then nothing bounces, and the model says nothing.
    cspr_kinematics.KinematicsError
        If there is no such pose.
    """
    cables, motor = robot.cables, robot.motor
    if not np.isfinite(cables.axial_stiffness).all():
        raise StabilityError(
            "the stability of the loop cannot be computed: how much the cables stretch is not known; give "
            "cables.axial_stiffness in robot.yaml, a catalogue value will do"
        )
    r, m = robot.winch.transmission_ratio, robot.number_of_cables
    lengths = inverse_kinematics(robot, pose).lengths
    A, weight = _wrenches(robot, pose, payload, np.zeros(6))
    t0 = distribute_tensions(A, weight, robot.tension_min, robot.tension_max, method).tensions

    tension_slope, weight_slope = np.empty((6, 6)), np.empty((6, 6))
    for column, displacement in enumerate(_STEP * np.eye(6)):
        (A1, w1), (A0, w0) = (_wrenches(robot, pose, payload, sign * displacement) for sign in (1.0, -1.0))
        tension_slope[:, column] = (A1 - A0) @ t0 / (2.0 * _STEP)
        weight_slope[:, column] = (w1 - w0) / (2.0 * _STEP)

    # l + d = (f + d) (1 + t / EA), f = f_home + r q
    free = (lengths + cables.dead_length) / (1.0 + t0 / cables.axial_stiffness)
    by_length = cables.axial_stiffness / free
    by_angle = r * (cables.axial_stiffness + t0) / free
    damping = by_length * cables.damping_time
    n = 12 + 2 * m
    xi, nu, q, qdot = slice(6), slice(6, 12), slice(12, 12 + m), slice(12 + m, n)
    C = np.zeros((m, n))
    C[:, xi], C[:, nu] = -by_length[:, None] * A.T, -damping[:, None] * A.T
    C[:, q], C[:, qdot] = -np.diag(by_angle), -np.diag(r * damping)

    F, B = np.zeros((n, n)), np.zeros((n, m))
    F[xi, nu], F[q, qdot] = np.eye(6), np.eye(m)
    force = A @ C
    force[:, xi] += tension_slope - weight_slope
    H = _mass_matrix(robot, pose, payload)
    F[nu] = np.linalg.solve(H, force)
    F[qdot] = r / motor.inertia * C
    F[qdot, qdot] -= np.eye(m) * motor.viscous_friction / motor.inertia
    B[qdot] = np.eye(m) / motor.inertia
    return LinearPlant(robot, pose, payload, F, B, C, t0, A, tension_slope, weight_slope, H, by_length)


def displaced(pose: Pose, displacement: FloatArray) -> Pose:
    """Return a pose moved by a small displacement (6,): position, m, and rotation vector, rad, in base axes."""
    x, y, z = displacement[3:]
    turn = expm(np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
    return Pose(pose.position + displacement[:3], turn @ pose.rotation)


def _wrenches(
    robot: Robot, pose: Pose, payload: Payload, displacement: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return wrench matrix (6, m) and the wrench that holds weight and ropes (6,) at a displaced pose."""
    there = displaced(pose, displacement)
    cables = inverse_kinematics(robot, there)
    return cables.wrench_matrix, static_wrench(robot, there, payload) + rope_wrench(robot, cables)


def _mass_matrix(robot: Robot, pose: Pose, payload: Payload) -> FloatArray:
    """Return H (6, 6) about the platform's origin, in base axes: what each unit of acceleration adds to the wrench."""
    accelerations = Acceleration(*np.split(np.eye(6), 2, axis=1))
    wrenches = required_wrench(robot, pose, Twist.zero(), accelerations, payload)
    return np.asarray((wrenches - static_wrench(robot, pose, payload)).T)
