import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.topics import motor_names
from cspr_msgs_py.wire.conversion import decode_joint, decode_joint_state
from cspr_msgs_py.wire.joint_state import FIELDS, JointStateCodec

STAMP = 1_700_000_000_123_456_789


def message(names, frame_id="", position=(), velocity=(), effort=()) -> JointState:
    result = JointState(
        name=list(names), position=list(position), velocity=list(velocity), effort=list(effort)
    )
    result.header.frame_id = frame_id
    result.header.stamp.sec, result.header.stamp.nanosec = divmod(STAMP, 10**9)
    return result


def test_golden_bytes() -> None:
    codec = JointStateCodec(["motor_1"], velocity=False)
    expected = (
        "00010000"  # plain CDR, little-endian
        "01000000 02000000"  # stamp
        "01000000 00 000000"  # frame_id: only its final zero, then padding
        "01000000 08000000 6d6f746f725f3100"  # one name of eight bytes
        "01000000 00000000 000000000000f03f"  # one position: padding to a multiple of eight, then 1.0
        "00000000"  # no velocity
        "01000000 00000000000000c0"  # one effort, aligned as it stands: -2.0
    )
    assert codec.encode(1_000_000_002, position=[1.0], effort=[-2.0]) == bytes.fromhex(expected)


@pytest.mark.parametrize("number", [1, 6, 8, 12])
@pytest.mark.parametrize("frame_id", ["", "base", "a longer frame"])
@pytest.mark.parametrize("carried", range(8))
def test_bytes_are_those_of_rclpy(number: int, frame_id: str, carried: int) -> None:
    names = motor_names(number)
    rng = np.random.default_rng(number)
    fields = {field: rng.normal(size=number) for bit, field in enumerate(FIELDS) if carried >> bit & 1}
    codec = JointStateCodec(names, frame_id, *(field in fields for field in FIELDS))
    expected = message(names, frame_id, **fields)

    ours = codec.encode(STAMP, **fields)
    assert deserialize_message(ours, JointState) == expected

    # rmw's buffer may be longer than the message, and its padding holds stale memory; all else is the same.
    theirs = serialize_message(expected)
    assert len(theirs) - len(ours) in range(20)
    for data in (ours, theirs[: len(ours)]):
        sample = codec.decode(data)
        assert sample is not None
        assert sample.stamp_ns == STAMP
        for field in FIELDS:
            np.testing.assert_array_equal(getattr(sample, field), fields.get(field, []))
            assert not getattr(sample, field).flags.writeable


@given(st.lists(st.floats(width=64), min_size=8, max_size=8), st.integers(0, 2**31 * 10**9 - 1))
def test_every_double_and_stamp_survives(values: list[float], stamp_ns: int) -> None:
    codec = JointStateCodec(motor_names(8), position=False, velocity=False)
    sample = codec.decode(codec.encode(stamp_ns, effort=values))
    assert sample is not None
    assert sample.stamp_ns == stamp_ns
    np.testing.assert_array_equal(sample.effort, values)


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_buffer_is_decoded_to_read_only_arrays(kind) -> None:
    codec = JointStateCodec(motor_names(6))
    sample = codec.decode(kind(codec.encode(1, range(6), range(6), range(6))))
    with pytest.raises(ValueError, match="read-only"):
        sample.position[0] = 1.0


class TestEncodingRefuses:
    codec = JointStateCodec(motor_names(6), velocity=False)

    def test_a_field_of_another_length(self) -> None:
        with pytest.raises(ValueError, match=r"effort has shape \(5,\).*6 names"):
            self.codec.encode(0, np.zeros(6), effort=np.zeros(5))

    def test_a_scalar(self) -> None:
        with pytest.raises(ValueError, match="position has shape"):
            self.codec.encode(0, 1.0, effort=np.zeros(6))

    def test_a_missing_field(self) -> None:
        with pytest.raises(ValueError, match="carries effort, and none is given"):
            self.codec.encode(0, np.zeros(6))

    def test_a_field_that_is_not_carried(self) -> None:
        with pytest.raises(ValueError, match="does not carry velocity"):
            self.codec.encode(0, np.zeros(6), np.zeros(6), np.zeros(6))

    def test_a_stamp_beyond_32_bits_of_seconds(self) -> None:
        with pytest.raises(ValueError, match="32 bits"):
            self.codec.encode(2**31 * 10**9, np.zeros(6), effort=np.zeros(6))

    def test_one_string_for_names(self) -> None:
        with pytest.raises(TypeError, match="sequence of names"):
            JointStateCodec("motor_1")


