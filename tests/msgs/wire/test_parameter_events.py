"""Parameter events without ROS, against rclpy's own bytes."""

import pytest
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rclpy.serialization import serialize_message

from cspr_msgs_py.wire.parameter_events import TYPE, decode_parameter_event

VALUES = {
    "flag": (True, ParameterType.PARAMETER_BOOL, "bool_value"),
    "count": (-7, ParameterType.PARAMETER_INTEGER, "integer_value"),
    "time_constant": (0.25, ParameterType.PARAMETER_DOUBLE, "double_value"),
    "model": ("static", ParameterType.PARAMETER_STRING, "string_value"),
    "flags": ([True, False, True], ParameterType.PARAMETER_BOOL_ARRAY, "bool_array_value"),
    "counts": ([1, -2], ParameterType.PARAMETER_INTEGER_ARRAY, "integer_array_value"),
    "center": ([0.5, -1.5, 2.0], ParameterType.PARAMETER_DOUBLE_ARRAY, "double_array_value"),
    "words": (["a", "bcd", ""], ParameterType.PARAMETER_STRING_ARRAY, "string_array_value"),
    "nothing": (None, ParameterType.PARAMETER_NOT_SET, ""),
}


def parameter(name):
    value, kind, field = VALUES[name]
    return Parameter(name=name, value=ParameterValue(type=kind, **({field: value} if field else {})))


def test_every_type_is_read():
    event = ParameterEvent(
        node="/feedforward",
        new_parameters=[parameter(name) for name in VALUES],
        changed_parameters=[parameter("model"), parameter("center")],
        deleted_parameters=[parameter("count")],
    )
    decoded = decode_parameter_event(bytes(serialize_message(event)))
    assert decoded.node == "feedforward"
    assert decoded.declared == {name: value for name, (value, _, _) in VALUES.items()}
    assert decoded.changed == {"model": "static", "center": [0.5, -1.5, 2.0]}
    assert TYPE == "rcl_interfaces/msg/ParameterEvent"


def test_other_bytes_are_refused():
    data = bytes(serialize_message(ParameterEvent(node="/a", new_parameters=[parameter("model")])))
    with pytest.raises(ValueError, match="ends early"):
        decode_parameter_event(data[:-8])
    with pytest.raises(ValueError, match="not little-endian CDR"):
        decode_parameter_event(b"\x00\x00" + data[2:])
