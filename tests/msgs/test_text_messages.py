"""Messages of words are read as rclpy writes them."""

from __future__ import annotations

import pytest
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from cspr_msgs_py.conversions import Level, diagnostic_array, diagnostic_status
from cspr_msgs_py.text_messages import (
    LogLine,
    Status,
    decode_log_line,
    decode_status,
    decode_statuses,
    decode_text,
)


def test_status() -> None:
    message = diagnostic_status("supervisor", Level.ERROR, "fault", {"cause": "Seil 3 löst", "": "x"}, "vm")
    assert decode_status(serialize_message(message)) == Status(
        2, "supervisor", "fault", "vm", {"cause": "Seil 3 löst", "": "x"}
    )


def test_statuses_of_any_length_of_text() -> None:
    statuses = [
        diagnostic_status("n" * k, Level.OK, "m" * (2 * k), {"key": "v" * k}) for k in range(9)
    ]  # every alignment
    decoded = decode_statuses(serialize_message(diagnostic_array(1_500_000_000, statuses)))
    assert [(s.name, s.message, s.values) for s in decoded] == [
        ("n" * k, "m" * (2 * k), {"key": "v" * k}) for k in range(9)
    ]
    assert decode_statuses(serialize_message(diagnostic_array(0, []))) == ()


def test_log_line_and_text() -> None:
    line = Log(
        stamp=Time(sec=5, nanosec=7), level=30, name="drives", msg="cable_5 is slack", file="f", line=9
    )
    assert decode_log_line(serialize_message(line)) == LogLine(
        5_000_000_007, 30, "drives", "cable_5 is slack"
    )
    assert decode_text(serialize_message(String(data="first lift"))) == "first lift"


def test_bytes_that_end_early_are_an_error() -> None:
    data = serialize_message(diagnostic_status("supervisor", Level.OK, "enabled"))
    with pytest.raises(ValueError, match="ends early"):
        decode_status(data[:20])
    with pytest.raises(ValueError, match="not little-endian CDR"):
        decode_text(b"\x00\x00")
