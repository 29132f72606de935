"""The closed loop without ROS and without waiting: the nodes' own functions on the simulated plant, step by step."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from time import monotonic

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.numbers import mass
from cspr_control.analysis.numbers.mass import MassTrace
from cspr_control.estimation.payload import EstimatorSettings, PayloadEstimator
from cspr_control.estimation.pose import PoseEstimator
from cspr_control.motors.feedforward import Feedforward, Setpoint
from cspr_control.motors.motor_control import MotorController, MotorGains
from cspr_control.parameters.file import ParameterFile
from cspr_control.parameters.tables import (
    FEEDFORWARD,
    MASS_ESTIMATOR,
    estimator_settings,
    feedforward_settings,
    parameter_values,
)
from cspr_control.reference.catalogue import TrajectoryName, TrajectoryOptions, make_trajectory
from cspr_control.reference.player import TrajectoryPlayer
from cspr_control.reference.point_to_point import MotionLimits, PointToPoint
from cspr_control.reference.reference_point import ReferencePoint
from cspr_drivers.simulation.plant.plant import Plant
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import Payload, Pulleys, Robot
from cspr_msgs_py.vocabulary import FeedforwardModel, PayloadSource, TrajectoryPhase

CONFIG = Path(__file__).parents[1] / "config"
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LoopSettings:
    """One run of the closed loop; masses in kg, times in s."""

    model: FeedforwardModel = FeedforwardModel.DYNAMIC
    payload_source: PayloadSource = PayloadSource.ESTIMATED
    exact_mass: bool = False
    gains: MotorGains | None = None  # None: those of control.yaml
    estimator: EstimatorSettings | None = None  # likewise
    trajectory: TrajectoryName = TrajectoryName.PAPER_19
    payload: float = 100.0
    added: float = 100.0
    added_at: float = 3.0
    motor_inertia_factor: float = 1.0  # on the simulated motors
    robot: str = "robot.yaml"  # what the controllers believe
    true_pulleys: Pulleys | None = None  # of the simulated machine; by default as in config/simulation.yaml
    period: float = 0.004
    estimator_cycles: int = 5  # cycles between two updates of the mass estimate
    latency: float = 0.0015  # from the latching of the motor states to the torque
    phase: float = 0.002  # from the start of the trajectory to the first set-point on it, less than a period


@dataclass(frozen=True)
class LoopRecord:
    """What happened between the start and the end of the trajectory; n cycles, m motors."""

    time: FloatArray  # (n,) s after the start
    position_error: FloatArray  # (n, m) rad, demanded less measured
    velocity_error: FloatArray  # (n, m) rad/s, likewise
    tensions: FloatArray  # (n, m) N, true
    asked_tensions: FloatArray  # (n, m) N, behind the feed-forward torque
    torque: FloatArray  # (n, m) N m
    mass_estimate: FloatArray  # (n,) kg of payload
    mass_valid: NDArray[np.bool_]
    mass_true: FloatArray
    simulated: float  # s, from the release of the brakes to the end of the trajectory
    elapsed: float  # s of the machine's time that the simulation took

    @property
    def rms_deg(self) -> FloatArray:
        """RMS position error of each motor (m,), degrees."""
        return np.degrees(np.sqrt((self.position_error**2).mean(axis=0)))

    @property
    def max_deg(self) -> FloatArray:
        """Largest position error of each motor (m,), degrees."""
        return np.degrees(np.abs(self.position_error).max(axis=0))


def run(settings: LoopSettings, config_directory: Path = CONFIG) -> LoopRecord:
    """Run one trajectory on the plant of simulation.yaml, with the parameters of control.yaml.

    A second takes about a third of one. The first control commands come while the platform hangs at its home pose,
    two seconds before the approach to the trajectory begins, as in the demo.
    """
    began = monotonic()
    robot = Robot.from_yaml(config_directory / settings.robot)
    parameters = ParameterFile.from_yaml(config_directory / "control.yaml")
    config = SimulationConfig.from_yaml(config_directory / "simulation.yaml")
    config = config.with_payload(Payload(settings.payload, np.zeros(3)))
    motor = replace(config.robot.motor, inertia=config.robot.motor.inertia * settings.motor_inertia_factor)
    true_robot = replace(config.robot, motor=motor).with_geometry(pulleys=settings.true_pulleys)
    config = replace(config, robot=true_robot)
    plant, noise = Plant(config), np.random.default_rng(config.seed)
    m = robot.number_of_cables
    limits = MotionLimits(speed=0.4, acceleration=0.5, angular_speed=0.3, angular_acceleration=0.5)
    values = parameter_values(FEEDFORWARD, parameters.of("feedforward"))
    feedforward = Feedforward(
        robot,
        replace(
            feedforward_settings(m, values), model=settings.model, payload_source=settings.payload_source
        ),
    )
    gains = settings.gains or motor_gains(parameters)
    controllers = [MotorController(robot.motor, gains) for _ in range(m)]
    estimator = settings.estimator or estimator_settings(
        parameter_values(MASS_ESTIMATOR, parameters.of("mass_estimator"))
    )
    pose_estimator, payload_estimator = PoseEstimator(robot), PayloadEstimator(robot, estimator)
    trajectory = make_trajectory(
        settings.trajectory, robot, robot.home, TrajectoryOptions(limits, robot.home)
    )
    approach = PointToPoint(robot.home, trajectory.sample(0.0).pose, limits)
    dwell = 1.0 + (-settings.phase - approach.duration - 1.0) % settings.period
    player = TrajectoryPlayer(limits, dwell)

    def advance_to_setpoint(time: float) -> Setpoint:
        reference = player.sample(round(time * 1e9))
        assert isinstance(reference, ReferencePoint)
        setpoint = feedforward.compute(time, reference)
        for k, controller in enumerate(controllers):
            controller.set_setpoint(
                time, round(time * 1e9), setpoint.position[k], setpoint.velocity[k], setpoint.effort[k]
            )
        return setpoint

    player.hold(robot.home)
    setpoint = advance_to_setpoint(0.0)
    for k in range(m):
        plant.set_torque(k, -robot.winch.ratio * plant.tensions()[k])
        plant.set_brake(k, closed=False)
    angles = plant.motor_angles()
    rows = []
    cycle, started = 0, False
    while player.phase is not TrajectoryPhase.FINISHED:
        time = cycle * settings.period
        stamp = round(time * 1e9)
        plant.advance(time)
        if started and plant.payload.mass == settings.payload and settings.added:
            assert player.start_time is not None
            if stamp >= player.start_time + round(settings.added_at * 1e9):
                plant.set_payload(Payload(settings.payload + settings.added, np.zeros(3)))
        previous, angles = angles, plant.motor_angles()
        speeds = (angles - previous) / settings.period
        cells = config.load_cells
        measured = (
            plant.tensions() * (1 + cells.gain_error)
            + cells.offset
            + cells.noise_std * noise.standard_normal(m)
        )
        payload_estimator.observe_tensions(time, stamp, measured)
        if cycle % settings.estimator_cycles == 0:
            payload_estimator.observe_pose(time, stamp, pose_estimator.estimate(angles))
            published = payload_estimator.update(time).published
            estimate = plant.payload if settings.exact_mass else published
            feedforward.set_estimate(time, estimate.mass, estimate.center_of_mass)
        torque = np.array(
            [c.command(time, stamp, a, s) for c, a, s in zip(controllers, angles, speeds, strict=True)]
        )
        rows.append(
            (
                stamp,
                setpoint.position - angles,
                setpoint.velocity - speeds,
                plant.tensions(),
                setpoint.tensions,
                torque,
                payload_estimator.newest,
                plant.payload.mass,
            )
        )
        setpoint = advance_to_setpoint(time + settings.period)
        if time >= 2.0 and not started:
            player.start(trajectory)
            started = True
        plant.advance(time + settings.latency)
        for k in range(m):
            plant.set_torque(k, torque[k])
        cycle += 1
    assert player.start_time is not None
    simulated = cycle * settings.period
    rows = [row for row in rows if row[0] >= player.start_time]
    stamps, position, velocity, tensions, asked, torques, estimates, masses = zip(*rows, strict=True)
    return LoopRecord(
        time=(np.array(stamps) - player.start_time) * 1e-9,
        position_error=np.array(position),
        velocity_error=np.array(velocity),
        tensions=np.array(tensions),
        asked_tensions=np.array(asked),
        torque=np.array(torques),
        mass_estimate=np.array([estimate.published.mass for estimate in estimates]),
        mass_valid=np.array([estimate.valid for estimate in estimates]),
        mass_true=np.array(masses),
        simulated=simulated,
        elapsed=monotonic() - began,
    )


def motor_gains(parameters: ParameterFile) -> MotorGains:
    """Return the gains that a parameter file gives to the motor controllers."""
    given = parameters.of("motor_control_gains")
    return MotorGains(**{f.name: given[f.name] for f in fields(MotorGains) if f.name in given})


def settling_time(record: LoopRecord) -> float:
    """Time from the change of the payload until the estimate is within 2 % for good, s; inf if never."""
    stamps = (record.time * 1e9).round().astype(np.int64)
    settled = mass.settling_time(MassTrace(stamps, record.mass_estimate), MassTrace(stamps, record.mass_true))
    return np.inf if settled is None else settled
