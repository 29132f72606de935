"""Configuring devices in the background, again and again until each one answers.

A wrong device is not asked again until a device restarts in its place.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import Empty, SimpleQueue

from cspr_drivers.clock import COMPUTER, Clock, Thread
from cspr_drivers.errors import DeviceError, WrongDeviceError
from cspr_drivers.thread_end import EndHandler, telling


class SetupThread:
    """A thread that configures the devices that need it.

    Parameters
    ----------
    names
        Names of the devices, for messages.
    configure
        Configures the device of an index; raises `DeviceError` when that fails; what else it raises is a defect, which
        is reported as well and comes with its traceback on stderr. Called in this thread.
    allowed
        Whether the device of an index may be configured now.
    report
        Told, in one line, of each device that fails (once per cause) and of each that is ready.
    clock
        Clock of the machine.
    retry_interval
        After which devices that failed are tried again, s.
    on_end
        Told when the thread has ended by an error of its own.
    """

    def __init__(
        self,
        names: Sequence[str],
        configure: Callable[[int], None],
        allowed: Callable[[int], bool],
        report: Callable[[str], None],
        clock: Clock = COMPUTER,
        retry_interval: float = 1.0,
        on_end: EndHandler = lambda problem: None,
    ) -> None:
        self._names = tuple(names)
        self._configure = configure
        self._allowed = allowed
        self._report = report
        self._clock = clock
        self._retry_interval = retry_interval
        self._on_end = on_end
        self._lock = threading.Lock()
        self._problems: dict[int, str] = dict.fromkeys(range(len(self._names)), "not configured yet")
        self._requests = [0] * len(self._names)
        self._wrong: set[int] = set()
        self._reported: dict[int, str] = {}
        self._wake: SimpleQueue[None] = SimpleQueue()
        self._stopping = threading.Event()
        self._thread: Thread | None = None

    def start(self) -> None:
        """Begin to set up all devices."""
        name = "device set-up"
        self._thread = self._clock.start(telling(self._run, name, self._on_end), name)

    def stop(self) -> None:
        """Stop; returns when the present device is finished."""
        self._stopping.set()
        self._wake.put(None)
        if self._thread is not None and self._thread.is_alive():
            self._thread.join(timeout=2.0)

    def request(self, index: int, reason: str) -> None:
        """Configure a device again."""
        with self._lock:
            self._problems[index] = reason
            self._requests[index] += 1
            self._wrong.discard(index)
        self._wake.put(None)

    @property
    def problems(self) -> dict[str, str]:
        """Devices that are not configured, with the reason, in words."""
        with self._lock:
            return {self._names[index]: problem for index, problem in sorted(self._problems.items())}

    def _run(self) -> None:
        while not self._stopping.is_set():
            while not self._wake.empty():
                self._wake.get_nowait()
            with self._lock:
                waiting = sorted(self._problems.keys() - self._wrong)
            for index in waiting:
                if self._stopping.is_set():
                    return
                if self._allowed(index):
                    self._attempt(index)
            with suppress(Empty):
                self._clock.take(self._wake, self._retry_interval if waiting else None)

    def _attempt(self, index: int) -> None:
        with self._lock:
            request = self._requests[index]
        try:
            self._configure(index)
        except Exception as error:  # also a defect, so that it is reported and the other devices are set up
            problem = error.problem if isinstance(error, DeviceError) else f"{type(error).__name__}: {error}"
            with self._lock:
                self._problems[index] = problem
                if isinstance(error, WrongDeviceError) and self._requests[index] == request:
                    self._wrong.add(index)
            if self._reported.get(index) != problem:
                self._reported[index] = problem
                self._report(f"{self._names[index]}: {problem}")
                if not isinstance(error, DeviceError):
                    traceback.print_exception(error)
            return
        with self._lock:
            # A restart reported meanwhile calls for one more round.
            if self._requests[index] == request:
                del self._problems[index]
        if self._reported.pop(index, None) is not None:
            self._report(f"{self._names[index]}: ready")
