"""The true values of the simulated machine, read from simulation.yaml."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cspr_drivers.config.config_section import ConfigSection
from cspr_drivers.errors import ConfigurationError
from cspr_kinematics import InvalidInputError, KinematicsError, Payload, Pulleys, RigidBody, Robot

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class CableProperties:
    """Elastic, massless cables.

    Attributes
    ----------
    axial_stiffness
        Young's modulus times the metallic cross-section, N.
    damping_time
        Ratio of damping to stiffness of a taut cable, s.
    dead_length
        Length between drum and exit point, which stretches too, m.
    """

    axial_stiffness: float
    damping_time: float
    dead_length: float


@dataclass(frozen=True)
class BrakeProperties:
    """Holding brakes at the motor shafts: delays in s, torque in N m."""

    open_delay: float
    close_delay: float
    holding_torque: float


@dataclass(frozen=True)
class DriveProperties:
    """What a drive does by itself.

    Attributes
    ----------
    quick_stop_damping
        Velocity feedback of the drive during a quick stop, N m s/rad.
    quick_stop_time
        Longest time that the drive takes to stop its motor before the brake closes all the same, s.
    """

    quick_stop_damping: float
    quick_stop_time: float


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

    noise_std: float
    gain_error: FloatArray
    offset: FloatArray
    conversion_time: float = 0.0


@dataclass(frozen=True)
class PayloadChange:
    """A payload that is there from `time` (s after the start of the simulation) on."""

    time: float
    payload: Payload


@dataclass(frozen=True)
class SimulationConfig:
    """Everything that the simulated machine is and the controller is not told."""

    robot: Robot
    cables: CableProperties
    brake: BrakeProperties
    drive: DriveProperties
    load_cells: LoadCellProperties
    payload: Payload
    payload_changes: tuple[PayloadChange, ...]
    time_step: float
    seed: int

    @classmethod
    def from_yaml(cls, path: str | Path) -> SimulationConfig:
        """Read a simulation file; the robot file it names is relative to it.

        Raises
        ------
        ConfigurationError
            Names the file, the key and the value that is wrong.
        """
        return _read(Path(path))

    def with_payload(self, payload: Payload, *changes: PayloadChange) -> SimulationConfig:
        """Return the same machine carrying another payload."""
        return dataclasses.replace(self, payload=payload, payload_changes=changes)


def _payload(section: ConfigSection) -> Payload:
    return Payload(section.number("mass", 0.0), section.array("center_of_mass", 3))


def _read(path: Path) -> SimulationConfig:
    file = ConfigSection.from_yaml(path)
    try:
        believed = Robot.from_yaml(path.parent / file.text("robot"))
        robot = _true_robot(believed, file.section("true_values"))
    except KinematicsError as error:
        raise ConfigurationError(f"{path}: {error}") from error
    m = robot.number_of_cables

    section = file.section("cables")
    cables = CableProperties(
        axial_stiffness=section.number("axial_stiffness", 1.0),
        damping_time=section.number("damping_time", 0.0),
        dead_length=section.number("dead_length", 0.0),
    )
    section.finish()

    section = file.section("brake")
    brake = BrakeProperties(
        open_delay=section.number("open_delay", 0.0),
        close_delay=section.number("close_delay", 0.0),
        holding_torque=section.number("holding_torque", 0.0),
    )
    section.finish()

    section = file.section("drive")
    drive = DriveProperties(
        quick_stop_damping=section.number("quick_stop_damping", 0.0),
        quick_stop_time=section.number("quick_stop_time", 0.0),
    )
    section.finish()

    section = file.section("load_cells")
    load_cells = LoadCellProperties(
        noise_std=section.number("noise_std", 0.0),
        gain_error=section.array("gain_error", m),
        offset=section.array("offset", m),
        conversion_time=section.number("conversion_time", 0.0),
    )
    section.finish()

    section = file.section("payload")
    payload = _payload(section)
    section.finish()
    changes = []
    for section in file.sections("payload_changes", may_be_empty=True):
        changes.append(PayloadChange(section.number("time", 0.0), _payload(section)))
        section.finish()
    config = SimulationConfig(
        robot=robot,
        cables=cables,
        brake=brake,
        drive=drive,
        load_cells=load_cells,
        payload=payload,
        payload_changes=tuple(sorted(changes, key=lambda change: change.time)),
        time_step=_time_step(file),
        seed=file.integer("seed", 0, 2**32 - 1),
    )
    file.finish()
    return config


def _time_step(file: ConfigSection) -> float:
    value = file.number("time_step", above=0.0)
    if value > 2e-3:  # the fastest mode, the platform turning on its cables, is near 100 Hz
        raise file.error("time_step", "must be at most 0.002 s, or the cables are not integrated stably")
    return value


def _true_robot(believed: Robot, section: ConfigSection) -> Robot:
    """Return the robot as it is, from what the controller believes and the listed departures from it."""
    m = believed.number_of_cables
    mass = section.number("platform_mass", above=0.0)
    platform = RigidBody(
        mass=mass,
        center_of_mass=believed.platform.center_of_mass + section.array("center_of_mass_error", 3),
        inertia=believed.platform.inertia * (mass / believed.platform.mass),
    )
    motor = dataclasses.replace(
        believed.motor,
        inertia=believed.motor.inertia * section.number("motor_inertia_ratio", above=0.0),
        coulomb_friction=believed.motor.coulomb_friction * section.number("coulomb_friction_ratio", 0.0),
        viscous_friction=believed.motor.viscous_friction * section.number("viscous_friction_ratio", 0.0),
    )
    robot = believed.with_geometry(
        exit_points=believed.exit_points + section.array("exit_point_errors", m, 3),
        anchor_points=believed.anchor_points + section.array("anchor_point_errors", m, 3),
        pulleys=_pulleys(section.section("pulleys"), m) if "pulleys" in section else believed.pulleys,
    )
    section.finish()
    return dataclasses.replace(robot, platform=platform, motor=motor)


def _pulleys(section: ConfigSection, number_of_cables: int) -> Pulleys:
    radius = section.array_or_row("radius", number_of_cables)
    try:
        pulleys = Pulleys(radius)
        if "swivel_axis" in section:
            pulleys = Pulleys(radius, section.array_or_row("swivel_axis", number_of_cables, 3))
    except InvalidInputError as error:
        raise section.error(error.name, error.reason) from error
    section.finish()
    return pulleys
