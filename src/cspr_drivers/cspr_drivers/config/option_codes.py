"""What the drives do when they stop: option codes of CiA 402-2, sections on objects 605Ah to 605Eh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class OptionCodes:
    """Option codes with which a drive slows its motor down and holds it, so that the load stays held.

    Code 0 takes the torque away at once, and codes 5 to 8 of 605Ah leave the drive in quick stop active, its brake
    open: none of them is allowed.

    Attributes
    ----------
    quick_stop
        605Ah: 1 slow down ramp, 2 quick stop ramp, 3 current limit, 4 voltage limit; then switch on disabled.
    shutdown, disable_operation
        605Bh, 605Ch: 1 slow down ramp, then the brake closes and the power goes.
    halt
        605Dh: 1 slow down ramp, 2 quick stop ramp, 3 current limit, 4 voltage limit.
    fault_reaction
        605Eh: as 605Ah, then fault.
    """

    quick_stop: Literal[1, 2, 3, 4]
    shutdown: Literal[1]
    disable_operation: Literal[1]
    halt: Literal[1, 2, 3, 4]
    fault_reaction: Literal[1, 2, 3, 4]
