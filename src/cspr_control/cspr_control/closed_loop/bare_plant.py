"""The plant alone: no devices and no buses between it and the controllers, and none of what takes their time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cspr_control.closed_loop.machine import Publish
from cspr_control.closed_loop.simulated_time import SimulatedTime
from cspr_control.supervision.supervisor import Decision
from cspr_drivers.simulation.devices.encoder import Encoder
from cspr_drivers.simulation.fault_injection import FaultInjector
from cspr_drivers.simulation.plant.plant import Plant
from cspr_drivers.simulation.plant.shared import SharedPlant
from cspr_drivers.simulation.simulation_config import SimulationConfig, Sling
from cspr_kinematics import Payload
from cspr_msgs_py.topics import CABLE_TENSIONS, DRIVE_STATES, LOAD_CELL_STATES, MOTOR_STATES, TRUE_POSE
from cspr_msgs_py.vocabulary import DriverState, Level
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import PoseSample, Status, StatusArray

_NONE = np.empty(0)


@dataclass
class _Cell:
    """A load cell, as `FaultyCell` says."""

    stuck: bool = False
    shift: float = 0.0
    gain_loss: float = 0.0


class BarePlant:
    """Platform, cables and winches with ideal drives and with the load cells of `simulation.yaml`; a `Machine`.

    Parameters
    ----------
    time
        Its time.
    config
        The true machine.
    period
        Of the control cycle, s.

    Attributes
    ----------
    faults
        Puts faults that need no devices into it.
    """

    def __init__(self, time: SimulatedTime, config: SimulationConfig, period: float) -> None:
        self.time = time
        self.plant = Plant(config)
        self.publish: Publish = lambda topic, sample: None
        self._config = config
        self._period = period
        self._machine = SharedPlant(self.plant, config.payload_changes, time)
        self._noise = np.random.default_rng(config.seed)
        self._gains = 1 + np.array(config.load_cells.gain_error)
        self._cells = tuple(_Cell() for _ in self._gains)
        self._encoders = tuple(Encoder() for _ in self._gains)
        self.faults = FaultInjector((), self._cells, self._machine, {}, encoders=self._encoders)
        self._shown = np.zeros(len(self._cells))
        self._offsets = np.array(config.load_cells.offset)
        self._angles = self.plant.motor_angles()
        self._enabled = False
        self._m = config.robot.number_of_cables

    def begin(self) -> None:
        """Let the control cycles begin, brakes closed."""
        self.time.every(self._period, self._cycle)
        self.time.every(1.0, self._publish_states)

    def command(self, commands: Sequence[tuple[int, int, float]]) -> None:
        """Apply torques, N m, at once."""
        if self._enabled:
            self._advance()
            for index, _, torque in commands:
                self.plant.set_torque(index, torque)

    def reject_command(self, motor: int, problem: str) -> None:
        """Do nothing: there is no driver that stops then."""

    def supervised(self, stamp_ns: int) -> None:
        """Do nothing: there is no driver that stops without a supervisor."""

    def call(self, service: str) -> Decision:
        """Open the brakes, or close them; the motors balance the present tensions until the next command."""
        self._advance()
        if service == "/can_drives/enable":
            self._enabled = True
        elif service in ("/can_drives/disable", "/can_drives/quick_stop"):
            self._enabled = False
        held = -self._config.robot.winch.transmission_ratio * self.plant.tensions()
        for index in range(self._m):
            self.plant.set_torque(index, held[index] if self._enabled else 0.0)
            self.plant.set_brake(index, closed=not self._enabled)
        self.time.at(self.time.monotonic(), self._publish_states)
        return Decision(True, "accepted")

    def change_payload(
        self, payload: Payload, stamp_ns: int, duration: float = 0.0, sling: Sling | None = None
    ) -> None:
        """Let another payload come aboard from a moment on, ns of ROS time, within a duration, s, or on a sling."""
        time = (stamp_ns - self.time.system_ns()) * 1e-9 + self._machine.now()
        self._machine.change_payload(payload, time, duration, sling)

    def close(self) -> None:
        """Do nothing: there is no driver."""

    def _advance(self) -> None:
        self._machine.advance(self._machine.now(), exactly=True)

    def _cycle(self) -> None:
        self._advance()
        stamp = self.time.system_ns()
        noise = self._config.load_cells.noise_std * self._noise.standard_normal(self._m)
        true = self.plant.tensions()
        tensions = true * self._gains + self._offsets + noise
        for index, cell in enumerate(self._cells):
            if cell.stuck:
                tensions[index] = self._shown[index]
            else:
                tensions[index] += cell.shift - cell.gain_loss * self._gains[index] * true[index]
        self._shown = tensions
        self.publish(CABLE_TENSIONS, JointStateSample(stamp, _NONE, _NONE, tensions))
        plant = self.plant
        self.publish(TRUE_POSE, PoseSample(stamp, plant.platform_position(), plant.platform_quaternion()))
        before, turned, now = self._angles, self.plant.motor_angles(), self._machine.time
        self._angles = np.array(
            [encoder.angle(now, angle) for encoder, angle in zip(self._encoders, turned, strict=True)]
        )
        speeds = (self._angles - before) / self._period
        states = JointStateSample(stamp, self._angles, speeds, self.plant.motor_torques())
        self.publish(MOTOR_STATES, states)

    def _publish_states(self) -> None:
        state = DriverState.ENABLED if self._enabled else DriverState.DISABLED
        for topic, name, message in (
            (DRIVE_STATES, "can_drives", state.value),
            (LOAD_CELL_STATES, "load_cells", "ok"),
        ):
            status = Status(name, Level.OK, message, {"cause": ""})
            self.publish(topic, StatusArray(self.time.system_ns(), (status,)))
