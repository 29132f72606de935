"""The robot as shapes: against the kinematics, and what the views in config/views expect of the graph."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import yaml

from cspr_control.markers.robot_markers import (
    STEEL,
    ShapeKind,
    cable_shape,
    frame_shapes,
    path_shape,
    payload_shapes,
    platform_shape,
    trajectory_shape,
)
from cspr_control.markers.tension_colours import TENSION_COLOURS, UNKNOWN, tension_colours
from cspr_control.reference.paper import paper_19
from cspr_kinematics import Payload, Pose, Robot, inverse_kinematics
from cspr_kinematics.kinematics.inverse import cable_lengths
from cspr_msgs_py.topics import (
    BASE_FRAME,
    EXTERNAL_WRENCH,
    LOAD_CELL_CHECK,
    PAYLOAD,
    PAYLOAD_IN_USE,
    PLATFORM_POSE,
    ROBOT_MARKERS,
    TRUE_POSE,
    graph_topics,
)

CONFIG = Path(__file__).parents[3] / "config"
VIEWS = CONFIG / "views"
POSE = Pose.from_euler([0.3, -0.2, 1.2], 0.2, -0.1, 0.15)


@pytest.fixture(params=["robot.yaml", "robot_pulleys.yaml"])
def any_robot(request):
    return Robot.from_yaml(CONFIG / request.param)


def test_cables_run_from_the_anchors_over_the_pulleys_to_the_exit_points(any_robot):
    shape = cable_shape(any_robot, POSE, None)
    anchor, departure, again, exit_point = shape.points.reshape(-1, 4, 3).swapaxes(0, 1)
    np.testing.assert_allclose(anchor, POSE.position + any_robot.anchor_points @ POSE.rotation.T, atol=1e-12)
    np.testing.assert_array_equal(departure, again)
    np.testing.assert_array_equal(exit_point, any_robot.exit_points)
    free = np.linalg.norm(departure - anchor, axis=1)
    np.testing.assert_allclose(free, inverse_kinematics(any_robot, POSE).free_lengths, rtol=1e-12)
    # on the pulley: as far from its centre as its radius, and at right angles to the cable
    radius = any_robot.pulleys.radii(8)
    axis = any_robot.pulleys.axes(8)
    across = anchor - exit_point
    across -= (across * axis).sum(axis=1, keepdims=True) * axis
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    center = exit_point + radius[:, None] * across
    np.testing.assert_allclose(np.linalg.norm(departure - center, axis=1), radius, atol=1e-9)
    np.testing.assert_allclose(((departure - center) * (departure - anchor)).sum(axis=1), 0.0, atol=1e-9)


def test_without_pulleys_what_is_drawn_is_as_long_as_the_cables(robot):
    pieces = cable_shape(robot, POSE, None).points.reshape(-1, 2, 3)
    drawn = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).reshape(-1, 2).sum(axis=1)
    np.testing.assert_allclose(drawn, cable_lengths(robot, POSE), rtol=1e-12)


def test_cables_are_coloured_by_tension(robot):
    tensions = np.linspace(50.0, 3000.0, 8)
    tensions[3] = np.nan
    colours = cable_shape(robot, POSE, tensions).colours.reshape(8, 4, 3)
    assert (colours == colours[:, :1]).all()  # one colour a cable
    first, last = (
        [int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in (TENSION_COLOURS[0], TENSION_COLOURS[-1])
    )
    np.testing.assert_allclose(colours[0, 0], first)
    np.testing.assert_allclose(colours[7, 0], last)
    np.testing.assert_allclose(colours[3, 0], UNKNOWN)
    assert len({tuple(colour) for colour in colours[:, 0]}) == 8
    np.testing.assert_array_equal(tension_colours([-1e3, 1e6], 50.0, 3000.0), [first, last])
    np.testing.assert_array_equal(tension_colours([500.0, 500.0], [500.0, 0.0], [1e3, 500.0]), [first, last])


def test_the_platform_is_where_its_pose_is(robot):
    shape = platform_shape(robot, POSE)
    np.testing.assert_array_equal(shape.points, [POSE.position])
    np.testing.assert_array_equal(shape.size, robot.platform_size)
    np.testing.assert_allclose(
        Pose.from_quaternion(shape.points[0], shape.quaternion).rotation, POSE.rotation
    )
    # the anchors of this robot are the corners of its platform
    np.testing.assert_allclose(np.abs(robot.anchor_points), np.tile(robot.platform_size / 2, (8, 1)))


def test_the_frame_stands_on_the_floor_around_the_exit_points(robot):
    frame, exits = frame_shapes(robot)
    edges = frame.points.reshape(-1, 2, 3)
    assert len(edges) == 12
    lengths = np.sort(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1))
    np.testing.assert_allclose(lengths, np.sort(np.repeat(robot.frame_size, 4)))
    assert frame.points[:, 2].min() == 0.0
    np.testing.assert_array_equal(exits.points, robot.exit_points)
    assert (exits.points >= frame.points.min(axis=0) - 1e-9).all()
    assert (exits.points <= frame.points.max(axis=0) + 1e-9).all()


def test_the_payload_weighs_what_its_ball_of_steel_weighs():
    ball, text = payload_shapes(POSE, Payload(200.0, np.array([0.02, -0.01, 0.05])))
    np.testing.assert_allclose(ball.points[0], POSE.position + POSE.rotation @ [0.02, -0.01, 0.05])
    assert STEEL * np.pi / 6.0 * ball.size[0] ** 3 == pytest.approx(200.0)
    assert text.kind is ShapeKind.TEXT_VIEW_FACING
    assert text.text == "200.0 kg"
    nothing, text = payload_shapes(POSE, Payload.none())
    assert nothing.size[0] < 0.01
    assert text.text == "no payload"


def test_the_trajectory_passes_through_its_samples(robot):
    trajectory = paper_19(robot.trajectory_center)
    points = trajectory_shape(trajectory).points
    np.testing.assert_array_equal(points[0], trajectory.sample(0.0).pose.position)
    np.testing.assert_array_equal(points[-1], trajectory.sample(trajectory.duration).pose.position)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 0.05
    np.testing.assert_array_equal(path_shape([points[0], points[1]]).points, points[:2])


# --- config/views

TOPICS = {topic.name: topic for topic in graph_topics(8)}
PLATFORM_AND_PAYLOAD = (PLATFORM_POSE, TRUE_POSE, PAYLOAD, PAYLOAD_IN_USE, EXTERNAL_WRENCH)


def test_rviz_shows_the_markers_in_base(robot):
    view = yaml.safe_load((VIEWS / "robot.rviz").read_text(encoding="utf-8"))["Visualization Manager"]
    assert view["Global Options"]["Fixed Frame"] == BASE_FRAME
    displays = {display["Name"]: display for display in view["Displays"]}
    assert displays["Robot"]["Topic"]["Value"] == ROBOT_MARKERS.name
    for display in displays.values():
        if "Topic" in display:
            topic = TOPICS[display["Topic"]["Value"]]
            policy = "Reliable" if topic.reliable else "Best Effort"
            assert display["Topic"]["Reliability Policy"] == policy
    shapes = [
        *frame_shapes(robot), platform_shape(robot, POSE), cable_shape(robot, POSE, None),
        *payload_shapes(POSE, Payload.none()), trajectory_shape(paper_19(robot.trajectory_center)),
        path_shape([POSE.position] * 2),
    ]  # fmt: skip
    assert {shape.name for shape in shapes} | {"reference"} == set(displays["Robot"]["Namespaces"])


def test_foxglove_shows_topics_that_there_are():
    layout = json.loads((VIEWS / "foxglove.json").read_text(encoding="utf-8"))
    panels = layout["configById"]

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(layout["layout"])) == sorted(panels)
    shown = set(panels["3D!robot"]["topics"]) | {panels["DiagnosticSummary!health"]["topicToRender"]}
    for panel in panels.values():
        for path in panel.get("paths", []):
            topic, field = re.fullmatch(r"(/[\w/]+)\.([\w.\[\]]+)", path["value"]).groups()
            shown.add(topic)
            _require_field(TOPICS[topic].type, field)
    assert shown <= set(TOPICS)
    assert {each.name for each in (ROBOT_MARKERS, LOAD_CELL_CHECK, *PLATFORM_AND_PAYLOAD)} <= shown


def test_plotjuggler_shows_curves_that_there_are():
    root = ElementTree.parse(VIEWS / "plotjuggler.xml").getroot()
    curves = [curve.attrib["name"] for curve in root.iter("curve")]
    assert len(curves) > 30
    for topic in PLATFORM_AND_PAYLOAD:
        assert any(curve.startswith(f"{topic.name}/") for curve in curves)
    for curve in curves:
        topic = max((name for name in TOPICS if curve.startswith(f"{name}/")), key=len)
        rest = curve.removeprefix(f"{topic}/")
        if TOPICS[topic].type == "sensor_msgs/msg/JointState":
            assert re.fullmatch(r"(motor|cable)_[1-8]/(position|velocity|effort)", rest)
        else:
            _require_field(TOPICS[topic].type, rest.replace("/", "."))


def _require_field(type_name, field):
    from cspr_msgs_py.message_definitions import message_class

    message = message_class(type_name)()
    for name in re.sub(r"\[\d+\]", "", field).split("."):
        message = getattr(message, name)
