"""What a run of the closed loop does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cspr_control.errors import ControlError
from cspr_control.parameters.experiment import Experiment, require_undecided
from cspr_drivers.simulation.fault_injection import InjectedFault
from cspr_drivers.simulation.simulation_config import LARGEST_SEED, SimulationConfig
from cspr_kinematics import Payload, Pulleys
from cspr_msgs_py.bag.bag_file import Attachment
from cspr_msgs_py.parameters.file import ParameterFile

_LATENCY = 0.0005  # s from the motor states to the torques, in one process
_LATENCY_WITH_BUS = 0.0015  # s, with what frames take on the bus before and after

FAULTS = {fault.value: (fault.target.value, fault.meaning) for fault in InjectedFault}
"""What can go wrong with devices, by name: what has it, and what it is."""


@dataclass(frozen=True)
class PlannedFault:
    """A fault as ``drive_silent motor_3`` names it with its place, and when, s after the start of the trajectory."""

    fault: str
    time: float


@dataclass(frozen=True)
class Scenario(Experiment):
    """One run: a trajectory, what controls it, what it carries, and what goes wrong.

    Attributes
    ----------
    faults
        What goes wrong; only with devices.
    config
        Directory of the configuration.
    devices
        Whether drivers, buses and devices are simulated, or the plant alone.
    seed
        Of the noise; that of simulation.yaml if None.
    duration
        How long the trajectory is followed before it is stopped, s; to its end if None. Payloads that would be added
        later stay away.
    parameters
        Parameters of the control nodes that are to be otherwise than in control.yaml, by node; none that follows from
        controller and trajectory.
    buses
        File of the configuration that describes buses and devices.
    true_pulleys, motor_inertia_factor, conversion_time
        Of the simulated machine: its pulleys and the time from SYNC to the answer of an amplifier, s, if they are not
        those of simulation.yaml, and a factor on the inertia of its motors.
    latency
        From the motor states to the arrival of the torques at the driver, s; by default 0.5 ms with devices, where the
        buses take their time as well, and 1.5 ms without.
    phase
        From the start of the trajectory to the first set-point on it, s, less than a period; None lets it be.
    speed
        Simulated seconds per second of the computer on which the controllers run.
    """

    faults: tuple[PlannedFault, ...] = ()
    config: Path = Path("config")
    devices: bool = True
    seed: int | None = None
    duration: float | None = None
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    buses: str = "can.yaml"
    true_pulleys: Pulleys | None = None
    motor_inertia_factor: float = 1.0
    conversion_time: float | None = None
    latency: float | None = None
    phase: float | None = None
    speed: float = 1.0

    def __post_init__(self) -> None:
        if self.seed is not None and not 0 <= self.seed <= LARGEST_SEED:
            raise ControlError(f"the seed is {self.seed:.6g}; it must lie in [0, {LARGEST_SEED}]")
        if self.faults and not self.devices:
            raise ControlError("faults need devices that can have them: run the scenario with devices")
        require_undecided(self.parameters)

    @property
    def reaction_time(self) -> float:
        """From the motor states to the arrival of the torques at the driver, s."""
        if self.latency is not None:
            return self.latency
        return _LATENCY if self.devices else _LATENCY_WITH_BUS

    def read_parameters(self) -> ParameterFile:
        """Read control.yaml, with what is otherwise in this run."""
        parameters = ParameterFile.from_yaml(self.config / "control.yaml")
        self.choose(parameters)
        for node, values in self.parameters.items():
            parameters.change(node, values)
        return parameters

    def attachments(self) -> list[Attachment]:
        """Return the files of the configuration, control.yaml as it is in this run.

        Raises
        ------
        BagError
            If one cannot be read.
        """
        files = [Attachment.from_file(path) for path in sorted(self.config.glob("*.yaml"))]
        control = self.read_parameters().text().encode()
        return [
            replace(file, data=control) if Path(file.name).name == "control.yaml" else file for file in files
        ]

    def read_machine(self) -> SimulationConfig:
        """Read simulation.yaml, with what is otherwise in this run."""
        config = SimulationConfig.from_yaml(self.config / "simulation.yaml")
        config = config.with_payload(Payload(self.payload, np.zeros(3)))
        motor = config.robot.motor
        motor = replace(motor, inertia=motor.inertia * self.motor_inertia_factor)
        robot = replace(config.robot, motor=motor).with_geometry(pulleys=self.true_pulleys)
        cells = config.load_cells
        if self.conversion_time is not None:
            cells = replace(cells, conversion_time=self.conversion_time)
        seed = config.seed if self.seed is None else self.seed
        return replace(config, robot=robot, load_cells=cells, seed=seed)
