"""Node ``load_cells``: cable tensions from the load-cell amplifiers."""

from __future__ import annotations

import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_srvs.srv import Trigger

from cspr_drivers import clock
from cspr_drivers.can_bus import CanPorts, open_ports
from cspr_drivers.can_config import CanConfig
from cspr_drivers.load_cell_master import LoadCellMaster
from cspr_drivers.nodes.can_drives import SWITCH_INTERVAL, load_config
from cspr_drivers.nodes.driver_messages import bus_status, load_cell_diagnostics
from cspr_msgs_py.joint_state import JointStateCodec
from cspr_msgs_py.nodes.process import Diagnostics, advertise, declare, run_nodes, steady_timer
from cspr_msgs_py.topics import CABLE_TENSIONS, cable_names

WATCH_PERIOD = 0.5  # s


class LoadCells(Node):
    """Driver of all load cells of `can.yaml`.

    Parameters
    ----------
    config, ports
        Configuration and open buses when they are shared with another node; the node closes only buses that
        it has opened itself. By default both come from the parameter ``can_config``.
    options
        Keyword arguments of `Node`.
    """

    def __init__(
        self, config: CanConfig | None = None, ports: CanPorts | None = None, **options: Any
    ) -> None:
        super().__init__("load_cells", **options)
        self.config = load_config(self) if config is None else config
        self._tare_limit = declare(
            self,
            "tare_limit",
            100.0,
            "largest tension of a cable that may be tared as slack",
            minimum=0.0,
            unit="N",
            read_only=True,
        )
        self._codec = JointStateCodec(
            cable_names(len(self.config.load_cells)), position=False, velocity=False
        )
        self._tensions = advertise(self, CABLE_TENSIONS)
        self._owns_ports = ports is None
        self.ports = open_ports(self.config) if ports is None else ports
        self._master = LoadCellMaster(self.config, self.ports, self._publish, self.get_logger().warning)
        self._master.start()
        self.create_service(Trigger, "~/tare", self._tare)
        steady_timer(self, WATCH_PERIOD, lambda: self._master.watch(clock.monotonic()))
        self._diagnostics = Diagnostics(self, self._report)

    def make_safe(self) -> None:
        """Leave the bus."""
        self._master.stop()

    def destroy_node(self) -> None:
        """Destroy the node; close the buses if it has opened them."""
        if self._owns_ports:
            self.ports.close()
        super().destroy_node()

    def _publish(self, stamp_ns: int, tensions: tuple[float, ...]) -> None:
        self._tensions.publish(self._codec.encode(stamp_ns, effort=tensions))

    def _tare(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refusal = self._master.tare(self._tare_limit)
        response.success = refusal is None
        response.message = refusal or "accepted"
        return response

    def _report(self) -> list[DiagnosticStatus]:
        status = load_cell_diagnostics(self._master.snapshot(clock.monotonic()))
        return [status, *(bus_status("load_cells", port) for port in self.ports)]


def main() -> int:
    """Run the node in a process of its own."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_nodes(lambda: [LoadCells()])


if __name__ == "__main__":
    sys.exit(main())
