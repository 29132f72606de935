"""A virtual bus on which frames take as long as on a real bus, and on which things can go wrong.

One thread delivers what is through, many frames at a wake-up: each carries the time at which it was through, and a
thread that slept for each of some 6,000 frames a second would cost more than all devices together.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import can

from cspr_drivers.bus.virtual_bus import QuickVirtualBus, copied_frame
from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.simulation.bus.bus_timing import DRIVER, BusDisturbance, BusTiming

_LONGEST_BATCH = 0.0015  # s between two deliveries while frames wait
_BABBLING_BATCH = 0.002  # s, as a babbling node's frames need not be punctual


class TimedBus:
    """The devices' end of a virtual bus, in place of a python-can bus.

    Parameters
    ----------
    end
        The end that is open.
    bitrate
        bit/s.
    deliver
        Given each frame of the driver.
    timed
        Whether frames take their time; otherwise they are through at once, which costs less.
    clock
        Clock of the machine.
    """

    channel_info = "simulated bus"

    def __init__(
        self,
        end: QuickVirtualBus,
        bitrate: int,
        deliver: Callable[[can.Message], None],
        timed: bool,
        clock: Clock = COMPUTER,
    ) -> None:
        self._clock = clock
        self._end = end
        self._deliver = deliver
        self._timed = timed
        self._timing = BusTiming(bitrate)
        self._changed = threading.Condition()
        self._idle = False
        self._closed = False
        self._moment: float | None = None  # at which the frame was through that is being delivered, s
        self._thread = threading.Thread(target=self._run, name="simulated bus", daemon=True)
        self._direct = not timed
        end.deliver_to(self._from_driver)
        self._thread.start()

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        """Put a frame of a device on the bus."""
        if self._direct:
            self._end.send(message)
            return
        # Devices send their answer at the moment the frame was through, however late this computer delivers it.
        on_time = self._moment is not None and threading.current_thread() is self._thread
        self._offer(copied_frame(message), message.arbitration_id, self._moment if on_time else None)

    def disturb(self, disturbance: BusDisturbance) -> None:
        """Set what disturbs the bus from now on."""
        with self._changed:
            self._timing.passed(self._clock.monotonic())
            self._timing.disturb(disturbance)
            self._direct = not (self._timed or self._timing.disturbed)
            self._changed.notify()

    def shutdown(self) -> None:
        """Leave the bus."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread is not threading.current_thread():
            self._thread.join()
        self._end.shutdown()

    def _from_driver(self, frame: can.Message) -> None:
        if self._direct:
            self._deliver(frame)
        else:
            self._offer(frame, DRIVER, None)

    def _offer(self, frame: can.Message, sender: object, time: float | None) -> None:
        with self._changed:
            self._timing.offer(frame, sender, self._clock.monotonic() if time is None else time)
            if self._idle:
                self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._idle = True
                while (pause := self._pause()) is None and not self._closed:
                    self._changed.wait()
                self._idle = False
                if self._closed:
                    return
            if pause:
                self._clock.sleep(pause)
            with self._changed:
                through = self._timing.passed(self._clock.monotonic())
            for time, sender, frame in through:
                frame.timestamp = self._clock.stamp(time)
                self._moment = time
                if sender is DRIVER:
                    self._deliver(frame)
                else:
                    self._end.pass_on(frame)
            self._moment = None

    def _pause(self) -> float | None:
        """Return how long nothing is to be delivered, s; `None` when no frame waits."""
        next_end = self._timing.next_end()
        if next_end is None:
            return None
        now = self._clock.monotonic()
        if self._timing.disturbed:
            return max(next_end - now, _BABBLING_BATCH)
        return max(0.0, min(self._timing.last_end() - now, _LONGEST_BATCH))
