"""Every parameter of every node: name, default, meaning, unit, range, and when it may change.

This table is the only place where these are written down: the nodes declare it, the settings of the control graph
take their defaults from it, and files, command lines and re-runs are checked against it. `config/control.yaml` shows
what is worth changing; a test compares its values with the defaults here. Names and numbers only: nothing of ROS is
imported, see :mod:`cspr_msgs_py.runtime.parameters` for that.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from difflib import SequenceMatcher, get_close_matches
from functools import cache, partial
from typing import Any

from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.parameters.row import NodeParameter
from cspr_msgs_py.vocabulary import FeedforwardModel, PayloadMethod, PayloadSource, TrajectoryName

ALL_NODES = "/**"
"""Stands for every node in files and on the command line."""

_fixed = NodeParameter
_live = partial(NodeParameter, changeable=True)
_DURATION, _RATE, _HEIGHT = 1, -1, 2

CPU = _fixed("cpu", -1, "CPU on which the whole process runs, -1 for any", "", -1, 1023)
REALTIME_PRIORITY = _fixed(
    "realtime_priority", 0, "SCHED_FIFO priority of the process, 0 for normal scheduling", "", 0, 99
)
ROBOT_CONFIG = _fixed("robot_config", "config/robot.yaml", "File that describes the robot")
CAN_CONFIG = _fixed("can_config", "config/can.yaml", "File that describes the CAN side")
CONTROL_RATE = _fixed(
    "control_rate", 250.0, "Rate of the control cycle, as the bus driver runs it", "Hz", 1.0, 2000.0
)
MOTOR = _fixed("motor", 1, "Motor to control, counted from 1", "", 1, 127)
SETPOINT_TIMEOUT = _fixed(
    "setpoint_timeout", 0.1, "Age at which a set-point is no longer used", "s", 1e-3, 1.0, stretch=_DURATION
)
_MAX_PAYLOAD = _live("max_payload", 300.0, "Largest payload that is estimated and believed", "kg", 0.1, 1e5)
AUTOSTART = _fixed("autostart", True, "Configure and activate the node at its start")

_GAINS = (
    _live("kp", 2.0, "Proportional gain", "N m/rad", 0.0, 1000.0),
    _live("kd", 0.1, "Derivative gain, below 2 J / T with the motor inertia J and the control period T", "N m s/rad",
          0.0, 100.0),
    _live("speed_delay", 0.002, "How old measured speeds are: half a period, where they are differences of positions",
          "s", 0.0, 0.1),
    _live("friction_compensation", 1.0, "Share of the motor's friction that is compensated at the desired speed", "",
          0.0, 1.0),
    _live("friction_smoothing_speed", 1.0,
          "Desired motor speed at which the smoothed sign of the friction reaches tanh(1)", "rad/s", 1e-3, 100.0),
)  # fmt: skip


def _limit(name: str, default: float | type[float], meaning: str, unit: str) -> NodeParameter:
    """Return a limit of the supervisor; those in seconds are all on the computer's clock."""
    stretch = _DURATION if unit == "s" else 0
    return NodeParameter(name, default, meaning, unit, 0.0, 1000.0, stretch=stretch)


def _max_age(topic: str, default: float) -> NodeParameter:
    meaning = f"Age from which /{topic} counts as stale"
    return NodeParameter(f"max_age.{topic}", default, meaning, "s", 0.01, 60.0, stretch=_DURATION)


