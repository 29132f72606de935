"""What every node process does the same way: start, topics, diagnostics, shutdown."""

import gc
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.utilities import remove_ros_args

from cspr_msgs_py.errors import MessageError, NodeError, ParameterError, failure_text, shortened
from cspr_msgs_py.message_definitions import message_class
from cspr_msgs_py.parameters.file import Heard, check_arguments
from cspr_msgs_py.parameters.table import CPU, REALTIME_PRIORITY
from cspr_msgs_py.qos import qos_profile
from cspr_msgs_py.runtime.network import creating_nodes, init_ros
from cspr_msgs_py.runtime.parameters import declare
from cspr_msgs_py.runtime.scheduling import set_cpu, set_realtime_priority
from cspr_msgs_py.runtime.time_of_day import timers_reset_at_steps
from cspr_msgs_py.security.discovery import reach
from cspr_msgs_py.security.enforcement import unprotected
from cspr_msgs_py.topics import DIAGNOSTICS, Topic
from cspr_msgs_py.wire.samples import Status, StatusArray
from cspr_msgs_py.wire.topic_codecs import topic_codec

LEAN_NODE: Final = {"enable_rosout": False, "start_parameter_services": False}
"""Keyword arguments of :class:`rclpy.node.Node` for nodes of which a process or a graph has many."""

_COLLECTION_PERIOD = 60.0  # s between garbage collections
_STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def run_nodes(
    factory: Callable[[], Sequence[Node]],
    *,
    realtime: bool = True,
    asked_before: Heard = MappingProxyType({}),
) -> int:
    """Run the nodes that `factory` creates until SIGINT or SIGTERM, and return the exit status.

    On either signal each node's ``make_safe()`` is called if it has one; the node can still publish and call services
    then. A callback that raises ends nothing: the error is one line on stderr that names the node, whose
    ``failed(error)`` is called if it has one. An error at the start ends the process, likewise in one line; errors
    that are defects of the program come with their traceback. Must be called from the
    main thread, as the last thing that the process does: afterwards it ignores both signals.

    Parameters
    ----------
    factory : callable
        Creates the nodes; called when rclpy is initialised.
    realtime : bool
        Whether the nodes have the parameter ``realtime_priority``, which puts the process under SCHED_FIFO.
        All have the parameter ``cpu``, which binds the process to one CPU.
    asked_before : mapping
        Parameters of nodes that exist only until the factory has read them.

    Returns
    -------
    int
        0 after SIGINT or SIGTERM, 1 after an error or with a parameter that no node here takes, 2 for arguments and
        parameters that nobody knows.
    """
    arguments = sys.argv
    program = os.path.basename(arguments[0])
    try:
        init_ros(arguments, Path(program).stem)
    except Exception as error:  # rcl reports arguments and parameter files with its own kinds of error
        return _report(program, error)
    try:
        if unknown := remove_ros_args(arguments)[1:]:
            print(
                f"{program}: unknown arguments: {' '.join(unknown)}; parameters follow --ros-args",
                file=sys.stderr,
            )
            return 2
        check_arguments(arguments)
        return _run(factory, arguments, program, realtime, asked_before)
    except ParameterError as error:
        _report(program, error)
        return 2
    finally:
        rclpy.try_shutdown()


def _run(
    factory: Callable[[], Sequence[Node]],
    arguments: Sequence[str],
    program: str,
    realtime: bool,
    asked_before: Heard,
) -> int:
    nodes: list[Node] = []
    status = 0
    with _stop_on_signal() as stop:
        try:
            with creating_nodes():
                nodes += factory()
            stop.armed = True
            _say_who_can_reach(nodes[0])
            _set_scheduling(nodes, realtime)
            declared = {node.get_name(): set(node.get_parameters_by_prefix("")) for node in nodes}
            check_arguments(arguments, {**asked_before, **declared})
            with timers_reset_at_steps(nodes):
                _spin(nodes, stop.future, program)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        except Exception as error:
            status = _report(*_blamed(error, program))
        for node in nodes:
            status = max(status, _make_safe(node))
        for node in nodes:
            node.destroy_node()
    return status


def _say_who_can_reach(node: Node) -> None:
    node.get_logger().info(reach(os.environ))
    if problem := unprotected(os.environ):
        node.get_logger().warning(problem)


class _Stop:
    """The request to stop, as the future that ends the executor's spinning; a thread sets it at a byte in the pipe."""

    def __init__(self, pipe: int) -> None:
        self.future = Future()
        self.armed = False  # whether nodes are there to be made safe; before, a signal interrupts the start
        self._pipe = pipe

    def on_signal(self, number: int, frame: object) -> None:
        # The main thread may be interrupted in the middle of a method of the future, with the future's lock held:
        # asked here, the future would wait for that for ever.
        if self.armed:
            with suppress(BlockingIOError):  # the pipe is full of requests
                os.write(self._pipe, b"\0")
        else:
            self.armed = True
            raise KeyboardInterrupt


