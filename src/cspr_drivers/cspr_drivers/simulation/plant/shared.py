"""The simulated machine as the emulated devices on several buses share it: one lock, one time."""

from __future__ import annotations

import bisect
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.errors import DriverError
from cspr_drivers.simulation.simulation_config import PayloadChange, Sling
from cspr_kinematics import Payload

if TYPE_CHECKING:  # users of another plant need no MuJoCo
    from cspr_drivers.simulation.plant.plant import Plant

# s. A frame's time stamp further than this from its reception is of another clock (a CAN adapter's own, or a
# time of day that was set meanwhile): the time of reception counts instead.
_LARGEST_FRAME_AGE = 1.0

# s. Inputs that change within this time of each other take effect together.
_SIMULTANEOUS_INPUTS = 0.5e-3


@dataclass(frozen=True)
class Measurement:
    """What encoders, drives and load cells sense at one moment, each as m plain numbers.

    Attributes
    ----------
    angles, speeds, torques
        At the motor shafts, rad, rad/s, N m.
    tensions
        True tensions of the cables, N.
    """

    angles: list[float]
    speeds: list[float]
    torques: list[float]
    tensions: list[float]


class SharedPlant:
    """A plant, its lock, and the relation of its time to the clocks of this computer.

    Callers of methods other than `now`, `time_at` and `arrive` hold `lock`.

    Parameters
    ----------
    plant
        The machine. Its time 0 is the moment at which this object is made.
    payload_changes
        Payloads that arrive at times of their own.
    clock
        Clock of the machine. Plant time runs with its monotonic time; frames are stamped with its time of day.

    Attributes
    ----------
    lock
        Serialises all access to the plant and to the devices around it.
    time
        Time to which the plant has been integrated, s.
    failure
        The error that ended the simulation, `None` while it runs.
    inputs_at_once
        Number of inputs at which those that have arrived are applied without waiting for the plant to move.
    newest_measurement
        What was sensed last; may be read without the lock.
    """

    def __init__(
        self,
        plant: Plant,
        payload_changes: tuple[PayloadChange, ...] = (),
        clock: Clock = COMPUTER,
    ) -> None:
        self.plant = plant
        self.lock = threading.RLock()
        self.failure: DriverError | None = None
        self.inputs_at_once = 1
        self._clock = clock
        self._steady_start = self._clock.monotonic()
        self._ros_start = 1e-9 * self._clock.system_ns()
        self._arrived: deque[tuple[float, Callable[[], None]]] = deque()
        self._payload_changes = sorted(payload_changes, key=lambda change: change.time)
        self.time = plant.time
        self._measured = False
        self.newest_measurement = self.measure()

    def now(self) -> float:
        """Return the present plant time, s."""
        return self._clock.monotonic() - self._steady_start

    def from_ros_time(self, stamp: float) -> float:
        """Return the plant time, s, of a moment in ROS time, s since 1970."""
        return stamp - self._ros_start

    def ros_time(self, time: float) -> float:
        """Return the moment in ROS time, s since 1970, of a plant time, s."""
        return time + self._ros_start

    def time_at(self, stamp: float) -> float:
        """Return the plant time, s, at which a frame with this time stamp was on the bus."""
        time = self._clock.moment(stamp) - self._steady_start
        now = self._clock.monotonic() - self._steady_start
        return time if abs(now - time) <= _LARGEST_FRAME_AGE else now

    def advance(self, time: float, exactly: bool = False) -> None:
        """Integrate to a time, s; payloads that are due arrive on the way.

        Parameters
        ----------
        time
            Plant time; earlier ones do nothing.
        exactly
            Whether the time must be met, as when encoders are latched. Otherwise a time less than half a
            millisecond ahead is left for later: eight torques that arrive one by one are not worth eight steps.

        Raises
        ------
        DriverError
            If the plant cannot go on; `failure` keeps it.
        """
        self.apply_arrived(time)
        if time - self.time <= (0.0 if exactly else _SIMULTANEOUS_INPUTS):
            return
        if self.failure is not None:
            raise self.failure
        try:
            while self._payload_changes and self._payload_changes[0].time <= time:
                change = self._payload_changes.pop(0)
                self.plant.advance(change.time)
                self.plant.set_payload(change.payload, change.duration, change.sling)
            self.plant.advance(time)
        except DriverError as error:
            self.failure = error
            raise
        self.time = time
        self._measured = False

    def arrive(self, time: float, apply: Callable[[], None]) -> int:
        """Keep an input that arrived at a plant time, s, until the plant passes it; needs no lock.

        `apply` is called, with the lock held, when the plant is about to be integrated past that time, in the
        order of arrival. To apply each input at once would keep the bus waiting for the plant eight times per cycle.

        Returns
        -------
        int
            How many inputs wait; `apply_arrived` applies them when there is time for it.
        """
        self._arrived.append((time, apply))
        return len(self._arrived)

    def apply_arrived(self, time: float) -> None:
        """Apply the inputs that arrived up to a plant time, s."""
        arrived = self._arrived
        while arrived and arrived[0][0] <= time:
            arrived.popleft()[1]()

    def measure(self) -> Measurement:
        """Return what can be sensed at `time`."""
        if not self._measured:
            plant = self.plant
            self.newest_measurement = Measurement(
                plant.motor_angles().tolist(),
                plant.motor_speeds().tolist(),
                plant.motor_torques().tolist(),
                plant.tensions().tolist(),
            )
            self._measured = True
        return self.newest_measurement

    def change_payload(
        self, payload: Payload, time: float, duration: float = 0.0, sling: Sling | None = None
    ) -> None:
        """Let a payload replace the present one from a plant time, s, on; a time in the past means at once.

        It takes a duration, s, or hangs on a sling; see `Plant.set_payload`.
        """
        change = PayloadChange(time, payload, duration, sling)
        bisect.insort(self._payload_changes, change, key=lambda change: change.time)
