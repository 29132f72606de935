"""Executable ``drivers``: ``can_drives`` and ``load_cells`` in one process, on the same open buses."""

from __future__ import annotations

import sys

from rclpy.node import Node

from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.nodes.can_drives import CanDrives
from cspr_drivers.nodes.driver_node import SWITCH_INTERVAL
from cspr_drivers.nodes.load_cells import LoadCells
from cspr_msgs_py.runtime.process import run_nodes


def create_nodes(clock: Clock = COMPUTER) -> list[Node]:
    """Return both nodes; they share the buses and a clock."""
    drives = CanDrives(clock=clock)
    return [drives, LoadCells(drives.config, drives.shared_ports)]


def main() -> int:
    """Run both nodes in one process."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_nodes(create_nodes)


if __name__ == "__main__":
    sys.exit(main())
