import errno
import os
import shutil
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader

from cspr_msgs_py.bag.bag_file import Attachment, BagFile
from cspr_msgs_py.bag.mcap_writer import Compression
from cspr_msgs_py.bag.metadata import OfferedQos, RecordedTopic, parse_offered_qos
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.bag.writer import FLUSH_PERIOD, BagWriter
from cspr_msgs_py.errors import BagError, BagWarning
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.topics import JOINT_STATE, MOTOR_STATES

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


class TestSplitBags:
    @pytest.fixture
    def directory(self, recording) -> Path:
        return recording.write(split=True)

    def test_every_file_stands_alone(self, directory: Path, recording) -> None:
        total = 0
        for index in range(3):
            with Bag(directory / f"bag_{index}.mcap") as bag:
                assert bag.complete
                assert bag.attachments.keys() == {"config/robot.yaml"}
                assert bag.topics.keys() == {"/motor_states", "/reference", "/platform_pose"}
                total += bag.counts["/motor_states"]
        assert total == recording.number

    def test_standard_tools_read_them_as_one(self, directory: Path, recording) -> None:
        with Reader(directory) as reader:
            assert reader.message_count == recording.number * 11 // 10
            assert reader.duration == (recording.number - 1) * 4_000_000 + 1
            stamps = [time_ns for _, time_ns, _ in reader.messages()]
        assert len(stamps) == recording.number * 11 // 10
        with Bag(directory) as bag:
            np.testing.assert_array_equal(bag["/motor_states"].position[:, 0], np.arange(recording.number))

    def test_metadata_list_the_files(self, directory: Path, recording) -> None:
        content = yaml.safe_load((directory / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        assert content["relative_file_paths"] == [f"bag_{index}.mcap" for index in range(3)]
        assert [file["path"] for file in content["files"]] == content["relative_file_paths"]
        counts = [file["message_count"] for file in content["files"]]
        assert sum(counts) == content["message_count"] == recording.number * 11 // 10
        starts = [file["starting_time"]["nanoseconds_since_epoch"] for file in content["files"]]
        assert starts == [
            recording.start,
            recording.start + 701 * 4_000_000,
            recording.start + 1401 * 4_000_000,
        ]

    @pytest.mark.parametrize("split", [{"split_size": 100_000}, {"split_duration": 1_000_000_000}])
    def test_limits_are_kept(self, tmp_path: Path, recording, split: dict[str, int]) -> None:
        bag = BagFile(tmp_path / "bag", {}, compression=Compression.NONE, **split)
        topic = bag.add_topic(TOPIC)
        for index in range(1000):
            bag.add_message(topic, index * 4_000_000, index * 4_000_000, recording.state(index))
            if index % 50 == 49:
                bag.sync()
        bag.close()
        assert bag.files >= 4
        for file in bag.directory.glob("*.mcap"):
            assert file.stat().st_size < 150_000
        with Bag(bag.directory) as read:
            assert read.counts == {"/motor_states": 1000}


class TestMetadata:
    """``metadata.yaml``, key by key as rosbag2_storage's yaml.hpp of Jazzy writes it."""

    def test_layout_of_version_9(self, recording) -> None:
        content = yaml.safe_load((recording.write() / "metadata.yaml").read_text())
        (information,) = content.values()
        assert list(content) == ["rosbag2_bagfile_information"]
        assert list(information) == [
            "version",
            "storage_identifier",
            "duration",
            "starting_time",
            "message_count",
            "topics_with_message_count",
            "compression_format",
            "compression_mode",
            "relative_file_paths",
            "files",
            "custom_data",
            "ros_distro",
        ]
        topic = information["topics_with_message_count"][0]
        assert list(topic) == ["topic_metadata", "message_count"]
        assert list(topic["topic_metadata"]) == [
            "name",
            "type",
            "serialization_format",
            "offered_qos_profiles",
            "type_description_hash",
        ]
        assert topic["topic_metadata"]["offered_qos_profiles"] == [
            {
                "history": "keep_last",
                "depth": MOTOR_STATES.depth,
                "reliability": "best_effort",
                "durability": "volatile",
                "deadline": {"sec": 9223372036, "nsec": 854775807},
                "lifespan": {"sec": 9223372036, "nsec": 854775807},
                "liveliness": "automatic",
                "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
                "avoid_ros_namespace_conventions": False,
            }
        ]
        assert list(information["files"][0]) == ["path", "starting_time", "duration", "message_count"]
        assert information["custom_data"] == {"host": "here"}

    def test_it_is_there_from_the_start(self, tmp_path: Path) -> None:
        bag = BagFile(tmp_path / "bag", {})
        content = yaml.safe_load((bag.directory / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        bag.abandon()
        assert content["relative_file_paths"] == ["bag_0.mcap"]
        assert content["starting_time"] == {"nanoseconds_since_epoch": 2**63 - 1}  # as rosbag2 writes it

    def test_profiles_of_every_version_are_understood(self) -> None:
        profile = OfferedQos("keep_last", 7, "reliable", "transient_local", lifespan=2_500_000_000)
        topic = RecordedTopic("/x", "x/msg/X", "", (profile, OfferedQos()))
        assert parse_offered_qos(topic.channel_metadata["offered_qos_profiles"]) == topic.qos
        numbers = """- history: 1
  depth: 7
  reliability: 1
  durability: 1
  deadline: {sec: 2147483647, nsec: 4294967295}
  lifespan: {sec: 2, nsec: 500000000}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""
        (older,) = parse_offered_qos(numbers)
        assert older == replace(profile, deadline=older.deadline)
        assert parse_offered_qos("- what: ever\n- 1\n") == parse_offered_qos("}{") == ()


FILL_THE_DISK = """
import os, resource, sys
from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.bag.mcap_writer import Compression
from cspr_msgs_py.bag.writer import BagWriter
from cspr_msgs_py.bag.metadata import RecordedTopic
from cspr_msgs_py.errors import BagError, BagWarning
directory, limit = sys.argv[1], int(sys.argv[2])
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
writer = BagWriter(BagFile(directory, {}, compression=Compression.NONE))
topic = writer.add_topic(RecordedTopic("/t", "x/msg/X", ""))
number = 0
while writer.error is None and number < 100_000:
    if writer.waiting < 100:
        writer.write(topic, number, number, number.to_bytes(8, "little") + bytes(10_000))
        number += 1
try:
    writer.close()
except BagError as error:
    print(number, sum(writer.counts.values()), sum(writer.drops.values()), error)
"""


class TestFullDisk:
    """The kernel's own refusal, not one that is made up."""

    def fill(self, directory: Path, limit: int = 0) -> tuple[list[int], str]:
        done = subprocess.run(
            [sys.executable, "-c", FILL_THE_DISK, str(directory), str(limit)],
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
        *numbers, text = done.stdout.split(maxsplit=3)
        return [int(number) for number in numbers], text

    def check(self, directory: Path, numbers: list[int]) -> None:
        taken, written, dropped = numbers
        assert written > 100
        assert taken == written + dropped
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with Bag(directory) as bag:
                assert bag.complete
                messages = [int.from_bytes(data[:8], "little") for *_, data in bag.messages("/t")]
                # the last message may have come when the bag was closed already
                assert dropped - 1 <= int(bag.metadata["dropped"]["/t"]) <= dropped
        assert messages == list(range(written))
        with Reader(directory) as reader:
            assert reader.message_count == written

    @pytest.fixture
    def small(self, tmp_path: Path) -> Iterator[Callable[[int], Path]]:
        """Mount a file system of so many MB."""
        mount = tmp_path / "small"
        mount.mkdir()

        def make(size: int) -> Path:
            command = ["mount", "-t", "tmpfs", "-o", f"size={size}m", "tmpfs", str(mount)]
            if (
                shutil.which("mount") is None
                or subprocess.run(command, capture_output=True, check=False).returncode
            ):
                pytest.skip("mounting a small file system is not permitted here")
            return mount

        yield make
        if mount.is_mount():
            subprocess.run(["umount", str(mount)], check=True)

    def test_a_file_system_without_space(self, small: Callable[[int], Path]) -> None:
        directory = small(16) / "bag"
        numbers, text = self.fill(directory)
        assert "recording ended early" in text
        assert "No space left on device" in text
        self.check(directory, numbers)

    def test_too_little_space_to_begin_with(self, small: Callable[[int], Path]) -> None:
        """Nothing is left behind that would be in the way of the next attempt."""
        directory = small(3) / "bag"
        with pytest.raises(
            BagError, match=r"cannot write bag .*: No space left on device; at least 4 MB are needed"
        ):
            BagFile(directory, {})
        assert not directory.exists()

    def test_a_limit_of_the_file_size(self, tmp_path: Path) -> None:
        numbers, text = self.fill(tmp_path / "bag", limit=6_300_000)
        assert "File too large" in text
        self.check(tmp_path / "bag", numbers)


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
        deadline = time.monotonic() + 120 * FLUSH_PERIOD
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
        assert time.monotonic() - start < 5.0  # the disk takes 10 s
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
        deadline = time.monotonic() + 120 * FLUSH_PERIOD
        while writer.error is None and time.monotonic() < deadline:
            time.sleep(0.02)
        writer.write(topic, 2, 2, recording.state(2))
        assert writer.drops == {"/motor_states": 1}
        with pytest.raises(BagError, match=r"ended early, .*bag_0.mcap cannot be written: No space left"):
            writer.close()
        with Bag(bag.directory) as read:
            assert read.counts == {"/motor_states": 1}
        assert not (bag.directory / ".reserve").exists()

    def test_a_queue_is_bounded_in_bytes_too(self, bag, recording, monkeypatch) -> None:
        release, waiting = threading.Event(), threading.Event()

        def slow_disk(descriptor: int) -> None:
            waiting.set()
            release.wait(10)

        monkeypatch.setattr(os, "fdatasync", slow_disk)
        writer = BagWriter(bag, queue_size=10_000_000)
        topic = writer.add_topic(TOPIC)
        assert waiting.wait(30)
        for index in range(20):
            writer.write(topic, index, index, bytes(1_000_000))
        assert writer.drops == {"/motor_states": 10}
        release.set()
        writer.close()
        with Bag(bag.directory) as read:
            assert read.metadata["dropped"] == {"/motor_states": "10"}

    def test_a_bag_can_go_on_in_a_new_file_at_any_time(self, bag, recording) -> None:
        writer = BagWriter(bag)
        topic = writer.add_topic(TOPIC)
        writer.write(topic, 1, 1, recording.state(1))
        writer.split()
        deadline = time.monotonic() + 120.0
        while bag.files == 1:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        writer.write(topic, 2, 2, recording.state(2))
        writer.close()
        assert writer.counts == {"/motor_states": 2}
        for index in range(2):
            with Bag(bag.directory / f"bag_{index}.mcap") as read:
                assert read.counts == {"/motor_states": 1}

    def test_a_disk_that_fills_at_the_very_end(self, bag, monkeypatch) -> None:
        writer = BagWriter(bag)
        monkeypatch.setattr(os, "fdatasync", full_disk)
        with pytest.raises(BagError, match="No space left on device"):
            writer.close()
