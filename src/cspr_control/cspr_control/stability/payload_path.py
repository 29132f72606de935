"""From angles and tensions to what they tell, and from the payload to set-points, linearised about rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_control.stability.linear_plant import LinearPlant
from cspr_control.stability.sampled_loop import SetpointDeviation
from cspr_kinematics import Acceleration, Method, Twist, balance_regressor, distribute_tensions

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PayloadLoop:
    """What closes the loop through the estimate of the payload at one place, whichever way it is estimated.

    Attributes
    ----------
    plant
        Linearised at a pose with a payload.
    period
        Of the control cycle, s.
    payload_height
        Assumed z of the payload's centre of mass in platform, m.
    feedforward
        Settings of the feed-forward.
    """

    plant: LinearPlant
    period: float
    payload_height: float
    feedforward: FeedforwardSettings


class LinearObservation:
    """Displacement of the pose with stretch that fits angles and tensions best, and the wrench of the cables there.

    State: what is left of earlier tensions in those that the stretch of damped cables stands for (`CableFollower`).

    Parameters
    ----------
    loop
        Of which plant and period count.
    """

    def __init__(self, loop: PayloadLoop) -> None:
        plant, robot = loop.plant, loop.plant.robot
        self.size = robot.number_of_cables
        share = loop.period / np.maximum(robot.cables.damping_time, 1e-3 * loop.period)
        left = np.exp(-share)
        mean = (1.0 - left) / share
        self._left, self._newest, self._before = np.diag(left), np.diag(1.0 - mean), np.diag(mean - left)
        extension = 1.0 + plant.tensions / robot.cables.axial_stiffness
        to_pose = np.linalg.pinv(-plant.wrench_matrix.T)  # of changed lengths
        self._by_angle = to_pose * (robot.winch.transmission_ratio * extension)
        self._by_tension = to_pose / plant.axial_stiffness
        self._wrench_matrix = plant.wrench_matrix
        self._slope = plant.tension_slope

    def __call__(
        self, state: FloatArray, angles: FloatArray, tensions: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the next state, and displacement and wrench (6, ...) of deviations of angles and tensions (m, ...)."""
        elastic = state + self._newest @ tensions
        displacement = self._by_angle @ angles + self._by_tension @ elastic
        wrench = self._wrench_matrix @ tensions + self._slope @ displacement
        return self._left @ elastic + self._before @ tensions, displacement, wrench


class FeedforwardPath:
    """What deviations of the payload add to the set-points: torques at once, and the stretch of the cables with time.

    Its state is the payload that the newest set-point counts on, the one that its stretch does (`SmoothedStretch`), the
    rate of that now and one cycle before, and its curvature; each for mass, kg, and first moments about x and y, kg m.

    Parameters
    ----------
    loop
        To which it belongs.
    """

    size = 15

    def __init__(self, loop: PayloadLoop) -> None:
        plant, robot, settings = loop.plant, loop.plant.robot, loop.feedforward
        tensions = payload_tensions(plant, loop.payload_height, settings.tension_method)
        self._period, self._slew = loop.period, settings.stretch_slew
        self._torques = robot.winch.motor_torque(tensions.T).T
        # f + d = (l + d) / (1 + t / EA), and its derivative by t
        extension = 1.0 + plant.tensions / robot.cables.axial_stiffness
        per_newton = -1.0 / (plant.axial_stiffness * extension)
        turns = robot.winch.motor_speed(per_newton[:, None].T * tensions.T).T
        self._angles = turns if settings.stretch_compensation else np.zeros_like(turns)
        self._inertia = robot.motor.inertia if settings.winch_inertia else 0.0

    def setpoint(self, state: FloatArray) -> SetpointDeviation:
        """Return what a state makes of the set-points."""
        used, stretch, rate, before, curvature = np.split(state, 5)
        torques = self._torques @ used + self._inertia * (self._angles @ curvature)
        acceleration = self._angles @ (rate - before) / self._period
        return SetpointDeviation(self._angles @ stretch, self._angles @ rate, acceleration, torques)

    def advance(self, state: FloatArray, payload: FloatArray) -> FloatArray:
        """Return the state after a set-point that counts on a payload (3, ...)."""
        _, stretch, rate, _, _ = np.split(state, 5)
        share, slew = self._period / self._slew, self._slew
        beyond, left = stretch - payload, math.exp(-share)
        falling = rate * slew + beyond
        there = payload + left * (beyond + falling * share)
        now = left * (rate - falling * (share / slew))
        curvature = (payload - there) / slew**2 - 2.0 / slew * now
        return np.concatenate((payload, there, now, rate, curvature))


def payload_wrenches(plant: LinearPlant, payload_height: float) -> FloatArray:
    """Return the wrench that holds a unit of a payload's mass, at the assumed height, and of its moments, (6, 3)."""
    columns = balance_regressor(plant.pose, Twist.zero(), Acceleration.zero())
    return np.column_stack((columns[:, 0] + payload_height * columns[:, 3], columns[:, 1], columns[:, 2]))


def payload_tensions(plant: LinearPlant, payload_height: float, method: Method) -> FloatArray:
    """Return how the tensions of the feed-forward follow such a payload, (m, 3)."""
    robot, A = plant.robot, plant.wrench_matrix
    wrenches = payload_wrenches(plant, payload_height).T
    weight = A @ plant.tensions
    both = np.concatenate((weight + wrenches, weight - wrenches))
    found = distribute_tensions(A, both, robot.tension_min, robot.tension_max, method).tensions
    return np.asarray(0.5 * (found[:3] - found[3:]).T)
