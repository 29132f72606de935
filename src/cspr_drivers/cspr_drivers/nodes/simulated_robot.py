"""Executable ``simulated_robot``: both drivers on virtual buses, with emulated devices and a simulated plant."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import InertiaStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from std_srvs.srv import Trigger

from cspr_drivers.bus.shared_ports import SharedPorts
from cspr_drivers.clock import COMPUTER, SlowClock
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.errors import DriverError
from cspr_drivers.nodes.can_drives import CanDrives
from cspr_drivers.nodes.driver_node import SWITCH_INTERVAL, load_config
from cspr_drivers.nodes.load_cells import LoadCells
from cspr_drivers.simulation.robot_emulator import RobotEmulator
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_msgs_py.errors import StartError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import report_health, run_nodes, sample_publisher, steady_timer, subscribe
from cspr_msgs_py.topics import PLATFORM_FRAME, SET_SIMULATED_PAYLOAD, SIMULATED_PAYLOAD, TRUE_POSE
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.samples import InertiaSample, Status

if TYPE_CHECKING:
    from cspr_drivers.simulation.plant.plant import Plant

_PAYLOAD_PERIOD = 0.02  # s
_LARGEST_LAG = 0.1  # s by which the plant may be behind the clock before diagnostics warn


class SimulatedRobot(Node):
    """Owner of the simulated machine: publishes its true pose and payload, and changes the payload on request.

    Parameters
    ----------
    virtual
        Whether the devices sit on virtual buses inside this process instead of those that `can.yaml` names.
    **options
        Options of `rclpy.node.Node`.

    Attributes
    ----------
    config
        `can.yaml`, with the buses that the devices are on.
    clock
        Clock of the machine.
    announce_sync
        Told of each SYNC by a driver in this process: the true pose then bears the stamp of its motor states.
    """

    def __init__(self, virtual: bool = True, **options: Any) -> None:
        super().__init__("simulated_robot", **options)
        config = load_config(self)
        self.config = on_virtual_buses(config) if virtual else config
        values = declare_all(self)
        self.clock = COMPUTER if values["speed"] == 1.0 else SlowClock(values["speed"])
        simulation = SimulationConfig.from_yaml(values["simulation_config"])
        eds_directory = Path(self.config.source).parent / "eds"
        self._emulator = RobotEmulator(
            self.config, simulation, _plant(simulation), eds_directory, values["bus_timing"], self.clock,
            sample_publisher(self, TRUE_POSE),
        )  # fmt: skip
        self._send_payload = sample_publisher(self, SIMULATED_PAYLOAD)
        subscribe(self, SET_SIMULATED_PAYLOAD, self._set_payload)
        self.announce_sync = self._emulator.announce_sync
        self._refused_payloads = 0
        self._slack: tuple[int, ...] = ()
        self._slack_events = 0
        self.add_on_set_parameters_callback(self._check_parameters)
        self.create_service(Trigger, "~/inject_fault", self._inject_fault)
        self.create_service(Trigger, "~/clear_faults", self._clear_faults)
        steady_timer(self, _PAYLOAD_PERIOD, self._watch)
        report_health(self, self._report)

    def let_supervisor_be_killed(self, drives: CanDrives) -> None:
        """Let the fault of that name make a driver deaf to the supervisor, which lives in another process."""

        def hear(deaf: bool) -> None:
            drives.deaf_to_supervisor = deaf

        def kill() -> Callable[[], None]:
            hear(deaf=True)
            return partial(hear, deaf=False)

        self._emulator.faults.kill_supervisor = kill

    def failed(self, error: Exception) -> None:
        """End the process when the machine has failed: there is nothing left to be driven."""
        if self._emulator.machine.failure is not None:
            raise self._emulator.machine.failure

    def destroy_node(self) -> None:
        """Destroy the node, after the drivers: the devices go with it."""
        self._emulator.close()
        super().destroy_node()

    def _watch(self) -> None:
        if self._emulator.machine.failure is not None:
            raise self._emulator.machine.failure
        payload = self._emulator.payload
        self._send_payload(InertiaSample(self.clock.system_ns(), payload.mass, payload.center_of_mass))
        slack = self._emulator.slack_cables()
        for cable in sorted(set(slack) - set(self._slack)):
            self._slack_events += 1
            self.get_logger().warning(f"cable_{cable + 1} is slack", throttle_duration_sec=1.0)
        self._slack = slack

    def _set_payload(self, message: InertiaStamped) -> None:
        mass, center = message.inertia.m, message.inertia.com
        stamp = Time.from_msg(message.header.stamp).nanoseconds
        try:
            if message.header.frame_id not in ("", PLATFORM_FRAME):
                raise DriverError(f"frame_id is '{message.header.frame_id}', expected '{PLATFORM_FRAME}'")
            at = stamp * 1e-9 if stamp else None
            self._emulator.change_payload(mass, (center.x, center.y, center.z), at)
        except DriverError as error:
            self._refused_payloads += 1
            self.get_logger().error(f"payload refused: {error}")
            return
        self.get_logger().info(f"payload of {mass:g} kg accepted")

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == "fault" and parameter.value:
                try:
                    self._emulator.faults.read(parameter.value)
                except DriverError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _inject_fault(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        text = self.get_parameter("fault").value
        try:
            order = self._emulator.faults.read(text)
        except DriverError as error:
            response.message = f"set the parameter fault first: {error}"
            return response
        self._emulator.faults.inject(order)
        response.success = True
        response.message = f"{text}: {order.fault.meaning}"
        self.get_logger().warning(f"fault injected: {response.message}")
        return response

    def _clear_faults(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._emulator.faults.clear()
        response.success = True
        response.message = "all injected faults are removed; latched faults stay latched"
        self.get_logger().info(response.message)
        return response

    def _report(self) -> list[Status]:
        emulator = self._emulator
        lag = emulator.lag
        values = {
            "missed_syncs": emulator.missed_syncs,
            "plant_lag_ms": f"{1e3 * lag:.1f}",
            "payload_kg": f"{emulator.payload.mass:g}",
            "brakes_open": sum(drive.automaton.brake_open for drive in emulator.drives),
            "slack_cables": ", ".join(f"cable_{cable + 1}" for cable in self._slack) or "none",
            "slack_events": self._slack_events,
            "refused_payloads": self._refused_payloads,
        }
        if lag > _LARGEST_LAG:
            return [Status.of(self.get_name(), Level.WARN, "the plant cannot keep up with the clock", values)]
        if self._slack:
            return [Status.of(self.get_name(), Level.WARN, "slack cable", values)]
        return [Status.of(self.get_name(), Level.OK, "ok", values)]


def on_virtual_buses(config: CanConfig) -> CanConfig:
    """Return the same configuration with every bus a virtual one of this process."""
    buses = tuple(
        dataclasses.replace(bus, interface="virtual", channel=f"simulated {bus.name}") for bus in config.buses
    )
    return dataclasses.replace(config, buses=buses)


def create_nodes(**options: Any) -> list[Node]:
    """Return the drivers' nodes and, destroyed last, the one that owns the simulated machine."""
    simulated = SimulatedRobot(**options)
    ports = SharedPorts(simulated.config, simulated.clock, simulated.announce_sync)
    drives = CanDrives(simulated.config, ports, **options)
    simulated.let_supervisor_be_killed(drives)
    return [
        drives,
        LoadCells(simulated.config, ports, **options),
        simulated,
    ]


def _plant(simulation: SimulationConfig) -> Plant:
    try:
        from cspr_drivers.simulation.plant.plant import Plant
    except ImportError as error:
        raise StartError(
            f"the simulation needs MuJoCo; `pip install mujoco` installs it ({error})"
        ) from error
    return Plant(simulation)


def main() -> int:
    """Run the drivers and the simulated machine in one process."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_nodes(create_nodes)


if __name__ == "__main__":
    sys.exit(main())
