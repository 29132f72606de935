import shutil
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from mcap.writer import IndexType, Writer
from rclpy.serialization import serialize_message
from tests.messages import diagnostic_status, inertia_stamped, pose_stamped

from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.bag.mcap_writer import Compression
from cspr_msgs_py.bag.metadata import RecordedTopic
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.errors import BagError, BagWarning
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.topics import INERTIA_STAMPED, JOINT_STATE, MULTI_DOF_TRAJECTORY, POSE_STAMPED
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.reference import VECTORS


def write_messages(directory: Path, type_name: str, messages, topic: str = "/topic") -> Path:
    bag = BagFile(directory, {}, compression=Compression.NONE)
    index = bag.add_topic(RecordedTopic(topic, type_name, message_definition(type_name)))
    for time_ns, data in enumerate(messages):
        bag.add_message(index, time_ns, time_ns, data)
    bag.close()
    return directory


class TestWholeBag:
    @pytest.fixture
    def bag(self, recording):
        with Bag(recording.write()) as bag:
            yield bag

    def test_topics_and_counts(self, bag, recording) -> None:
        assert bag.complete
        assert bag.topics["/motor_states"] == "sensor_msgs/msg/JointState"
        assert bag.counts == {
            "/motor_states": recording.number,
            "/reference": recording.number // 10,
            "/platform_pose": 0,
        }

    def test_attachments_and_metadata(self, bag) -> None:
        assert bag.attachments == {"config/robot.yaml": b"name: x\n"}
        assert bag.metadata["recording"] == {"host": "here"}

    def test_messages_are_the_bytes_that_were_written(self, bag, recording) -> None:
        messages = list(bag.messages("/motor_states"))
        assert [data for _, _, data in messages] == [recording.state(k) for k in range(recording.number)]
        assert messages[3][:2] == (recording.start + 12_000_000,) * 2

    def test_joint_states_are_columns(self, bag, recording) -> None:
        states = bag.joint_states("/motor_states")
        cycles = np.arange(recording.number)
        assert states.names == recording.codec.names
        np.testing.assert_array_equal(states.time_ns, recording.start + cycles)
        np.testing.assert_array_equal(states.log_time_ns, recording.start + cycles * 4_000_000)
        np.testing.assert_array_equal(states.position, cycles[:, None] + np.arange(8.0))
        np.testing.assert_array_equal(states.effort[-1], -np.arange(8.0))

    def test_references_are_columns(self, bag, recording) -> None:
        references = bag.references()
        expected = [recording.reference(index) for index in range(0, recording.number, 10)]
        for field in VECTORS:
            np.testing.assert_array_equal(
                getattr(references, field), [getattr(sample, field) for sample in expected]
            )
        np.testing.assert_allclose(
            references.time_from_start, [sample.time_from_start for sample in expected], atol=1e-9
        )
        np.testing.assert_array_equal(references.time_ns, [sample.stamp_ns for sample in expected])

    def test_a_missing_topic_is_named_with_those_that_are_there(self, bag) -> None:
        with pytest.raises(BagError, match="no topic /nothing; it has /motor_states, /platform_pose"):
            bag.joint_states("/nothing")

    def test_a_silent_topic(self, bag) -> None:
        with pytest.raises(BagError, match="no message on /platform_pose"):
            bag.poses("/platform_pose")

    def test_a_topic_of_another_type(self, bag) -> None:
        with pytest.raises(BagError, match=r"/reference is of type trajectory_msgs.*not sensor_msgs"):
            bag.joint_states("/reference")


def opened_with_warning(path: Path, text: str) -> Bag:
    with pytest.warns(BagWarning, match=text):
        return Bag(path)


