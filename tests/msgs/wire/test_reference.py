import numpy as np
import pytest
from geometry_msgs.msg import Transform, Twist
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.wire.conversion import decode_reference
from cspr_msgs_py.wire.reference import VECTORS, ReferenceCodec, ReferenceSample

CODEC = ReferenceCodec()


@pytest.fixture
def sample() -> ReferenceSample:
    rng = np.random.default_rng(1)
    return ReferenceSample(
        1_700_000_000_000_000_003, 12.345678901, *(rng.normal(size=size) for size in VECTORS.values())
    )


def message(sample: ReferenceSample, joints=("platform",), frame_id="base") -> MultiDOFJointTrajectory:
    transform, velocity, acceleration = Transform(), Twist(), Twist()
    _fill(transform.translation, sample.position)
    _fill(velocity.linear, sample.linear_velocity)
    _fill(velocity.angular, sample.angular_velocity)
    _fill(acceleration.linear, sample.linear_acceleration)
    _fill(acceleration.angular, sample.angular_acceleration)
    rotation = transform.rotation
    rotation.x, rotation.y, rotation.z, rotation.w = sample.quaternion_xyzw
    point = MultiDOFJointTrajectoryPoint(
        transforms=[transform] * len(joints),
        velocities=[velocity] * len(joints),
        accelerations=[acceleration] * len(joints),
    )
    duration = round(sample.time_from_start * 1e9)
    point.time_from_start.sec, point.time_from_start.nanosec = divmod(duration, 10**9)
    result = MultiDOFJointTrajectory(joint_names=list(joints), points=[point])
    result.header.frame_id = frame_id
    result.header.stamp.sec, result.header.stamp.nanosec = divmod(sample.stamp_ns, 10**9)
    return result


def _fill(vector, values) -> None:
    vector.x, vector.y, vector.z = values


def assert_same(actual: ReferenceSample, expected: ReferenceSample) -> None:
    assert actual.stamp_ns == expected.stamp_ns
    assert actual.time_from_start == pytest.approx(expected.time_from_start, abs=1e-9)
    for field in VECTORS:
        np.testing.assert_array_equal(getattr(actual, field), getattr(expected, field))
        assert not getattr(actual, field).flags.writeable


def test_bytes_are_those_of_rclpy(sample: ReferenceSample) -> None:
    ours = CODEC.encode(sample)
    assert deserialize_message(ours, MultiDOFJointTrajectory) == message(sample)
    theirs = serialize_message(message(sample))  # its padding holds stale memory
    assert len(theirs) == len(ours)
    for data in (ours, theirs):
        assert_same(CODEC.decode(data), sample)


def test_golden_frame() -> None:
    zero = ReferenceSample(0, 0.0, *(np.zeros(size) for size in VECTORS.values()))
    head = (
        "00010000 00000000 00000000"  # encapsulation, stamp
        "05000000 6261736500 000000"  # "base"
        "01000000 09000000 706c6174666f726d00 000000"  # one joint, "platform"
        "01000000 01000000"  # one point, one transform: the doubles follow aligned
    )
    data = CODEC.encode(zero)
    assert data[:52] == bytes.fromhex(head)
    # 7 doubles, count and padding, 6 doubles, count and padding, 6 doubles, duration
    assert len(data) == 52 + 56 + 8 + 48 + 8 + 48 + 8


def test_a_negative_time_from_start_survives(sample: ReferenceSample) -> None:
    early = sample._replace(time_from_start=-0.25)
    assert CODEC.decode(CODEC.encode(early)).time_from_start == -0.25


def test_a_vector_of_another_length_is_refused(sample: ReferenceSample) -> None:
    with pytest.raises(ValueError, match=r"quaternion_xyzw has shape \(3,\), not \(4,\)"):
        CODEC.encode(sample._replace(quaternion_xyzw=np.zeros(3)))


def test_another_layout_is_deserialised(sample: ReferenceSample) -> None:
    data = serialize_message(message(sample, joints=("other", "platform")))
    assert CODEC.decode(data) is None
    assert_same(decode_reference(CODEC, data), sample)


def test_another_frame_is_refused(sample: ReferenceSample) -> None:
    with pytest.raises(MessageError, match="frame 'world', not in 'base'"):
        decode_reference(CODEC, serialize_message(message(sample, frame_id="world")))


def test_another_joint_is_refused(sample: ReferenceSample) -> None:
    with pytest.raises(MessageError, match="no joint 'platform'"):
        decode_reference(CODEC, serialize_message(message(sample, joints=("gripper",))))


def test_a_point_too_many_is_refused(sample: ReferenceSample) -> None:
    trajectory = message(sample)
    trajectory.points = [*trajectory.points, *trajectory.points]
    with pytest.raises(MessageError, match="2 points, one is needed"):
        decode_reference(CODEC, serialize_message(trajectory))


def test_missing_accelerations_are_refused(sample: ReferenceSample) -> None:
    trajectory = message(sample)
    trajectory.points[0].accelerations = []
    with pytest.raises(MessageError, match="0 accelerations for 1 joints"):
        decode_reference(CODEC, serialize_message(trajectory))


@pytest.mark.parametrize("length", [0, 4, 60, 200])
def test_a_frame_cut_short_is_refused(sample: ReferenceSample, length: int) -> None:
    with pytest.raises(MessageError, match=f"{length} bytes are not a trajectory_msgs"):
        decode_reference(CODEC, CODEC.encode(sample)[:length])
