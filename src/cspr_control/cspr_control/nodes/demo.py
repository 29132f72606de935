"""The whole robot on one machine: the node graph on simulated drives and load cells, recorded and judged."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import Any

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import InertiaStamped
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from cspr_control.child_processes import ChildProcesses
from cspr_control.errors import ControlError
from cspr_control.recorded_run import summarise_run
from cspr_control.run_summary import RunSummary, format_comparison, format_summary
from cspr_control.trajectory_catalogue import TrajectoryName
from cspr_msgs_py import topics
from cspr_msgs_py.conversions import inertia_stamped
from cspr_msgs_py.qos import qos_profile

CONTROLLERS: dict[
    str, tuple[str, str]
] = {  # feed-forward model and payload source of each of the paper's controllers
    "pd": ("none", "nominal"),
    "static": ("static", "nominal"),
    "pdff": ("dynamic", "nominal"),
    "pdff-mass": ("dynamic", "estimated"),
}
TRAJECTORIES = [
    name.value for name in TrajectoryName if name not in (TrajectoryName.HOLD, TrajectoryName.MOVE)
]
COMPARED = [("pd", False), ("static", False), ("pdff", False), ("pdff-mass", False), ("pdff", True)]
PACKAGES = {
    "simulated_robot": "cspr_drivers.nodes.simulated_robot",
    "control": "cspr_control.nodes.control",
    "recorder": "cspr_msgs_py.nodes.recorder",
    "robot_markers": "cspr_control.nodes.robot_markers",
}
# A machine without real-time priority, shared with who knows what, may stand still for longer than a robot may be
# left alone. Without a robot, and without --realtime, the demo therefore waits longer than the configuration says.
RELAXED_WATCHDOGS = {
    "command": 0.5,
    "feedback": 0.5,
    "rpdo": 1.0,
    "heartbeat_consumer": 2.0,
}  # s, in can.yaml
RELAXED_AGES = {
    "motor_states": 1.0,
    "setpoint": 1.0,
    "cable_tensions": 1.0,
    "platform_pose": 1.0,
}  # s, supervisor

DESCRIPTION = """\
Run the complete node graph on a simulated robot, record it, and say how well it did.

