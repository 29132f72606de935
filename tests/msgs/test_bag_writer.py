import errno
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader

from cspr_msgs_py.bag_file import Attachment, BagFile, Compression
from cspr_msgs_py.bag_metadata import OfferedQos, RecordedTopic
from cspr_msgs_py.bag_reader import Bag, BagWarning
from cspr_msgs_py.bag_writer import FLUSH_PERIOD, BagWriter
from cspr_msgs_py.errors import BagError
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.topics import JOINT_STATE

TOPIC = RecordedTopic(
    "/motor_states",
    JOINT_STATE,
    message_definition(JOINT_STATE),
    (OfferedQos("keep_last", 5, "best_effort", "volatile"),),
)


class TestStandardTools:
    def test_rosbags_opens_the_bag_with_its_metadata(self, recording) -> None:
        with Reader(recording.write()) as reader:
            assert reader.message_count == recording.number * 11 // 10
            assert reader.start_time == recording.start
            assert reader.ros_distro == "jazzy"
            by_topic = {connection.topic: connection for connection in reader.connections}
        assert by_topic["/motor_states"].msgcount == recording.number
        (profile,) = by_topic["/motor_states"].ext.offered_qos_profiles
        assert profile.reliability == QosReliability.BEST_EFFORT
        assert profile.durability == QosDurability.VOLATILE
        assert profile.depth == 1

    def test_rosbags_decodes_by_the_definitions_in_the_bag(self, recording) -> None:
        with AnyReader([recording.write()]) as reader:
            connection, time_ns, data = next(reader.messages())
            message = reader.deserialize(data, connection.msgtype)
        assert (connection.topic, time_ns) == ("/motor_states", recording.start)
        np.testing.assert_array_equal(message.position, np.arange(8.0))

    def test_mcap_ros2_support_decodes_every_message(self, recording) -> None:
        with (recording.write() / "bag_0.mcap").open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            assert reader.get_header().profile == "ros2"
            decoded = list(reader.iter_decoded_messages(topics=["/reference"]))
            summary = reader.get_summary()
        assert len(decoded) == recording.number // 10
        _, channel, _, message = decoded[1]
        expected = recording.reference(10)
        assert message.points[0].transforms[0].translation.x == expected.position[0]
        assert yaml.safe_load(channel.metadata["offered_qos_profiles"])[0]["reliability"] == "best_effort"
        assert {index.compression for index in summary.chunk_indexes} == {"zstd"}

    def test_metadata_inside_the_file_is_that_beside_it(self, recording) -> None:
        directory = recording.write()
        with Bag(directory) as bag:
            inside = yaml.safe_load(bag.metadata["rosbag2"]["serialized_metadata"])
        beside = yaml.safe_load((directory / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        assert inside == beside
        assert beside["version"] == 9
        assert beside["duration"]["nanoseconds"] == (recording.number - 1) * 4_000_000

    def test_a_bag_without_a_message(self, tmp_path: Path) -> None:
        bag = BagFile(tmp_path / "bag", {})
        bag.add_topic(TOPIC)
        bag.close()
        with Reader(bag.directory) as reader:
            assert reader.message_count == 0
        with Bag(bag.directory) as read:
            assert read.counts == {"/motor_states": 0}


class TestRefusals:
    def test_nothing_is_overwritten(self, recording) -> None:
        before = (recording.write() / "bag_0.mcap").read_bytes()
        with pytest.raises(BagError, match="exists already and is not overwritten"):
            BagFile(recording.directory / "bag", {})
        assert (recording.directory / "bag" / "bag_0.mcap").read_bytes() == before

    def test_a_place_where_nothing_can_be_written(self, tmp_path: Path) -> None:
        (tmp_path / "file").touch()
        with pytest.raises(BagError, match=r"cannot create bag .*: Not a directory"):
            BagFile(tmp_path / "file" / "bag", {})

    def test_an_attachment_that_is_not_there(self, tmp_path: Path) -> None:
        with pytest.raises(BagError, match=r"cannot attach .*robot.yaml: No such file"):
            Attachment.from_file(tmp_path / "robot.yaml")


def full_disk(descriptor: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class TestWriter:
    @pytest.fixture
    def bag(self, tmp_path: Path) -> BagFile:
        return BagFile(tmp_path / "bag", {}, compression=Compression.LZ4)

    def test_messages_of_topics_added_on_the_way_arrive_in_order(self, bag, recording) -> None:
        writer = BagWriter(bag)
        for topic in range(3):
            assert writer.add_topic(RecordedTopic(f"/t{topic}", JOINT_STATE, TOPIC.definition)) == topic
            for index in range(100):
                writer.write(topic, index, index, recording.state(index))
        writer.close()
        assert writer.counts == {"/t0": 100, "/t1": 100, "/t2": 100}
        assert writer.drops == {}
        with Bag(bag.directory) as read:
            np.testing.assert_array_equal(read.joint_states("/t2").position[:, 0], range(100))

    def test_a_message_reaches_the_disk_while_recording_goes_on(self, bag, recording) -> None:
        writer = BagWriter(bag)
        writer.write(writer.add_topic(TOPIC), 1, 1, recording.state(1))
        deadline = time.monotonic() + 4 * FLUSH_PERIOD
        number = 0
        while number == 0 and time.monotonic() < deadline:
            time.sleep(0.05)
            with pytest.warns(BagWarning), Bag(bag.directory) as read:
                number = sum(read.counts.values())
        writer.close()
        assert number == 1

    def test_a_slow_disk_costs_messages_and_never_time(self, bag, recording, monkeypatch) -> None:
        release = threading.Event()
        monkeypatch.setattr(os, "fdatasync", lambda descriptor: release.wait(10))
        writer = BagWriter(bag, queue_length=1000)
        topic = writer.add_topic(TOPIC)
        time.sleep(2 * FLUSH_PERIOD)  # by now the thread waits for the disk
        data = recording.state(0)
        start = time.monotonic()
        for index in range(1500):
            writer.write(topic, index, index, data)
        assert time.monotonic() - start < 0.2
        assert writer.waiting == 1000
        assert writer.drops == {"/motor_states": 500}
        release.set()
        writer.close()
        assert writer.counts == {"/motor_states": 1000}

    def test_a_full_disk_ends_the_recording_and_keeps_what_there_is(
        self, bag, recording, monkeypatch
    ) -> None:
        writer = BagWriter(bag)
        topic = writer.add_topic(TOPIC)
        writer.write(topic, 1, 1, recording.state(1))
        monkeypatch.setattr(os, "fdatasync", full_disk)
        deadline = time.monotonic() + 4 * FLUSH_PERIOD
        while writer.error is None and time.monotonic() < deadline:
            time.sleep(0.02)
        writer.write(topic, 2, 2, recording.state(2))
        assert writer.drops == {"/motor_states": 1}
        with pytest.raises(BagError, match=r"writing .*bag_0.mcap ended early: No space left on device"):
            writer.close()
        with pytest.warns(BagWarning), Bag(bag.directory) as read:
            assert read.counts == {"/motor_states": 1}

    def test_a_disk_that_fills_at_the_very_end(self, bag, monkeypatch) -> None:
        writer = BagWriter(bag)
        monkeypatch.setattr(os, "fdatasync", full_disk)
        with pytest.raises(BagError, match="No space left on device"):
            writer.close()
