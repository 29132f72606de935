"""What the closed loop needs of a machine: it publishes what it measures, takes torques, and answers services."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from cspr_control.closed_loop.simulated_time import SimulatedTime
from cspr_control.supervision.supervisor import Decision
from cspr_drivers.simulation.fault_injection import FaultInjector
from cspr_drivers.simulation.plant.plant import Plant
from cspr_drivers.simulation.simulation_config import Sling
from cspr_kinematics import Payload
from cspr_msgs_py.topics import Topic

Publish = Callable[[Topic, Any], None]


class Machine(Protocol):
    """A simulated machine with its driver; `BarePlant` and `SimulatedRobot` are the two there are.

    Attributes
    ----------
    time
        In which it lives.
    plant
        The true machine.
    publish
        Called with each topic and sample that the driver publishes.
    faults
        Puts faults into it.
    """

    faults: FaultInjector
    time: SimulatedTime
    plant: Plant
    publish: Publish

    def begin(self) -> None:
        """Let the driver begin; time passes until the drives can be enabled."""

    def command(self, commands: Sequence[tuple[int, int, float]]) -> None:
        """Take commands: a motor from 0, the stamp of the motor states that it answers, ns, and a torque, N m."""

    def reject_command(self, motor: int, problem: str) -> None:
        """Take a command for a motor, from 0, that cannot be read."""

    def supervised(self, stamp_ns: int) -> None:
        """Take the supervisor's sign of life: the stamp of the newest motor states that it has checked, ns."""

    def call(self, service: str) -> Decision:
        """Answer a service of the driver."""

    def change_payload(
        self, payload: Payload, stamp_ns: int, duration: float = 0.0, sling: Sling | None = None
    ) -> None:
        """Let another payload come aboard from a moment on, ns of ROS time, within a duration, s, or on a sling."""

    def close(self) -> None:
        """End the driver."""
