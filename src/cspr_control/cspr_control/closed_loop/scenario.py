"""What a run of the closed loop does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cspr_control.errors import ControlError
from cspr_control.parameters.experiment import Experiment, require_undecided
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.drives.home_position import with_home
from cspr_drivers.simulation.fault_injection import WITHOUT_DEVICES, InjectedFault
from cspr_drivers.simulation.simulation_config import LARGEST_SEED, SimulationConfig, Sling
from cspr_kinematics import Payload, Pulleys
from cspr_msgs_py.bag.bag_file import Attachment
from cspr_msgs_py.parameters.file import ParameterFile

_LATENCY = 0.0005  # s from the motor states to the torques, in one process
_LATENCY_WITH_BUS = 0.0015  # s, with what frames take on the bus before and after

FAULTS = {fault.value: (fault.target.value, fault.meaning) for fault in InjectedFault}
"""What can go wrong with devices, by name: what has it, and what it is."""

_SLING_STIFFNESS = 60e3  # N/m: a polyester sling for a few hundred kilograms


def soft_sling(length: float, deflection: float) -> Sling:
    """Return a polyester sling of a length, m, that is out of plumb towards x by an angle, rad, at the start."""
    return Sling(length, _SLING_STIFFNESS, deflection=(deflection, 0.0))


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
    growth
        How long what is added takes to come aboard, s: as when it is lifted off a table.
    sling
        On which all that is carried hangs from the platform's origin, if on any.
    table_height
        Of what it rests on when it comes down there, m, if not that of simulation.yaml.
    duration
        How long the trajectory is followed before it is stopped, s; to its end if None. Payloads that would be added
        later stay away.
    parameters
        Parameters of the control nodes that are to be otherwise than in control.yaml, by node; none that follows from
        controller and trajectory.
    buses
        File of the configuration that describes buses and devices.
    home_counts
        Position value of all drives at the home pose, if not those that the file gives each.
    payload_center
        Centre of mass of whatever is carried, m in platform.
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
    growth: float = 0.0
    sling: Sling | None = None
    table_height: float | None = None
    duration: float | None = None
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    buses: str = "can.yaml"
    home_counts: int | None = None
    payload_center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    true_pulleys: Pulleys | None = None
    motor_inertia_factor: float = 1.0
    conversion_time: float | None = None
    latency: float | None = None
    phase: float | None = None
    speed: float = 1.0

    def __post_init__(self) -> None:
        if self.seed is not None and not 0 <= self.seed <= LARGEST_SEED:
            raise ControlError(f"the seed is {self.seed:.6g}; it must lie in [0, {LARGEST_SEED}]")
        if self.sling is not None and self.growth > 0.0:
            raise ControlError("a load on a sling comes aboard by being lifted, not by growth")
        alone = {fault.value for fault in WITHOUT_DEVICES}
        for planned in self.faults:
            name = planned.fault.split(" ")[0]
            if not self.devices and name in FAULTS and name not in alone:
                raise ControlError(
                    f"the fault {name} needs devices that can have it; the plant alone can have "
                    f"{', '.join(sorted(alone))}"
                )
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

    def read_buses(self) -> CanConfig:
        """Read can.yaml, with what is otherwise in this run."""
        config = CanConfig.from_yaml(self.config / self.buses)
        if self.home_counts is None:
            return config
        return with_home(config, [self.home_counts] * len(config.drives))

    def read_machine(self) -> SimulationConfig:
        """Read simulation.yaml, with what is otherwise in this run."""
        config = SimulationConfig.from_yaml(self.config / "simulation.yaml")
        config = config.with_payload(Payload(self.payload, self.payload_center), sling=self.sling)
        motor = config.robot.motor
        motor = replace(motor, inertia=motor.inertia * self.motor_inertia_factor)
        robot = replace(config.robot, motor=motor).with_geometry(pulleys=self.true_pulleys)
        cells = config.load_cells
        if self.conversion_time is not None:
            cells = replace(cells, conversion_time=self.conversion_time)
        seed = config.seed if self.seed is None else self.seed
        table = config.table_height if self.table_height is None else self.table_height
        return replace(config, robot=robot, load_cells=cells, seed=seed, table_height=table)
