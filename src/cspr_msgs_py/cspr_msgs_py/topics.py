"""Every topic of the node graph: name, type, quality of service, rate and writer.

This table is the only place where these are written down. Nodes, the recorder and the analysis all take
them from here. Names and numbers only: nothing of ROS is imported, see :mod:`cspr_msgs_py.qos` for that.
"""

from dataclasses import dataclass
from enum import Enum
from functools import partial

BASE_FRAME = "base"
PLATFORM_FRAME = "platform"


class Rate(Enum):
    """How often a topic is published, where that is not a fixed number of hertz."""

    CONTROL = "once per control cycle"
    BUS = "once per SYNC of the CAN bus"
    ON_CHANGE = "on change"
    ON_REQUEST = "on request"


@dataclass(frozen=True)
class Topic:
    """One topic of the graph.

    Attributes
    ----------
    name : str
        Absolute name.
    type : str
        Message type as ``package/msg/Name``.
    rate : Rate or float
        A :class:`Rate`, or hertz.
    writer : str
        Name of the node that publishes it; ``*`` where every node does.
    content : str
        What a message holds, with units.
    reliable : bool
        Whether the middleware repeats what was lost on the way.
    latched : bool
        Whether a subscriber that joins late is given the last message.
    depth : int
        The history of publisher and subscribers keeps the last `depth` messages.
    """

    name: str
    type: str
    rate: Rate | float
    writer: str
    content: str
    reliable: bool
    latched: bool
    depth: int


MULTI_DOF_TRAJECTORY = "trajectory_msgs/msg/MultiDOFJointTrajectory"
JOINT_STATE = "sensor_msgs/msg/JointState"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
INERTIA_STAMPED = "geometry_msgs/msg/InertiaStamped"
WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
DIAGNOSTIC_STATUS = "diagnostic_msgs/msg/DiagnosticStatus"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
STRING = "std_msgs/msg/String"
HEADER = "std_msgs/msg/Header"
LOG = "rcl_interfaces/msg/Log"


def _stream(name: str, type: str, rate: Rate | float, writer: str, content: str) -> Topic:
    """Return a topic of samples: the next one replaces a lost one, so nothing is ever repeated.

    In the control cycle a receiver that is late does not work through old samples either: with a queue of five, a
    loop that cannot keep up would answer states that are five cycles old, and become unstable; with the newest alone
    it is merely slower.
    """
    depth = 1 if rate in (Rate.CONTROL, Rate.BUS) else 5
    return Topic(name, type, rate, writer, content, reliable=False, latched=False, depth=depth)


# A topic of states: everyone has the current one, whenever they join.
_latched = partial(Topic, reliable=True, latched=True, depth=1)
# A topic of events: none may be lost, old ones are of no use to late subscribers.
_reliable = partial(Topic, reliable=True, latched=False, depth=10)