class TestAnotherLayout:
    codec = JointStateCodec(["motor_1", "motor_2"])
    names = ("motor_2", "other", "motor_1")

    def decode(self, foreign: JointState):
        data = serialize_message(foreign)
        assert self.codec.decode(data) is None
        return decode_joint_state(self.codec, data)

    def test_is_reordered_by_name(self) -> None:
        sample = self.decode(message(self.names, "base", [2, 9, 1], [20, 90, 10], [200, 900, 100]))
        np.testing.assert_array_equal(sample.position, [1, 2])
        np.testing.assert_array_equal(sample.velocity, [10, 20])
        np.testing.assert_array_equal(sample.effort, [100, 200])
        assert sample.stamp_ns == STAMP
        assert not sample.effort.flags.writeable

    def test_big_endian_is_deserialised(self) -> None:
        parts = [struct.pack(">iI", 1, 2), struct.pack(">I", 1) + b"\0\0\0\0", struct.pack(">I", 2)]
        parts += [struct.pack(">I", 8) + name + b"\0" for name in (b"motor_1", b"motor_2")]
        body = b"".join(parts)
        for values in ((1.0, 2.0), (3.0, 4.0), (5.0, 6.0)):
            body += struct.pack(">I", 2)
            body += bytes(-len(body) % 8) + struct.pack(">2d", *values)
        data = b"\x00\x00\x00\x00" + body
        assert self.codec.decode(data) is None
        sample = decode_joint_state(self.codec, data)
        assert sample.stamp_ns == 1_000_000_002
        np.testing.assert_array_equal(sample.effort, [5, 6])

    def test_a_missing_joint_is_named(self) -> None:
        with pytest.raises(MessageError, match="lacks motor_2; it names motor_1, other"):
            self.decode(message(["motor_1", "other"], "", [1, 2], [1, 2], [1, 2]))

    def test_a_joint_named_twice_is_ambiguous(self) -> None:
        names = ["motor_1", "motor_2", "motor_1"]
        with pytest.raises(MessageError, match="motor_1 more than once"):
            self.decode(message(names, "", [1, 2, 3], [1, 2, 3], [1, 2, 3]))

    def test_a_missing_field_is_an_error(self) -> None:
        with pytest.raises(MessageError, match="0 values in velocity"):
            self.decode(message(self.names, "", [1, 2, 3], [], [1, 2, 3]))

    def test_a_field_too_short_is_an_error(self) -> None:
        with pytest.raises(MessageError, match="3 names but 2 values in effort"):
            self.decode(message(self.names, "", [1, 2, 3], [1, 2, 3], [1, 2]))

    @pytest.mark.parametrize("length", [0, 3, 4, 12, 30, 100])
    def test_a_frame_cut_short_is_an_error(self, length: int) -> None:
        data = self.codec.encode(0, [1, 2], [3, 4], [5, 6])[:length]
        assert self.codec.decode(data) is None
        with pytest.raises(MessageError, match=f"{length} bytes are not a sensor_msgs/JointState"):
            decode_joint_state(self.codec, data)

    def test_trailing_bytes_are_another_layout(self) -> None:
        data = self.codec.encode(0, [1, 2], [3, 4], [5, 6]) + bytes(4)
        assert self.codec.decode(data) is None
        np.testing.assert_array_equal(decode_joint_state(self.codec, data).effort, [5, 6])


class TestLayoutOfAMessage:
    def test_is_found_from_its_bytes(self) -> None:
        codec = JointStateCodec(motor_names(12), "base", velocity=False)
        found = JointStateCodec.of(codec.encode(0, position=range(12), effort=range(12)))
        assert found.names == codec.names
        assert found.frame_id == "base"
        assert found.fields == ("position", "effort")
        assert found.dtype == codec.dtype

    @pytest.mark.parametrize("length", [0, 4, 8, 20, 40, 90])
    def test_is_not_found_in_a_frame_cut_short(self, length: int) -> None:
        data = JointStateCodec(motor_names(2)).encode(0, [1, 2], [1, 2], [1, 2])
        with pytest.raises(ValueError, match="bytes"):
            JointStateCodec.of(data[:length])

    def test_needs_one_value_a_name(self) -> None:
        with pytest.raises(ValueError, match="2 names, 1 x position"):
            JointStateCodec.of(serialize_message(message(["a", "b"], "", [1.0])))

    def test_makes_columns_of_joined_messages(self) -> None:
        codec = JointStateCodec(motor_names(6))
        data = b"".join(codec.encode(k, np.full(6, k), np.full(6, -k), np.zeros(6)) for k in range(10))
        columns = np.frombuffer(data, codec.dtype)
        np.testing.assert_array_equal(columns["position"][:, 3], np.arange(10))
        np.testing.assert_array_equal(columns["nanoseconds"], np.arange(10))


def test_one_joint_is_the_first_of_the_whole_message() -> None:
    codec = JointStateCodec(motor_names(8))
    fields = dict(zip(FIELDS, np.random.default_rng(1).normal(size=(3, 8)), strict=True))
    buffer = codec.encode(STAMP, **fields)
    expected = (STAMP, *(fields[field][0] for field in FIELDS))
    assert codec.decode_joint(buffer) == expected
    assert decode_joint(codec, buffer) == expected
    # another publisher's layout is found by name
    foreign = message(motor_names(8)[::-1], "elsewhere", **{field: fields[field][::-1] for field in FIELDS})
    assert codec.decode_joint(serialize_message(foreign)) is None
    assert decode_joint(codec, serialize_message(foreign)) == expected


def test_one_joint_of_a_message_cut_short_is_refused() -> None:
    codec = JointStateCodec(motor_names(8))
    buffer = codec.encode(STAMP, *np.zeros((3, 8)))
    assert codec.decode_joint(buffer[:-4]) is None
    with pytest.raises(MessageError):
        decode_joint(codec, buffer[:-4])


def test_one_joint_lacks_what_the_layout_does_not_carry() -> None:
    codec = JointStateCodec(["motor_1"], position=False, velocity=False)
    joint = codec.decode_joint(codec.encode(STAMP, effort=[1.5]))
    assert joint is not None
    assert (joint.stamp_ns, joint.effort) == (STAMP, 1.5)
    assert np.isnan(joint.position)
    assert np.isnan(joint.velocity)
    foreign = decode_joint(codec, serialize_message(message(["motor_1"], "elsewhere", effort=[2.5])))
    assert (foreign.stamp_ns, foreign.effort) == (STAMP, 2.5)
    assert np.isnan(foreign.position)
