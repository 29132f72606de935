"""Opening the buses of a configuration, and saying in one line why one cannot be opened."""

from __future__ import annotations

import errno
from collections.abc import Collection

import can

from cspr_drivers.bus.can_bus import CanPort
from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.bus.socketcan_bus import QuickSocketCan
from cspr_drivers.bus.virtual_bus import QuickVirtualBus
from cspr_drivers.canopen.frame_table import NMT_COB_ID, SYNC_COB_ID, FunctionCode, cob_id
from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.config.can_config import BusConfig, CanConfig
from cspr_drivers.errors import BusError

_OPEN_PROBLEMS = {
    errno.ENODEV: "there is no such interface; `ip link` lists them",
    errno.ENETDOWN: "the interface is down; `ip link set {channel} up type can bitrate {bitrate}` starts it",
    errno.EBUSY: "the interface is in use by another program",
    errno.EPERM: "this user may not use the interface",
    errno.EACCES: "this user may not use the interface",
    errno.EAFNOSUPPORT: "this kernel has no CAN support; `modprobe can_raw` loads it",
    errno.EPROTONOSUPPORT: "this kernel has no CAN support; `modprobe can_raw` loads it",
}


def open_ports(config: CanConfig, clock: Clock = COMPUTER, filtered: bool = True) -> CanPorts:
    """Open all buses of a configuration, timed by a clock; unless `filtered`, frames of unknown nodes come in too.

    Raises
    ------
    BusError
        If one cannot be opened; those already open are closed again.
    """
    ports: list[CanPort] = []
    try:
        for bus in config.buses:
            known = _known_cob_ids(config, bus.name)
            end = open_bus(bus, known if filtered else None, clock)
            ports.append(CanPort(bus.name, end, known, clock))
    except BusError:
        for port in ports:
            port.close()
        raise
    return CanPorts(ports)


def open_bus(
    config: BusConfig, cob_ids: Collection[int] | None = None, clock: Clock = COMPUTER
) -> can.BusABC:
    """Open one bus with python-can.

    Parameters
    ----------
    config
        The bus.
    cob_ids
        COB-IDs of the frames that are wanted, where the interface has a filter; by default all.
    clock
        Clock of the machine, by which frames are stamped.

    Raises
    ------
    BusError
        In one line: which bus, and what to do about it.
    """
    place = f"CAN bus {config.name} ({config.interface}, channel {config.channel})"
    if config.interface == "virtual":
        return QuickVirtualBus(config.channel, clock)
    try:
        if config.interface == "socketcan":
            bus = QuickSocketCan(config.channel, cob_ids, clock)
        else:
            bus = can.Bus(channel=config.channel, interface=config.interface, bitrate=config.bitrate)
    except can.CanInterfaceNotImplementedError:
        raise BusError(
            f"{place}: python-can has no interface of this type, or its driver is missing"
        ) from None
    except (can.CanError, OSError, ValueError) as error:
        raise BusError(f"{place}: {_open_problem(error, config)}") from None
    try:
        bus.recv(timeout=0.0)  # an interface that is down can be opened, but not read
    except can.CanError as error:
        bus.shutdown()
        raise BusError(f"{place}: {_open_problem(error, config)}") from None
    return bus


def _open_problem(error: Exception, config: BusConfig) -> str:
    codes = [getattr(error, "errno", None), getattr(error, "error_code", None)]
    if error.__cause__ is not None:
        codes.append(getattr(error.__cause__, "errno", None))
    for code in codes:
        if code in _OPEN_PROBLEMS:
            return _OPEN_PROBLEMS[code].format(channel=config.channel, bitrate=config.bitrate)
    return " ".join(str(error).split()) or type(error).__name__


def _known_cob_ids(config: CanConfig, bus: str) -> set[int]:
    """Return the COB-IDs that may be seen on a bus, no matter which process handles them."""
    nodes = [drive.node_id for drive in config.drives if drive.bus == bus]
    nodes += [cell.node_id for cell in config.load_cells if cell.bus == bus]
    known = {cob_id(function, node) for function in FunctionCode for node in nodes}
    return known | {NMT_COB_ID, SYNC_COB_ID, cob_id(FunctionCode.HEARTBEAT, config.master_node_id)}
