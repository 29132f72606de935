"""Publish a bag as it was recorded, with its timing and ``/clock``."""

import argparse
import contextlib
import signal
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from itertools import chain

import rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock

from cspr_msgs_py.bag.reader import Bag, Message, find_bag
from cspr_msgs_py.errors import BagError, MessageError, StartError
from cspr_msgs_py.message_definitions import message_class
from cspr_msgs_py.programs.command_line import number, program_parser, run_program, show_progress
from cspr_msgs_py.qos import replay_profile
from cspr_msgs_py.runtime.network import creating_nodes, init_ros
from cspr_msgs_py.runtime.process import LEAN_NODE
from cspr_msgs_py.runtime.replay_pace import ReplayPace
from cspr_msgs_py.runtime.terminal import RIGHT_ARROW, Keyboard, keyboard
from cspr_msgs_py.topics import MOTOR_STATES, ROSOUT, SUPERVISOR_ALIVE, graph_topics
from cspr_msgs_py.wire.cdr import NANOSECONDS

CLOCK = "/clock"
DRIVER = "can_drives"  # the node that passes the motors' commands on to real drives

# Published by any number of nodes: nobody mistakes a replayed message for one of another node.
_COMMON = {
    ROSOUT.name,
    "/parameter_events",
    *(topic.name for topic in graph_topics(0) if topic.writer == "*"),
}

_CLOCK_PERIOD = 0.01  # s, of the wall clock and of the bag's time alike
_LOOK_PERIOD = 0.1  # s between two looks at the keyboard and the progress bar
_CONFLICT_PERIOD = 1.0  # s between two looks for a driver, and for others who publish the same
_DISCOVERY_TIME = 1.0  # s in which the nodes that are running are discovered
_MATCHING_TIME = 5.0  # s at most until those that subscribe are connected
_NAMING_TIME = 2.0  # s at most until an end point that is known has its node's name
_UNKNOWN = "_NODE_NAME_UNKNOWN_"  # of an end point whose node is not known yet, as rmw has it
_END_TIME = 0.5  # s for the last messages to arrive: those not yet taken are lost with their publisher

DESCRIPTION = """Publish a bag as it was recorded: the same bytes on the same topics with the same quality of service
and timing, and /clock, so that nodes with use_sim_time live in the bag's time.

On a terminal: space pauses and goes on; s or the right arrow publishes the next message, c all messages up to the
next motor states; + and - double and halve the rate; q ends."""

EPILOG = """A topic that somebody else publishes is refused, and so are commands of motors where a node can_drives
listens: replay into a graph of its own (another ROS_DOMAIN_ID), or choose the topics.

examples:
  cspr replay runs/latest                                      everything, to look at in RViz or Foxglove
  cspr replay runs/latest --loop --topics /motor_states /cable_tensions
  cspr replay runs/latest --start 12.5 --paused                to step through a moment"""

