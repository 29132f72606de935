"""The true values of the simulated machine, read from simulation.yaml."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from cspr_drivers.config.file_errors import as_configuration_error
from cspr_kinematics import Payload, RigidBody, Robot
from cspr_kinematics.arrays import require_one_for_each_cable
from cspr_kinematics.configuration.structure import (
    NotNegative,
    Positive,
    Text,
    Vector,
    located,
    structured,
)
from cspr_kinematics.configuration.yaml_file import read_yaml
from cspr_kinematics.errors import ConfigurationFileError
from cspr_kinematics.robot.robot_description import PulleysEntry

LARGEST_SEED = 2**32 - 1

_Angle = Annotated[float, Meta(ge=-1.2, le=1.2)]


@dataclass(frozen=True)
class CableProperties:
    """Elastic cables with weight, and the pulleys over which they run.

    Attributes
    ----------
    axial_stiffness
        Young's modulus times the metallic cross-section, N.
    damping_time
        Ratio of damping to stiffness of a taut cable, s.
    dead_length
        Length between drum and exit point, which stretches too, m; its weight is carried on the way.
    mass_per_metre
        Mass of the cable, kg/m.
    pulley_friction
        Share of the tension that the friction of a pulley takes.
    """

    axial_stiffness: Annotated[float, Meta(ge=1.0)]
    damping_time: NotNegative
    dead_length: NotNegative
    mass_per_metre: NotNegative = 0.0
    pulley_friction: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0


@dataclass(frozen=True)
class BrakeProperties:
    """Holding brakes at the motor shafts: delays in s, torque in N m."""

    open_delay: NotNegative
    close_delay: NotNegative
    holding_torque: NotNegative


@dataclass(frozen=True)
class DriveProperties:
    """What a drive does by itself.

    Attributes
    ----------
    quick_stop_damping
        Velocity feedback of the drive during a quick stop, N m s/rad.
    quick_stop_time
        Longest time that the drive takes to stop its motor before the brake closes all the same, s.
    no_load_speed_ratio
        Speed at which a motor drives nothing any more, as its supply's voltage is used up, over its speed limit, up to
        which it has its full torque.
    """

    quick_stop_damping: NotNegative
    quick_stop_time: NotNegative
    no_load_speed_ratio: Annotated[float, Meta(ge=1.01, le=10.0)] = 1.1


@dataclass(frozen=True)
class LoadCellProperties:
    """Load cells and their amplifiers.

    Attributes
    ----------
    noise_std
        Standard deviation of the noise, N.
    gain_error
        Relative errors (m,).
    offset
        Offsets (m,), N.
    conversion_time
        From SYNC, at which the tension is latched, to the amplifier's answer, s.
    """

    noise_std: NotNegative
    gain_error: list[float]
    offset: list[float]
    conversion_time: NotNegative


@dataclass(frozen=True)
class Sling:
    """An elastic sling, by which a payload hangs on the point of the platform that is else its centre of mass.

    Attributes
    ----------
    length
        Without load, m.
    stiffness
        N/m.
    damping_time
        Ratio of damping to stiffness, s.
    deflection
        Angles by which it is out of plumb at the beginning, towards x and y of `base`, rad.
    """

    length: Positive
    stiffness: Annotated[float, Meta(ge=1.0)]
    damping_time: NotNegative = 0.0
    deflection: tuple[_Angle, _Angle] = (0.0, 0.0)


@dataclass(frozen=True)
class PayloadChange:
    """A payload that comes aboard `time`, s, after the start of the simulation, and takes `duration`, s, for it."""

    time: float
    payload: Payload
    duration: float = 0.0
    sling: Sling | None = None


@dataclass(frozen=True, kw_only=True)
class SimulationValues:
    """What is used as it stands in the file.

    Attributes
    ----------
    table_height
        Height of what loads on slings rest on, m.
    time_step
        Longest step of the integration, s.
    seed
        Of the noise.
    """

    cables: CableProperties
    brake: BrakeProperties
    drive: DriveProperties
    load_cells: LoadCellProperties
    # the fastest mode, the platform turning on its cables, is near 100 Hz
    time_step: Annotated[float, Meta(gt=0.0, le=2e-3, description="or the cables are not integrated stably")]
    seed: Annotated[int, Meta(ge=0, le=LARGEST_SEED)]
    table_height: float = 0.0


@dataclass(frozen=True, kw_only=True)
class SimulationConfig(SimulationValues):
    """Everything that the simulated machine is and the controller is not told."""

    robot: Robot
    payload: Payload
    payload_changes: tuple[PayloadChange, ...]
    sling: Sling | None = None

    @property
    def has_sling(self) -> bool:
        """Whether the payload hangs on a sling, now or later."""
        return self.sling is not None or any(change.sling is not None for change in self.payload_changes)

    @classmethod
    def from_yaml(cls, path: str | Path) -> SimulationConfig:
        """Read a simulation file; the robot file it names is relative to it.

        Raises
        ------
        ConfigurationError
            Names the file, the key and the value that is wrong.
        """
        with as_configuration_error():
            return _config(structured(_File, read_yaml(path), str(path)), Path(path))

    def with_payload(
        self, payload: Payload, *changes: PayloadChange, sling: Sling | None = None
    ) -> SimulationConfig:
        """Return the same machine carrying another payload, on a sling if one is given."""
        return dataclasses.replace(self, payload=payload, payload_changes=changes, sling=sling)


@dataclass(frozen=True)
class _TrueValues:
    """How the machine departs from what the controllers believe: errors in m, ratios of true to believed values."""

    platform_mass: Positive
    center_of_mass_error: Vector
    motor_inertia_ratio: Positive
    coulomb_friction_ratio: NotNegative
    viscous_friction_ratio: NotNegative
    exit_point_errors: list[Vector]
    anchor_point_errors: list[Vector]
    pulleys: PulleysEntry | None = None


@dataclass(frozen=True)
class _PayloadEntry:
    """Mass in kg, its centre, or where its sling is fixed, in m in platform axes."""

    mass: NotNegative
    center_of_mass: Vector
    sling: Sling | None = None


@dataclass(frozen=True)
class _PayloadChangeEntry(_PayloadEntry):
    """What is aboard from `time`, s, on; `duration`, s, is how long it takes to come aboard."""

    time: NotNegative = field(kw_only=True)
    duration: NotNegative = 0.0


@dataclass(frozen=True, kw_only=True)
class _File(SimulationValues):
    """The content of simulation.yaml."""

    robot: Text
    true_values: _TrueValues
    payload: _PayloadEntry
    payload_changes: list[_PayloadChangeEntry]


def _config(file: _File, path: Path) -> SimulationConfig:
    try:
        believed = Robot.from_yaml(path.parent / file.robot)
    except ConfigurationFileError as error:
        raise ConfigurationFileError(str(path), "robot", file.robot, str(error)) from error
    for place, change in enumerate(file.payload_changes):
        if change.sling is not None and change.duration > 0.0:
            problem = (
                "a payload on a sling comes aboard at once, or by being lifted off table_height: leave it out"
            )
            raise ConfigurationFileError(
                str(path), f"payload_changes[{place}].duration", change.duration, problem
            )
    _require_one_for_each_cable(file, believed.number_of_cables, str(path))
    with located(str(path)):
        robot = _true_robot(believed, file.true_values, str(path))
    changes = sorted(file.payload_changes, key=lambda change: change.time)
    return SimulationConfig(
        robot=robot,
        **{field.name: getattr(file, field.name) for field in dataclasses.fields(SimulationValues)},
        payload=Payload(file.payload.mass, file.payload.center_of_mass),
        payload_changes=tuple(
            PayloadChange(c.time, Payload(c.mass, c.center_of_mass), c.duration) for c in changes
        ),
    )


def _require_one_for_each_cable(file: _File, number_of_cables: int, source: str) -> None:
    for section in ("true_values", "load_cells"):
        for key, value in vars(getattr(file, section)).items():
            if isinstance(value, list):
                with located(source, section):
                    require_one_for_each_cable(key, value, number_of_cables)


def _true_robot(believed: Robot, true: _TrueValues, source: str) -> Robot:
    """Return the robot as it is, from what the controllers believe and the listed departures from it."""
    platform = RigidBody(
        mass=true.platform_mass,
        center_of_mass=believed.platform.center_of_mass + true.center_of_mass_error,
        inertia=believed.platform.inertia * (true.platform_mass / believed.platform.mass),
    )
    motor = dataclasses.replace(
        believed.motor,
        inertia=believed.motor.inertia * true.motor_inertia_ratio,
        coulomb_friction=believed.motor.coulomb_friction * true.coulomb_friction_ratio,
        viscous_friction=believed.motor.viscous_friction * true.viscous_friction_ratio,
    )
    pulleys = believed.pulleys
    if true.pulleys is not None:
        pulleys = true.pulleys.pulleys(believed.number_of_cables, source, "true_values.pulleys")
    robot = believed.with_geometry(
        exit_points=believed.exit_points + true.exit_point_errors,
        anchor_points=believed.anchor_points + true.anchor_point_errors,
        pulleys=pulleys,
    )
    return dataclasses.replace(robot, platform=platform, motor=motor)