Three processes are started on this machine alone (control, the simulated robot, the recorder). The robot is enabled,
moves to the start of the trajectory, follows it with a payload that the controller has not been told of, takes up
another one on the way, stops and closes its brakes. Everything lies in runs/<UTC time>/, runs/latest points there:
bag/ (MCAP), config/ (what was used), log/, summary.json."""
EPILOG = """\
examples:
  demo                                         the feed-forward with the estimated mass, 100 kg aboard, +100 kg at 3 s
  demo --controller static --payload 200 --add-payload none
  demo --controller pdff --exact-mass          the yardstick: the controller always knows the true mass
  demo --compare                               all controllers one after the other, in one table
  demo --trajectory smooth-19 --realtime       at rest at both ends; with real-time priority"""


@dataclass(frozen=True)
class AddedPayload:
    """A payload change: mass in kg, time in s after the start of the trajectory."""

    mass: float
    time: float


@dataclass(frozen=True)
class Scenario:
    """What one run of the demo does."""

    controller: str
    exact_mass: bool
    trajectory: str
    payload: float
    added: AddedPayload | None
    realtime: bool
    markers: bool


class DemoError(ControlError):
    """The demo cannot go on; the message says at which step and why."""


def main(args: list[str] | None = None) -> int:
    """Run the demo; returns the exit status."""
    options = _parse(sys.argv[1:] if args is None else args)
    if options.realtime and (problem := _realtime_problem()):
        print(f"demo: {problem}", file=sys.stderr)
        return 2
    # On loopback, in a domain of its own: no robot in the same network hears a word of this.
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", "33")
    chosen = COMPARED if options.compare else [(options.controller, options.exact_mass)]
    summaries: list[RunSummary] = []

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    try:
        for controller, exact_mass in chosen:
            scenario = Scenario(
                controller,
                exact_mass,
                options.trajectory,
                options.payload,
                options.add_payload,
                options.realtime,
                options.markers,
            )
            directory = _new_run_directory(Path(options.runs))
            summary = _run(scenario, directory, Path(options.config))
            summaries.append(summary)
            print(f"\n{format_summary(summary)}\n  recorded in           {directory}\n")
    except KeyboardInterrupt:
        print(
            "demo: interrupted; brakes are closed, every process has ended, the bag is readable",
            file=sys.stderr,
        )
        return 130
    except ControlError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    if options.compare:
        print(format_comparison(summaries))
    return 0


def _parse(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="demo",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--controller", choices=CONTROLLERS, default="pdff-mass", help="default: %(default)s")
    parser.add_argument(
        "--exact-mass", action="store_true", help="tell the feed-forward the true mass at all times"
    )
    parser.add_argument(
        "--trajectory", choices=TRAJECTORIES, default="paper-19", metavar="NAME",
        help=f"one of {', '.join(TRAJECTORIES)}; default: %(default)s",
    )  # fmt: skip
    parser.add_argument(
        "--payload",
        type=_mass,
        default=100.0,
        metavar="KG",
        help="aboard from the start; default: %(default)s",
    )
    parser.add_argument(
        "--add-payload", type=_added_payload, default=AddedPayload(100.0, 3.0), metavar="KG@S",
        help="added S seconds after the start of the trajectory, or none; default: 100@3",
    )  # fmt: skip
    parser.add_argument(
        "--compare", action="store_true", help="run all controllers and compare them in one table"
    )
    parser.add_argument(
        "--realtime", action="store_true", help="SCHED_FIFO for control and drivers (needs the privilege)"
    )
    parser.add_argument(
        "--markers",
        action="store_true",
        help="also publish /robot_markers, for RViz and Foxglove (config/views)",
    )
    parser.add_argument(
        "--config", default="config", metavar="DIR", help="configuration; default: %(default)s"
    )
    parser.add_argument(
        "--runs", default="runs", metavar="DIR", help="where runs are stored; default: %(default)s"
    )
    options = parser.parse_args(arguments)
    if options.exact_mass and CONTROLLERS[options.controller][0] == "none":
        parser.error("--exact-mass has no meaning for --controller pd, which has no feed-forward")
    if not Path(options.config, "robot.yaml").is_file():
        parser.error(
            f"{options.config}/robot.yaml is not there: start from the repository's root or name --config DIR"
        )
    return options


def _mass(text: str) -> float:
    try:
        mass = float(text)
    except ValueError:
        mass = math.nan
    if not (math.isfinite(mass) and mass >= 0.0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a mass in kg of at least 0")
    return mass


def _added_payload(text: str) -> AddedPayload | None:
    if text == "none":
        return None
    mass, separator, moment = text.partition("@")
    try:
        change = AddedPayload(float(mass), float(moment))
    except ValueError:
        separator = ""
    if not separator or not math.isfinite(change.mass) or not 0.0 <= change.time < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form KG@S, such as 100@3, or none")
    return change


def _realtime_problem() -> str | None:
    """Why this user may not use real-time priorities, or None."""
    policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        return (
            "--realtime needs the privilege CAP_SYS_NICE or a real-time limit: add the line '@realtime - rtprio 80' to "
            "/etc/security/limits.d/realtime.conf, join the group realtime and log in again, or run without --realtime"
        )
    os.sched_setscheduler(0, policy, parameter)
    return None


def _cpus() -> tuple[int, int, int]:
    """CPUs for control, the simulated robot and the recorder: one each as far as there are any."""
    allowed = sorted(os.sched_getaffinity(0))
    return allowed[0], allowed[1 % len(allowed)], allowed[2] if len(allowed) > 2 else allowed[0]


def _new_run_directory(runs: Path) -> Path:
    """Make runs/<UTC time>/ and let runs/latest point there."""
    stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H-%M-%SZ")
    directory = runs / stamp
    number = 2
    while directory.exists():
        directory = runs / f"{stamp}-{number}"
        number += 1
    directory.mkdir(parents=True)
    link = runs / f".latest-{os.getpid()}"
    link.unlink(missing_ok=True)
    link.symlink_to(directory.name)
    link.replace(runs / "latest")
    return directory


def _copy_configuration(source: Path, directory: Path, scenario: Scenario) -> Path:
    """Copy the configuration into the run, with the scenario's payload aboard the simulated robot."""
    target = directory / "config"
    shutil.copytree(source, target, ignore=shutil.ignore_patterns("views"))
    model, payload_source = CONTROLLERS[scenario.controller]
    if scenario.exact_mass:
        payload_source = "estimated"  # the truth comes over the same path as the estimate would
    with _edited(target / "control.yaml") as control:
        for node, values in (
            ("feedforward", {"model": model, "payload_source": payload_source}),
            ("trajectory_publisher", {"trajectory": scenario.trajectory}),
        ):
            control.setdefault(node, {}).setdefault("ros__parameters", {}).update(values)
    with _edited(target / "simulation.yaml") as simulation:
        simulation["payload"]["mass"] = scenario.payload
        simulation["payload_changes"] = []
    if not scenario.realtime:
        with _edited(target / "can.yaml") as can:
            for name, time_limit in RELAXED_WATCHDOGS.items():
                can["timeouts"][name] = max(time_limit, can["timeouts"][name])
    return target


