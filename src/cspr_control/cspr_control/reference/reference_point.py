"""The reference: where the platform should be at one instant, and how it should move there."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_kinematics import Acceleration, Pose, Twist
from cspr_msgs_py.wire.reference import ReferenceSample


@dataclass(frozen=True)
class ReferencePoint:
    """Desired motion of the platform at one instant, in base axes; finite, because its parts are.

    Attributes
    ----------
    pose
        Position of the platform's origin (m) and rotation from platform to base.
    twist
        Linear (m/s) and angular (rad/s) velocity.
    acceleration
        Linear (m/s^2) and angular (rad/s^2) acceleration.
    """

    pose: Pose
    twist: Twist
    acceleration: Acceleration

    @staticmethod
    def at_rest(pose: Pose) -> ReferencePoint:
        """Return the reference that holds ``pose``."""
        return ReferencePoint(pose, Twist.zero(), Acceleration.zero())

    @staticmethod
    def of_sample(sample: ReferenceSample) -> ReferencePoint:
        """Return what a message says; raises cspr_kinematics.KinematicsError if it is no finite motion."""
        return ReferencePoint(
            Pose.from_quaternion(sample.position, sample.quaternion_xyzw),
            Twist(sample.linear_velocity, sample.angular_velocity),
            Acceleration(sample.linear_acceleration, sample.angular_acceleration),
        )

    def scaled_in_time(self, rate: float, acceleration: float) -> ReferencePoint:
        """Return the motion of the same path point when path time runs at another pace.

        With path time sigma(t), the chain rule gives the velocity ``v sigma'`` and the acceleration
        ``a sigma'^2 + v sigma''``; it holds for the angular parts too, because the angular velocity is linear
        in the rate.

        Parameters
        ----------
        rate
            sigma', seconds of path a second; 1 leaves the motion as it is.
        acceleration
            sigma'', 1/s.
        """
        twist, a = self.twist, self.acceleration
        return ReferencePoint(
            self.pose,
            Twist(twist.linear * rate, twist.angular * rate),
            Acceleration(
                a.linear * rate**2 + twist.linear * acceleration,
                a.angular * rate**2 + twist.angular * acceleration,
            ),
        )
