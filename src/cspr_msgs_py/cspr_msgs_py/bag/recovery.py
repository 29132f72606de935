"""Rebuilds a damaged bag: of a recording that was killed, cut off, or lies on a bad disk."""

import os
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cspr_msgs_py.bag.bag_file import RECORDING, Attachment, BagFile
from cspr_msgs_py.bag.mcap_file import McapFile
from cspr_msgs_py.bag.metadata import RecordedTopic, parse_offered_qos
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.errors import BagError, BagWarning

RECOVERY = "recovery"  # name of the metadata record about the recovery

_ROSBAG2 = "rosbag2"  # metadata record that is rewritten


@dataclass(frozen=True)
class Recovery:
    """What was recovered and what was lost.

    Attributes
    ----------
    directory : Path
        The whole bag.
    counts : dict of str to int
        Messages in it, by topic.
    missing : dict of str to int
        Messages that are known to be lost, by topic.
    losses : tuple of str
        What is missing, one line for each loss; empty for a bag that was whole.
    start_ns, end_ns : int
        Log times of the first and the last message in it, ns.
    """

    directory: Path
    counts: dict[str, int]
    missing: dict[str, int]
    losses: tuple[str, ...]
    start_ns: int
    end_ns: int


def recover(
    source: str | os.PathLike[str],
    output: str | os.PathLike[str],
    progress: Callable[[float], None] = lambda share: None,
) -> Recovery:
    """Write what can be read of a bag into a new, whole one.

    Attachments and metadata are copied; each file of the bag becomes one of the new bag.

    Parameters
    ----------
    source
        The damaged bag, which is not touched.
    output
        Directory of the new one, which must not exist yet.
    progress
        Called with the share that is done.

    Raises
    ------
    BagError
        If nothing can be read, or the new bag cannot be written.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", BagWarning)
        with Bag(source) as bag:
            attachments = [Attachment(name, data) for name, data in bag.attachments.items()]
            copy = BagFile(output, bag.metadata.get(RECORDING, {}), attachments, start_ns=bag.start_ns)
            try:
                _copy(bag, copy, progress)
                losses = tuple(
                    str(warning.message) for warning in caught if issubclass(warning.category, BagWarning)
                )
                copy.close(_notes(bag, losses))
            except OSError as error:
                copy.abandon()
                raise BagError(f"cannot write {copy.directory}: {error.strerror}") from error
            missing = _missing(bag, copy.counts)
            return Recovery(copy.directory, copy.counts, missing, losses, bag.start_ns, bag.end_ns)


def _missing(bag: Bag, recovered: dict[str, int]) -> dict[str, int]:
    """Return how many messages of each topic are known to have been in the bag and are not any more."""
    missing: Counter[str] = Counter()
    for file in bag.files:
        for channel, number in file.missing.items():
            missing[file.channels[channel].topic] += number
    for topic, number in bag.announced_counts.items():
        missing[topic] = max(missing[topic], number - recovered.get(topic, 0))
    return {topic: number for topic, number in missing.items() if number}


def _copy(bag: Bag, copy: BagFile, progress: Callable[[float], None]) -> None:
    indexes: dict[tuple[str, str], int] = {}
    number = sum(len(file.regions) for file in bag.files)
    done = 0
    for file in bag.files:
        if done:
            copy.split()
        known = {
            key: _topic_index(file, key, copy, indexes) for key, channel in sorted(file.channels.items())
        }
        for region in file.regions:
            block = bag.uncompressed(file.block(region, known))
            for channel, sequence, log_time, publish_time, data in block.messages():
                copy.add_message(known[channel], log_time, publish_time, data, sequence)
            done += 1
            progress(done / number)


def _topic_index(file: McapFile, key: int, copy: BagFile, indexes: dict[tuple[str, str], int]) -> int:
    channel = file.channels[key]
    schema = file.schemas.get(channel.schema_id)
    topic = RecordedTopic(
        channel.topic,
        schema.name if schema else "",
        schema.data.decode(errors="replace") if schema else "",
        parse_offered_qos(channel.metadata.get("offered_qos_profiles", "")),
        channel.metadata.get("topic_type_hash", ""),
        schema.encoding if schema else "",
    )
    name = (topic.name, topic.type)
    if name not in indexes:
        indexes[name] = copy.add_topic(topic)
    return indexes[name]


def _notes(bag: Bag, losses: tuple[str, ...]) -> dict[str, dict[str, str]]:
    others = {name: values for name, values in bag.metadata.items() if name not in (RECORDING, _ROSBAG2)}
    recovery = {"source": str(bag.path), **{f"loss {k}": text for k, text in enumerate(losses, start=1)}}
    return {**others, RECOVERY: recovery}