class TestCutOffBag:
    def test_without_its_end_everything_is_there(self, recording) -> None:
        directory = recording.write(close=False)
        with opened_with_warning(directory, "was cut off") as bag:
            assert not bag.complete
            assert bag.counts["/motor_states"] == recording.number
            assert bag.joint_states("/motor_states").position.shape == (recording.number, 8)
            assert bag.attachments.keys() == {"config/robot.yaml"}

    @pytest.mark.parametrize("share", [0.3, 0.55, 0.8, 0.97])
    def test_it_is_readable_up_to_its_last_chunk(self, recording, share: float) -> None:
        file = recording.write() / "bag_0.mcap"
        data = file.read_bytes()
        file.write_bytes(data[: int(len(data) * share)])
        with opened_with_warning(file, "are lost") as bag:
            states = bag.joint_states("/motor_states")
            number = len(states.time_ns)
            assert number % 250 == 0  # whole chunks
            assert 0 < number <= recording.number
            np.testing.assert_array_equal(states.position[:, 0], np.arange(number))
            assert bag.counts["/motor_states"] == number

    def test_zeros_that_the_file_system_left_are_not_records(self, recording) -> None:
        file = recording.write(close=False) / "bag_0.mcap"
        with file.open("ab") as stream:
            stream.write(bytes(4096))
        with opened_with_warning(file, "last 4096 of its") as bag:
            assert bag.counts["/motor_states"] == recording.number

    def test_a_last_chunk_without_its_contents_is_left_out(self, recording) -> None:
        file = recording.write(close=False) / "bag_0.mcap"
        data = bytearray(file.read_bytes())
        chunk = data.rindex(b"zstd")
        data[chunk + 40 :] = bytes(len(data) - chunk - 40)
        file.write_bytes(data)
        with opened_with_warning(file, "was cut off") as bag:
            assert bag.counts["/motor_states"] == recording.number - 250


class TestNoBag:
    def test_nothing_there(self, tmp_path: Path) -> None:
        with pytest.raises(BagError, match="there is no bag"):
            Bag(tmp_path / "none")

    def test_a_directory_without_a_bag(self, tmp_path: Path) -> None:
        with pytest.raises(BagError, match=r"neither metadata.yaml nor an .mcap file$"):
            Bag(tmp_path)

    def test_the_directory_around_a_bag(self, recording) -> None:
        directory = recording.write()
        with Bag(directory.parent) as bag:
            assert bag.path == directory
            assert bag.counts["/motor_states"] == recording.number

    def test_an_empty_file(self, tmp_path: Path) -> None:
        (tmp_path / "x.mcap").touch()
        with pytest.raises(BagError, match="is empty"):
            Bag(tmp_path)

    def test_another_file(self, tmp_path: Path) -> None:
        (tmp_path / "x.mcap").write_text("no bag at all")
        with pytest.raises(BagError, match="is not an MCAP file"):
            Bag(tmp_path / "x.mcap")

    def test_metadata_of_something_else(self, tmp_path: Path) -> None:
        (tmp_path / "metadata.yaml").write_text("[1, 2]")
        with pytest.raises(BagError, match=r"metadata.yaml is not the metadata of a bag"):
            Bag(tmp_path)
        (tmp_path / "metadata.yaml").write_text("name: other")
        with pytest.raises(BagError, match=r"metadata.yaml is .*: it lacks 'rosbag2_bagfile_information'"):
            Bag(tmp_path)

    def test_a_file_that_the_metadata_names_is_gone(self, recording) -> None:
        directory = recording.write()
        (directory / "bag_0.mcap").unlink()
        with pytest.raises(BagError, match=r"cannot open .*bag_0.mcap: No such file"):
            Bag(directory)


