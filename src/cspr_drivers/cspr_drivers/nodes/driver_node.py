"""What both drivers' nodes share: the life cycle of a managed node, and the buses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from lifecycle_msgs.srv import ChangeState
from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from std_srvs.srv import Trigger

from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.bus.shared_ports import SharedPorts
from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.driver_messages import bus_status
from cspr_drivers.drives.master import DriveMaster
from cspr_drivers.load_cells.master import LoadCellMaster
from cspr_msgs_py.errors import failure_text
from cspr_msgs_py.parameters.table import AUTOSTART, CAN_CONFIG
from cspr_msgs_py.runtime.parameters import declare
from cspr_msgs_py.runtime.process import report_health, sample_publisher, steady_timer
from cspr_msgs_py.topics import Topic
from cspr_msgs_py.vocabulary import HealthKey, Level
from cspr_msgs_py.wire.samples import Status, StatusArray

# Threads of a driver hold the interpreter for microseconds; Python's default of 5 ms is longer than a cycle.
SWITCH_INTERVAL = 0.0001  # s

_STATE_PERIOD = 0.02  # s; how soon a change of state is published

_Master = TypeVar("_Master", bound=DriveMaster | LoadCellMaster)


class DriverNode(LifecycleNode, Generic[_Master]):
    """A managed node that drives devices on the CAN buses by a master, and publishes their states.

    Configuring opens and checks the buses and sets up the devices; only when the node is active can anything be
    armed. With the parameter ``autostart`` the node configures and activates itself, and ends when it cannot.

    Parameters
    ----------
    config, ports
        Configuration and buses when they are shared with another node. By default both come from the parameter
        ``can_config``.
    clock
        Clock of the machine, for buses that are opened here.
    options
        Keyword arguments of `LifecycleNode`.

    Attributes
    ----------
    name
        Of the node, unless it is renamed.
    alone
        Whether no other node uses its buses.
    states
        Topic of the devices' states, which are published when they change, and once a second.

    Raises
    ------
    Exception
        Why the node could not configure and activate itself.
    """

    name: str
    states: Topic

    def __init__(
        self,
        config: CanConfig | None = None,
        ports: SharedPorts | None = None,
        clock: Clock = COMPUTER,
        **options: Any,
    ) -> None:
        super().__init__(self.name, **options)
        self.config = load_config(self) if config is None else config
        self.alone = ports is None
        self.shared_ports = SharedPorts(self.config, clock) if ports is None else ports
        self.active = False
        autostart = declare(self, AUTOSTART)
        self._ports: CanPorts | None = None
        self._master: _Master | None = None
        self._send_states = sample_publisher(self, self.states)
        self._published: object = None
        self._since_published = 0.0
        self._error: Exception | None = None
        self._failure = ""  # not yet reported
        self._starting = autostart  # a failure then ends the process, which reports it
        self.prepare()
        steady_timer(self, _STATE_PERIOD, self._watch_states)
        self._report_now = report_health(self, self._report)
        for trigger in (self.trigger_configure, self.trigger_activate) if autostart else ():
            if trigger() is not TransitionCallbackReturn.SUCCESS and self._error is not None:
                raise self._error
        self._starting = False

    # What a driver adds

    @abstractmethod
    def prepare(self) -> None:
        """Declare parameters, and offer topics and services."""

    @abstractmethod
    def create_master(self, ports: CanPorts) -> _Master:
        """Return the driver; it is started by the caller."""

    @abstractmethod
    def present(self, master: _Master) -> object:
        """Return the states of the devices, to find out whether they have changed."""

    @abstractmethod
    def statuses(self, master: _Master) -> list[Status]:
        """Return the states of the devices, to be published."""

    @abstractmethod
    def diagnostics(self, master: _Master) -> list[Status]:
        """Return the health of driver and devices."""

    def disarm(self, master: _Master) -> None:
        """Bring the devices to rest; they stay on the buses."""

    # Life cycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open and check the buses, and set up the devices."""
        return self._attempt(self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Allow arming."""
        self.active = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the devices to rest and no longer allow arming."""
        self.active = False
        return self._attempt(lambda: None if self._master is None else self.disarm(self._master))

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave the buses."""
        return self._attempt(self._leave)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the devices to rest, and leave the buses."""
        self.active = False
        return self._attempt(self._leave)

    def end(self) -> None:
        """Bring the devices to rest and leave the buses. May be called more than once."""
        if self._master is not None:
            self._master.stop()
            self._master = None

    def make_safe(self) -> None:
        """Bring the devices to rest and leave the buses: the process ends."""
        self.active = False
        self.end()

    def failed(self, error: Exception) -> None:
        """Say what went wrong in a callback, so that the supervisor stops the robot."""
        self._failure = failure_text(error)
        self._report_now()

    def destroy_node(self) -> None:
        """Destroy the node; give the buses back."""
        self._leave()
        super().destroy_node()

    def _LifecycleNodeMixin__on_change_state(  # the name is rclpy's
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        """Refuse a transition that the present state does not have, where rclpy raises."""
        try:
            answer: ChangeState.Response = super()._LifecycleNodeMixin__on_change_state(request, response)
        except RCLError as error:
            self.get_logger().warning(
                f"transition {request.transition.label or request.transition.id}: {error}"
            )
            response.success = False
            return response
        return answer

    def service(self, name: str, act: Callable[[_Master], str | None], needs_active: bool = False) -> None:
        """Offer a command; `act` returns why it is refused, or `None`.

        Parameters
        ----------
        name
            Of the service, of type ``std_srvs/srv/Trigger``.
        act
            Passes the command to the driver.
        needs_active
            Whether the command arms something.
        """

        def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            if self._master is None:
                refusal: str | None = f"{self.get_name()} is not configured"
            elif needs_active and not self.active:
                refusal = f"{self.get_name()} is inactive: activate it first"
            else:
                refusal = act(self._master)
            response.success = refusal is None
            response.message = refusal or "accepted"
            return response

        self.create_service(Trigger, name, answer)

    def _configure(self) -> None:
        self._ports = self.shared_ports.acquire()
        try:
            self._master = self.create_master(self._ports)
            self._master.start()
        except Exception:
            self._leave()
            raise

    def _leave(self) -> None:
        if self._ports is not None:
            self.end()
            self._ports = None
            self.shared_ports.release()

    def _watch_states(self) -> None:
        self._since_published += _STATE_PERIOD
        if self._master is not None and (
            self._since_published >= 1.0 or self.present(self._master) != self._published
        ):
            self.publish_states(self._master)

    def publish_states(self, master: _Master) -> None:
        """Publish the states of the devices as they are."""
        self._published = self.present(master)
        self._since_published = 0.0
        self._send_states(StatusArray(self.get_clock().now().nanoseconds, tuple(self.statuses(master))))

    def _report(self) -> list[Status]:
        master, ports = self._master, self._ports
        if failure := self._failure:
            self._failure = ""
            return [
                Status.of(self.get_name(), Level.ERROR, f"failed: {failure}", {HealthKey.FAILURE: failure})
            ]
        if master is None or ports is None:
            return [Status.of(self.get_name(), Level.WARN, "not configured: no bus is open", {})]
        return [*self.diagnostics(master), *(bus_status(self.name, port) for port in ports)]

    def _attempt(self, act: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            act()
        except Exception as error:
            self._error = error
            if not self._starting:
                self.get_logger().error(" ".join(str(error).split()))
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS


def load_config(node: Node) -> CanConfig:
    """Return the configuration that the node's parameter ``can_config`` names."""
    return CanConfig.from_yaml(Path(declare(node, CAN_CONFIG)), "name can.yaml with -p can_config:=PATH")
