"""robot_markers: the robot as markers, for RViz and Foxglove.

An executable of its own and not part of `control`: what is only looked at must not take time from the control cycle.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cspr_control.errors import ControlError, PayloadError
from cspr_control.markers.robot_markers import (
    REFERENCE_COLOUR,
    Shape,
    ShapeKind,
    cable_shape,
    frame_shapes,
    path_shape,
    payload_shapes,
    platform_shape,
    trajectory_shape,
)
from cspr_control.motors.feedforward import checked_payload
from cspr_control.nodes.parameters import declare_robot
from cspr_control.parameters.experiment import TRAJECTORIES
from cspr_control.reference.catalogue import TrajectorySettings, make_trajectory
from cspr_control.reference.point_to_point import MotionLimits
from cspr_kinematics import KinematicsError, Pose
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py import topics
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import (
    advertise,
    report_health,
    run_nodes,
    steady_timer,
    subscribe_raw,
    subscribe_samples,
)
from cspr_msgs_py.topics import Topic
from cspr_msgs_py.vocabulary import Level, TrajectoryName
from cspr_msgs_py.wire.conversion import decoder
from cspr_msgs_py.wire.samples import InertiaSample, PoseSample, Status

_PERIOD = 0.1  # s
_MAX_AGE = 0.5  # s; what is older is not shown
_LIFETIME = 1.0  # s after which a viewer takes a marker away that is not repeated


class RobotMarkers(Node):
    """Publishes the robot as it is ten times a second; what is not known, or too old, is not shown."""

    def __init__(self, **options: Any) -> None:
        super().__init__("robot_markers", **options)
        self._robot = declare_robot(self)
        warm_up(self._robot)
        trail = declare_all(self)["trail"]
        self._newest: dict[Topic, tuple[float, Any]] = {}  # with the time of arrival
        self._path: deque[NDArray[np.float64]] = deque(maxlen=round(trail / _PERIOD))
        self._trajectory_name = ""
        self._trajectory: Marker | None = None
        self._frame = [_marker(shape) for shape in frame_shapes(self._robot)]
        self._problem = ""
        self._publisher = advertise(self, topics.ROBOT_MARKERS)
        subscribe_samples(self, topics.PLATFORM_POSE, self._on_pose)
        subscribe_samples(self, topics.PAYLOAD, self._on_payload)
        subscribe_samples(self, topics.TRAJECTORY_STATE, self._on_trajectory_state)
        # decoded ten times a second, not each time that one arrives
        m = self._robot.number_of_cables
        self._decode = {topic: decoder(topic, m) for topic in (topics.CABLE_TENSIONS, topics.REFERENCE)}
        for topic in self._decode:
            subscribe_raw(self, topic, partial(self._keep, topic))
        report_health(self, self._status)
        steady_timer(self, _PERIOD, self._publish)

    def _on_pose(self, sample: PoseSample) -> None:
        try:
            pose = Pose.from_quaternion(sample.position, sample.quaternion_xyzw)
            self._keep(topics.PLATFORM_POSE, (sample.stamp_ns, pose))
        except KinematicsError as error:
            self._problem = str(error)

    def _on_payload(self, sample: InertiaSample) -> None:
        try:
            self._keep(
                topics.PAYLOAD,
                checked_payload(topics.PAYLOAD.name, sample.mass, sample.center_of_mass, np.inf),
            )
        except PayloadError as error:
            self._problem = str(error)

    def _keep(self, topic: Topic, value: Any) -> None:
        self._newest[topic] = time.monotonic(), value

    def _recent(self, topic: Topic) -> Any:
        """Return what a topic brought last; None if nothing, or too long ago."""
        arrival, value = self._newest.get(topic, (-np.inf, None))
        return value if time.monotonic() - arrival <= _MAX_AGE else None

    def _on_trajectory_state(self, status: Status) -> None:
        name = status.values.get("trajectory", "")
        if name == self._trajectory_name:
            return
        self._trajectory_name = name
        self._trajectory = None
        if name not in TRAJECTORIES:
            return
        # speeds do not change the path; where it runs is in the robot's file
        home, chosen = self._robot.home, TrajectoryName(name)
        settings = TrajectorySettings(chosen, MotionLimits(*([0.1] * 4)), home)
        try:
            trajectory = make_trajectory(chosen, self._robot, home, settings)
        except ControlError as error:
            self._problem = str(error)
            return
        self._trajectory = _marker(trajectory_shape(trajectory))

    def _publish(self) -> None:
        markers = list(self._frame)
        if self._trajectory is not None:
            markers.append(self._trajectory)
        stamp = time.time_ns()
        if (known := self._recent(topics.PLATFORM_POSE)) is not None:
            stamp, pose = known
            self._path.append(pose.position)
            try:
                shapes = self._shapes(pose)
            except (KinematicsError, MessageError) as error:
                self._problem = str(error)
                shapes = [platform_shape(self._robot, pose)]
            markers += [_marker(shape) for shape in shapes]
        message = MarkerArray(markers=markers)
        for marker in markers:
            marker.header.stamp = Time(nanoseconds=stamp).to_msg()
        self._publisher.publish(message)

    def _shapes(self, pose: Pose) -> list[Shape]:
        robot, tensions = self._robot, None
        shapes = [platform_shape(robot, pose)]
        if (message := self._recent(topics.CABLE_TENSIONS)) is not None:
            tensions = self._decode[topics.CABLE_TENSIONS](message).effort
        shapes.append(cable_shape(robot, pose, tensions))
        if (payload := self._recent(topics.PAYLOAD)) is not None:
            shapes += payload_shapes(pose, payload)
        if (message := self._recent(topics.REFERENCE)) is not None:
            sample = self._decode[topics.REFERENCE](message)
            reference = Pose.from_quaternion(sample.position, sample.quaternion_xyzw)
            shapes.append(platform_shape(robot, reference, "reference", REFERENCE_COLOUR))
        if len(self._path) >= 2:
            shapes.append(path_shape(list(self._path)))
        return shapes

    def _status(self) -> list[Status]:
        known = self._recent(topics.PLATFORM_POSE) is not None
        level, text = (Level.OK, "showing the robot") if known else (Level.STALE, "no platform pose")
        return [Status.of(self.get_name(), level, text, {"last_problem": self._problem})]


def _marker(shape: Shape) -> Marker:
    """Return a shape as a message, its stamp still to be set."""
    marker = Marker(ns=shape.name, id=0, type=getattr(Marker, shape.kind.name), action=Marker.ADD)
    marker.header.frame_id = topics.BASE_FRAME
    marker.lifetime = Duration(seconds=_LIFETIME).to_msg()
    marker.scale.x, marker.scale.y, marker.scale.z = shape.size
    marker.color = _colour(*shape.colour)
    pose = marker.pose
    if shape.kind in (ShapeKind.CUBE, ShapeKind.TEXT_VIEW_FACING):
        pose.position = _points(shape.points)[0]
        orientation = pose.orientation
        orientation.x, orientation.y, orientation.z, orientation.w = shape.quaternion
    else:
        marker.points = _points(shape.points)
        marker.colors = [_colour(r, g, b, shape.colour[3]) for r, g, b in shape.colours.tolist()]
    marker.text = shape.text
    return marker


def _points(points: NDArray[np.float64]) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]


def _colour(red: float, green: float, blue: float, opacity: float) -> ColorRGBA:
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)


def main() -> int:
    """Run the markers until SIGINT or SIGTERM."""
    # a priority given to all nodes of the graph is not for this one: the control loop comes first
    return run_nodes(lambda: [RobotMarkers()], realtime=False)


if __name__ == "__main__":
    sys.exit(main())
