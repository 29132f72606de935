"""What the drives measure: their frames in, motor states in SI units out."""

from __future__ import annotations

from collections.abc import Sequence

from cspr_drivers.config.can_config import CanConfig
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
        In how many frames the drives answer, and the units of each.

    Attributes
    ----------
    frames
        Number of frames in which each drive answers a SYNC.
    angles
        Motor angles, rad (m,).
    """

    def __init__(self, config: CanConfig) -> None:
        self._drives = config.drives
        self.frames = 1 if config.pdo.drive_tpdo_2 is None else 2
        self._difference = PositionDifference(config.velocity_filter) if self.frames == 1 else None
        self.angles = [0.0] * len(config.drives)
        self._speeds = [0.0] * len(config.drives)
        self._torques = [0.0] * len(config.drives)

    def measured(self, index: int, position: int, torque: int) -> float:
        """Store position and torque value of a drive; return its torque, N m."""
        units = self._drives[index].units
        self.angles[index] = units.angle(position)
        self._torques[index] = measured = units.torque(torque)
        return measured

    def moves(self, index: int, velocity: float) -> None:
        """Store the velocity of a drive, rad/s, with the sign of its encoder."""
        self._speeds[index] = self._drives[index].units.polarity * velocity

    def states(self, stamp_ns: int, time: float) -> MotorStates | None:
        """Return the motor states at a SYNC, stamp and monotonic time, s; `None` while there is no speed."""
        angles = tuple(self.angles)
        speeds = self._speeds if self._difference is None else self._difference.update(time, angles)
        if speeds is None:
            return None  # the first cycle has no speed yet
        return MotorStates(stamp_ns, angles, tuple(speeds), tuple(self._torques))

    def use(self, config: CanConfig) -> None:
        """Use the units of another configuration; the next angles have nothing to do with those before."""
        self._drives = config.drives
        if self._difference is not None:
            self._difference.clear()