@contextlib.contextmanager
def _edited(file: Path) -> Iterator[dict[str, Any]]:
    """Change the content of a YAML file."""
    try:
        values = yaml.safe_load(file.read_text(encoding="utf-8"))
        yield values
    except (OSError, yaml.YAMLError, TypeError, KeyError) as error:
        raise DemoError(f"{file} is not as the demo needs it: {type(error).__name__} {error}") from error
    file.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")


def _ros_arguments(config: Path, *more: str) -> list[str]:
    parameters = ["robot_config:=robot.yaml", "can_config:=can.yaml", "simulation_config:=simulation.yaml"]
    arguments = ["--ros-args", "--params-file", str(config / "control.yaml")]
    for parameter in parameters:
        name, _, file = parameter.partition(":=")
        arguments += ["-p", f"{name}:={config / file}"]
    return arguments + list(more)


def _run(scenario: Scenario, directory: Path, source: Path) -> RunSummary:
    config = _copy_configuration(source, directory, scenario)
    exact_mass = ["-r", f"feedforward:{topics.PAYLOAD.name}:={topics.SIMULATED_PAYLOAD.name}"]
    realtime = ["-p", "realtime_priority:=50"] if scenario.realtime else []
    ages = {} if scenario.realtime else RELAXED_AGES
    patience = [word for name, age in ages.items() for word in ("-p", f"supervisor:max_age.{name}:={age}")]
    control_cpu, robot_cpu, recorder_cpu = (["-p", f"cpu:={cpu}"] for cpu in _cpus())
    attached = sorted(str(path) for path in config.rglob("*") if path.is_file())

    with ChildProcesses(directory / "log") as children, _client() as client:
        progress = _Progress(f"{scenario.controller}{' (exact mass)' if scenario.exact_mass else ''}", client)
        run = _Operator(client, children, progress)
        try:
            attach = f"attach:=[{', '.join(attached)}]"
            recording = ["--ros-args", "-p", f"output:={directory / 'bag'}", "-p", attach, *recorder_cpu]
            controlling = _ros_arguments(
                config, *(exact_mass if scenario.exact_mass else []), *patience, *control_cpu, *realtime
            )
            children.start("recorder", PACKAGES["recorder"], recording)
            children.start(
                "simulated_robot", PACKAGES["simulated_robot"], _ros_arguments(config, *robot_cpu, *realtime)
            )
            children.start("control", PACKAGES["control"], controlling)
            if scenario.markers:
                children.start(
                    "robot_markers", PACKAGES["robot_markers"], _ros_arguments(config, *recorder_cpu)
                )
            run.wait("starting", lambda: client.ready, 120.0, lambda: client.missing)
            run.call("/supervisor/enable", 20.0)
            run.wait("enabling", lambda: client.robot_state == "enabled", 10.0, lambda: client.robot_message)
            run.pause("measuring the load", 2.0)
            run.call("/trajectory_publisher/start", 10.0)
            run.wait(
                "moving to the start", lambda: client.trajectory_times is not None, 5.0, client.phase_text
            )
            assert client.trajectory_times is not None  # the line above waited for it
            start, end = client.trajectory_times
            if scenario.added is not None:
                client.set_payload(
                    scenario.payload + scenario.added.mass, start + round(scenario.added.time * 1e9)
                )
            run.wait("moving to the start", lambda: client.phase == "running", 30.0, client.phase_text)
            run.wait(
                "running", lambda: client.phase == "finished", (end - start) * 1e-9 + 10.0, client.phase_text
            )
            run.pause("settling", 1.5)
            driver = run.stop()
        except (KeyboardInterrupt, ControlError):
            run.make_safe()
            raise
        finally:
            progress.end()
    summary = summarise_run(
        directory / "bag",
        window_ns=(start, end),
        controller=scenario.controller,
        exact_mass=scenario.exact_mass,
        trajectory=scenario.trajectory,
        driver=driver,
    )
    with open(directory / "summary.json", "w", encoding="utf-8") as file:
        json.dump(summary.as_mapping(), file, indent=2)
        file.write("\n")
    return summary


