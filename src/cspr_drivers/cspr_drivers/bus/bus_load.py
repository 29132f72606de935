"""Worst-case time that the process data of one cycle takes on each bus, and whether the cycle has room for it."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.errors import ConfigurationError


def worst_case_bits(data_bytes: int) -> int:
    """Return the bits of a classical CAN frame with 11-bit identifier when every stuff bit is needed.

    Of 47 + 8 n bits, interframe space included, the 34 + 8 n before the CRC delimiter are stuffed, with at
    most one bit after each four: 47 + 8 n + (33 + 8 n) // 4 = 55 + 10 n (ISO 11898-1).
    """
    return 55 + 10 * data_bytes


@dataclass(frozen=True)
class BusLoad:
    """Process data of one bus in one cycle.

    Attributes
    ----------
    bus
        Name of the bus.
    bits
        Worst-case bits of all its frames.
    busy, period
        Time that they take, and duration of the cycle, s.
    parts
        The sum in words.
    """

    bus: str
    bits: int
    busy: float
    period: float
    parts: str

    @property
    def share(self) -> float:
        """Part of the cycle in which the bus is busy."""
        return self.busy / self.period

    def __str__(self) -> str:
        return (
            f"bus {self.bus}: {self.parts} = {self.bits} bits, {1e6 * self.busy:.0f} us of a cycle of "
            f"{1e6 * self.period:.0f} us ({100.0 * self.share:.0f} %)"
        )


def bus_loads(config: CanConfig) -> tuple[BusLoad, ...]:
    """Return the load of each bus, in the order of the configuration."""
    loads = []
    for bus in config.buses:
        drives = sum(drive.bus == bus.name for drive in config.drives)
        load_cells = sum(cell.bus == bus.name for cell in config.load_cells)
        bits = worst_case_bits(0)
        parts = [f"SYNC {bits}"]
        for count, name, layout in (
            (drives, "drive RPDO", config.pdo.drive_rpdo),
            (drives, "drive TPDO", config.pdo.drive_tpdo),
            (drives, "drive TPDO 2", config.pdo.drive_tpdo_2),
            (load_cells, "load cell TPDO", config.pdo.load_cell_tpdo),
        ):
            if count and layout is not None:
                frame = worst_case_bits(layout.length)
                bits += count * frame
                parts.append(f"{count} x {name} {frame}")
        loads.append(BusLoad(bus.name, bits, bits / bus.bitrate, config.period, " + ".join(parts)))
    return tuple(loads)


def require_fitting_cycle(config: CanConfig, control_rate: float) -> tuple[BusLoad, ...]:
    """Return the load of each bus, of a cycle with which controllers that expect a rate, Hz, can start.

    Raises
    ------
    ConfigurationError
        If the controllers expect another rate, or the process data of a bus takes more than `bus_load_limit` of a
        cycle; the message shows the sum.
    """
    if control_rate != config.rate:
        raise ConfigurationError(
            f"parameter control_rate is {control_rate:g} Hz, but {config.source}: "
            f"rate = {config.rate:g}: make them equal"
        )
    loads = bus_loads(config)
    for load in loads:
        if load.share > config.bus_load_limit:
            raise ConfigurationError(
                f"{config.source}: rate = {config.rate:g}: {load}, more than the limit of "
                f"{100.0 * config.bus_load_limit:.0f} %: lower the rate or use another bus"
            )
    return loads