TABLE: Mapping[str, tuple[NodeParameter, ...]] = {
    "trajectory_publisher": (
        ROBOT_CONFIG,
        CONTROL_RATE,
        _live("trajectory", "paper-19", "Trajectory that the next start plays", choices=tuple(TrajectoryName)),
        _live("move_position", list, "Target position of move, in base; the home pose's by default", "m"),
        _live("move_orientation", list,
              "Target angles alpha, beta, gamma of move, about z, y, x; the home pose's by default", "rad"),
        _live("hold_duration", 10.0, "Duration of hold", "s", 0.0, 1e6),
        _live("blend_time", 1.0, "Time from rest to full pace of the smooth trajectories", "s", 1e-3, 60.0),
        _live("speed", 0.2, "Speed limit of approach and move", "m/s", 1e-3, 10.0),
        _live("acceleration", 0.3, "Acceleration limit of approach and move", "m/s^2", 1e-3, 100.0),
        _live("angular_speed", 0.2, "Angular speed limit of approach and move", "rad/s", 1e-3, 10.0),
        _live("angular_acceleration", 0.4, "Angular acceleration limit of approach and move", "rad/s^2", 1e-3, 100.0),
        _fixed("dwell", 1.0, "Rest at the start of a trajectory before it begins", "s", 0.0, 60.0),
        _fixed("stop_time", 0.5, "Time to come to rest along the path", "s", 0.01, 10.0),
        _fixed("supervision_timeout", 0.2, "Age of the supervisor's sign of life from which no trajectory runs", "s",
               0.04, 10.0, stretch=_DURATION),
        _fixed("max_gap", 0.1, "Longest gap in the motor states after which a trajectory still continues", "s", 0.01,
               10.0, stretch=_DURATION),
    ),
    "feedforward": (
        ROBOT_CONFIG,
        _live("model", "dynamic", "Model of the feed-forward torque", choices=tuple(FeedforwardModel)),
        _live("winch_inertia", True, "Whether the dynamic model counts the torque that accelerates the winches"),
        _live("payload_source", "estimated", "Which payload is used", choices=tuple(PayloadSource)),
        _live("nominal_payload_mass", 0.0, "Payload assumed without an estimate", "kg", 0.0, 1e5),
        _live("nominal_payload_center", [0.0, 0.0, 0.0], "Its centre of mass in platform", "m", -10.0, 10.0),
        _MAX_PAYLOAD,
        _live("payload_timeout", 0.5, "Age from which an estimate counts as stale", "s", 1e-3, 60.0,
              stretch=_DURATION),
        _live("switch_slew", 2.0, "Fastest change of a motor's torque when model, payload or tension method changes",
              "N m/s", 1e-3, 1e4, stretch=_RATE),
        _live("stretch_compensation", True, "Whether set-points allow for the stretch under the model's tensions"),
        _live("stretch_slew", 0.15, "Time constant of the two poles through which they do", "s", 1e-3, 10.0),
        _live("rope_weight", True, "Whether the tensions carry the ropes too, as those at the frame must"),
        _live("tension_method", "closest", "How the wrench is distributed over the cables",
              choices=("closest", "centroid", "analytic_center")),
        _live("swing_damping", 0.0, "Damping ratio that a load on a sling is given when it swings; 0 leaves it alone",
              "", 0.0, 0.35),
        _live("swing_dead_zone", 8.0, "Amplitude of the load's sideways pull up to which it may swing", "N", 0.1, 1e4),
        _fixed("swing_reach", 0.04, "How far the platform may depart from the reference for it", "m", 1e-3, 1.0),
        _live("swing_acceleration", 0.8, "Largest acceleration with which it does", "m/s^2", 1e-3, 100.0),
        _live("swing_delay", 0.045, "How old /external_wrench is: twice the estimator's time_constant, and a cycle",
              "s", 0.0, 0.2),
    ),
    "motor_control_gains": (ROBOT_CONFIG, CONTROL_RATE, *_GAINS),
    "motor_controller": (MOTOR,),  # read first: the node's name depends on it
    "motor_controller_K": (ROBOT_CONFIG, CONTROL_RATE, SETPOINT_TIMEOUT, *_GAINS),
    "pose_estimator": (
        ROBOT_CONFIG,
        CONTROL_RATE,
        _fixed("rate", 50.0, "Rate of the poses", "Hz", 1.0, 1000.0),
    ),
    "mass_estimator": (
        ROBOT_CONFIG,
        _live("method", "motion", "How the payload is estimated", choices=tuple(PayloadMethod)),
        # times of motion and static are on the clock of the stamps, which is the machine's
        _live("time_constant", 0.02, "Time constant of each of the two poles that both sides of the balance pass", "s",
              1e-3, 1.0),
        _live("mass_walk", 1.0, "Random walk of the payload's mass, in the square root of a second", "kg", 1e-3, 1e3),
        _live("moment_walk", 0.1, "Random walk of its first moment, in the square root of a second", "kg m", 1e-4, 1e3),
        _live("force_noise", 3.0, "Standard deviation of the balance of forces in one cycle", "N", 1e-3, 1e4),
        _live("moment_noise", 1.0, "Standard deviation of the balance of moments in one cycle", "N m", 1e-3, 1e4),
        _live("change_mass", 1.5, "Size of a sudden change of the mass that is to be detected", "kg", 1e-2, 1e3),
        _live("max_acceleration", 7.85, "Vertical acceleration, up or down, above which the estimate is held",
              "m/s^2", 0.1, 1e3),
        _live("tension_skew", 0.0, "How much older tensions are than the motor angles of the same SYNC: the delay of "
              "the amplifiers' own filters; 0 for amplifiers that convert at the SYNC, as the simulated ones", "s", 0.0,
              0.02),
        _live("mass_rate_limit", 2000.0, "Fastest change of the published mass", "kg/s", 0.1, 1e5),
        _live("center_rate_limit", 2.0, "Fastest change of the published centre of mass", "m/s", 1e-3, 100.0),
        _MAX_PAYLOAD,
        _live("max_offset", 0.15, "Largest distance of the centre of mass from the middle of the platform along x and "
              "y, and from payload_height along z", "m", 1e-3, 10.0),
        _live("minimum_mass", 5.0, "Payload below which no centre of mass is published", "kg", 0.1, 1e3),
        _live("payload_height", 0.0, "Assumed z of the payload's centre of mass in platform", "m", -10.0, 10.0),
        _live("slack_tension", 25.0, "Tension below which a cable counts as slack", "N", 0.1, 1e4),
        _live("slack_hold", 0.3, "How long the estimate is held after the last slack cable", "s", 0.0, 10.0),
        # beyond what follows, a cell may be wrong by more than 60 N, or for more than a second, before it is found
        _live("cell_tolerance", 18.0, "Sideways force of all cells together, which no payload explains, above which "
              "one is suspected", "N", 0.1, 60.0),
        _live("cell_confirmation", 0.02, "How long one cell must explain it before it is left out", "s", 0.0, 1.0),
        _live("cell_recovery", 1.0, "How long a cell that was left out must agree, brakes closed, to be believed again",
              "s", 0.0, 60.0),
        _live("stuck_time", 0.9, "How long a load cell may show exactly the same value", "s", 0.01, 1.0),
        _live("input_timeout", 0.1, "Age from which motor states and tensions of one SYNC count as stale", "s", 1e-3,
              10.0, stretch=_DURATION),
        _live("static.time_constant", 0.4, "Time constant of the low-pass filter of the static balance", "s", 1e-3,
              60.0),
        _live("static.max_speed", 0.6, "Speed above which the static balance is not believed", "m/s", 1e-3, 100.0),
        _live("static.max_angular_speed", 0.3, "Angular speed above which the static balance is not believed", "rad/s",
              1e-3, 100.0),
        _live("static.max_sideways_ratio", 0.1, "Horizontal force over vertical above which the static balance is not "
              "believed", "", 1e-3, 10.0),
    ),
    "supervisor": (
        ROBOT_CONFIG,
        _limit("following_error", 12.0, "Largest difference between desired and measured motor angle", "rad"),
        _limit("following_error_time", 0.05, "How long it may be exceeded", "s"),
        _limit("starting_error", 2.0, "Largest such difference at which the robot may be enabled", "rad"),
        _limit("tension_min_time", 0.5, "How long a tension may be below tension_min of the robot", "s"),
        _limit("tension_max_time", 0.1, "How long a tension may be above tension_max of the robot", "s"),
        _limit("motor_speed_time", 0.02, "How long a motor may be faster than speed_limit of the robot", "s"),
        _fixed("workspace_margin", 0.05, "How far the platform may leave the workspace of the robot", "m", 0.0, 0.2),
        _limit("tension_difference", 250.0, "Largest difference between a load cell and the torque of its motor", "N"),
        _limit("tension_difference_time", 1.0, "How long it may be exceeded", "s"),
        _limit("stuck_time", 1.0, "How long a load cell may show exactly the same value", "s"),
        _limit("length_misfit", float, "Largest difference between a cable's length and its path at the pose that fits "
               "all best; length_uncertainty of the robot by default", "m"),
        _limit("slack_misfit", 0.003, "The same while a cable is slack, where that is more", "m"),
        # 25 at 250 Hz are 20 mm of a cable that runs at 0.2 m/s
        _fixed("misfit_cycles", 3, "Cycles in a row in which it must be exceeded", "", 1, 25),
        _limit("slack_tension", 25.0, "Tension below which a cable counts as slack", "N"),
        _limit("slack_hold", 0.1, "How long it counts as slack afterwards", "s"),
        _fixed("verification_required", True, "Whether a configuration must have been verified before the robot is "
               "enabled"),
        _live("declared_load", -1.0, "What hangs from the platform when the robot is enabled; negative: not declared, "
              "anything from nothing to max_payload", "kg", -1.0, 1e5),
        _MAX_PAYLOAD,
        _fixed("cell_accuracy", 0.003, "Share of its tension by which a load cell, its pulley included, is off, as a "
               "standard deviation; three are tolerated at enabling", "", 0.0, 1.0),
        _fixed("weight_accuracy", 0.02, "Share by which the weight that the cells carry may be off besides", "",
               0.0, 1.0),
        _fixed("torque_accuracy", 0.05, "Share by which a motor's torque and tension may disagree, besides friction",
               "", 0.0, 10.0),
        _limit("node_timeout", 3.5, "Silence of a node on /diagnostics after which it counts as ended", "s"),
        _fixed("allowed_drop", 0.02, "Height that each of these may cost, more on a simulated machine", "m", 1e-4,
               1000.0, stretch=_HEIGHT),
        _limit("enable_timeout", 5.0, "Time for the drives to become enabled", "s"),
        _limit("stop_timeout", 3.0, "Time for the trajectory to come to rest", "s"),
        _limit("drive_timeout", 5.0, "Time for the drives to become disabled or reset", "s"),
        _max_age("motor_states", 0.2),
        _max_age("reference", 0.2),
        _max_age("setpoint", 0.2),
        _max_age("cable_tensions", 0.2),
        _max_age("platform_pose", 0.3),
        _max_age("drive_states", 3.0),
    ),
    "robot_markers": (
        ROBOT_CONFIG,
        _fixed("trail", 20.0, "How much of the path behind the platform is shown", "s", 1.0, 600.0,
               stretch=_DURATION),
    ),
    "can_drives": (
        CAN_CONFIG,
        AUTOSTART,
        replace(CONTROL_RATE, default=float,
                meaning="Rate of the control cycle that the controllers expect; that of can.yaml by default"),
    ),
    "load_cells": (
        CAN_CONFIG,
        AUTOSTART,
        _fixed("tare_limit", 100.0, "Largest tension of a cable that may be tared as slack", "N", 0.0, 1e4),
    ),
    "simulated_robot": (
        CAN_CONFIG,
        _fixed("simulation_config", "config/simulation.yaml", "File with the true values of the simulated machine"),
        _fixed("speed", 1.0, "Simulated seconds per second of the computer; below 1 for a slow computer", "",
               0.01, 1.0),
        _fixed("bus_timing", False,
               "Whether frames take as long as on a real bus, at the cost of more computing time"),
        _live("fault", "",
              "What ~/inject_fault injects, and where, as in 'drive_silent motor_3'; refusals list the faults"),
    ),
    "recorder": (
        _fixed("output", "", "Directory of the bag, which must not exist yet; runs/<UTC time>/bag if empty"),
        _fixed("topics", [""], "Topics to record besides /events; if empty, all, including those that appear later"),
        _fixed("attach", [""], "Files to keep inside the bag; config/*.yaml if empty"),
        _fixed("compression", "zstd", "Of the bag", choices=("zstd", "lz4", "none")),
        _fixed("split_size", 0.0, "Continue in a new file at this size, 0 for never", "MB", 0.0, 1e6),
        _fixed("split_duration", 0.0, "Continue in a new file after this time, 0 for never", "s", 0.0, 1e6),
        _fixed("nice", 5, "Nice level of the threads that receive and write", "", 0, 19),
        replace(CONTROL_RATE, meaning="Rate of the control cycle, noted in the bag"),
        _live("mark_text", "", "Text of the next mark, which ~/mark makes; a mark always has a number"),
    ),
}  # fmt: skip
"""The parameters of each node; every node also has those of its process."""

