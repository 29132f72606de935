"""Reading a bag of /motor_states into numpy arrays, against the common readers of the same file.

The others decode message by message; they read a part of the file, and their time is extrapolated.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from time import perf_counter

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from cspr_msgs_py.bag_file import BagFile, Compression
from cspr_msgs_py.bag_metadata import RecordedTopic
from cspr_msgs_py.bag_reader import Bag
from cspr_msgs_py.joint_state import JointStateCodec
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.topics import MOTOR_STATES, motor_names

MOTORS = 8
PERIOD = 4_000_000  # ns


def write(directory: Path, number: int, compression: Compression) -> Path:
    """Write a bag of this number of motor states, a chunk every half second as the recorder does."""
    codec = JointStateCodec(motor_names(MOTORS))
    bag = BagFile(directory, {}, compression=compression)
    topic = bag.add_topic(
        RecordedTopic(MOTOR_STATES.name, MOTOR_STATES.type, message_definition(MOTOR_STATES.type))
    )
    counts = (
        np.random.default_rng(0).integers(-(2**31), 2**31, (1000, 3, MOTORS)) * 2.0**-24
    )  # as an encoder's
    for index in range(number):
        bag.add_message(
            topic, index * PERIOD, index * PERIOD, codec.encode(index * PERIOD, *counts[index % 1000])
        )
        if index % 125 == 124:
            bag._writer.end_chunk()
    bag.close()
    return directory


def seconds(function: Callable[[], object], repetitions: int = 3) -> float:
    """Return the best of some runs, s."""
    times = []
    for _ in range(repetitions):
        start = perf_counter()
        function()
        times.append(perf_counter() - start)
    return min(times)


def ours(bag: Path) -> None:
    with Bag(bag) as read:
        states = read[MOTOR_STATES.name]
    assert states.position.shape[1] == MOTORS


def mcap_ros2_support(bag: Path, number: int) -> None:
    with (bag / f"{bag.name}_0.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [message for *_, message in islice(reader.iter_decoded_messages(), number)]
    np.array([(message.position, message.velocity, message.effort) for message in messages])


def rosbags(bag: Path, number: int) -> None:
    with AnyReader([bag]) as reader:
        messages = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in islice(reader.messages(), number)
        ]
    np.array([(message.position, message.velocity, message.effort) for message in messages])


def main(arguments: Sequence[str] = ()) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reading", description=__doc__)
    parser.add_argument("--messages", type=int, default=1_000_000, help="default: %(default)s")
    number = parser.parse_args(arguments).messages
    part = max(number // 50, 1)
    with tempfile.TemporaryDirectory() as directory:
        plain = write(Path(directory) / "plain", number, Compression.NONE)
        packed = write(Path(directory) / "packed", number, Compression.ZSTD)
        compiled = seconds(lambda: mcap_ros2_support(packed, part), 1) * number / part
        others = seconds(lambda: rosbags(packed, part), 1) * number / part
        rows = [
            ("Bag, decompressed", seconds(lambda: ours(plain))),
            ("Bag, zstd", seconds(lambda: ours(packed))),
            (f"mcap-ros2-support, zstd, {part} read", compiled),
            (f"rosbags, zstd, {part} read", others),
        ]
    print(f"{f'{number} messages of {MOTOR_STATES.name}':50}{'s':>10}{'ratio':>10}")
    for name, time in rows:
        print(f"{name:50}{time:>10.3f}{time / rows[1][1]:>10.1f}")


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
