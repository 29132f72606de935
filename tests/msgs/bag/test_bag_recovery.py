import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.bag.recovery import recover
from cspr_msgs_py.errors import BagError
from cspr_msgs_py.topics import MOTOR_STATES


def whole(directory: Path) -> Bag:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Bag(directory)


def test_what_a_killed_recorder_left(recording, tmp_path: Path) -> None:
    source = recording.write(close=False)
    before = (source / "bag_0.mcap").read_bytes()
    result = recover(source, tmp_path / "new")
    assert result.counts["/motor_states"] == recording.number
    assert len(result.losses) == 1
    assert "was cut off" in result.losses[0]
    assert (source / "bag_0.mcap").read_bytes() == before
    with whole(tmp_path / "new") as bag:
        assert [data for *_, data in bag.messages("/motor_states")] == [
            recording.state(index) for index in range(recording.number)
        ]
        assert bag.attachments == {"config/robot.yaml": b"name: x\n"}
        assert bag.metadata["recording"] == {"host": "here"}
        assert "was cut off" in bag.metadata["recovery"]["loss 1"]
        assert bag.offered_qos("/motor_states")[0].depth == MOTOR_STATES.depth
    with Reader(tmp_path / "new") as reader:
        assert reader.message_count == recording.number * 11 // 10


def test_it_says_how_many_messages_a_damaged_chunk_held(recording, tmp_path: Path) -> None:
    file = recording.write() / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    data[data.index(b"zstd") + 100] ^= 0xFF
    file.write_bytes(data)
    result = recover(file.parent, tmp_path / "new")
    assert result.missing == {"/motor_states": 250, "/reference": 25}
    assert "is damaged" in result.losses[0]
    with whole(tmp_path / "new") as bag:
        np.testing.assert_array_equal(bag["/motor_states"].position[:, 0], np.arange(250, recording.number))


def test_a_file_of_a_split_bag_that_is_gone_is_counted_by_the_metadata(recording, tmp_path: Path) -> None:
    source = recording.write(split=True)
    (source / "bag_1.mcap").unlink()
    result = recover(source, tmp_path / "new")
    assert result.counts["/motor_states"] + result.missing["/motor_states"] == recording.number
    with whole(tmp_path / "new") as bag:
        assert len(bag.files) == 2


def test_a_whole_bag_has_lost_nothing(recording, tmp_path: Path) -> None:
    result = recover(recording.write(), tmp_path / "new")
    assert result.losses == ()
    assert result.missing == {}


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "cspr_msgs_py.programs.recover", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


class TestExecutable:
    def test_it_says_what_was_lost(self, recording) -> None:
        source = recording.write()
        file = source / "bag_0.mcap"
        file.write_bytes(file.read_bytes()[:-70_000])
        done = run(source.parent)  # the directory of the run
        assert done.returncode == 0, done.stderr
        first, second, *others = done.stdout.splitlines()
        recovered = source.with_name("bag_recovered")
        assert first.startswith(f"{recovered}: ")
        assert "from 2023-11-14 22:13:20.000 to 2023-11-14 22:13:2" in first
        assert second.startswith(f"lost: {file} was cut off: the last ")
        with whole(recovered) as bag:
            lost = recording.number - bag.counts["/motor_states"]
        assert f"lost: {lost} messages of /motor_states" in others

    def test_a_reader_that_is_gone_is_no_error(self, recording) -> None:
        reading, writing = os.pipe()
        os.close(reading)
        command = [sys.executable, "-m", "cspr_msgs_py.programs.recover", str(recording.write())]
        done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
        os.close(writing)
        assert (done.stderr, done.returncode) == ("", 141)

    def test_nothing_is_overwritten(self, recording) -> None:
        source = recording.write()
        source.with_name("bag_recovered").mkdir()
        done = run(source)
        assert done.returncode == 1
        assert "bag_recovered exists already and is not overwritten" in done.stderr

    @pytest.mark.parametrize("name", ["none", "empty"])
    def test_what_is_no_bag(self, tmp_path: Path, name: str) -> None:
        (tmp_path / "empty").mkdir()
        done = run(tmp_path / name)
        assert done.returncode == 1
        assert done.stderr.startswith("recover: ")
        assert "Traceback" not in done.stderr


def test_a_full_disk(recording, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match="cannot create bag"):
        recover(recording.write(), tmp_path / "file" / "new")