class TestDamagedBag:
    def test_a_damaged_chunk_is_left_out_and_named(self, recording) -> None:
        file = recording.write() / "bag_0.mcap"
        data = bytearray(file.read_bytes())
        data[data.index(b"zstd") + 100] ^= 0xFF  # in the first chunk
        file.write_bytes(data)
        with Bag(file) as bag:
            with pytest.warns(
                BagWarning, match=r"is damaged .* 1.00 s: 250 of /motor_states, 25 of /reference"
            ):
                states = bag["/motor_states"]
            np.testing.assert_array_equal(states.position[:, 0], np.arange(250, recording.number))
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # once is enough
                assert len(bag["/reference"]) == (recording.number - 250) // 10

    def test_what_lies_behind_a_destroyed_stretch_is_found_by_the_summary(self, recording) -> None:
        file = recording.write() / "bag_0.mcap"
        data = bytearray(file.read_bytes())
        second = data.index(b"zstd", data.index(b"zstd") + 4) - 50
        data[second : second + 200] = b"\xff" * 200
        file.write_bytes(data)
        with opened_with_warning(file, r"bytes \d+ to \d+ are damaged") as bag:
            assert not bag.complete
            number = len(bag["/motor_states"])
            assert recording.number - 500 <= number < recording.number
            assert bag["/motor_states"].position[-1, 0] == recording.number - 1

    def test_a_missing_file_of_several(self, recording) -> None:
        directory = recording.write(split=True)
        (directory / "bag_1.mcap").unlink()
        with opened_with_warning(directory, r"cannot open .*bag_1.mcap") as bag:
            assert not bag.complete
            number = len(bag["/motor_states"])
        assert 0 < number < recording.number


class TestForeignBags:
    """Bags as rosbag2 writes them with its compression plugin, and messages that the graph would not send."""

    @pytest.fixture
    def file(self, recording) -> Path:
        return recording.write() / "bag_0.mcap"

    def declare(self, file: Path, mode: str, name: str) -> Path:
        metadata = yaml.safe_load((file.parent / "metadata.yaml").read_text())
        information = metadata["rosbag2_bagfile_information"]
        information |= {"compression_format": "zstd", "compression_mode": mode, "relative_file_paths": [name]}
        (file.parent / "metadata.yaml").write_text(yaml.safe_dump(metadata))
        return file.parent

    @pytest.mark.parametrize("name", ["bag_0.mcap", "bag_0.mcap.zstd"])
    def test_files_compressed_as_a_whole(self, recording, file: Path, name: str) -> None:
        compressed = file.with_name("bag_0.mcap.zstd")
        compressed.write_bytes(zstandard.compress(file.read_bytes()))
        file.unlink()
        with Bag(self.declare(file, "FILE", name)) as bag:
            np.testing.assert_array_equal(bag["/motor_states"].position[:, 0], np.arange(recording.number))

    def test_a_compressed_file_that_is_none(self, file: Path) -> None:
        file.rename(file.with_name("bag_0.mcap.zstd"))
        with pytest.raises(BagError, match=r"bag_0.mcap.zstd cannot be decompressed"):
            Bag(self.declare(file, "FILE", "bag_0.mcap.zstd"))

    def test_messages_compressed_one_by_one(self, recording, tmp_path: Path) -> None:
        packed = [zstandard.compress(recording.state(index)) for index in range(20)]
        directory = write_messages(tmp_path / "bag", JOINT_STATE, packed)
        with Bag(self.declare(directory / "bag_0.mcap", "MESSAGE", "bag_0.mcap")) as bag:
            np.testing.assert_array_equal(bag["/topic"].position[:, 0], np.arange(20))
            assert [data for *_, data in bag.in_order()] == [recording.state(index) for index in range(20)]

    def test_another_storage(self, file: Path) -> None:
        text = (file.parent / "metadata.yaml").read_text()
        (file.parent / "metadata.yaml").write_text(text.replace("identifier: mcap", "identifier: sqlite3"))
        with pytest.raises(BagError, match="is a bag in sqlite3 and not in mcap: convert it"):
            Bag(file.parent)

    def test_big_endian_messages(self, tmp_path: Path) -> None:
        values = (3, 5, 1, 0, 1, 2, b"a\x00", 1, 1.5, 1, 2.5, 1, 3.5)  # stamp, "", ["a"], three sequences
        layout = "iI IB3x I I2s2x Id I4xd I4xd"
        little, big = (
            bytes([0, order, 0, 0]) + struct.pack(sign + layout, *values)
            for sign, order in (("<", 1), (">", 0))
        )
        with Bag(write_messages(tmp_path / "bag", JOINT_STATE, [little, big])) as bag:
            states = bag["/topic"]
        np.testing.assert_array_equal(states.time_ns, [3_000_000_005] * 2)
        np.testing.assert_array_equal(states.position, [[1.5], [1.5]])
        np.testing.assert_array_equal(states.effort, [[3.5], [3.5]])

    def test_any_type_is_decoded_by_its_definition(self, tmp_path: Path) -> None:
        statuses = [diagnostic_status("node", k % 3, f"text {k}", {"k": k}) for k in range(5)]
        kind = "diagnostic_msgs/msg/DiagnosticStatus"
        with Bag(write_messages(tmp_path / "bag", kind, map(serialize_message, statuses))) as bag:
            read = bag["/topic"]
        assert [message.values[0].value for message in read.messages] == list("01234")
        np.testing.assert_array_equal(read.column("level"), [0, 1, 2, 0, 1])
        np.testing.assert_array_equal(read.time_ns, range(5))  # without a header: when it was received

    def test_a_type_whose_definition_is_in_another_language(self, tmp_path: Path) -> None:
        bag = BagFile(tmp_path / "bag", {})
        topic = bag.add_topic(
            RecordedTopic("/topic", "x/msg/Y", "module x {};", definition_language="ros2idl")
        )
        bag.add_message(topic, 1, 1, b"12345678")
        bag.close()
        with Bag(tmp_path / "bag") as read:
            assert [data for *_, data in read.messages("/topic")] == [b"12345678"]
            with pytest.raises(BagError, match="/topic cannot be decoded, their definition is in 'ros2idl'"):
                read["/topic"]


