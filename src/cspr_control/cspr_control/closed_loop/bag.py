"""The recording of a run in simulated time, like the recorder's of a live one: same topics, bytes and definitions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cspr_control.analysis.sample_memory import SampleMemory
from cspr_control.closed_loop.loop import ClosedLoop
from cspr_control.closed_loop.scenario import Scenario
from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.bag.recording_information import recording_information
from cspr_msgs_py.bag.sample_bag import SampleBag
from cspr_msgs_py.topics import RECORDER_STATE, Topic
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.samples import Status


@contextmanager
def recorded(directory: Path | None, scenario: Scenario, loop: ClosedLoop[Any]) -> Iterator[SampleMemory]:
    """Keep what is published in a closed loop, and write it to a bag, which is complete at the end of the block.

    The bag bears simulated time, and the same run gives the same bytes. What is published at one moment is a nanosecond
    apart, as no two messages reach a recorder at once: so every reader has them in the order in which they came about.

    Parameters
    ----------
    directory
        The bag, which must not exist yet; None for no bag.
    scenario
        The run; its configuration travels in the bag as it was used.
    loop
        The closed loop.

    Raises
    ------
    BagError
        If the bag exists already or cannot be written.
    """
    time, start = loop.time, loop.time.system_ns()
    started = datetime.fromtimestamp(start * 1e-9, UTC)
    information = recording_information(started, loop.settings.control_rate) | {"simulated": scenario.label}
    files, m = scenario.attachments(), loop.robot.number_of_cables
    memory = SampleMemory(directory or Path("run"), m, information, files)
    bag = None
    if directory is not None:
        bag = SampleBag(BagFile(directory, information, files, start_ns=start), m)
        # the name and not the path: the bytes must not depend on the place
        recording = {"bag": directory.name, "cause": ""}
        bag.write(RECORDER_STATE, start, Status("recorder", Level.OK, "recording", recording))
    written = start

    def write(topic: Topic, sample: Any) -> None:
        nonlocal written
        written = max(written + 1, time.system_ns())
        memory.write(topic, written, sample)
        if bag is not None:
            bag.write(topic, written, sample)

    loop.listeners.append(write)
    try:
        yield memory
    finally:
        if bag is not None:
            bag.close()
