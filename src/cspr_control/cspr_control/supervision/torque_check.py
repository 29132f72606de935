"""What is wrong where the torque of a motor and the tension of its cable contradict each other, by what fits.

A cell that is wrong contradicts the balance of the platform as well; what turns a winch, or holds it, does not. Of what
several motors have in common it is neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

AT_LIMIT = 0.98
"""Share of a motor's largest torque from which it is at its limit."""

_ALIKE = 0.15  # share by which factors, and tensions that were exchanged, may differ
_OF_WINCH = "polarity, rated torque, gear, brake or friction of {}"
_SOUND = 1.0  # of the estimator's tolerance; beyond, the cells contradict the balance


@dataclass(frozen=True)
class Contradiction:
    """Tensions as cells and as motors know them, (m,) each, N, and what else is known.

    Attributes
    ----------
    shown, held
        By the load cells, and by the torques of the motors less what accelerates them.
    beyond
        Where they differ by more than allowed.
    at_limit
        Which motors apply all the torque that they have.
    unexplained
        How much of the cells' sum no payload explains, as a multiple of what is allowed; not-a-number where nobody has
        said so lately.
    """

    shown: FloatArray
    held: FloatArray
    beyond: NDArray[np.bool_]
    at_limit: NDArray[np.bool_]
    unexplained: float

    def culprit(self, cable: int) -> tuple[bool, str]:
        """Return whether a load cell is to blame for what is wrong at a cable, from 0, and what is, in words."""
        name, motor = f"cable_{cable + 1}", f"motor_{cable + 1}"
        if self.at_limit[cable]:
            return (
                False,
                f"{motor} is at its torque limit and its cable does not feel it: winch or brake blocked",
            )
        if several := self._several():
            return False, several
        if self.unexplained > _SOUND:
            return True, f"the balance of the platform contradicts the load cell of {name}"
        if self.unexplained <= _SOUND:
            return False, f"the balance of the platform fits the load cell, so {_OF_WINCH.format(motor)}"
        return False, f"load cell of {name}, or {_OF_WINCH.format(motor)}"

    def _several(self) -> str:
        """Return what the cables that are concerned have in common; nothing for a single one."""
        concerned = np.flatnonzero(self.beyond)
        if len(concerned) < 2:
            return ""
        shown, held = self.shown[concerned], self.held[concerned]
        names = ", ".join(f"motor_{k + 1}" for k in concerned)
        if (shown * held < 0.0).all():
            return f"torque and tension of {names} have opposite signs: polarity of drives or load cells"
        if len(concerned) == 2 and _alike(shown[::-1], held):
            first, second = concerned + 1
            return f"cable_{first} and cable_{second} show what the other's motor holds: drives or load cells swapped"
        factors = shown / np.where(held == 0.0, np.nan, held)
        middle = float(np.median(factors))
        if _alike(factors, np.full_like(factors, middle)):
            return (
                f"cells of {len(concerned)} cables show {middle:.2f} times what their motors hold: gear_ratio, "
                "drum_radius, rated_torque, or the scale of load cells"
            )
        return f"several at once, {names}: drives or load cells swapped, or wrong gears"


def _alike(values: FloatArray, others: FloatArray) -> bool:
    return bool((np.abs(values - others) <= _ALIKE * np.abs(others)).all())