NODES = tuple(node.replace("_K", "_1") for node in TABLE)
"""The nodes' names, with one motor controller for all."""

OF_PROCESS = (CPU.name, REALTIME_PRIORITY.name)
"""Parameters that say how a process runs, not what its nodes do."""

_OTHER_NAMES = {"payload_estimator": "mass_estimator", "feed_forward": "feedforward"}

_WITHOUT_PRIORITY = ("recorder", "robot_markers")  # the control loop comes first
_OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")


@cache
def node_parameters(node: str) -> Mapping[str, NodeParameter]:
    """Return the parameters of a node by name, those of its process included; empty if it is none of ours.

    Those of `ALL_NODES` are all that some node has.
    """
    if node == ALL_NODES:
        return {name: row for each in TABLE for name, row in node_parameters(each).items()}
    key = re.sub(r"^motor_controller_[1-9]\d*$", "motor_controller_K", node)
    if key not in TABLE:
        return {}
    process = (CPU,) if node in _WITHOUT_PRIORITY else (CPU, REALTIME_PRIORITY)
    return {parameter.name: parameter for parameter in (*TABLE[key], *process)}


def _meant_node(name: str) -> str | None:
    """Return the node of ours that a name, which is none of theirs, was probably meant for.

    It was, if it is almost one of them, or made of parts of their words alone. Other nodes have a word of their own.
    """
    ours = {node: node for node in NODES} | _OTHER_NAMES
    words = re.findall("[a-z]+", name.lower())
    shared = {
        node: {word for word in words if any(_is_part(word, whole) for whole in node.split("_"))}
        for node in ours
    }
    of_our_words = words and set(words) == set().union(*shared.values())
    if not of_our_words and not get_close_matches(name.lower(), ours, n=1, cutoff=0.8):
        return None
    nearest = max(
        ours, key=lambda node: (len(shared[node]), SequenceMatcher(None, name.lower(), node).ratio())
    )
    number = re.search(r"[1-9]\d*$", name)
    return re.sub("^motor_controller(_1)?$", f"motor_controller_{number[0] if number else 1}", ours[nearest])


