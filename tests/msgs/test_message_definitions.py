import pytest
import rclpy
from rosbags.typesys import get_types_from_msg
from sensor_msgs.msg import JointState

from cspr_msgs_py import message_definitions
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.message_definitions import message_class, message_definition, message_type_hash
from cspr_msgs_py.topics import MOTOR_STATES, ROBOT_STATE, ROSOUT, graph_topics


def test_class_by_name() -> None:
    assert message_class("sensor_msgs/msg/JointState") is JointState


@pytest.mark.parametrize("name", ["JointState", "sensor_msgs/JointState", "std_srvs/srv/Trigger"])
def test_other_names_are_refused(name: str) -> None:
    with pytest.raises(MessageError, match="not the name of a message type"):
        message_class(name)


@pytest.mark.parametrize("name", ["no_such_msgs/msg/Thing", "sensor_msgs/msg/NoSuchThing"])
def test_what_is_not_installed_is_named(name: str) -> None:
    with pytest.raises(MessageError, match=f"{name} is not installed.*install the ROS package"):
        message_class(name)


@pytest.fixture
def without_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """An installation without the .msg files."""
    monkeypatch.setattr(message_definitions, "shared_file", lambda package, name: None)


TYPES = sorted({topic.type for topic in graph_topics(1)} | {"rcl_interfaces/msg/Log", "sensor_msgs/msg/Imu"})


@pytest.mark.parametrize("name", TYPES)
def test_it_is_the_text_of_the_files_where_there_are_any(name: str) -> None:
    package, _, short = name.split("/")
    file = message_definitions.shared_file(package, f"{short}.msg")
    assert file is not None
    assert file.name == f"{short}.msg"
    assert message_definition(name).startswith(file.read_text().rstrip() + "\n")


@pytest.mark.parametrize("name", TYPES)
def test_the_rebuilt_text_says_the_same_of_the_bytes(name: str, request: pytest.FixtureRequest) -> None:
    """By the parser of another project."""
    written = get_types_from_msg(message_definition(name), name)
    request.getfixturevalue("without_files")
    rebuilt = get_types_from_msg(message_definition(name), name)
    assert {each: fields for each, (_, fields) in rebuilt.items()} == {
        each: fields for each, (_, fields) in written.items()
    }


def test_the_hash_of_a_type_is_the_one_that_publishers_tell() -> None:
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        node = rclpy.create_node("hashes", context=context)
        for topic in (MOTOR_STATES, ROBOT_STATE, ROSOUT):
            node.create_publisher(message_class(topic.type), topic.name + "_hash", 1)
            (told,) = node.get_publishers_info_by_topic(topic.name + "_hash")
            assert message_type_hash(topic.type) == str(told.topic_type_hash)
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)


def test_what_is_not_installed_has_no_hash() -> None:
    assert message_type_hash("no_such_msgs/msg/Thing") == ""


def test_constants_have_their_names() -> None:
    constants, _ = get_types_from_msg(
        message_definition("diagnostic_msgs/msg/DiagnosticStatus"), "diagnostic_msgs/msg/DiagnosticStatus"
    )["diagnostic_msgs/msg/DiagnosticStatus"]
    assert [name for name, *_ in constants] == ["OK", "WARN", "ERROR", "STALE"]


@pytest.mark.usefixtures("without_files")
def test_definition_of_nested_messages() -> None:
    separator = "=" * 80
    assert message_definition("sensor_msgs/msg/JointState") == (
        "std_msgs/Header header\n"
        "string[] name\n"
        "float64[] position\n"
        "float64[] velocity\n"
        "float64[] effort\n"
        f"{separator}\n"
        "MSG: std_msgs/Header\n"
        "builtin_interfaces/Time stamp\n"
        "string frame_id\n"
        f"{separator}\n"
        "MSG: builtin_interfaces/Time\n"
        "int32 sec\n"
        "uint32 nanosec\n"
    )


@pytest.mark.usefixtures("without_files")
@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("sensor_msgs/msg/Imu", "float64[9] orientation_covariance"),
        ("sensor_msgs/msg/Image", "uint8[] data"),
        ("sensor_msgs/msg/LaserScan", "float32 angle_min"),
        ("shape_msgs/msg/SolidPrimitive", "float64[<=3] dimensions"),
        ("std_msgs/msg/Bool", "bool data"),
        ("diagnostic_msgs/msg/DiagnosticStatus", "byte level"),
        ("geometry_msgs/msg/PolygonStamped", "geometry_msgs/Point32[] points"),
    ],
)
def test_spelling_of_field_types(name: str, line: str) -> None:
    assert f"{line}\n" in message_definition(name)
