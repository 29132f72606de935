import pytest
from sensor_msgs.msg import JointState

from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.message_definitions import message_class, message_definition


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