class _Client(Node):
    """The demo's view of the graph: states, the payload, and the services of the operator."""

    def __init__(self) -> None:
        super().__init__("demo")
        self.robot_state = self.robot_message = self.phase = self.drives = ""
        self.trajectory_times: tuple[int, int] | None = None
        self.estimated_mass = self.true_mass = math.nan
        self.cycle_values: dict[str, str] = {}
        self._seen: set[str] = set()
        # services are asked for by name again and again: one client each
        self._trigger_clients: dict[str, Any] = {}
        for topic, kind, callback in (
            (topics.ROBOT_STATE, DiagnosticStatus, self._on_robot_state),
            (topics.TRAJECTORY_STATE, DiagnosticStatus, self._on_trajectory_state),
            (topics.DRIVE_STATES, DiagnosticArray, self._on_drive_states),
            (topics.DIAGNOSTICS, DiagnosticArray, self._on_diagnostics),
            (topics.PAYLOAD, InertiaStamped, self._on_payload),
            (topics.SIMULATED_PAYLOAD, InertiaStamped, self._on_true_payload),
        ):
            self.create_subscription(kind, topic.name, callback, qos_profile(topic))
        self._set_payload = self.create_publisher(
            InertiaStamped, topics.SET_SIMULATED_PAYLOAD.name, qos_profile(topics.SET_SIMULATED_PAYLOAD)
        )

    @property
    def missing(self) -> str:
        """What is not there yet."""
        waiting = {"recorder", "can_drives", "load_cells", "feedforward", "supervisor"} - self._seen
        parts = [f"no word yet from {', '.join(sorted(waiting))}"] if waiting else []
        if self.drives != "disabled":
            parts.append(f"drives are {self.drives or 'silent'}")
        if self.robot_state != "disabled":
            parts.append(f"the supervisor is {self.robot_state or 'silent'} ({self.robot_message})")
        return "; ".join(parts)

    @property
    def ready(self) -> bool:
        """Whether everything is there and the robot may be enabled."""
        return not self.missing

    def phase_text(self) -> str:
        """Where the trajectory and the robot are."""
        return f"the trajectory is in phase {self.phase or 'unknown'}, the robot is {self.robot_state}"

    def set_payload(self, mass: float, stamp_ns: int) -> None:
        """Let the simulated robot carry a mass from a moment on."""
        self._set_payload.publish(inertia_stamped(stamp_ns, mass, (0.0, 0.0, 0.0)))

    def trigger(self, service: str) -> Any:
        """Ask a service; returns the future."""
        if service not in self._trigger_clients:
            self._trigger_clients[service] = self.create_client(Trigger, service)
        client = self._trigger_clients[service]
        return client.call_async(Trigger.Request()) if client.wait_for_service(timeout_sec=5.0) else None

    def _on_robot_state(self, status: DiagnosticStatus) -> None:
        values = {pair.key: pair.value for pair in status.values}
        self.robot_state, self.robot_message = status.message, values.get("cause", "")

    def _on_trajectory_state(self, status: DiagnosticStatus) -> None:
        values = {pair.key: pair.value for pair in status.values}
        self.phase = status.message
        if self.phase in ("approach", "running") and "start_time" in values:
            self.trajectory_times = (int(values["start_time"]), int(values["end_time"]))

    def _on_drive_states(self, states: DiagnosticArray) -> None:
        for status in states.status:
            if status.name == "can_drives":
                self.drives = status.message

    def _on_diagnostics(self, diagnostics: DiagnosticArray) -> None:
        for status in diagnostics.status:
            name = status.name.rsplit("/", 1)[-1]
            self._seen.add(name)
            if name == "can_drives":
                self.cycle_values = {pair.key: pair.value for pair in status.values}

    def _on_payload(self, message: InertiaStamped) -> None:
        self.estimated_mass = message.inertia.m

    def _on_true_payload(self, message: InertiaStamped) -> None:
        self.true_mass = message.inertia.m