EXIT_STATUS = (
    "exit status: 0 ended, be it by Ctrl-C, 1 not replayed, for the reason on stderr, 2 wrong arguments"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Replay a bag; return the exit status."""
    words = list(sys.argv if arguments is None else ["replay", *arguments])
    options = _parse(remove_ros_args(words)[1:])
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(0))  # after the terminal is as it was
    try:
        return run_program("replay", lambda: _run(options, words), (BagError, StartError))
    finally:
        rclpy.try_shutdown()


def _run(options: argparse.Namespace, words: Sequence[str]) -> None:
    init_ros(words, "replay")
    with contextlib.suppress(KeyboardInterrupt), Bag(options.bag) as bag, keyboard() as keys:
        replay = Replay(bag, options, keys)
        try:
            replay.run()
        finally:
            if sys.stderr.isatty():
                print(file=sys.stderr)  # how far it came stays to be read


def node_names(ask: Callable[[str], Sequence[TopicEndpointInfo]], topic: str) -> set[str]:
    """Return the nodes of a topic's end points, of which discovery may learn earlier than of their nodes' names."""
    deadline = time.monotonic() + _NAMING_TIME
    while _UNKNOWN in (names := {each.node_name for each in ask(topic)}) and time.monotonic() < deadline:
        time.sleep(0.02)
    return names


class Replay:
    """A replay of a bag.

    Parameters
    ----------
    bag : Bag
    options
        Of the command line.
    keys : Keyboard

    Raises
    ------
    StartError, BagError
        If a selected topic is not in the bag, or must not be published.
    """

    def __init__(self, bag: Bag, options: argparse.Namespace, keys: Keyboard) -> None:
        if not any(bag.counts.values()):
            raise BagError(f"{bag.path} has no message: there is nothing to replay")
        self._bag = bag
        self._keys = keys
        self._loop: bool = options.loop
        self._start_ns = bag.start_ns + round(options.start * NANOSECONDS)
        if self._start_ns > bag.end_ns:
            length = (bag.end_ns - bag.start_ns) / NANOSECONDS
            raise StartError(f"--start {options.start:g}: the bag is {length:.2f} s long")
        self._step: str | None = None  # the topic that ends the step under way; of any topic if empty
        self._ended = self._late = False
        self._looked = self._checked = -1e9
        with creating_nodes():
            self._node = Node("replay", **LEAN_NODE)
        self._clock = self._node.create_publisher(
            Clock, CLOCK, QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        )
        self._clock_ns = 0
        self._latched: set[str] = set()
        self._publishers: dict[str, Publisher] = {}
        self._create_publishers(options.topics)
        time.sleep(_DISCOVERY_TIME)
        self._refuse_conflicts()
        self._wait_for_subscribers()
        self._pace = ReplayPace(self._start_ns, time.monotonic(), options.rate, options.paused)

    def run(self) -> None:
        """Publish until the end of the bag, again and again if asked to."""
        while not self._ended:
            self._pace.move(self._start_ns, time.monotonic())
            messages = self._bag.in_order(self._publishers, self._start_ns)
            for message in chain(self._states_at_start(), messages):
                if not self._wait_for(message):
                    return
                self._publish(message)
            self._show(self._bag.end_ns)
            self._ended |= not self._loop
        time.sleep(_END_TIME)

    def _create_publishers(self, chosen: Sequence[str]) -> None:
        known = self._bag.topics
        for name in chosen or [name for name in known if name != CLOCK]:
            if name not in known:
                raise StartError(f"--topics {name}: the bag has {', '.join(sorted(known))}")
            try:
                kind = message_class(known[name])
            except MessageError as error:
                if chosen:
                    raise StartError(f"--topics {name}: {error}") from error
                print(f"replay: {name} is left out: {error}", file=sys.stderr)
                continue
            profile = replay_profile(self._bag.offered_qos(name))
            if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                self._latched.add(name)
            self._publishers[name] = self._node.create_publisher(kind, name, profile)
        if not self._publishers:
            raise StartError(f"no topic of {self._bag.path} can be published")

    def _refuse_conflicts(self) -> None:
        """Refuse to impersonate running nodes, and to pass recorded torques to drives."""
        node = self._node
        for name in {*self._publishers, CLOCK} - _COMMON:
            others = node_names(node.get_publishers_info_by_topic, name) - {node.get_name()}
            if others:
                raise StartError(
                    f"{name} is published by {', '.join(sorted(others))} already: leave it out with --topics, or "
                    "replay into a graph of its own (another ROS_DOMAIN_ID)"
                )
            moves = name.endswith("/command") or name == SUPERVISOR_ALIVE.name
            if moves and node_names(node.get_subscriptions_info_by_topic, name) & {DRIVER, _UNKNOWN}:
                raise StartError(
                    f"{name} goes to the drives of a running {DRIVER}: no recording may move a robot"
                )
        self._checked = time.monotonic()

    def _wait_for_subscribers(self) -> None:
        deadline = time.monotonic() + _MATCHING_TIME
        while time.monotonic() < deadline and any(
            publisher.get_subscription_count() < self._node.count_subscribers(name)
            for name, publisher in self._publishers.items()
        ):
            time.sleep(0.01)

    def _states_at_start(self) -> Iterable[Message]:
        """Return what the latched topics had said before the start, for their subscribers."""
        last: dict[str, Message] = {}
        if self._start_ns > self._bag.start_ns:
            for message in self._bag.in_order(self._latched, end_ns=self._start_ns):
                last[message.topic] = message._replace(log_time_ns=self._start_ns)
        return last.values()

    def _wait_for(self, message: Message) -> bool:
        """Wait until a message is due, or belongs to a step; return False if the replay is to end before.

        Clock, keys and progress are served meanwhile.
        """
        due_ns = message.log_time_ns
        while not self._ended and self._step is None:
            now = time.monotonic()
            self._late |= self._pace.catch_up(due_ns, now)
            delay = self._pace.delay(due_ns, now)
            if delay <= 0.0 and now - self._looked < _LOOK_PERIOD:
                return True
            self._look(min(max(delay, 0.0), _CLOCK_PERIOD), now)
            self._publish_clock(min(self._pace.time_ns(time.monotonic()), due_ns))
            if delay <= 0.0 and not self._pace.paused:
                return True
        return not self._ended

    def _publish(self, message: Message) -> None:
        if message.log_time_ns - self._clock_ns >= _CLOCK_PERIOD * NANOSECONDS or self._step is not None:
            self._publish_clock(message.log_time_ns)
        self._publishers[message.topic].publish(message.data)
        if self._step is not None:
            self._pace.move(message.log_time_ns, time.monotonic())
            if self._step in ("", message.topic):
                self._step = None
                self._show(message.log_time_ns, f", {message.topic}")

    def _publish_clock(self, time_ns: int) -> None:
        self._clock_ns = time_ns
        self._clock.publish(Clock(clock=Time(nanoseconds=time_ns).to_msg()))

    def _look(self, timeout: float, now: float) -> None:
        """Watch the keyboard for this long, and everything else now and then."""
        key = self._keys.wait(timeout)
        if key:
            self._take(key, time.monotonic())
        if key or now - self._looked >= _LOOK_PERIOD:
            self._looked = now
            if not self._pace.paused or key == " ":
                self._show(self._pace.time_ns(now))
        if now - self._checked >= _CONFLICT_PERIOD:
            self._refuse_conflicts()

    def _take(self, key: str, now: float) -> None:
        pace = self._pace
        if key == " ":
            pace.pause(now, not pace.paused)
        elif key in ("s", "c", RIGHT_ARROW):
            pace.pause(now)
            self._step = MOTOR_STATES.name if key == "c" and MOTOR_STATES.name in self._publishers else ""
        elif key in ("+", "-"):
            pace.change_rate(pace.rate * (2.0 if key == "+" else 0.5), now)
        elif key == "q":
            self._ended = True

    def _show(self, time_ns: int, remark: str = "") -> None:
        start_ns, end_ns = self._bag.start_ns, self._bag.end_ns
        length = max(end_ns - start_ns, 1)
        done = min(time_ns, end_ns) - start_ns
        state = "paused" if self._pace.paused else f"{self._pace.rate:g}x"
        if self._late:
            state += ", slower than that: the computer cannot keep up"
        text = f"{done / NANOSECONDS:.3f} of {length / NANOSECONDS:.3f} s, {state}{remark}"
        show_progress(text, done / length)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = program_parser("replay", DESCRIPTION, EPILOG, EXIT_STATUS)
    add = parser.add_argument
    add("bag", metavar="BAG", type=find_bag, help="a bag, one of its files, or a run's directory")
    add(
        "--rate", type=number("a rate of 0.001 or more", 0.001), default=1.0, metavar="R",
        help="seconds of the bag per second of real time; default: 1",
    )  # fmt: skip
    add("--loop", action="store_true", help="begin again at the end")
    add(
        "--start", type=number("a time in s, 0 or more", 0.0), default=0.0, metavar="S",
        help="begin this many seconds into the bag",
    )  # fmt: skip
    add("--topics", metavar="TOPIC", nargs="+", default=[], help="publish only these; default: all")
    add("--paused", action="store_true", help="start paused")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
