"""What the drives measure: their frames in, motor states in SI units out."""

from __future__ import annotations

from collections.abc import Sequence

from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.drives.motion_watch import MotionWatch
from cspr_drivers.drives.report import MotorStates


class PositionDifference:
    """Speed over the measured time between two samples, so that jitter of the SYNC does no harm.

    Parameters
    ----------
    time_constant
        Of a low-pass filter of first order, s; 0 for none. It smooths the steps of a coarse encoder and delays the
        speed by as much.
    """

    def __init__(self, time_constant: float = 0.0) -> None:
        self._time_constant = time_constant
        self._time = 0.0
        self._angles: tuple[float, ...] = ()
        self._speeds: list[float] | None = None

    def clear(self) -> None:
        """Start over: the next sample has nothing to do with those before."""
        self._angles = ()
        self._speeds = None

    def update(self, time: float, angles: Sequence[float]) -> list[float] | None:
        """Return the speeds since the sample before, rad/s, or `None` for the first sample.

        Parameters
        ----------
        time
            Moment at which the positions were latched, s; later than that of the sample before.
        angles
            Motor angles, rad (m,).
        """
        elapsed = time - self._time
        before, self._time, self._angles = self._angles, time, tuple(angles)
        if not before or elapsed <= 0.0:
            return None
        speeds = [(now - then) / elapsed for now, then in zip(angles, before, strict=True)]
        if self._time_constant and self._speeds is not None:
            share = elapsed / (self._time_constant + elapsed)
            speeds = [old + share * (new - old) for old, new in zip(self._speeds, speeds, strict=True)]
        self._speeds = speeds
        return speeds


class MotorFeedback:
    """Newest angle, speed and torque of each motor.

    Parameters
    ----------
    config
        In how many frames the drives answer, the units of each, and what no motor can do.

    Attributes
    ----------
    frames
        Number of frames in which each drive answers a SYNC.
    angles, speeds, torques
        Newest motor angles that are believed, rad, speeds, rad/s, and torques, N m (m,).
    """

    def __init__(self, config: CanConfig) -> None:
        self._drives = config.drives
        self._watch = MotionWatch(len(config.drives), config.largest_motor_speed, config.period)
        self.frames = 1 if config.pdo.drive_tpdo_2 is None else 2
        self._difference = PositionDifference(config.velocity_filter) if self.frames == 1 else None
        self.angles = [0.0] * len(config.drives)
        self.speeds = [0.0] * len(config.drives)
        self.torques = [0.0] * len(config.drives)

    def measured(self, index: int, position: int, torque: int, time: float) -> str:
        """Store position and torque value of a drive; return why the position cannot be, or an empty text.

        Parameters
        ----------
        index
            Of the drive.
        position, torque
            As they stand in the frame.
        time
            Moment of the SYNC at which they were latched, s.
        """
        units = self._drives[index].units
        self.torques[index] = units.torque(torque)
        angle = units.angle(position)
        problem = self._watch.position_problem(index, angle, time)
        if index not in self._watch.disbelieved:
            self.angles[index] = angle
        return problem

    def moves(self, index: int, velocity: float) -> str:
        """Store the velocity of a drive, rad/s, with the sign of its encoder; return why it cannot be, or nothing."""
        self.speeds[index] = speed = self._drives[index].units.polarity * velocity
        return self._watch.speed_problem(index, speed)

    @property
    def disbelieved(self) -> tuple[int, ...]:
        """Drives, from 0, whose positions are not believed until `begin_anew`; no states are published meanwhile."""
        return tuple(sorted(self._watch.disbelieved))

    def begin_anew(self) -> None:
        """Believe what the drives tell next."""
        self._watch.forget()
        if self._difference is not None:
            self._difference.clear()

    def states(self, stamp_ns: int, time: float) -> MotorStates | None:
        """Return the motor states at a SYNC, stamp and monotonic time, s; `None` while none can be believed."""
        if self._watch.disbelieved:
            return None
        angles = tuple(self.angles)
        if self._difference is not None:
            speeds = self._difference.update(time, angles)
            if speeds is None:
                return None  # the first cycle has no speed yet
            self.speeds = speeds
        return MotorStates(stamp_ns, angles, tuple(self.speeds), tuple(self.torques))

    def use(self, config: CanConfig) -> None:
        """Use the units of another configuration; the next angles have nothing to do with those before."""
        self._drives = config.drives
        self.begin_anew()
