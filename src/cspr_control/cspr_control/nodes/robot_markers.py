"""robot_markers: the robot as markers, for RViz and Foxglove.

An executable of its own and not part of `control`: what is only looked at must not take time from the control cycle.
"""

from __future__ import annotations

import sys
import time
from collections import deque
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
    Shape,
    ShapeKind,
    cable_shape,
    frame_shapes,
    path_shape,
    payload_shapes,
    platform_shape,
    reference_shape,
    trajectory_shape,
)
from cspr_control.motors.feedforward import checked_payload
from cspr_control.nodes.parameters import declare_robot
from cspr_control.reference.catalogue import TrajectoryName, TrajectoryOptions, make_trajectory
from cspr_control.reference.point_to_point import MotionLimits
from cspr_kinematics import KinematicsError, Payload, Pose
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import (
    Diagnostics,
    advertise,
    run_nodes,
    steady_timer,
    subscribe_raw,
    subscribe_samples,
)
from cspr_msgs_py.topics import (
    BASE_FRAME,
    CABLE_TENSIONS,
    PAYLOAD,
    PLATFORM_POSE,
    REFERENCE,
    ROBOT_MARKERS,
    TRAJECTORY_STATE,
    cable_names,
)
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.conversion import decode_joint_state, decode_reference
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.reference import ReferenceCodec
from cspr_msgs_py.wire.samples import InertiaSample, PoseSample, Status

_PERIOD = 0.1  # s
_MAX_AGE = 0.5  # s; what is older is not shown
_LIFETIME = 1.0  # s after which a viewer takes a marker away that is not repeated
_PLANNED = {name for name in TrajectoryName if name not in (TrajectoryName.HOLD, TrajectoryName.MOVE)}

_KINDS = {
    ShapeKind.LINES: Marker.LINE_LIST,
    ShapeKind.PATH: Marker.LINE_STRIP,
    ShapeKind.BALLS: Marker.SPHERE_LIST,
    ShapeKind.BOX: Marker.CUBE,
    ShapeKind.TEXT: Marker.TEXT_VIEW_FACING,
}


class RobotMarkers(Node):
    """Publishes the robot as it is ten times a second; what is not known, or too old, is not shown."""

    def __init__(self, **options: Any) -> None:
        super().__init__("robot_markers", **options)
        self._robot = declare_robot(self)
        warm_up(self._robot)
        trail = declare_all(self)["trail"]
        self._tensions_codec = JointStateCodec(
            cable_names(self._robot.number_of_cables), position=False, velocity=False
        )
        self._reference_codec = ReferenceCodec()
        self._pose: tuple[float, int, Pose] | None = None  # each with its time of arrival
        self._payload: tuple[float, Payload] | None = None
        self._tensions: tuple[float, bytes] | None = None
        self._reference: tuple[float, bytes] | None = None
        self._path: deque[NDArray[np.float64]] = deque(maxlen=round(trail / _PERIOD))
        self._trajectory_name = ""
        self._trajectory: Marker | None = None
        self._frame = [_marker(shape) for shape in frame_shapes(self._robot)]
        self._problem = ""
        self._publisher = advertise(self, ROBOT_MARKERS)
        subscribe_samples(self, PLATFORM_POSE, self._on_pose)
        subscribe_samples(self, PAYLOAD, self._on_payload)
        subscribe_samples(self, TRAJECTORY_STATE, self._on_trajectory_state)
        # decoded ten times a second, not each time that one arrives
        subscribe_raw(self, CABLE_TENSIONS, self._on_tensions)
        subscribe_raw(self, REFERENCE, self._on_reference)
        self._diagnostics = Diagnostics(self, self._status)
        self._timer = steady_timer(self, _PERIOD, self._publish)

    def _on_pose(self, sample: PoseSample) -> None:
        try:
            pose = Pose.from_quaternion(sample.position, sample.quaternion_xyzw)
            self._pose = time.monotonic(), sample.stamp_ns, pose
        except KinematicsError as error:
            self._problem = str(error)

    def _on_payload(self, sample: InertiaSample) -> None:
        try:
            payload = checked_payload(PAYLOAD.name, sample.mass, sample.center_of_mass, np.inf)
            self._payload = time.monotonic(), payload
        except PayloadError as error:
            self._problem = str(error)

    def _on_tensions(self, message: bytes) -> None:
        self._tensions = time.monotonic(), message

    def _on_reference(self, message: bytes) -> None:
        self._reference = time.monotonic(), message

    def _on_trajectory_state(self, status: Status) -> None:
        name = status.values.get("trajectory", "")
        if name == self._trajectory_name:
            return
        self._trajectory_name = name
        self._trajectory = None
        if name not in {planned.value for planned in _PLANNED}:
            return
        # speeds do not change the path; where it runs is in the robot's file
        options = TrajectoryOptions(MotionLimits(1.0, 1.0, 1.0, 1.0), self._robot.home)
        try:
            trajectory = make_trajectory(TrajectoryName(name), self._robot, self._robot.home, options)
        except ControlError as error:
            self._problem = str(error)
            return
        self._trajectory = _marker(trajectory_shape(trajectory))

    def _publish(self) -> None:
        now = time.monotonic()
        markers = list(self._frame)
        if self._trajectory is not None:
            markers.append(self._trajectory)
        stamp = time.time_ns()
        if self._pose is not None and now - self._pose[0] <= _MAX_AGE:
            _, stamp, pose = self._pose
            self._path.append(pose.position)
            try:
                shapes = self._shapes(now, pose)
            except (KinematicsError, MessageError) as error:
                self._problem = str(error)
                shapes = [platform_shape(self._robot, pose)]
            markers += [_marker(shape) for shape in shapes]
        message = MarkerArray(markers=markers)
        for marker in markers:
            marker.header.stamp = Time(nanoseconds=stamp).to_msg()
        self._publisher.publish(message)

    def _shapes(self, now: float, pose: Pose) -> list[Shape]:
        robot, tensions = self._robot, None
        shapes = [platform_shape(robot, pose)]
        if self._tensions is not None and now - self._tensions[0] <= _MAX_AGE:
            tensions = decode_joint_state(self._tensions_codec, self._tensions[1]).effort
        shapes.append(cable_shape(robot, pose, tensions))
        if self._payload is not None and now - self._payload[0] <= _MAX_AGE:
            shapes += payload_shapes(pose, self._payload[1])
        if self._reference is not None and now - self._reference[0] <= _MAX_AGE:
            sample = decode_reference(self._reference_codec, self._reference[1])
            reference = Pose.from_quaternion(sample.position, sample.quaternion_xyzw)
            shapes.append(reference_shape(robot, reference))
        if len(self._path) >= 2:
            shapes.append(path_shape(list(self._path)))
        return shapes

    def _status(self) -> list[Status]:
        known = self._pose is not None and time.monotonic() - self._pose[0] <= _MAX_AGE
        level, text = (Level.OK, "showing the robot") if known else (Level.STALE, "no platform pose")
        return [Status.of(self.get_name(), level, text, {"last_problem": self._problem})]


def _marker(shape: Shape) -> Marker:
    """Return a shape as a message, its stamp still to be set."""
    marker = Marker(ns=shape.name, id=0, type=_KINDS[shape.kind], action=Marker.ADD)
    marker.header.frame_id = BASE_FRAME
    marker.lifetime = Duration(seconds=_LIFETIME).to_msg()
    marker.scale.x, marker.scale.y, marker.scale.z = shape.size
    marker.color = _colour(*shape.colour)
    pose = marker.pose
    if shape.kind in (ShapeKind.BOX, ShapeKind.TEXT):
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
