"""Who may do what: the topics that each node hears, the services that it offers and calls, process by process.

What a node publishes stands in `cspr_msgs_py.topics`, as the writer of each topic. What it hears, offers and calls
stands here, as a grant: `cspr security` makes policies of both, and tests compare these with what the nodes have. A
node that wants more than this table gives it fails a test first, and a person decides.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from cspr_msgs_py import topics
from cspr_msgs_py.topics import ROSOUT, Topic, graph_topics, motor_command

ENCLAVES = "/cspr"
"""The enclaves of all processes stand below this one."""

EVERYTHING = "*"
"""Stands for every topic."""

PARAMETER_EVENTS = "/parameter_events"
_PARAMETER_SERVICES = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)
_TYPE_SERVICE = "get_type_description"
_LIFECYCLE_SERVICES = (
    "change_state",
    "get_available_states",
    "get_available_transitions",
    "get_state",
    "get_transition_graph",
)
_DRIVE_COMMANDS = ("enable", "disable", "quick_stop", "fault_reset")
_WINDING = ("wind_in", "wind_out")  # of one drive alone


@dataclass(frozen=True)
class Access:
    """What one node may do.

    Attributes
    ----------
    publishes, hears
        Names of topics.
    offers, calls
        Names of services that it answers and asks.
    """

    publishes: frozenset[str] = frozenset()
    hears: frozenset[str] = frozenset()
    offers: frozenset[str] = frozenset()
    calls: frozenset[str] = frozenset()


@dataclass(frozen=True)
class _Node:
    """What a node has besides the topics that it is the writer of.

    `also` are topics that any node may publish. `offers` are services by their names within the node. A managed node
    has the services of its life cycle; a lean one has no parameter services and writes no log to ``/rosout``.
    """

    hears: tuple[Topic, ...] = ()
    offers: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()
    also: tuple[Topic, ...] = (topics.DIAGNOSTICS,)
    managed: bool = False
    lean: bool = False

    def access(self, name: str, number_of_motors: int) -> Access:
        written = {topic.name for topic in graph_topics(number_of_motors) if topic.writer == name}
        publishes = {PARAMETER_EVENTS, *written, *(topic.name for topic in self.also)}
        offers = [*self.offers, _TYPE_SERVICE]
        if not self.lean:
            publishes.add(ROSOUT.name)
            offers += _PARAMETER_SERVICES
        if self.managed:
            publishes.add(f"/{name}/transition_event")
            offers += _LIFECYCLE_SERVICES
        return Access(
            frozenset(publishes),
            frozenset(topic.name for topic in self.hears),
            frozenset(f"/{name}/{service}" for service in offers),
            frozenset(self.calls),
        )


_MOTOR_CONTROLLER = _Node(hears=(topics.MOTOR_STATES, topics.SETPOINT))
_LEAN = _Node(also=(), lean=True)
_CONTROL: Mapping[str, _Node] = {
    "trajectory_publisher": _Node(
        hears=(topics.MOTOR_STATES, topics.PLATFORM_POSE, topics.ROBOT_STATE, topics.SUPERVISOR_ALIVE),
        offers=("start", "verify", "stop"),
    ),
    "feedforward": _Node(
        hears=(
            topics.REFERENCE, topics.PAYLOAD, topics.EXTERNAL_WRENCH, topics.CABLE_TENSIONS, topics.ROBOT_STATE,
        ),
    ),
    "pose_estimator": _Node(hears=(topics.MOTOR_STATES, topics.CABLE_TENSIONS)),
    "mass_estimator": _Node(
        hears=(topics.MOTOR_STATES, topics.CABLE_TENSIONS, topics.ROBOT_STATE, topics.PAYLOAD_IN_USE),
    ),
    "supervisor": _Node(
        hears=(
            topics.MOTOR_STATES, topics.REFERENCE, topics.SETPOINT, topics.CABLE_TENSIONS, topics.PLATFORM_POSE,
            topics.PAYLOAD, topics.ROBOT_STATE, topics.SUPERVISOR_ALIVE, topics.DRIVE_STATES, topics.LOAD_CELL_STATES,
            topics.LOAD_CELL_CHECK, topics.TRAJECTORY_STATE, topics.RECORDER_STATE, topics.DIAGNOSTICS,
        ),
        offers=("enable", "verify", "stop", "reset"),
        calls=(
            "/can_drives/enable", "/can_drives/disable", "/can_drives/quick_stop", "/can_drives/fault_reset",
            "/trajectory_publisher/stop", "/trajectory_publisher/verify",
        ),
    ),
}  # fmt: skip
_LOAD_CELLS = _Node(offers=("tare",), managed=True)
_SIMULATED_ROBOT = _Node(hears=(topics.SET_SIMULATED_PAYLOAD,), offers=("inject_fault", "clear_faults"))
_RECORDER = _Node(offers=("pause", "resume", "split", "mark"), also=(topics.DIAGNOSTICS, topics.EVENTS))
_ROBOT_MARKERS = _Node(
    hears=(
        topics.PLATFORM_POSE, topics.PAYLOAD, topics.TRAJECTORY_STATE, topics.CABLE_TENSIONS, topics.REFERENCE,
    ),
)  # fmt: skip
_DEMO = _Node(
    hears=(
        topics.ROBOT_STATE, topics.TRAJECTORY_STATE, topics.DRIVE_STATES, topics.DIAGNOSTICS, topics.PAYLOAD,
        topics.SIMULATED_PAYLOAD,
    ),
    calls=("/supervisor/enable", "/supervisor/stop", "/trajectory_publisher/start"),
    also=(),
)  # fmt: skip

Process = Mapping[str, Access]
"""The nodes of a process, by name."""


def _can_drives(number_of_motors: int) -> _Node:
    motors = range(1, number_of_motors + 1)
    single = [f"motor_{k}/{command}" for k in motors for command in (*_DRIVE_COMMANDS, *_WINDING)]
    return _Node(
        hears=(topics.SUPERVISOR_ALIVE, topics.CABLE_TENSIONS, *(motor_command(k) for k in motors)),
        offers=(*_DRIVE_COMMANDS, "set_home", *single),
        managed=True,
    )


def processes(number_of_motors: int) -> dict[str, Process]:
    """Return what each process may do, by the name of its enclave below `ENCLAVES`."""
    m = number_of_motors
    motors = range(1, m + 1)
    drivers = {"can_drives": _can_drives(m), "load_cells": _LOAD_CELLS}
    # in one process: nodes of which there are many are lean, their gains are parameters of one
    composed = {
        "motor_control_gains": _Node(),
        **{f"motor_controller_{k}": replace(_MOTOR_CONTROLLER, lean=True) for k in motors},
        **_CONTROL,
    }
    nodes: dict[str, Mapping[str, _Node]] = {
        "control": composed,
        **{name: {name: node} for name, node in _CONTROL.items()},
        # its first node is there until it has read which motor is meant
        **{
            f"motor_controller_{k}": {"motor_controller": _LEAN, f"motor_controller_{k}": _MOTOR_CONTROLLER}
            for k in motors
        },
        "drivers": drivers,
        "can_drives": {"can_drives": drivers["can_drives"]},
        # alone it has the time of the driver's SYNC from the motor states
        "load_cells": {"load_cells": replace(_LOAD_CELLS, hears=(topics.MOTOR_STATES,))},
        "simulated_robot": {**drivers, "simulated_robot": _SIMULATED_ROBOT},
        "emulated_robot": {"simulated_robot": _SIMULATED_ROBOT},
        "recorder": {"recorder": _RECORDER, "_recorder_intake": _LEAN},
        "robot_markers": {"robot_markers": _ROBOT_MARKERS},
        "demo": {"demo": _DEMO},
    }
    found: dict[str, dict[str, Access]] = {
        process: {name: node.access(name, m) for name, node in members.items()}
        for process, members in nodes.items()
    }
    intake = found["recorder"]["_recorder_intake"]
    found["recorder"]["_recorder_intake"] = replace(intake, hears=frozenset([EVERYTHING]))
    return {**found, **_people(found)}


def _people(running: Mapping[str, Process]) -> dict[str, Process]:
    """Return what people may do with the tools of ``ros2``, by what they are at the robot."""
    offered = {service for nodes in running.values() for node in nodes.values() for service in node.offers}
    parameters = {
        f"/{node}/{name}"
        for node in ("trajectory_publisher", "supervisor", "recorder")
        for name in _PARAMETER_SERVICES
    }
    tool = Access(
        frozenset([PARAMETER_EVENTS, ROSOUT.name]),
        frozenset([EVERYTHING]),
        frozenset([f"/_ros2cli_*/{_TYPE_SERVICE}"]),
    )
    operator = replace(
        tool,
        publishes=tool.publishes | {topics.EVENTS.name},
        calls=frozenset({
            "/supervisor/enable", "/supervisor/verify", "/supervisor/stop", "/supervisor/reset",
            "/trajectory_publisher/start", "/trajectory_publisher/stop",
            *(f"/recorder/{name}" for name in _RECORDER.offers), *parameters,
        }),
    )  # fmt: skip
    maintenance = replace(
        operator,
        publishes=operator.publishes | {topics.SET_SIMULATED_PAYLOAD.name},
        calls=frozenset(offered),
    )
    people = {"viewer": tool, "operator": operator, "maintenance": maintenance}
    return {name: {"_ros2cli_*": access} for name, access in people.items()}
