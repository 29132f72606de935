"""Reading a bag of /motor_states into numpy arrays, against the common readers of the same file.

The others decode message by message; they read a part of the file, and their time is extrapolated. CPU time, since
all of them work on one core and on nothing else.
"""

from __future__ import annotations

import tempfile
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from benchmarks.timing import seconds
from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.bag.sample_bag import SampleBag
from cspr_msgs_py.topics import MOTOR_STATES
from cspr_msgs_py.wire.joint_state import JointStateSample

MESSAGES = 1_000_000
PART = MESSAGES // 50  # of them that the others read
MOTORS = 8
PERIOD = 4_000_000  # ns
CHUNK = 125  # messages in half a second


def write(directory: Path) -> Path:
    """Write a bag of motor states, a chunk every half second as the recorder does."""
    file = BagFile(directory, {})
    bag = SampleBag(file, MOTORS)
    # as an encoder's
    counts = np.random.default_rng(0).integers(-(2**31), 2**31, (1000, 3, MOTORS)) * 2.0**-24
    for index in range(MESSAGES):
        bag.write(MOTOR_STATES, index * PERIOD, JointStateSample(index * PERIOD, *counts[index % 1000]))
        if index % CHUNK == CHUNK - 1:
            file.sync()
    bag.close()
    return directory


def ours(bag: Path) -> None:
    with Bag(bag) as read:
        states = read[MOTOR_STATES.name]
    assert states.position.shape[1] == MOTORS


def decompressed(bag: Path) -> None:
    """Read, decompress and check every chunk, and look into none."""
    with Bag(bag) as read:
        for file in read.files:
            for region in file.regions:
                file.contents(region)


def mcap_ros2_support(bag: Path) -> None:
    with (bag / f"{bag.name}_0.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [message for *_, message in islice(reader.iter_decoded_messages(), PART)]
    np.array([(message.position, message.velocity, message.effort) for message in messages])


def rosbags(bag: Path) -> None:
    with AnyReader([bag]) as reader:
        messages: list[Any] = [  # of a class that is made from the definition in the bag
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in islice(reader.messages(), PART)
        ]
    np.array([(message.position, message.velocity, message.effort) for message in messages])


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as directory:
        packed = write(Path(directory) / "bag")
        decoded = seconds(lambda: mcap_ros2_support(packed), repetitions=1) * MESSAGES / PART
        others = seconds(lambda: rosbags(packed), repetitions=1) * MESSAGES / PART
        whole, before = seconds(lambda: ours(packed)), seconds(lambda: decompressed(packed))
        rows = [
            ("Bag, zstd", whole),
            ("  of which reading, decompressing, checksums", before),
            ("  of which columns", whole - before),
            (f"mcap-ros2-support, {PART} read", decoded),
            (f"rosbags, {PART} read", others),
        ]
    print(f"{f'{MESSAGES} messages of {MOTOR_STATES.name}':50}{'s':>10}{'ratio':>10}")
    for name, time in rows:
        print(f"{name:50}{time:>10.3f}{time / rows[0][1]:>10.2f}")
