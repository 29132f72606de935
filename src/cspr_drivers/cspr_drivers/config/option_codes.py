"""What the drives do when they stop: option codes of CiA 402-2, sections on objects 605Ah to 605Eh."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers.config.config_section import ConfigSection

# Codes with which a drive slows its motor down and holds it. Code 0 takes the torque away at once, and codes 5 to 8
# of 605Ah leave the drive in quick stop active, its brake open.
_QUICK_STOP = (1, 2, 3, 4)
_SLOW_DOWN = (1,)
_HALT = (1, 2, 3, 4)
_FAULT_REACTION = (1, 2, 3, 4)


@dataclass(frozen=True)
class OptionCodes:
    """Option codes, all of them such that the load stays held.

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

    quick_stop: int
    shutdown: int
    disable_operation: int
    halt: int
    fault_reaction: int


def read_option_codes(section: ConfigSection) -> OptionCodes:
    """Return the section ``option_codes``.

    Raises
    ------
    ConfigurationError
        If a code is missing, or is one that would drop the load.
    """
    codes = OptionCodes(
        quick_stop=int(section.choice("quick_stop", _QUICK_STOP)),
        shutdown=int(section.choice("shutdown", _SLOW_DOWN)),
        disable_operation=int(section.choice("disable_operation", _SLOW_DOWN)),
        halt=int(section.choice("halt", _HALT)),
        fault_reaction=int(section.choice("fault_reaction", _FAULT_REACTION)),
    )
    section.finish()
    return codes
