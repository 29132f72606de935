"""Takes messages for a bag without ever making the caller wait for the disk.

:meth:`BagWriter.write` only puts a message into a bounded queue; a thread of its own compresses and writes.
A message that finds the queue full is dropped and counted. At least every half second what has arrived is
closed as a chunk and forced to the disk, so that a power failure costs no more than that.
"""

import threading
import time
from collections import Counter, deque
from typing import Final

from cspr_msgs_py.bag_file import BagFile
from cspr_msgs_py.bag_metadata import RecordedTopic
from cspr_msgs_py.errors import BagError

FLUSH_PERIOD: Final = 0.5  # s, the most that a power failure costs
QUEUE_LENGTH: Final = 50_000  # messages: some ten seconds of the whole graph

_TURN: Final = 0.1  # s between two turns of the writing thread


class BagWriter:
    """The thread that writes a bag, and the queue in front of it.

    Topics are added and messages written by one thread. The file is closed by :meth:`close`.

    Attributes
    ----------
    error : BagError or None
        Why writing ended early: a full disk, for example. Messages that come later are dropped.
    """

    def __init__(self, bag: BagFile, queue_length: int = QUEUE_LENGTH) -> None:
        self.error: BagError | None = None
        self._bag = bag
        self._topics: list[RecordedTopic] = []
        self._queue: deque[tuple[int, int, int, bytes]] = deque()
        self._queue_length = queue_length
        self._dropped: Counter[int] = Counter()
        self._registered = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def add_topic(self, topic: RecordedTopic) -> int:
        """Add a topic and return its index for :meth:`write`."""
        self._topics.append(topic)
        return len(self._topics) - 1

    def write(self, topic: int, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """Take a message of the topic with this index; never waits."""
        if len(self._queue) < self._queue_length and self.error is None:
            self._queue.append((topic, log_time_ns, publish_time_ns, data))
        else:
            self._dropped[topic] += 1

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages written so far, by topic."""
        return {topic.name: self._bag.counts[topic.name] for topic in list(self._topics)}

    @property
    def drops(self) -> dict[str, int]:
        """Number of messages dropped so far, by topic; only topics that lost any."""
        return {self._topics[topic].name: number for topic, number in dict(self._dropped).items()}

    @property
    def waiting(self) -> int:
        """Number of messages in the queue."""
        return len(self._queue)

    def close(self) -> None:
        """Write what waits, finish the file, and return when it is on the disk.

        Raises
        ------
        BagError
            If writing failed, now or before.
        """
        self._closing.set()
        self._thread.join()
        if self.error is not None:
            raise self.error

    def _run(self) -> None:
        synced = time.monotonic()
        try:
            closing = False
            while not closing:
                closing = self._closing.wait(_TURN)
                self._register(len(self._topics))
                self._drain()
                if time.monotonic() - synced >= FLUSH_PERIOD:
                    self._bag.sync()
                    synced = time.monotonic()
            self._bag.close()
        except OSError as error:
            self.error = BagError(f"writing {self._bag.path} ended early: {error.strerror}")
            self._bag.abandon()
        except BagError as error:
            self.error = error

    def _register(self, number: int) -> None:
        for topic in self._topics[self._registered : number]:
            self._bag.add_topic(topic)
            self._registered += 1

    def _drain(self) -> None:
        """Write what waits now; what arrives meanwhile waits for the next turn."""
        for _ in range(len(self._queue)):
            message = self._queue.popleft()
            if message[0] >= self._registered:
                self._register(message[0] + 1)
            self._bag.add_message(*message)
