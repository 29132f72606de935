"""Where a plant's platform is, as a pose."""

from cspr_drivers.simulation.plant.plant import Plant
from cspr_kinematics import Pose


def platform_pose(plant: Plant) -> Pose:
    """Return the pose of the platform in the base frame."""
    return Pose.from_quaternion(plant.platform_position(), plant.platform_quaternion())
