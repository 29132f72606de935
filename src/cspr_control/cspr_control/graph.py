"""The control graph: all control, wired once.

`ControlGraph` holds the components (trajectory player, feed-forward, one controller for each motor, estimation of pose
and payload, supervision) and the routes between them, which follow from the topics that each one hears. It reads no
clock, starts no thread and knows nothing of ROS: the nodes drive it with what arrives on topics, the closed loop with
simulated devices in simulated time, a re-run with a recording, the tests with a script.

To wire and drive it::

    graph = control_graph(robot, control_settings(robot, ParameterFile.from_yaml("config/control.yaml")))
    outputs = graph.begin(now)                       # the latched states, before anything has arrived
    outputs = graph.on(topic, now, sample)           # what came from outside; the inner topics are fed through
    outputs = graph.advance(now)                     # what was due by now: updates, checks, diagnostics
    decision, outputs = graph.call(now, "/supervisor/enable")

``now`` is monotonic time in s and never goes back; stamps in samples are ROS time in ns. ``outputs`` come in the order
in which they came about, those that other components have heard as well:

- `Publication(topic, sample)`: for the drives, the recorder and all other subscribers.
- `Call(component, service)`: a service to be called, of the drivers or of the graph itself. When its answer is there,
  some time later, it goes to ``graph.answered(now, call, accepted, message)``. The graph itself never
  answers, so that its caller decides how long a service takes.
- `Remark(component, level, text)`: a line for the log.

Samples are the records of `cspr_msgs_py.wire`; `cspr_msgs_py.wire.topic_codecs` turns them into the bytes of messages.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from heapq import heapify, heappush, heapreplace
from typing import Any, NamedTuple

from cspr_control.components.component import Call, Component, Output, Outputs, Publication, Timer
from cspr_control.components.feedforward import FeedforwardComponent
from cspr_control.components.motor import MotorComponent
from cspr_control.components.payload import PayloadComponent
from cspr_control.components.pose import PoseComponent
from cspr_control.components.supervision import SupervisionComponent
from cspr_control.components.trajectory import TrajectoryComponent
from cspr_control.parameters.control_settings import ControlSettings
from cspr_control.supervision.supervisor import Decision
from cspr_kinematics import Robot
from cspr_msgs_py.topics import Topic

ORDER = (
    MotorComponent,
    TrajectoryComponent,
    FeedforwardComponent,
    PoseComponent,
    PayloadComponent,
    SupervisionComponent,
)
"""The components of the graph in the order in which they hear a topic: the most urgent answers first."""


class Route(NamedTuple):
    """A way of a topic: the component that hears it, as which of its inputs, and what takes the samples."""

    component: Component
    input: Topic
    handle: Callable[[float, Any], Outputs]


class ControlGraph:
    """Components and the routes between them.

    Parameters
    ----------
    components
        In the order in which they hear a topic.
    heard_instead
        Topics that a component hears in place of one of its inputs, by the names of the component and of the input:
        ``{("feedforward", "/payload"): SIMULATED_PAYLOAD}`` tells the feed-forward the true payload.

    Attributes
    ----------
    components
        By name.
    inputs
        Topics that some component hears, by name.
    services
        The commands that `call` takes, by name.
    """

    def __init__(
        self,
        components: Iterable[Component] = (),
        heard_instead: Mapping[tuple[str, str], Topic] | None = None,
    ) -> None:
        self.components: dict[str, Component] = {}
        self.inputs: dict[str, Topic] = {}
        self._heard_instead = heard_instead or {}
        self._routes: dict[str, list[Route]] = {}
        self.services: dict[str, Any] = {}
        # A heap: when each timer is due next, monotonic s, which of those due at one moment comes first, and whose
        # it is.
        self._due: list[tuple[float, int, Component, Timer]] = []
        for component in components:
            self.add(component)

    def add(self, component: Component) -> tuple[Topic, ...]:
        """Wire one more component; returns the topics that nobody has heard before it."""
        self.components[component.name] = component
        self.services |= component.services()
        new = []
        for own in component.inputs:
            topic = self._heard_instead.get((component.name, own.name), own)
            if topic.name not in self.inputs:
                self.inputs[topic.name] = topic
                new.append(topic)
            self._routes.setdefault(topic.name, []).append(Route(component, own, component.handler(own)))
        return tuple(new)

    def end(self, name: str) -> None:
        """Let a component end from one moment to the next, as by SIGKILL."""
        ended = self.components.pop(name)
        for routes in self._routes.values():
            routes[:] = [route for route in routes if route.component is not ended]
        for service in ended.services():
            del self.services[service]
        self._due = [due for due in self._due if due[2] is not ended]
        heapify(self._due)

    def start(self, component: Component, now: float) -> list[Output]:
        """Start a component while the others run; it hears topics last. Return what it publishes first."""
        self.add(component)
        self._set_timers(component, now)
        return self._through(component.begin(), now)

    def _set_timers(self, component: Component, now: float) -> None:
        first = 1 + max((order for _, order, _, _ in self._due), default=-1)
        for order, timer in enumerate(component.timers(), first):
            heappush(self._due, (now + timer.period, order, component, timer))

    def routes(self, topic: Topic) -> Sequence[Route]:
        """Return the routes of a topic, one for each component that hears it, in their order.

        For callers that send each answer at once, so that it does not wait for less urgent ones. Components that are
        added later come last.
        """
        return self._routes.setdefault(topic.name, [])

    def deliver(self, topic: Topic, now: float, sample: Any) -> list[Output]:
        """Give a sample to those that hear the topic, and return what they answer, without feeding it through."""
        outputs: list[Output] = []
        for _, _, handle in self._routes.get(topic.name, ()):
            outputs += handle(now, sample)
        return outputs

    def on(self, topic: Topic, now: float, sample: Any) -> list[Output]:
        """Give a sample to those that hear the topic, what they publish to those that hear that, and so on.

        Everybody hears what is older first: all answers to one sample before the answers to any of them.
        """
        return self._through(self.deliver(topic, now, sample), now)

    def disturb(self, topic: Topic, through: Callable[[Any], Any | None]) -> Callable[[], None]:
        """Let samples go through a function before anybody hears them, None for nothing; return what ends that."""
        routes = self._routes.setdefault(topic.name, [])
        heard = list(routes)

        def hear(now: float, sample: Any) -> list[Output]:
            passed = through(sample)
            return [] if passed is None else [out for route in heard for out in route.handle(now, passed)]

        def end() -> None:
            routes[:] = heard

        routes[:] = [route._replace(handle=hear) for route in heard[:1]]
        return end

    def refuse(self, topic: Topic, problem: str) -> None:
        """Let those that hear the topic count a message that could not be read."""
        for component, own, _ in self._routes.get(topic.name, ()):
            component.refuse(own, problem)

    def begin(self, now: float) -> list[Output]:
        """Return what is published before anything has arrived; timers count from here."""
        self._due = []
        for component in self.components.values():
            self._set_timers(component, now)
        begun = (component.begin() for component in self.components.values())
        return self._through([output for outputs in begun for output in outputs], now)

    def advance(self, now: float) -> list[Output]:
        """Let each timer that is due by now do its work, each at the time at which it was due, in that order."""
        if not self._due:
            return self.begin(now)
        outputs: list[Output] = []
        while self.next_due <= now:
            time, order, component, timer = self._due[0]
            outputs += self._through(timer.run(time), time)
            heapreplace(self._due, (time + timer.period, order, component, timer))
        return outputs

    @property
    def next_due(self) -> float:
        """Monotonic time at which `advance` has something to do, s."""
        return self._due[0][0]

    def call(self, now: float, service: str) -> tuple[Decision, list[Output]]:
        """Give a command to the component whose service it is; raises KeyError for another's."""
        decision, outputs = self.services[service](now)
        return decision, self._through(outputs, now)

    def answered(self, now: float, call: Call, accepted: bool, message: str) -> list[Output]:
        """Give the answer to a call to the component that it came from."""
        return self._through(self.components[call.component].answered(now, call, accepted, message), now)

    def _through(self, outputs: Iterable[Output], now: float) -> list[Output]:
        """Feed publications to those that hear them; return them with all that comes of it."""
        through = list(outputs)
        for output in through:  # which grows on the way
            if isinstance(output, Publication):
                for _, _, handle in self._routes.get(output.topic.name, ()):
                    through += handle(now, output.sample)
        return through


def control_graph(
    robot: Robot,
    settings: ControlSettings,
    heard_instead: Mapping[tuple[str, str], Topic] | None = None,
) -> ControlGraph:
    """Wire all components for a robot.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    settings
        See `cspr_control.parameters.control_settings`.
    heard_instead
        See `ControlGraph`.
    """
    period = 1.0 / settings.control_rate
    components = (
        *(
            MotorComponent(number, robot.motor, settings.gains, timeout)
            for number, timeout in enumerate(settings.setpoint_timeouts, start=1)
        ),
        TrajectoryComponent(robot, settings.trajectory, period),
        FeedforwardComponent(robot, settings.feedforward),
        PoseComponent(robot, settings.pose_rate, period),
        PayloadComponent(robot, settings.payload),
        SupervisionComponent(robot, settings.supervision),
    )
    return ControlGraph(sorted(components, key=lambda each: ORDER.index(type(each))), heard_instead)