def _is_part(word: str, whole: str) -> bool:
    return (len(word) >= 3 and whole.startswith(word)) or SequenceMatcher(None, word, whole).ratio() >= 0.8


class ParameterValues(dict[str, Any]):
    """Values of a node's parameters by name; looking up one that has no row says where the row belongs."""

    def __missing__(self, name: str) -> Any:
        raise ParameterError(f"there is no parameter {name!r}: its row is missing in {__name__}.TABLE")


def defaults(node: str) -> dict[str, Any]:
    """Return the defaults of a node's parameters by name, without those that depend on its robot or its buses."""
    rows = node_parameters(node).values()
    return ParameterValues((row.name, row.default) for row in rows if not isinstance(row.default, type))


def parameter_values(node: str, *given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the value of each parameter of a node of ours: the default, or the last one given.

    Other names are ignored: what is given to all nodes is for many.

    Raises
    ------
    ParameterError
        If a value does not fit its parameter.
    """
    values = defaults(node)
    for mapping in given:
        for name, row in node_parameters(node).items():
            if name in mapping:
                values[name] = row.checked(mapping[name])
    return values


def known_parameter(node: str, name: str) -> NodeParameter | None:
    """Return a parameter that somebody named, to be sure that it exists.

    Parameters
    ----------
    node
        Name of the node, or `ALL_NODES`: then it is enough that one of ours knows the parameter.
    name
        Name of the parameter.

    Returns
    -------
    The parameter; None for those that ROS itself has, and for nodes that are not ours.

    Raises
    ------
    ParameterError
        If a node of ours has no such parameter, or the node's name is almost that of one; says what was probably meant.
    """
    everywhere, known = node_parameters(ALL_NODES), node_parameters(node)
    if not known or node.endswith("_K"):
        if meant := _meant_node(node):
            raise ParameterError(f"there is no node {node}; did you mean {meant}?")
        return None
    if name in known or name.startswith(_OF_ROS):
        return known.get(name)
    near = get_close_matches(name.lower(), known, n=1)
    elsewhere = [name] if name in everywhere else near or get_close_matches(name.lower(), everywhere, n=1)
    hint = "" if node == ALL_NODES else f"; it has {', '.join(known)}"
    if elsewhere == near != []:
        hint = f"; did you mean {near[0]}?"
    elif elsewhere:
        hint = f"; {next(each for each in NODES if elsewhere[0] in node_parameters(each))} has {elsewhere[0]}"
    raise ParameterError(
        f"{'no node has a' if node == ALL_NODES else f'{node} has no'} parameter {name!r}{hint}"
    )
