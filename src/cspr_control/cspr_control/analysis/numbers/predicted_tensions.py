"""Cable tensions that the models predict along a recorded reference, ropes included (docs/model.md, section 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics import (
    Acceleration,
    Payload,
    Pose,
    Robot,
    Twist,
    balance_regressor,
    distribute_tensions,
    inverse_kinematics,
    required_wrench,
    rope_wrench,
)
from cspr_msgs_py.bag.columns import Inertias, References

Floats = NDArray[np.float64]
Times = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PredictedTensions:
    """Tensions along the reference by both models, with the payload that hung there.

    Attributes
    ----------
    time_ns : ndarray, shape (n,)
    dynamic, static : ndarray, shape (n, m)
        N.
    """

    time_ns: Times
    dynamic: Floats
    static: Floats

    @property
    def deviation(self) -> Floats:
        """Dynamic less static (n, m), N."""
        return self.dynamic - self.static

    def dynamic_at(self, time_ns: Times) -> Floats:
        """Return the dynamic model's tensions at other times, between the references; shape (k, m)."""
        columns = [np.interp(time_ns, self.time_ns, column) for column in self.dynamic.T]
        return np.stack(columns, axis=-1)


def predict_tensions(robot: Robot, references: References, payload: Inertias | None) -> PredictedTensions:
    """Predict the tensions along a reference.

    Parameters
    ----------
    robot
        As the controller believed it to be.
    references
        In the order of their stamps.
    payload
        Carried, each from its time on; None for the empty platform.

    Raises
    ------
    InvalidInputError, CableReachError
        If a reference is not one that the robot can have.
    """
    pose = Pose.from_quaternion(references.position, references.quaternion_xyzw)
    twist = Twist(references.linear_velocity, references.angular_velocity)
    acceleration = Acceleration(references.linear_acceleration, references.angular_acceleration)
    parameters = np.zeros((references.time_ns.size, 10))
    if payload is not None:
        since = np.searchsorted(payload.log_time_ns, references.time_ns, side="right") - 1
        # before the first one is known it already hung there
        parameters = _payload_parameters(payload)[np.maximum(since, 0)]
    cables, limits = inverse_kinematics(robot, pose), (robot.tension_min, robot.tension_max)
    A, ropes = cables.wrench_matrix, rope_wrench(robot, cables)
    tensions = []
    for t, a in ((twist, acceleration), (Twist.zero(), Acceleration.zero())):
        # the wrench is linear in the inertial parameters: a payload acts like an external wrench that it takes
        taken = np.einsum("nij,nj->ni", balance_regressor(pose, t, a), parameters)
        wrench = required_wrench(robot, pose, t, a, None, -taken) + ropes
        tensions.append(distribute_tensions(A, wrench, *limits, "closest").tensions)
    return PredictedTensions(references.time_ns, tensions[0], tensions[1])


def _payload_parameters(payload: Inertias) -> Floats:
    """Return the inertial parameters (k, 10) of payloads; a mass that is not one counts as none."""
    mass = np.where(np.isfinite(payload.mass) & (payload.mass > 0.0), payload.mass, 0.0)
    rows = np.column_stack((mass, np.nan_to_num(payload.center_of_mass)))
    distinct, place = np.unique(rows, axis=0, return_inverse=True)
    parameters = np.array([Payload(row[0], row[1:]).inertial_parameters for row in distinct])
    return np.asarray(parameters[place.reshape(-1)])
