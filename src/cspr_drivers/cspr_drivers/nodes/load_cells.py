"""Node ``load_cells``: cable tensions from the load-cell amplifiers."""

from __future__ import annotations

import sys
from typing import Any

from cspr_drivers.bus.can_bus import CanPorts
from cspr_drivers.bus.shared_ports import SharedPorts
from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.load_cells.master import LoadCellMaster
from cspr_drivers.nodes.can_drives import SWITCH_INTERVAL
from cspr_drivers.nodes.driver_messages import (
    bus_status,
    load_cell_diagnostics,
    load_cell_states,
    not_configured,
)
from cspr_drivers.nodes.driver_node import DriverNode
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import Diagnostics, advertise, run_nodes, sample_publisher, steady_timer
from cspr_msgs_py.topics import CABLE_TENSIONS, LOAD_CELL_STATES, cable_names
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.samples import Status, StatusArray

WATCH_PERIOD = 0.5  # s; how often heartbeats are looked at
STATE_PERIOD = 0.02  # s; how soon a problem is on /load_cell_states


class LoadCells(DriverNode):
    """Driver of all load cells of `can.yaml`; parameters as of `DriverNode`."""

    def __init__(
        self,
        config: CanConfig | None = None,
        ports: SharedPorts | CanPorts | None = None,
        clock: Clock = COMPUTER,
        **options: Any,
    ) -> None:
        super().__init__("load_cells", config, ports, clock, **options)
        tare_limit = declare_all(self)["tare_limit"]
        self._codec = JointStateCodec(
            cable_names(len(self.config.load_cells)), position=False, velocity=False
        )
        self._tensions = advertise(self, CABLE_TENSIONS)
        self._send_states = sample_publisher(self, LOAD_CELL_STATES)
        self._names = cable_names(len(self.config.load_cells))
        self._published: dict[str, str] | None = None
        self._since_published = 0.0
        self._master: LoadCellMaster | None = None
        self.service("~/tare", lambda: self.master.tare(tare_limit))
        steady_timer(self, WATCH_PERIOD, self._watch)
        steady_timer(self, STATE_PERIOD, self._watch_cells)
        self._diagnostics = Diagnostics(self, self._report)
        self.autostart()

    @property
    def master(self) -> LoadCellMaster:
        """The driver of a node that is configured."""
        if self._master is None:
            raise RuntimeError("the node is not configured")
        return self._master

    def begin(self, ports: CanPorts) -> None:
        """Begin to configure the amplifiers and to listen to them."""
        self._master = LoadCellMaster(self.config, ports, self._publish, self.get_logger().warning)
        self._master.start()

    def end(self) -> None:
        """Leave the bus."""
        if self._master is not None:
            self._master.stop()
            self._master = None

    def _watch(self) -> None:
        if self._master is not None:
            self._master.watch(self.ports.clock.monotonic())

    def _watch_cells(self) -> None:
        if self._master is None:
            return
        self._since_published += STATE_PERIOD
        problems = self._master.problems(self.ports.clock.monotonic())
        if problems == self._published and self._since_published < 1.0:
            return
        self._published = problems
        self._since_published = 0.0
        stamp = self.get_clock().now().nanoseconds
        statuses = load_cell_states(self._names, problems)
        self._send_states(StatusArray(stamp, tuple(statuses)))

    def _publish(self, stamp_ns: int, tensions: tuple[float, ...]) -> None:
        self._tensions.publish(self._codec.encode(stamp_ns, effort=tensions))

    def _report(self) -> list[Status]:
        if self._master is None:
            return [not_configured(self.get_name())]
        report = self._master.snapshot(self.ports.clock.monotonic())
        return [
            *load_cell_diagnostics(self._names, report),
            *(bus_status("load_cells", port) for port in self.ports),
        ]


def main() -> int:
    """Run the node in a process of its own."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_nodes(lambda: [LoadCells()])


if __name__ == "__main__":
    sys.exit(main())
