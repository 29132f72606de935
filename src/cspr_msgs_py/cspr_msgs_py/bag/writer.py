"""Takes messages for a bag without ever making the caller wait for the disk.

:meth:`BagWriter.write` only puts a message into a bounded queue; a thread of its own compresses and writes.
A message that finds the queue full is dropped and counted. At least every half second what has arrived is
closed as a chunk and forced to the disk, so that a power failure costs no more than that.
"""

import threading
import time
from collections import Counter, deque
from collections.abc import Mapping
from typing import Final

from cspr_msgs_py.bag.bag_file import DROPPED, BagFile
from cspr_msgs_py.bag.metadata import RecordedTopic
from cspr_msgs_py.errors import BagError

FLUSH_PERIOD: Final = 0.5  # s, the most that a power failure costs
QUEUE_LENGTH: Final = 50_000  # messages: some ten seconds of the whole graph
QUEUE_SIZE: Final = 128 * 1024 * 1024  # bytes: what others publish may be large

_TURN: Final = 0.1  # s between two turns of the writing thread


class BagWriter:
    """The thread that writes a bag, and the queue in front of it.

    Topics are added and messages written by one thread. The file is closed by :meth:`close`.

    Attributes
    ----------
    error : BagError or None
        Why writing ended early: a full disk, for example. Messages that come later are dropped.
    """

    def __init__(self, bag: BagFile, queue_length: int = QUEUE_LENGTH, queue_size: int = QUEUE_SIZE) -> None:
        self.error: BagError | None = None
        self._bag = bag
        self._topics: list[RecordedTopic] = []
        self._queue: deque[tuple[int, int, int, bytes, int]] = deque()
        self._queue_length = queue_length
        self._queue_size = queue_size
        self._taken = self._written = 0  # bytes; each is changed by one thread only
        self._dropped: Counter[int] = Counter()
        self._notes: Mapping[str, Mapping[str, str]] = {}
        self._registered = 0
        self._split = False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def add_topic(self, topic: RecordedTopic) -> int:
        """Add a topic and return its index for :meth:`write`."""
        self._topics.append(topic)
        return len(self._topics) - 1

    def write(
        self, topic: int, log_time_ns: int, publish_time_ns: int, data: bytes, sequence: int = 0
    ) -> None:
        """Take a message of the topic with this index; never waits."""
        if (
            len(self._queue) < self._queue_length
            and self._taken - self._written < self._queue_size
            and self.error is None
        ):
            self._queue.append((topic, log_time_ns, publish_time_ns, data, sequence))
            self._taken += len(data)
        else:
            self._dropped[topic] += 1

    def split(self) -> None:
        """Let the bag continue in a new file, after what has been queued so far."""
        self._split = True

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages written so far, by topic."""
        return self._bag.counts

    @property
    def drops(self) -> dict[str, int]:
        """Number of messages dropped so far, by topic; only topics that lost any."""
        return {self._topics[topic].name: number for topic, number in dict(self._dropped).items()}

    @property
    def waiting(self) -> int:
        """Number of messages in the queue."""
        return len(self._queue)

    def close(self, notes: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Write what is queued, finish the file, and return when it is on the disk.

        Parameters
        ----------
        notes
            More metadata records by name.

        Raises
        ------
        BagError
            If writing failed, now or before.
        """
        self._notes = notes or {}
        self._closing.set()
        self._thread.join()
        if self.error is not None:
            raise self.error

    def _run(self) -> None:
        try:
            self._write_until_closed()
        except OSError as error:
            self.error = BagError(
                f"recording ended early, {self._bag.path} cannot be written: {error.strerror}"
            )
            self._dropped += self._bag.give_up_chunk()
            self._dropped += Counter(message[0] for message in self._queue)
            self._queue.clear()
            self._bag.close_full(self._all_notes())

    def _write_until_closed(self) -> None:
        synced = time.monotonic()
        closing = False
        while not closing:
            closing = self._closing.wait(_TURN)
            split, self._split = self._split, False
            self._register(len(self._topics))
            self._drain()
            if split:
                self._bag.split()
            if time.monotonic() - synced >= FLUSH_PERIOD:
                self._bag.sync()
                synced = time.monotonic()
        self._bag.close(self._all_notes())

    def _all_notes(self) -> dict[str, Mapping[str, str]]:
        drops = {name: str(number) for name, number in self.drops.items()}
        return {**self._notes, **({DROPPED: drops} if drops else {})}

    def _register(self, number: int) -> None:
        new = self._topics[self._registered : number]
        for topic in new:
            self._bag.add_topic(topic)
            self._registered += 1
        if new:
            self._bag.write_metadata()

    def _drain(self) -> None:
        """Write what is queued now; what arrives meanwhile waits for the next turn."""
        take, write = self._queue.popleft, self._bag.add_message
        for _ in range(len(self._queue)):
            message = take()
            if message[0] >= self._registered:
                self._register(message[0] + 1)
            write(*message)
            self._written += len(message[3])