REFERENCE = _stream(
    "/reference",
    MULTI_DOF_TRAJECTORY,
    Rate.CONTROL,
    "trajectory_publisher",
    "pose (m), twist (m/s, rad/s) and acceleration (m/s^2, rad/s^2) of the platform in base, one point",
)
SETPOINT = _stream(
    "/setpoint",
    JOINT_STATE,
    Rate.CONTROL,
    "feedforward",
    "per motor: angle (rad), speed (rad/s), feed-forward torque (N m), at the motor shaft",
)
MOTOR_STATES = _stream(
    "/motor_states",
    JOINT_STATE,
    Rate.BUS,
    "can_drives",
    "per motor: angle (rad), speed (rad/s), torque (N m), at the motor shaft",
)
CABLE_TENSIONS = _stream(
    "/cable_tensions",
    JOINT_STATE,
    Rate.BUS,
    "load_cells",
    "per cable: effort = tension (N), positive when it pulls",
)
PLATFORM_POSE = _stream(
    "/platform_pose",
    POSE_STAMPED,
    50.0,
    "pose_estimator",
    "pose of the platform in base by forward kinematics of motor angles and tensions of the same SYNC",
)
PAYLOAD = _stream(
    "/payload",
    INERTIA_STAMPED,
    Rate.BUS,
    "mass_estimator",
    "estimated mass (kg) and centre of mass (m, in platform) of the payload; stamp: of the newest cycle in it",
)
EXTERNAL_WRENCH = _stream(
    "/external_wrench",
    WRENCH_STAMPED,
    Rate.BUS,
    "mass_estimator",
    "force (N) and moment (N m) that the surroundings exert on the platform beyond gravity and inertia, about its "
    "origin along the axes of base; silent while the estimate is held",
)
PAYLOAD_IN_USE = _latched(
    "/payload_in_use",
    INERTIA_STAMPED,
    Rate.ON_CHANGE,
    "feedforward",
    "mass (kg) and centre of mass (m, in platform) of the payload that set-points count on",
)
ROBOT_STATE = _latched(
    "/robot_state",
    DIAGNOSTIC_STATUS,
    Rate.ON_CHANGE,
    "supervisor",
    "message = state of the robot: disabled, enabling, enabled, stopping, fault; values: its cause",
)
SUPERVISOR_ALIVE = _stream(
    "/supervisor_alive",
    HEADER,
    50.0,
    "supervisor",
    "sign of life: sent with each round of checks; stamp: of the newest motor states in it. Without it several drives "
    "together are neither enabled nor stay so, and no trajectory runs",
)
TRAJECTORY_STATE = _latched(
    "/trajectory_state",
    DIAGNOSTIC_STATUS,
    Rate.ON_CHANGE,
    "trajectory_publisher",
    "message = phase: idle, hold, approach, running, stopping, finished; values: trajectory, start_time, "
    "end_time (ROS time, ns)",
)
DRIVE_STATES = _latched(
    "/drive_states",
    DIAGNOSTIC_ARRAY,
    Rate.ON_CHANGE,
    "can_drives",
    "also once a second: first the driver as a whole, then one status for each motor: message = CiA 402 state; "
    "values: brake, error_code, statusword",
)
RECORDER_STATE = _latched(
    "/recorder_state",
    DIAGNOSTIC_STATUS,
    Rate.ON_CHANGE,
    "recorder",
    "message = state of the recording: recording, paused, failed; values: bag, cause",
)
LOAD_CELL_STATES = _latched(
    "/load_cell_states",
    DIAGNOSTIC_ARRAY,
    Rate.ON_CHANGE,
    "load_cells",
    "also once a second: first the driver as a whole (message: ok or fault; values: cause), then one status for each "
    "cable: message = ok, or what is wrong with its load cell",
)
LOAD_CELL_CHECK = _latched(
    "/load_cell_check",
    DIAGNOSTIC_STATUS,
    Rate.ON_CHANGE,
    "mass_estimator",
    "message = what balance and motors say of the load cells: sound, excluded; values: cell, cause",
)
DIAGNOSTICS = _reliable("/diagnostics", DIAGNOSTIC_ARRAY, 1.0, "*", "health of each node")
ROBOT_MARKERS = _reliable(
    "/robot_markers",
    MARKER_ARRAY,
    10.0,
    "robot_markers",
    "frame, platform, cables coloured by tension, payload and trajectory as markers in base, for RViz and Foxglove",
)
EVENTS = _reliable(
    "/events",
    STRING,
    Rate.ON_REQUEST,
    "*",
    "text that marks a moment in a recording, at the time of its arrival; anyone may publish one",
)
SIMULATED_PAYLOAD = _stream(
    "/simulation/payload",
    INERTIA_STAMPED,
    50.0,
    "simulated_robot",
    "true mass (kg) and centre of mass (m, in platform) of the simulated payload",
)
TRUE_POSE = _stream(
    "/true_pose",
    POSE_STAMPED,
    Rate.BUS,
    "simulated_robot",
    "true pose of the simulated platform in base, with the stamp of the motor states of the same SYNC",
)
SET_SIMULATED_PAYLOAD = _reliable(
    "/simulation/set_payload",
    INERTIA_STAMPED,
    Rate.ON_REQUEST,
    "demo",
    "payload that the simulated robot carries from header.stamp on (0 = now)",
)
_ROWS = tuple(row for row in list(globals().values()) if isinstance(row, Topic))

# What every node of ROS publishes by itself; no part of the graph, and so not among `graph_topics`.
ROSOUT = Topic(
    "/rosout", LOG, Rate.ON_REQUEST, "*", "lines of the log", reliable=True, latched=True, depth=1000
)


def motor_command(k: int) -> Topic:
    """Return the topic of the torque commands to motor `k`, counted from 1."""
    if k < 1:
        raise ValueError(f"motors are counted from 1, not {k}")
    return _stream(
        f"/motor_{k}/command",
        JOINT_STATE,
        Rate.BUS,
        f"motor_controller_{k}",
        f"effort = commanded torque (N m) of motor {k}, at the motor shaft",
    )


def motor_names(number_of_motors: int) -> tuple[str, ...]:
    """Return the names that stand for the motors in messages: ``motor_1`` and so on."""
    return tuple(f"motor_{k}" for k in range(1, number_of_motors + 1))


def cable_names(number_of_cables: int) -> tuple[str, ...]:
    """Return the names that stand for the cables in messages: ``cable_1`` and so on."""
    return tuple(f"cable_{k}" for k in range(1, number_of_cables + 1))


def graph_topics(number_of_motors: int) -> tuple[Topic, ...]:
    """Return every topic of a robot with this number of motors: the rows above, then the motors' commands."""
    return (*_ROWS, *(motor_command(k) for k in range(1, number_of_motors + 1)))