@contextmanager
def _stop_on_signal() -> Iterator[_Stop]:
    """Turn SIGINT and SIGTERM into a finished future while the block runs.

    rclpy's own handlers would invalidate the context at once, before a node could make its robot safe.
    Python's run only when the main thread executes Python code, which it does not while the executor waits:
    so the interpreter's wake-up descriptor tells a thread, and the thread tells the executor.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    stop = _Stop(writing)

    def wait() -> None:
        while os.read(reading, 1) != b"":
            if stop.armed and not stop.future.done():
                stop.future.set_result(None)

    watcher = threading.Thread(target=wait, name="signals", daemon=True)
    watcher.start()
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in _STOP_SIGNALS:
        signal.signal(number, stop.on_signal)
    try:
        yield stop
    finally:
        # The process is about to end; a second Ctrl-C must not turn that into a failure.
        for number in _STOP_SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        signal.set_wakeup_fd(-1)
        os.close(writing)
        watcher.join()
        os.close(reading)


def _spin(nodes: Sequence[Node], stop: Future, program: str) -> None:
    executor = EventsExecutor()
    try:
        for node in nodes:
            executor.add_node(node)
        # What exists now stays until the end: the collector need not walk it again, nor choose its moment.
        gc.collect()
        gc.freeze()
        gc.disable()
        for node in nodes:
            node.get_logger().info(f"{node.get_name()} ready")
        while not stop.done() and rclpy.ok():
            # Without a time-out the wait can overflow: the executor then runs at full load and calls nobody.
            try:
                executor.spin_until_future_complete(stop, timeout_sec=_COLLECTION_PERIOD)
            except ExternalShutdownException:
                raise
            except Exception as error:  # the executor goes on with the next event
                _survive(nodes, *_blamed(error, program))
            else:
                gc.collect()
    finally:
        gc.enable()
        gc.unfreeze()
        for node in nodes:
            executor.remove_node(node)
        executor.shutdown()


def _set_scheduling(nodes: Sequence[Node], realtime: bool) -> None:
    # Parameters of the whole process: each of its nodes has them, the largest value counts.
    cpu = max(declare(node, CPU) for node in nodes)
    refusals = [set_cpu(cpu)] if cpu >= 0 else []
    if realtime:
        priority = max(declare(node, REALTIME_PRIORITY) for node in nodes)
        refusals += [set_realtime_priority(priority)] if priority > 0 else []
    for refusal in refusals:
        if refusal is not None:
            nodes[0].get_logger().warning(refusal)


def _survive(nodes: Sequence[Node], name: str, error: Exception) -> None:
    """Tell the node in whose callback something went wrong; what it cannot deal with ends the process after all."""
    print(f"{name}: {failure_text(error)}", file=sys.stderr, flush=True)
    for node in nodes:
        if node.get_name() == name and (failed := getattr(node, "failed", None)) is not None:
            failed(error)


def _make_safe(node: Node) -> int:
    try:
        getattr(node, "make_safe", lambda: None)()
    except Exception as error:  # the other nodes must be made safe whatever happens to this one
        return _report(node.get_name(), error)
    return 0


def _report(name: str, error: Exception) -> int:
    """Write the line that says what ended the process; return the exit status."""
    kind = type(error)
    deliberate = kind.__module__ != "builtins" or isinstance(error, OSError)
    if not deliberate:
        traceback.print_exception(error)
    text = shortened(" ".join(str(error).split())) or kind.__name__
    print(f"{name}: {text if deliberate else f'{kind.__name__}: {text}'}", file=sys.stderr, flush=True)
    return 1


def _blamed(error: Exception, program: str) -> tuple[str, Exception]:
    """Return who was at work when `error` was raised, a node or else the program, and what went wrong."""
    name = program
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if isinstance(node := frame.f_locals.get("self"), Node):
            with suppress(Exception):  # a node that could not be created has no name yet
                name = node.get_name()
    while isinstance(error, NodeError) and isinstance(error.__cause__, Exception):
        name, error = str(error), error.__cause__
    return name, error


def subscribe(node: Node, topic: Topic, callback: Callable[[Any], None]) -> Subscription:
    """Subscribe to `topic`; the callback receives message objects."""
    return node.create_subscription(message_class(topic.type), topic.name, callback, qos_profile(topic))


def subscribe_raw(node: Node, topic: Topic, callback: Callable[[bytes], None]) -> Subscription:
    """Subscribe to `topic`; the callback receives each message as CDR bytes."""
    return node.create_subscription(
        message_class(topic.type), topic.name, callback, qos_profile(topic), raw=True
    )


def advertise(node: Node, topic: Topic) -> Publisher:
    """Create the publisher of `topic`; its ``publish`` takes message objects and CDR bytes alike."""
    return node.create_publisher(message_class(topic.type), topic.name, qos_profile(topic))


def sample_publisher(node: Node, topic: Topic, number_of_motors: int = 0) -> Callable[[Any], None]:
    """Create the publisher of a topic, and return what publishes its samples; some depend on the number of motors."""
    publish, encode = advertise(node, topic).publish, topic_codec(topic, number_of_motors).encode
    return lambda sample: publish(encode(sample))


def subscribe_samples(node: Node, topic: Topic, callback: Callable[[Any], None]) -> Subscription:
    """Subscribe to a topic that does not depend on the robot; the callback receives its samples.

    Messages that cannot be read are logged and skipped.
    """
    decode = topic_codec(topic, 0).decode

    def take(message: bytes) -> None:
        try:
            sample = decode(message)
        except MessageError as error:
            node.get_logger().warning(str(error), throttle_duration_sec=1.0)
        else:
            callback(sample)

    return subscribe_raw(node, topic, take)


def steady_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Create a timer of `period` seconds on the monotonic clock, which nobody can set."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def report_health(node: Node, statuses: Callable[[], Iterable[Status]]) -> Callable[[], None]:
    """Publish the statuses of a node on ``/diagnostics`` once a second; return what publishes them at once."""
    send = sample_publisher(node, DIAGNOSTICS)

    def report() -> None:
        send(StatusArray(time.time_ns(), tuple(statuses())))

    steady_timer(node, 1.0, report)
    return report
