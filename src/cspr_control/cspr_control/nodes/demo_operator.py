"""The operator of the demo: what a person at the robot sees and does, as a node of the graph."""

from __future__ import annotations

import contextlib
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from cspr_control.demo.child_processes import ChildProcesses
from cspr_control.demo.graph_processes import MODULES
from cspr_control.demo.scenario import DemoError
from cspr_control.errors import ControlError
from cspr_msgs_py import topics
from cspr_msgs_py.runtime.network import creating_nodes, init_ros
from cspr_msgs_py.runtime.process import sample_publisher, subscribe_samples
from cspr_msgs_py.vocabulary import FOLLOWING, UNDER_WAY, DriverState, RobotState
from cspr_msgs_py.wire.samples import InertiaSample, Status, StatusArray


class DemoClient(Node):
    """The demo's view of the graph: states, the payload, and the services of the operator."""

    def __init__(self) -> None:
        super().__init__("demo")
        self.robot_state = self.robot_message = self.phase = self.interruption = self.drives = ""
        self.trajectory_times: tuple[int, int] | None = None
        self.estimated_mass = self.true_mass = math.nan
        self.cycle_values: dict[str, str] = {}
        self._seen: set[str] = set()
        # services are called by name again and again: one client each
        self._trigger_clients: dict[str, Any] = {}
        for topic, callback in (
            (topics.ROBOT_STATE, self._on_robot_state),
            (topics.TRAJECTORY_STATE, self._on_trajectory_state),
            (topics.DRIVE_STATES, self._on_drive_states),
            (topics.DIAGNOSTICS, self._on_diagnostics),
            (topics.PAYLOAD, lambda sample: setattr(self, "estimated_mass", sample.mass)),
            (topics.SIMULATED_PAYLOAD, lambda sample: setattr(self, "true_mass", sample.mass)),
        ):
            subscribe_samples(self, topic, callback)
        self._send_payload = sample_publisher(self, topics.SET_SIMULATED_PAYLOAD)

    @property
    def missing(self) -> str:
        """What is not there yet."""
        waiting = {"recorder", "can_drives", "load_cells", "feedforward", "supervisor"} - self._seen
        parts = [f"nothing received yet from {', '.join(sorted(waiting))}"] if waiting else []
        if self.drives != DriverState.DISABLED:
            parts.append(f"drives are {self.drives or 'silent'}")
        if self.robot_state != RobotState.DISABLED:
            parts.append(f"the supervisor is {self.robot_state or 'silent'} ({self.robot_message})")
        return "; ".join(parts)

    def explained(self, cause: str) -> str:
        """Why the robot stopped, and whether this computer had a part in it."""
        try:
            cycles, missed = (int(self.cycle_values[name]) for name in ("cycles", "missed_cycles"))
        except (KeyError, ValueError):
            return cause
        if missed < 0.2 * max(cycles, 1):
            return cause
        return (
            f"{cause}. This computer missed {missed} of {cycles} control cycles: it is too slow or too "
            "busy for real time; close other programs, or slow the simulated machine down with --speed 0.5"
        )

    def phase_text(self) -> str:
        """Where the trajectory and the robot are."""
        return f"the trajectory is in phase {self.phase or 'unknown'}, the robot is {self.robot_state}"

    def set_payload(self, mass: float, stamp_ns: int) -> None:
        """Let the simulated robot carry a mass from a moment on."""
        self._send_payload(InertiaSample(stamp_ns, mass, np.zeros(3)))

    def trigger(self, service: str) -> Any:
        """Ask a service; returns the future."""
        if service not in self._trigger_clients:
            self._trigger_clients[service] = self.create_client(Trigger, service)
        client = self._trigger_clients[service]
        return client.call_async(Trigger.Request()) if client.wait_for_service(timeout_sec=5.0) else None

    def _on_robot_state(self, status: Status) -> None:
        self.robot_state = status.message
        self.robot_message = status.values.get("cause") or status.values.get("remark", "")

    def _on_trajectory_state(self, status: Status) -> None:
        values = status.values
        self.phase, self.interruption = status.message, values.get("interruption", "")
        if self.phase in UNDER_WAY and "start_time" in values:
            self.trajectory_times = (int(values["start_time"]), int(values["end_time"]))

    def _on_drive_states(self, states: StatusArray) -> None:
        if (drives := states.find("can_drives")) is not None:
            self.drives = drives.message

    def _on_diagnostics(self, diagnostics: StatusArray) -> None:
        for status in diagnostics.statuses:
            name = status.name.rsplit("/", 1)[-1]
            self._seen.add(name)
            if name == "can_drives":
                self.cycle_values = dict(status.values)


@contextlib.contextmanager
def demo_client() -> Iterator[DemoClient]:
    """Spin the demo's node in the background."""
    init_ros(["demo"], "demo")
    with creating_nodes():
        node = DemoClient()
    stopping = rclpy.task.Future()

    def spin() -> None:
        executor = EventsExecutor()
        executor.add_node(node)
        while not stopping.done():
            executor.spin_until_future_complete(stopping, timeout_sec=1.0)
        executor.remove_node(node)
        executor.shutdown()

    thread = threading.Thread(target=spin, name="demo", daemon=True)
    thread.start()
    try:
        yield node
    finally:
        stopping.set_result(None)
        thread.join(timeout=5.0)
        node.destroy_node()
        rclpy.try_shutdown()


