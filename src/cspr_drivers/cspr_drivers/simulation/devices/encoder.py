"""The encoder of a motor: what drive and driver know of the shaft, which is not always what it does."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Encoder:
    """What an encoder makes of angle and speed of its shaft.

    Attributes
    ----------
    frozen
        Injected fault: it shows the same angle for ever.
    drift
        Injected fault: it turns against its shaft at this speed, rad/s. Without, it is referenced anew.
    """

    frozen: bool = False
    drift: float = 0.0
    _slip: float = 0.0  # rad by which it has turned against its shaft
    _time: float = 0.0
    _shown: float = 0.0

    def angle(self, time: float, true: float) -> float:
        """Return the angle that it shows, rad, of a true one at a time, s."""
        if not self.frozen:
            self._slip = self._slip + self.drift * (time - self._time) if self.drift else 0.0
            self._shown = true + self._slip
        self._time = time
        return self._shown

    def speed(self, true: float) -> float:
        """Return the speed that it shows, rad/s, of a true one."""
        return 0.0 if self.frozen else true + self.drift
