import numpy as np

from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.conversions import (
    diagnostic_array,
    diagnostic_status,
    from_diagnostic_array,
    from_diagnostic_status,
    from_inertia_stamped,
    from_pose_stamped,
    inertia_stamped,
    nanoseconds,
    pose_stamped,
    time_message,
)

STAMP = 1_700_000_000_000_000_007


def test_time_there_and_back() -> None:
    assert nanoseconds(time_message(STAMP)) == STAMP
    assert time_message(STAMP).nanosec == 7


def test_pose_there_and_back() -> None:
    message = pose_stamped(STAMP, np.array([1.0, 2.0, 3.0]), [0.1, 0.2, 0.3, 0.9])
    assert message.header.frame_id == "base"
    stamp, position, quaternion = from_pose_stamped(message)
    assert stamp == STAMP
    np.testing.assert_array_equal(position, [1, 2, 3])
    np.testing.assert_array_equal(quaternion, [0.1, 0.2, 0.3, 0.9])


def test_inertia_there_and_back() -> None:
    message = inertia_stamped(STAMP, 100, (0.01, 0.02, -0.2))
    assert message.header.frame_id == "platform"
    stamp, mass, center = from_inertia_stamped(message)
    assert (stamp, mass) == (STAMP, 100.0)
    np.testing.assert_array_equal(center, [0.01, 0.02, -0.2])


def test_diagnostic_status_there_and_back() -> None:
    message = diagnostic_status("supervisor", Level.ERROR, "fault", {"cause": "slack cable", "cable": 3})
    assert from_diagnostic_status(message) == (
        "supervisor",
        Level.ERROR,
        "fault",
        {"cause": "slack cable", "cable": "3"},
    )


def test_diagnostic_array_keeps_the_order() -> None:
    statuses = [diagnostic_status(name, Level.OK, name.upper()) for name in ("can_drives", "motor_1")]
    message = diagnostic_array(STAMP, statuses)
    assert nanoseconds(message.header.stamp) == STAMP
    read = from_diagnostic_array(message)
    assert list(read) == ["can_drives", "motor_1"]
    assert read["motor_1"] == (Level.OK, "MOTOR_1", {})
