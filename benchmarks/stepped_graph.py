"""The whole graph in simulated time: what the control nodes do, on `SteppedRobot`, without ROS."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.stepped_robot import SteppedRobot
from cspr_control.estimation.payload import EstimatorSettings, PayloadEstimator
from cspr_control.estimation.pose import PoseEstimator
from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings
from cspr_control.motors.motor_control import MotorController, MotorGains
from cspr_control.reference.player import TrajectoryPlayer
from cspr_control.reference.point_to_point import MotionLimits
from cspr_control.reference.reference_point import ReferencePoint
from cspr_control.reference.trajectory import Trajectory
from cspr_control.supervision.checks import MonitoredInput, SupervisionLimits
from cspr_control.supervision.supervisor import Action, Decision, Supervisor
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.drives.report import MotorStates
from cspr_drivers.load_cells.master import in_words
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import KinematicsError, Payload, Robot
from cspr_msgs_py.vocabulary import DriverState, RobotState

CONFIG = Path(__file__).parents[1] / "config"
GAINS = MotorGains(kp=2.0, kd=0.1)  # as in config/control.yaml
LIMITS = MotionLimits(speed=0.2, acceleration=0.3, angular_speed=0.2, angular_acceleration=0.4)
LATENCY = 0.0005  # s from the motor states to the torque commands, in one process
SERVICE_TIME = 0.002  # s from a call of a service to its answer
SUPERVISION_PERIOD = 0.02  # s, as the supervisor's
_POSE_CYCLES = 5  # cycles between two poses: 50 Hz
_FOLLOWING = (RobotState.ENABLING, RobotState.ENABLED, RobotState.STOPPING)


def supervision_limits(robot: Robot) -> SupervisionLimits:
    """Return the limits of the supervisor as config/control.yaml has them."""
    parameters = yaml.safe_load((CONFIG / "control.yaml").read_text(encoding="utf-8"))
    values = parameters["supervisor"]["ros__parameters"]
    ages = {source: values["max_age"][source.name.lower()] for source in MonitoredInput}
    return SupervisionLimits(
        max_ages=ages,
        tension_min=robot.tension_min,
        tension_max=robot.tension_max,
        motor_speed=robot.motor.speed_limit,
        workspace_min=tuple(robot.workspace_min.tolist()),
        workspace_max=tuple(robot.workspace_max.tolist()),
        pay_out=robot.winch.ratio,
        **{name: value for name, value in values.items() if name != "max_age"},
    )


class SteppedGraph:
    """Drivers, controllers, estimators and supervisor around the simulated machine.

    Parameters
    ----------
    payload
        What the platform carries, kg.
    can_config
        File in `config/` that describes buses and devices.
    conversion_time
        Time from SYNC to the answer of an amplifier, s; by default that of `simulation.yaml`.

    Attributes
    ----------
    robot
        Drivers, buses, devices and plant.
    supervisor, player
        Those of the nodes.
    dead_controllers
        Motors, from 0, whose controllers have been killed.
    torque
        Changes the torque that a controller commands; by motor from 0.
    """

    def __init__(
        self, payload: float = 200.0, can_config: str = "can.yaml", conversion_time: float | None = None
    ) -> None:
        self.model = model = Robot.from_yaml(CONFIG / "robot.yaml")
        simulation = SimulationConfig.from_yaml(CONFIG / "simulation.yaml")
        simulation = simulation.with_payload(Payload(payload, np.zeros(3)))
        if conversion_time is not None:
            cells = dataclasses.replace(simulation.load_cells, conversion_time=conversion_time)
            simulation = dataclasses.replace(simulation, load_cells=cells)
        self.robot = SteppedRobot(CanConfig.from_yaml(CONFIG / can_config), simulation, CONFIG / "eds")
        m = model.number_of_cables
        self.supervisor = Supervisor(m, supervision_limits(model))
        self.player = TrajectoryPlayer(LIMITS)
        self.dead_controllers: set[int] = set()
        self.torque: dict[int, Callable[[float], float]] = {}
        self._feedforward = Feedforward(model, FeedforwardSettings())
        self._controllers = [MotorController(model.motor, GAINS, setpoint_timeout=0.1) for _ in range(m)]
        self._pose_estimator = PoseEstimator(model)
        self._payload_estimator = PayloadEstimator(model, EstimatorSettings())
        self._cycle = 0
        robot = self.robot
        robot.on_states = self._on_states
        robot.on_tensions = self._on_tensions
        robot.at(robot.now, self._supervise)
        robot.start()
        robot.wait(2.0)  # the estimate of the payload settles

    @property
    def state(self) -> RobotState:
        """State of the robot."""
        return self.supervisor.state

    @property
    def cause(self) -> str:
        """What is latched, in words; empty when nothing is."""
        return str(self.supervisor.fault) if self.supervisor.fault else ""

    def close(self) -> None:
        """Let all threads end."""
        self.robot.close()

    def order(self, command: Callable[[float], Decision]) -> Decision:
        """Give an operator's command to the supervisor."""
        decision = command(self.robot.now)
        self._act()
        return decision

    def enable(self) -> None:
        """Enable the robot and wait until it is."""
        decision = self.order(self.supervisor.enable)
        if not decision.accepted:
            raise RuntimeError(decision.message)
        self.wait_for(RobotState.ENABLED, 3.0)

    def start(self, trajectory: Trajectory) -> None:
        """Begin a trajectory."""
        self.player.start(trajectory)

    def wait_for(self, state: RobotState, limit: float) -> None:
        """Let simulated time pass until the robot is in a state, s at most."""
        end = self.robot.now + limit
        while self.state is not state:
            if self.robot.now > end:
                drives = self.robot.drives.states()[:2]
                raise TimeoutError(f"the robot is {self.state.value} ({self.cause}), the drives are {drives}")
            self.robot.wait(0.004)

    def _on_states(self, states: MotorStates) -> None:
        now, stamp = self.robot.now, states.stamp_ns
        angles, speeds, torques = map(np.array, (states.angles, states.speeds, states.torques))
        self.supervisor.checks.observe_motors(now, stamp, angles, speeds, torques)
        for index, controller in enumerate(self._controllers):
            if index in self.dead_controllers:
                continue
            torque = controller.command(now, stamp, states.angles[index], states.speeds[index])
            if torque is not None:
                torque = self.torque[index](torque) if index in self.torque else torque
                self.robot.at(now + LATENCY, partial(self._command, index, stamp, torque))
        self._cycle += 1
        if self._cycle % _POSE_CYCLES == 0:
            self._estimate(now, stamp, angles)
        target = stamp + round(self.robot.config.period * 1e9)
        reference = self.player.sample(target)
        if isinstance(reference, ReferencePoint):
            setpoint = self._feedforward.compute(now, reference)
            for index, controller in enumerate(self._controllers):
                controller.set_setpoint(
                    now, target, setpoint.position[index], setpoint.velocity[index], setpoint.effort[index]
                )
            self.supervisor.checks.observe_setpoint(now, target, setpoint.position, setpoint.velocity)

    def _estimate(self, now: float, stamp: int, angles: NDArray[np.float64]) -> None:
        try:
            pose = self._pose_estimator.estimate(angles)
        except KinematicsError:
            return  # as the node: no pose, and whoever needs one sees it grow old
        self.supervisor.checks.observe_pose(now, pose.position)
        self._payload_estimator.observe_pose(now, stamp, pose)
        estimate = self._payload_estimator.update(now).published
        self._feedforward.set_estimate(now, estimate.mass, estimate.center_of_mass)
        if self.state not in _FOLLOWING:
            self.player.hold(pose)

    def _command(self, index: int, stamp: int, torque: float) -> None:
        if self.robot.driver_runs:
            self.robot.drives.command(index, stamp, torque)

    def _on_tensions(self, stamp: int, tensions: tuple[float, ...]) -> None:
        now = self.robot.now
        self.supervisor.checks.observe_tensions(now, np.array(tensions))
        self._payload_estimator.observe_tensions(now, stamp, tensions)

    def _supervise(self) -> None:
        self.robot.at(self.robot.now + SUPERVISION_PERIOD, self._supervise)
        if self.robot.driver_runs:
            state, cause, _ = self.robot.drives.states()
            self.supervisor.observe_drives(self.robot.now, DriverState(state.value), cause)
            self.supervisor.observe_load_cells(in_words(self.robot.load_cells.problems(self.robot.now)))
        self._act()

    def _act(self) -> None:
        self.supervisor.observe_trajectory(self.player.phase)
        for action in self.supervisor.update(self.robot.now):
            self.robot.at(self.robot.now + SERVICE_TIME, partial(self._carry_out, action))
        if self.state not in _FOLLOWING:
            self.player.stop()

    def _carry_out(self, action: Action) -> None:
        drives = self.robot.drives
        if action is not Action.STOP_TRAJECTORY and not self.robot.driver_runs:
            self.supervisor.answered(self.robot.now, action, False, "the driver does not answer")
            return
        refusal: str | None = None
        match action:
            case Action.ENABLE_DRIVES:
                refusal = drives.enable()
            case Action.DISABLE_DRIVES:
                drives.disable()
            case Action.QUICK_STOP:
                drives.quick_stop("quick stop commanded")
            case Action.RESET_DRIVES:
                refusal = drives.fault_reset()
            case Action.STOP_TRAJECTORY:
                self.player.stop()
        self.supervisor.answered(self.robot.now, action, refusal is None, refusal or "")