class TestRanges:
    def test_a_range_of_time(self, recording) -> None:
        with Bag(recording.write()) as bag:
            states = bag.read("/motor_states", start=1.0, end=3.0)
            np.testing.assert_array_equal(states.position[:, 0], np.arange(250, 750))
            assert len(bag.read("/motor_states", start=7.0)) == recording.number - 1750
            assert len(bag.read("/motor_states", end=0.004)) == 1

    def test_an_empty_range(self, recording) -> None:
        with (
            Bag(recording.write()) as bag,
            pytest.raises(BagError, match="/motor_states in this range of time"),
        ):
            bag.read("/motor_states", start=100.0)

    def test_times_count_from_the_start_of_the_bag(self, tmp_path: Path) -> None:
        codec = JointStateCodec(["a"])
        bag = BagFile(tmp_path / "bag", {})
        topics = [bag.add_topic(RecordedTopic(name, JOINT_STATE, "")) for name in ("/early", "/late")]
        for index, topic in enumerate(topics):
            stamp = 5_000_000_000 + index * 2_000_000_000
            bag.add_message(topic, stamp, stamp, codec.encode(stamp, [1], [1], [1]))
        bag.close()
        with Bag(tmp_path / "bag") as read:
            assert read["/early"].time == [0.0]
            assert read["/late"].time == [2.0]

    def test_messages_in_order_of_time(self, tmp_path: Path) -> None:
        """As the recorder writes them: topic by topic between two polls, and chunks that overlap a little."""
        bag = BagFile(tmp_path / "bag", {}, compression=Compression.NONE)
        topics = [bag.add_topic(RecordedTopic(f"/t{k}", JOINT_STATE, "")) for k in range(3)]
        rng = np.random.default_rng(1)
        for window in range(20):
            for topic in topics:
                for time_ns in np.sort(rng.integers(window * 100 - 30, window * 100 + 130, 7)) + 1000:
                    bag.add_message(topic, int(time_ns), int(time_ns), str(time_ns).encode())
            bag.sync()
        bag.close()
        with Bag(tmp_path / "bag") as read:
            times = [message.log_time_ns for message in read.in_order()]
            assert times == sorted(times)
            assert len(times) == 20 * 3 * 7
            chosen = list(read.in_order(["/t1"], start_ns=1500, end_ns=2000))
        assert {message.topic for message in chosen} == {"/t1"}
        assert all(1500 <= message.log_time_ns < 2000 for message in chosen)


