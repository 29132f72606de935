"""What both drivers' nodes share: the life cycle of a managed node, and the buses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from std_srvs.srv import Trigger

from cspr_drivers.bus.can_bus import CanPorts
from cspr_drivers.bus.shared_ports import SharedPorts
from cspr_drivers.clock import Clock
from cspr_drivers.config.can_config import CanConfig
from cspr_msgs_py.parameters.table import AUTOSTART, CAN_CONFIG
from cspr_msgs_py.runtime.parameters import declare


class DriverNode(LifecycleNode):
    """A managed node that drives devices on the CAN buses.

    Configuring opens and checks the buses and sets up the devices; only when the node is active can anything be
    armed. With the parameter ``autostart`` the node configures and activates itself, and ends when it cannot.

    Parameters
    ----------
    name
        Of the node.
    config, ports
        Configuration and buses when they are shared with another node. By default both come from the parameter
        ``can_config``.
    clock
        Clock of the machine, for buses that are opened here.
    options
        Keyword arguments of `LifecycleNode`.
    """

    def __init__(
        self,
        name: str,
        config: CanConfig | None,
        ports: SharedPorts | CanPorts | None,
        clock: Clock,
        **options: Any,
    ) -> None:
        super().__init__(name, **options)
        self.config = load_config(self) if config is None else config
        self.shared_ports = (
            ports if isinstance(ports, SharedPorts) else SharedPorts(self.config, ports, clock)
        )
        self.active = False
        self._autostart = declare(self, AUTOSTART)
        self._ports: CanPorts | None = None
        self._error: Exception | None = None
        self._starting = False  # a failure then ends the process, which reports it

    def autostart(self) -> None:
        """Configure and activate, if the parameter says so.

        Raises
        ------
        Exception
            Why that failed.
        """
        if not self._autostart:
            return
        self._starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() is not TransitionCallbackReturn.SUCCESS and self._error is not None:
                raise self._error
        self._starting = False

    @property
    def ports(self) -> CanPorts:
        """The open buses of a node that is configured."""
        if self._ports is None:
            raise RuntimeError("the node is not configured")
        return self._ports

    # What a driver adds

    @abstractmethod
    def begin(self, ports: CanPorts) -> None:
        """Set up the devices."""

    @abstractmethod
    def end(self) -> None:
        """Bring the devices to rest and leave the buses. May be called more than once."""

    def disarm(self) -> None:
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
        return self._attempt(self.disarm)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave the buses."""
        return self._attempt(self._leave)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the devices to rest, and leave the buses."""
        self.active = False
        return self._attempt(self._leave)

    def make_safe(self) -> None:
        """Bring the devices to rest and leave the buses: the process ends."""
        self.active = False
        self.end()

    def destroy_node(self) -> None:
        """Destroy the node; give the buses back."""
        self._leave()
        super().destroy_node()

    def service(self, name: str, act: Callable[[], str | None], needs_active: bool = False) -> None:
        """Offer a command; `act` returns why it is refused, or `None`.

        Parameters
        ----------
        name
            Of the service, of type ``std_srvs/srv/Trigger``.
        act
            What is done.
        needs_active
            Whether the command arms something.
        """

        def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            if self._ports is None:
                refusal: str | None = f"{self.get_name()} is not configured"
            elif needs_active and not self.active:
                refusal = f"{self.get_name()} is inactive: activate it first"
            else:
                refusal = act()
            response.success = refusal is None
            response.message = refusal or "accepted"
            return response

        self.create_service(Trigger, name, answer)

    def _configure(self) -> None:
        self._ports = self.shared_ports.acquire()
        try:
            self.begin(self._ports)
        except Exception:
            self._leave()
            raise

    def _leave(self) -> None:
        if self._ports is not None:
            self.end()
            self._ports = None
            self.shared_ports.release()

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
    return CanConfig.from_yaml(Path(declare(node, CAN_CONFIG)))
