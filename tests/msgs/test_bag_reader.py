import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import IndexType, Writer
from rclpy.serialization import serialize_message

from cspr_msgs_py.bag_file import BagFile, Compression
from cspr_msgs_py.bag_metadata import RecordedTopic
from cspr_msgs_py.bag_reader import Bag, BagWarning
from cspr_msgs_py.conversions import inertia_stamped, pose_stamped
from cspr_msgs_py.errors import BagError
from cspr_msgs_py.joint_state import JointStateCodec
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.reference import VECTORS
from cspr_msgs_py.topics import INERTIA_STAMPED, JOINT_STATE, MULTI_DOF_TRAJECTORY, POSE_STAMPED


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
        with pytest.raises(BagError, match=r"neither metadata.yaml nor an .mcap file"):
            Bag(tmp_path)

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

    def test_a_file_that_the_metadata_names_is_gone(self, recording) -> None:
        directory = recording.write()
        (directory / "bag_0.mcap").unlink()
        with pytest.raises(BagError, match=r"cannot open .*bag_0.mcap: No such file"):
            Bag(directory)


def test_a_damaged_chunk_in_a_whole_file_is_an_error(recording) -> None:
    file = recording.write() / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    data[data.index(b"zstd") + 100] ^= 0xFF
    file.write_bytes(data)
    with Bag(file) as bag, pytest.raises(BagError, match=r"chunk at byte .* is damaged"):
        list(bag.messages("/motor_states"))


def test_messages_of_another_layout_are_reordered(tmp_path: Path) -> None:
    codec = JointStateCodec(["a", "b"], velocity=False)
    other = JointStateCodec(["b", "a"], "base", velocity=False)
    messages = [codec.encode(1, [1, 2], effort=[3, 4]), other.encode(2, [20, 10], effort=[40, 30])]
    with Bag(write_messages(tmp_path / "bag", JOINT_STATE, messages)) as bag:
        states = bag.joint_states("/topic")
    np.testing.assert_array_equal(states.position, [[1, 2], [10, 20]])
    np.testing.assert_array_equal(states.effort, [[3, 4], [30, 40]])
    assert states.velocity.shape == (2, 0)


def test_messages_of_other_joints_are_an_error(tmp_path: Path) -> None:
    messages = [JointStateCodec([name]).encode(0, [1], [1], [1]) for name in ("a", "b")]
    with (
        Bag(write_messages(tmp_path / "bag", JOINT_STATE, messages)) as bag,
        pytest.raises(BagError, match=r"it names b .* the first one a"),
    ):
        bag.joint_states("/topic")


def test_a_reference_of_another_layout_is_an_error(tmp_path: Path) -> None:
    directory = write_messages(tmp_path / "bag", MULTI_DOF_TRAJECTORY, [bytes(10)])
    with Bag(directory) as bag, pytest.raises(BagError, match="message 0 on /topic has another layout"):
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