def test_messages_of_another_layout_are_reordered(tmp_path: Path) -> None:
    codec = JointStateCodec(["a", "b"], velocity=False)
    other = JointStateCodec(["b", "a"], "base", velocity=False)
    messages = [codec.encode(1, [1, 2], effort=[3, 4]), other.encode(2, [20, 10], effort=[40, 30])]
    with Bag(write_messages(tmp_path / "bag", JOINT_STATE, messages)) as bag:
        states = bag.joint_states("/topic")
    np.testing.assert_array_equal(states.position, [[1, 2], [10, 20]])
    np.testing.assert_array_equal(states.effort, [[3, 4], [30, 40]])
    assert states.velocity.shape == (2, 0)


def test_joints_that_come_and_go(tmp_path: Path) -> None:
    messages = [
        JointStateCodec(["a", "b"], effort=False).encode(0, [1, 2], [3, 4]),
        JointStateCodec(["c"], velocity=False, effort=False).encode(1, [5]),
        JointStateCodec(["b"], effort=False).encode(2, [6], [7]),
    ]
    with Bag(write_messages(tmp_path / "bag", JOINT_STATE, messages)) as bag:
        states = bag["/topic"]
    nan = np.nan
    assert states.names == ("a", "b", "c")
    np.testing.assert_array_equal(states.position, [[1, 2, nan], [nan, nan, 5], [nan, 6, nan]])
    np.testing.assert_array_equal(states.velocity, [[3, 4, nan], [nan, nan, nan], [nan, 7, nan]])
    assert states.effort.shape == (3, 0)


def test_poses_in_several_frames(tmp_path: Path) -> None:
    frames = ["base", "a_frame_with_a_longer_name", "base"]
    messages = [
        serialize_message(pose_stamped(k, [k, 0, 0], [0, 0, 0, 1], frame)) for k, frame in enumerate(frames)
    ]
    with Bag(write_messages(tmp_path / "bag", POSE_STAMPED, messages)) as bag:
        np.testing.assert_array_equal(bag["/topic"].position[:, 0], [0, 1, 2])


def test_a_reference_that_is_none(tmp_path: Path) -> None:
    directory = write_messages(tmp_path / "bag", MULTI_DOF_TRAJECTORY, [bytes(10)])
    with Bag(directory) as bag, pytest.raises(BagError, match="a message on /topic is not a trajectory_msgs"):
        bag.references("/topic")


def test_poses_and_inertias_are_columns(tmp_path: Path) -> None:
    poses = [serialize_message(pose_stamped(k, [k, 2, 3], [0, 0, 0, 1])) for k in range(5)]
    with Bag(write_messages(tmp_path / "poses", POSE_STAMPED, poses)) as bag:
        read = bag.poses("/topic")
    np.testing.assert_array_equal(read.position, [[k, 2, 3] for k in range(5)])
    np.testing.assert_array_equal(read.quaternion_xyzw[0], [0, 0, 0, 1])
    np.testing.assert_array_equal(read.time_ns, range(5))

    inertias = [serialize_message(inertia_stamped(k, 100 + k, [0.1, 0.2, k])) for k in range(5)]
    with Bag(write_messages(tmp_path / "inertias", INERTIA_STAMPED, inertias)) as bag:
        loads = bag.inertias("/topic")
    np.testing.assert_array_equal(loads.mass, [100, 101, 102, 103, 104])
    np.testing.assert_array_equal(loads.center_of_mass[4], [0.1, 0.2, 4])


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"index_types": IndexType.NONE}])
def test_files_of_other_writers(recording, tmp_path: Path, options) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start()
        schema = writer.register_schema(JOINT_STATE, "ros2msg", b"")
        channel = writer.register_channel("/motor_states", "cdr", schema)
        for index in range(20):
            writer.add_message(channel, index, recording.state(index), index)
        writer.finish()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with Bag(path) as bag:
            assert bag.counts == {"/motor_states": 20}
            np.testing.assert_array_equal(bag.joint_states("/motor_states").position[:, 0], range(20))


def test_a_bag_of_several_files(recording) -> None:
    directory = recording.write()
    shutil.copy(directory / "bag_0.mcap", directory / "bag_1.mcap")
    (directory / "metadata.yaml").unlink()
    with Bag(directory) as bag:
        assert bag.counts["/motor_states"] == 2 * recording.number
        assert bag.joint_states("/motor_states").position.shape == (2 * recording.number, 8)
