"""A bag of a run in simulated time, like the recorder's of a live one: same topics, bytes and definitions."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cspr_control.closed_loop.loop import ClosedLoop
from cspr_control.closed_loop.scenario import Scenario
from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.bag.recording_information import recording_information
from cspr_msgs_py.bag.sample_bag import SampleBag
from cspr_msgs_py.topics import Topic


class LoopBag:
    """Writes what is published in a closed loop; a context manager, at whose end the bag is complete.

    The bag bears simulated time, and the same run gives the same bytes.

    Parameters
    ----------
    directory
        The bag, which must not exist yet.
    scenario
        The run; its configuration travels in the bag as it was used.
    loop
        The closed loop.

    Raises
    ------
    BagError
        If the bag exists already or cannot be written.
    """

    def __init__(self, directory: Path, scenario: Scenario, loop: ClosedLoop[Any]) -> None:
        self._time = loop.time
        start = loop.time.system_ns()
        started = datetime.fromtimestamp(start * 1e-9, UTC)
        bag = BagFile(
            directory,
            recording_information(started, 1.0 / loop.settings.period) | {"simulated": scenario.label},
            scenario.attachments(),
            start_ns=start,
        )
        self._bag = SampleBag(bag, loop.robot.number_of_cables)
        loop.listeners.append(self._write)

    def __enter__(self) -> LoopBag:
        return self

    def __exit__(self, *error: object) -> None:
        self._bag.close()

    def _write(self, topic: Topic, sample: Any) -> None:
        self._bag.write(topic, self._time.system_ns(), sample)