class Progress:
    """One live line on a terminal; one line per step elsewhere."""

    def __init__(self, title: str, client: DemoClient) -> None:
        self._title, self._client = title, client
        self._live = sys.stdout.isatty()
        self._step = ""
        self._began = time.monotonic()

    def show(self, step: str) -> None:
        """Show the step that is under way."""
        elapsed = time.monotonic() - self._began
        if self._live:
            client = self._client
            load = f"  payload {client.estimated_mass:z6.1f} kg (true {client.true_mass:.1f})"
            line = f"{self._title}: {elapsed:5.1f} s  {step:<20}{load if math.isfinite(client.estimated_mass) else ''}"
            sys.stdout.write(f"\r\x1b[K{line}")
            sys.stdout.flush()
        elif step != self._step:
            print(f"{self._title}: {elapsed:5.1f} s  {step}", flush=True)
        self._step = step

    def end(self) -> None:
        """Leave the line."""
        if self._live:
            sys.stdout.write("\n")
            sys.stdout.flush()


class Operator:
    """Does what an operator does, while every process lives and no fault is latched.

    Limits and durations are those of the machine, s; on a slower one they last longer on the clock, whose time `now`
    returns, and which `sleep` lets pass.
    """

    def __init__(
        self,
        client: DemoClient,
        children: ChildProcesses,
        progress: Progress,
        speed: float,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._client, self._children, self._progress, self._speed = client, children, progress, speed
        self._now, self._sleep = now, sleep
        self._refusal = ""  # of the service that was asked last

    def begin(self, processes: Mapping[str, Sequence[str]]) -> None:
        """Start the processes of a graph, each by its name with its arguments, and wait until all of them are there."""
        for name, arguments in processes.items():
            self._children.start(name, MODULES[name], arguments)
        self.wait("starting", lambda: not self._client.missing, 120.0, lambda: self._client.missing)

    def wait(self, step: str, done: Callable[[], bool], limit: float, why_not: Callable[[], str]) -> None:
        """Wait until something is so, and say why it is not when that takes too long."""
        deadline = self._after(limit)
        while not done():
            self._progress.show(step)
            self._children.check()
            if self._client.robot_state == RobotState.FAULT:
                cause = self._client.explained(self._client.robot_message)
                raise DemoError(f"{step}: the robot stopped with brakes closed: {cause}")
            if self._client.interruption:
                cause = self._client.explained(self._client.interruption)
                raise DemoError(f"{step}: the trajectory was given up, the platform held its pose: {cause}")
            if self._now() > deadline:
                raise DemoError(f"{step}: not done within {limit:.0f} s: {why_not()}")
            self._sleep(0.02)

    def pause(self, step: str, duration: float) -> None:
        """Let time pass while all is well."""
        end = self._after(duration)
        self.wait(step, lambda: self._now() >= end, duration + 5.0, lambda: "the clock stands still")

    def _after(self, duration: float) -> float:
        """Return when a duration of the machine is over, on the computer's clock."""
        return self._now() + duration / self._speed

    def call(self, service: str, limit: float) -> None:
        """Ask a service until it accepts; a refusal is final only when the time is up."""
        step = f"calling {service.rsplit('/', 1)[-1]}"
        self.wait(step, lambda: self._ask(service), limit, lambda: self._refusal)

    def enable(self, limit: float) -> None:
        """Enable the robot; ask again when the drives had to refuse, as when the torques were not there yet."""
        client, self._refusal = self._client, ""

        def enabled() -> bool:
            if client.robot_state == RobotState.DISABLED:
                self._ask("/supervisor/enable")
            return client.robot_state == RobotState.ENABLED

        self.wait(
            "enabling", enabled, limit, lambda: client.robot_message or self._refusal or client.robot_state
        )

    def _ask(self, service: str) -> bool:
        """Ask a service; returns whether it accepts, and keeps why it does not."""
        future = self._client.trigger(service)
        end = self._after(5.0)
        while future is not None and not future.done() and self._now() < end:
            self._children.check()
            self._sleep(0.01)
        if future is None or not future.done():
            self._refusal = "no answer"
            return False
        answer = future.result()
        self._refusal = "" if answer.success else str(answer.message)
        return bool(answer.success)

    def stop(self) -> None:
        """Stop the robot, brakes closed."""
        client = self._client
        self.call("/supervisor/stop", 10.0)
        self.wait(
            "stopping", lambda: client.robot_state == RobotState.DISABLED, 10.0, lambda: client.robot_message
        )
        self.wait(
            "closing brakes",
            lambda: client.drives == DriverState.DISABLED,
            5.0,
            lambda: f"drives are {client.drives}",
        )

    def make_safe(self) -> None:
        """Close the brakes if the graph can still be reached; the processes close them on their own end as well."""
        with contextlib.suppress(KeyboardInterrupt, ControlError, OSError):  # the terminal may be gone
            client = self._client
            if client.robot_state in FOLLOWING and client.trigger("/supervisor/stop") is not None:
                deadline = self._after(4.0)
                while client.robot_state != RobotState.DISABLED and self._now() < deadline:
                    self._progress.show("stopping")
                    self._children.check(("control", "simulated_robot"))  # nobody else has a part in it
                    self._sleep(0.02)
