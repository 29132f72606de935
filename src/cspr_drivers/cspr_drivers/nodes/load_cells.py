"""Node ``load_cells``: cable tensions from the load-cell amplifiers."""

from __future__ import annotations

import sys

from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.driver_messages import load_cell_diagnostics, load_cell_states
from cspr_drivers.load_cells.master import LoadCellMaster
from cspr_drivers.nodes.driver_node import SWITCH_INTERVAL, DriverNode
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import advertise, run_nodes, steady_timer, subscribe_raw
from cspr_msgs_py.topics import CABLE_TENSIONS, LOAD_CELL_STATES, MOTOR_STATES, cable_names
from cspr_msgs_py.wire.conversion import decoder
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.samples import Status

WATCH_PERIOD = 0.5  # s; how often heartbeats are looked at


class LoadCells(DriverNode[LoadCellMaster]):
    """Driver of all load cells of `can.yaml`; parameters as of `DriverNode`."""

    name = "load_cells"
    states = LOAD_CELL_STATES

    def prepare(self) -> None:
        """Declare parameters, and offer tensions and taring."""
        tare_limit = declare_all(self)["tare_limit"]
        self._names = cable_names(len(self.config.load_cells))
        self._codec = JointStateCodec(self._names, position=False, velocity=False)
        self._tensions = advertise(self, CABLE_TENSIONS)
        if self.alone:  # else it is there when the driver sends SYNC
            self._states = decoder(MOTOR_STATES, len(self.config.drives))
            subscribe_raw(self, MOTOR_STATES, self._heard)
        self.service("~/tare", lambda master: master.tare(tare_limit))
        steady_timer(self, WATCH_PERIOD, self._watch)

    def create_master(self, ports: CanPorts) -> LoadCellMaster:
        """Return a driver that configures the amplifiers and listens to them."""
        return LoadCellMaster(self.config, ports, self._publish, self.get_logger().warning)

    def present(self, master: LoadCellMaster) -> dict[str, str]:
        """Return what is wrong with cells, by name."""
        return master.problems(master.clock.monotonic())

    def statuses(self, master: LoadCellMaster) -> list[Status]:
        """Return the states of the load cells."""
        return load_cell_states(self._names, self.present(master))

    def diagnostics(self, master: LoadCellMaster) -> list[Status]:
        """Return the health of the driver, and that of each cell."""
        return load_cell_diagnostics(self._names, master.snapshot(master.clock.monotonic()))

    def _watch(self) -> None:
        if self._master is not None:
            self._master.watch(self._master.clock.monotonic())

    def _heard(self, buffer: bytes) -> None:
        if self._ports is None:
            return
        try:
            stamp = self._states(buffer).stamp_ns
        except MessageError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=1.0)
        else:
            self._ports.driver_time.heard(stamp)

    def _publish(self, stamp_ns: int, tensions: tuple[float, ...]) -> None:
        self._tensions.publish(self._codec.encode(stamp_ns, effort=tensions))


def main() -> int:
    """Run the node in a process of its own."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_nodes(lambda: [LoadCells()])


if __name__ == "__main__":
    sys.exit(main())
