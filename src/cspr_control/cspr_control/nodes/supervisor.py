"""supervisor: enable, stop and faults of the robot as a whole."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from cspr_control.nodes.parameters import declare_robot
from cspr_control.parameters.settings import supervision_limits
from cspr_control.supervision.checks import MonitoredInput
from cspr_control.supervision.supervisor import Action, Decision, Supervisor
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import (
    Diagnostics,
    advertise,
    run_nodes,
    steady_timer,
    subscribe,
    subscribe_raw,
)
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    DRIVE_STATES,
    LOAD_CELL_STATES,
    MOTOR_STATES,
    PLATFORM_POSE,
    RECORDER_STATE,
    ROBOT_STATE,
    SETPOINT,
    TRAJECTORY_STATE,
    cable_names,
    motor_names,
)
from cspr_msgs_py.vocabulary import DriverState, Level, RobotState, TrajectoryPhase
from cspr_msgs_py.wire.conversions import (
    diagnostic_status,
    from_diagnostic_array,
    from_diagnostic_status,
    from_pose_stamped,
)
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.joint_state_conversion import decode_joint_state

_PERIOD = 0.02
"""Of the checks, s."""

_SERVICES = {
    Action.ENABLE_DRIVES: "/can_drives/enable",
    Action.DISABLE_DRIVES: "/can_drives/disable",
    Action.QUICK_STOP: "/can_drives/quick_stop",
    Action.RESET_DRIVES: "/can_drives/fault_reset",
    Action.STOP_TRAJECTORY: "/trajectory_publisher/stop",
}


class SupervisorNode(Node):
    """Carries out what the state machine decides, and publishes its state."""

    def __init__(self, **options: Any) -> None:
        super().__init__("supervisor", **options)
        robot = declare_robot(self)
        count = robot.number_of_cables
        self._supervisor = Supervisor(count, supervision_limits(robot, declare_all(self)))
        self._motors = JointStateCodec(motor_names(count))
        self._cables = JointStateCodec(cable_names(count), position=False, velocity=False)
        self._arrived: dict[MonitoredInput, tuple[float, bytes]] = {}  # not looked into yet
        self._unusable = 0
        self._problem = ""
        self._recorder_problem = ""
        self._published_state: tuple[str, ...] = ()
        self._publisher = advertise(self, ROBOT_STATE)
        self._action_clients = {
            action: self.create_client(Trigger, service) for action, service in _SERVICES.items()
        }
        hot = {
            MonitoredInput.MOTOR_STATES: MOTOR_STATES,
            MonitoredInput.SETPOINT: SETPOINT,
            MonitoredInput.CABLE_TENSIONS: CABLE_TENSIONS,
        }
        for source, topic in hot.items():
            subscribe_raw(self, topic, partial(self._note, source))
        subscribe(self, PLATFORM_POSE, self._on_pose)
        subscribe(self, DRIVE_STATES, self._on_drive_states)
        subscribe(self, LOAD_CELL_STATES, self._on_load_cell_states)
        subscribe(self, TRAJECTORY_STATE, self._on_trajectory_state)
        subscribe(self, RECORDER_STATE, self._on_recorder_state)
        for name, command in (
            ("enable", self._supervisor.enable),
            ("stop", self._supervisor.stop),
            ("reset", self._supervisor.reset),
        ):
            self.create_service(Trigger, f"/supervisor/{name}", partial(self._answer, name, command))
        self._diagnostics = Diagnostics(self, self._status)
        self._timer = steady_timer(self, _PERIOD, self._update)
        self._publish_state()

    def _note(self, source: MonitoredInput, message: bytes) -> None:
        # The checks run less often than the bus; what arrives in between is replaced unread.
        self._arrived[source] = (time.monotonic(), message)

    def _read_arrived(self) -> None:
        checks = self._supervisor.checks
        arrived, self._arrived = self._arrived, {}
        for source, (arrival, message) in arrived.items():
            try:
                if source is MonitoredInput.CABLE_TENSIONS:
                    checks.observe_tensions(arrival, decode_joint_state(self._cables, message).effort)
                elif source is MonitoredInput.MOTOR_STATES:
                    sample = decode_joint_state(self._motors, message)
                    checks.observe_motors(
                        arrival, sample.stamp_ns, sample.position, sample.velocity, sample.effort
                    )
                else:
                    sample = decode_joint_state(self._motors, message)
                    checks.observe_setpoint(arrival, sample.stamp_ns, sample.position, sample.velocity)
            except MessageError as error:
                self._refuse(str(error))  # and its topic grows stale

    def _on_pose(self, message: PoseStamped) -> None:
        _, position, _ = from_pose_stamped(message)
        self._supervisor.checks.observe_pose(time.monotonic(), position)

    def _on_drive_states(self, message: DiagnosticArray) -> None:
        status = from_diagnostic_array(message).get("can_drives")
        if status is None:
            self._refuse(f"{DRIVE_STATES.name} carries no status named can_drives")
            return
        _, state, values = status
        try:
            drives = DriverState(state)
        except ValueError:
            self._refuse(f"{DRIVE_STATES.name} carries an unknown state, {state!r}")
            return
        self._supervisor.observe_drives(time.monotonic(), drives, values.get("cause", ""))
        self._update()

    def _on_load_cell_states(self, message: DiagnosticArray) -> None:
        status = from_diagnostic_array(message).get("load_cells")
        if status is None:
            self._refuse(f"{LOAD_CELL_STATES.name} carries no status named load_cells")
            return
        self._supervisor.observe_load_cells(status[2].get("cause", ""))
        self._update()

    def _on_trajectory_state(self, message: DiagnosticStatus) -> None:
        _, _, phase, _ = from_diagnostic_status(message)
        try:
            self._supervisor.observe_trajectory(TrajectoryPhase(phase))
        except ValueError:
            self._refuse(f"{TRAJECTORY_STATE.name} carries an unknown phase, {phase!r}")

    def _on_recorder_state(self, message: DiagnosticStatus) -> None:
        _, level, _, values = from_diagnostic_status(message)
        self._recorder_problem = values.get("cause", "") if level >= Level.ERROR else ""
        self._supervisor.observe_recording(self._recorder_problem)
        if self._recorder_problem:
            self.get_logger().error(f"recorder: {self._recorder_problem}")
            self._update()

    def _refuse(self, problem: str) -> None:
        self._unusable += 1
        self._problem = problem

    def _answer(
        self,
        name: str,
        command: Callable[[float], Decision],
        request: Trigger.Request,
        response: Trigger.Response,
    ) -> Trigger.Response:
        self._read_arrived()
        decision = command(time.monotonic())
        response.success, response.message = decision.accepted, decision.message
        self.get_logger().info(f"{name}: {decision.message}")
        self._update()
        return response

    def _update(self) -> None:
        self._read_arrived()
        before = self._supervisor.state
        for action in self._supervisor.update(time.monotonic()):
            self._carry_out(action)
        if self._supervisor.state is not before and self._supervisor.fault is not None:
            self.get_logger().error(f"stopped by {self._supervisor.fault}")
        self._publish_state()

    def _carry_out(self, action: Action) -> None:
        client = self._action_clients[action]
        if not client.service_is_ready():
            unavailable = f"service {client.srv_name} is not available"
            self._supervisor.answered(time.monotonic(), action, False, unavailable)
            return
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda done: self._on_answer(action, done))

    def _on_answer(self, action: Action, future: Future) -> None:
        answer = future.result()
        if not answer.success:
            self.get_logger().warning(f"{action.value}: {answer.message}")
        self._supervisor.answered(time.monotonic(), action, answer.success, answer.message)
        self._update()

    def _publish_state(self) -> None:
        supervisor = self._supervisor
        cause = str(supervisor.fault) if supervisor.fault else ""
        state = (supervisor.state.value, cause, supervisor.remark)
        if state == self._published_state:
            return
        self._published_state = state
        level = Level.ERROR if supervisor.state is RobotState.FAULT else Level.OK
        values = {"cause": cause, "remark": supervisor.remark}
        self._publisher.publish(diagnostic_status(self.get_name(), level, supervisor.state.value, values))

    def _status(self) -> list[DiagnosticStatus]:
        supervisor, now = self._supervisor, time.monotonic()
        level, text = Level.OK, supervisor.state.value
        if supervisor.fault is not None:
            level, text = Level.ERROR, f"fault: {supervisor.fault}"
        elif self._recorder_problem:
            level, text = Level.WARN, f"{text}; recorder: {self._recorder_problem}"
        values: dict[str, Any] = {
            f"age_{source.name.lower()}": f"{supervisor.checks.age(source, now):.3f}"
            for source in MonitoredInput
            if math.isfinite(supervisor.checks.age(source, now))
        }
        values |= {"unusable_messages": self._unusable, "last_problem": self._problem}
        return [diagnostic_status(self.get_name(), level, text, values)]

    def make_safe(self) -> None:
        """Close the brakes of a robot that is enabled: with this node goes what watches it."""
        if self._supervisor.state not in (RobotState.ENABLING, RobotState.ENABLED, RobotState.STOPPING):
            return
        client = self._action_clients[Action.QUICK_STOP]
        if client.service_is_ready():
            future = client.call_async(Trigger.Request())
            executor = SingleThreadedExecutor(context=self.context)
            rclpy.spin_until_future_complete(self, future, executor, timeout_sec=0.5)
            executor.shutdown()


def main() -> int:
    """Run the supervisor."""
    return run_nodes(lambda: [SupervisorNode()])


if __name__ == "__main__":
    sys.exit(main())
