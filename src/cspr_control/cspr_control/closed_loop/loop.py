"""The control graph and a simulated machine, driven by simulated time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Generic, TypeVar

from cspr_control.closed_loop.machine import Machine
from cspr_control.components.component import Call, Output, Publication, Remark
from cspr_control.components.supervision import SupervisionComponent
from cspr_control.components.trajectory import TrajectoryComponent
from cspr_control.errors import ControlError
from cspr_control.graph import control_graph
from cspr_control.parameters.control_settings import ControlSettings
from cspr_control.reference.player import TrajectoryPlayer
from cspr_control.reference.trajectory import Trajectory
from cspr_control.supervision.supervisor import Decision, Supervisor
from cspr_kinematics import Pose, Robot
from cspr_msgs_py.topics import (
    DIAGNOSTICS,
    PAYLOAD,
    ROSOUT,
    SIMULATED_PAYLOAD,
    SUPERVISOR_ALIVE,
    Topic,
    motor_command,
)
from cspr_msgs_py.vocabulary import RobotState
from cspr_msgs_py.wire.samples import InertiaSample, LogLine

SERVICE_TIME = 0.002  # s from a call of a service to its answer
_PAYLOAD_PERIOD = 0.02  # s between two words about the true payload
_STEP = 0.004  # s between two checks while waiting for something

M = TypeVar("M", bound=Machine)
Listener = Callable[[Topic, Any], None]


class ClosedLoopError(ControlError):
    """Something did not come about in the closed loop."""


class ClosedLoop(Generic[M]):
    """A control graph around a machine.

    Parameters
    ----------
    robot, settings
        Of the control graph.
    machine
        The machine that it drives.
    latency
        Time from the publication of the motor states to the arrival of the torques at the driver, s.
    exact_mass
        Whether the feed-forward is given the true mass.
    speed
        Simulated seconds per second of the computer that runs the graph.

    Attributes
    ----------
    graph
        The control graph.
    time
        Time of both.
    listeners
        Told of each topic and sample that is published, before anybody who hears the topic answers it.
    motors
        Motors, from 0, by the names of the topics of their commands.
    tampering
        Changes the torques that controllers command, by motor from 0; None takes them away.
    """

    def __init__(
        self,
        robot: Robot,
        settings: ControlSettings,
        machine: M,
        latency: float,
        exact_mass: bool = False,
        speed: float = 1.0,
    ) -> None:
        heard_instead = {("feedforward", PAYLOAD.name): SIMULATED_PAYLOAD} if exact_mass else None
        self.graph = control_graph(robot, settings, heard_instead)
        self.robot = robot
        self.settings = settings
        self.machine = machine
        self.time = machine.time
        self.listeners: list[Listener] = []
        self.tampering: dict[int, Callable[[float], float | None]] = {}
        self._disturbed: dict[str, Callable[[Any], Any | None]] = {}  # what goes to the machine, by topic
        self._latency = latency
        self._speed = speed
        self.motors = {motor_command(k + 1).name: k for k in range(robot.number_of_cables)}
        machine.publish = self.publish
        machine.faults.kill_supervisor = self._kill_supervisor
        supervision = self.graph.components["supervisor"]
        assert isinstance(supervision, SupervisionComponent)
        self._supervision = supervision

    # The parts that scenarios look at

    @property
    def supervisor(self) -> Supervisor:
        """The supervisor of the graph, or the one that was killed."""
        return self._supervision.supervisor

    @property
    def trajectory(self) -> TrajectoryComponent:
        """The component of the graph that plays trajectories."""
        component = self.graph.components["trajectory_publisher"]
        assert isinstance(component, TrajectoryComponent)
        return component

    @property
    def player(self) -> TrajectoryPlayer:
        """Its player."""
        return self.trajectory.player

    @property
    def state(self) -> RobotState:
        """State of the robot."""
        return self.supervisor.state

    @property
    def cause(self) -> str:
        """What is latched, in words; empty when nothing is."""
        return str(self.supervisor.fault) if self.supervisor.fault else ""

    # What an operator does

    def begin(self) -> None:
        """Let graph and machine begin; time passes until the drives can be enabled."""
        self._carry_out(self.graph.begin(self._now))
        self.time.at(self._due, self._advance)
        self.time.every(_PAYLOAD_PERIOD, self._publish_payload)
        self.machine.begin()

    def play(self, make: Callable[[Pose], Trajectory]) -> None:
        """Let the platform follow the trajectory that is made for the pose at which it rests."""
        decision, outputs = self.trajectory.play(self._now, make)
        if not decision.accepted:
            raise ClosedLoopError(decision.message)
        self._carry_out(outputs)

    def order(self, service: str) -> Decision:
        """Give an operator's command to the graph."""
        decision, outputs = self.graph.call(self._now, service)
        self._carry_out(outputs)
        return decision

    def enable(self, limit: float = 5.0) -> None:
        """Enable the robot, as soon as it may be, and wait until it is, for a time, s, at most."""
        refusal = ""

        def accepted() -> bool:
            nonlocal refusal
            decision = self.order("/supervisor/enable")
            refusal = decision.message
            return decision.accepted

        self.wait_until(accepted, limit, lambda: f"the robot cannot be enabled: {refusal}")
        self.wait_for(RobotState.ENABLED, limit)

    def wait_for(self, state: RobotState, limit: float) -> None:
        """Let time pass until the robot is in a state, s at most."""
        self.wait_until(lambda: self.state is state, limit, lambda: f"the robot is {self.state}, not {state}")

    def wait_until(self, condition: Callable[[], bool], limit: float, problem: Callable[[], str]) -> None:
        """Let time pass until something is so, s at most.

        Raises
        ------
        ClosedLoopError
            If it does not come about; says what is latched.
        """
        end = self.time.monotonic() + limit
        while not condition():
            if self.time.monotonic() > end:
                raise ClosedLoopError(f"{problem()}" + (f" ({self.cause})" if self.cause else ""))
            self.time.wait(_STEP)

    # What drives the graph

    @property
    def _now(self) -> float:
        """Monotonic time of the computer that runs the graph, s."""
        return self.time.monotonic() / self._speed

    @property
    def _due(self) -> float:
        return self.graph.next_due * self._speed

    def publish(self, topic: Topic, sample: Any) -> None:
        """Publish something that the graph may hear."""
        for listen in self.listeners:
            listen(topic, sample)
        self._carry_out(self.graph.on(topic, self._now, sample))

    def disturb(self, topic: Topic, make: Callable[[], Callable[[Any], Any | None]]) -> Callable[[], None]:
        """Let a topic go through what `make` makes, on its way to graph and machine; return what ends that."""
        end = self.graph.disturb(topic, make())
        self._disturbed[topic.name] = make()

        def undo() -> None:
            end()
            del self._disturbed[topic.name]

        return undo

    def refuse(self, topic: Topic, problem: str) -> None:
        """Give graph or machine a message that cannot be read."""
        motor = self.motors.get(topic.name)
        if motor is not None:
            self.machine.reject_command(motor, problem)
        self.graph.refuse(topic, problem)

    def _advance(self) -> None:
        self._carry_out(self.graph.advance(self._now))
        self.time.at(self._due, self._advance)

    def _publish_payload(self) -> None:
        payload = self.machine.plant.payload
        stamp = self.time.system_ns()
        self.publish(SIMULATED_PAYLOAD, InertiaSample(stamp, payload.mass, payload.center_of_mass))

    def _carry_out(self, outputs: Iterable[Output]) -> None:
        commands: list[tuple[int, int, float]] = []
        for output in outputs:
            if isinstance(output, Publication):
                topic, sample = output
                if topic is DIAGNOSTICS:
                    sample = sample._replace(stamp_ns=self.time.system_ns())
                for listen in self.listeners:
                    listen(topic, sample)
                if topic.name in self._disturbed:
                    sample = self._disturbed[topic.name](sample)
                    if sample is None:
                        continue
                if topic is SUPERVISOR_ALIVE:
                    self.time.at(
                        self.time.monotonic() + self._latency,
                        partial(self.machine.supervised, sample.stamp_ns),
                    )
                motor = self.motors.get(topic.name)
                if motor is not None:
                    torque = sample.effort
                    if motor in self.tampering:
                        torque = self.tampering[motor](torque)
                    if torque is not None:
                        commands.append((motor, sample.stamp_ns, torque))
            elif isinstance(output, Call):
                self.time.at(self.time.monotonic() + SERVICE_TIME, partial(self._call, output))
            elif isinstance(output, Remark):
                name, level, text = output
                self.publish(ROSOUT, LogLine(self.time.system_ns(), level, name, text))
        if commands:
            self.time.at(self.time.monotonic() + self._latency, partial(self.machine.command, commands))

    def _kill_supervisor(self) -> Callable[[], None]:
        self.graph.end(self._supervision.name)
        return self._restart_supervisor

    def _restart_supervisor(self) -> None:
        self._supervision = SupervisionComponent(self.robot, self.settings.supervision)
        self._carry_out(self.graph.start(self._supervision, self._now))

    def _call(self, call: Call) -> None:
        if call.component not in self.graph.components:
            return  # it has ended meanwhile
        serve: Callable[[str], Any] = self.machine.call
        if call.service in self.graph.services:
            serve = self.order
        answer = serve(call.service)
        self._carry_out(self.graph.answered(self._now, call, answer.accepted, answer.message))