@contextlib.contextmanager
def _client() -> Iterator[_Client]:
    """Spin the demo's node in the background."""
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = _Client()
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


class _Progress:
    """One live line on a terminal; a line a step elsewhere."""

    def __init__(self, title: str, client: _Client) -> None:
        self._title, self._client = title, client
        self._live = sys.stdout.isatty()
        self._step = ""
        self._began = time.monotonic()

    def show(self, step: str) -> None:
        elapsed = time.monotonic() - self._began
        if self._live:
            client = self._client
            load = f"  load {client.estimated_mass:6.1f} kg (true {client.true_mass:.1f})"
            line = f"{self._title}: {elapsed:5.1f} s  {step:<20}{load if math.isfinite(client.estimated_mass) else ''}"
            sys.stdout.write(f"\r\x1b[K{line}")
            sys.stdout.flush()
        elif step != self._step:
            print(f"{self._title}: {elapsed:5.1f} s  {step}", flush=True)
        self._step = step

    def end(self) -> None:
        if self._live:
            sys.stdout.write("\n")
            sys.stdout.flush()


class _Operator:
    """Does what an operator does, while every process lives and no fault is latched."""

    def __init__(self, client: _Client, children: ChildProcesses, progress: _Progress) -> None:
        self._client, self._children, self._progress = client, children, progress

    def wait(self, step: str, done: Callable[[], bool], limit: float, why_not: Callable[[], str]) -> None:
        """Wait until something is so, and say why it is not when that takes too long."""
        deadline = time.monotonic() + limit
        while not done():
            self._progress.show(step)
            self._children.check()
            if self._client.robot_state == "fault":
                raise DemoError(f"{step}: the robot stopped with brakes closed: {self._client.robot_message}")
            if time.monotonic() > deadline:
                raise DemoError(f"{step}: not done within {limit:.0f} s: {why_not()}")
            time.sleep(0.02)

    def pause(self, step: str, duration: float) -> None:
        """Let time pass while all is well."""
        end = time.monotonic() + duration
        self.wait(step, lambda: time.monotonic() >= end, duration + 5.0, lambda: "the clock stands still")

    def call(self, service: str, limit: float) -> None:
        """Ask a service until it accepts; a refusal is final only when the time is up."""
        deadline = time.monotonic() + limit
        refusal = ["no such service"]

        def accepted() -> bool:
            future = self._client.trigger(service)
            end = time.monotonic() + 5.0
            while future is not None and not future.done() and time.monotonic() < end:
                self._children.check()
                time.sleep(0.01)
            if future is None or not future.done():
                refusal[0] = "no answer"
                return False
            refusal[0] = future.result().message
            return bool(future.result().success)

        self.wait(
            f"calling {service.rsplit('/', 1)[-1]}", accepted, deadline - time.monotonic(), lambda: refusal[0]
        )

    def stop(self) -> dict[str, str]:
        """Stop the robot, brakes closed; returns the driver's counters of the run."""
        client = self._client
        values = dict(client.cycle_values)
        self.call("/supervisor/stop", 10.0)
        self.wait("stopping", lambda: client.robot_state == "disabled", 10.0, lambda: client.robot_message)
        self.wait(
            "closing brakes", lambda: client.drives == "disabled", 5.0, lambda: f"drives are {client.drives}"
        )
        return values

    def make_safe(self) -> None:
        """Close the brakes if the graph can still be reached; the processes close them on their own end as well."""
        with contextlib.suppress(KeyboardInterrupt, ControlError):
            if self._client.robot_state in ("enabling", "enabled", "stopping"):
                future = self._client.trigger("/supervisor/stop")
                deadline = time.monotonic() + 4.0
                while (
                    future is not None
                    and self._client.robot_state != "disabled"
                    and time.monotonic() < deadline
                ):
                    self._children.check()
                    time.sleep(0.02)


if __name__ == "__main__":
    sys.exit(main())
