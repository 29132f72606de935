"""Parameters that several nodes of this package declare, and groups that change together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from cspr_control.errors import ControlError
from cspr_control.parameters.tables import NodeParameter
from cspr_kinematics import KinematicsError, Robot
from cspr_msgs_py.runtime.process import declare

Settings = TypeVar("Settings")


def declare_robot(node: Node) -> Robot:
    """Declare ``robot_config`` and read the robot from the file it names.

    Raises
    ------
    cspr_kinematics.ConfigurationFileError
        If the file is missing or does not describe a robot.
    """
    path = declare(node, "robot_config", "config/robot.yaml", "File that describes the robot", read_only=True)
    return Robot.from_yaml(path)


def declare_control_period(node: Node) -> float:
    """Declare ``control_rate`` and return the period of the control cycle, s."""
    rate: float = declare(
        node,
        "control_rate",
        250.0,
        "Rate of the control cycle, as the bus driver runs it",
        minimum=1.0,
        maximum=2000.0,
        unit="Hz",
        read_only=True,
    )
    return 1.0 / rate


def declare_all(node: Node, parameters: Sequence[NodeParameter]) -> tuple[str, ...]:
    """Declare the parameters of a table and return their names."""
    for p in parameters:
        declare(node, p.name, p.default, p.description, minimum=p.minimum, maximum=p.maximum, unit=p.unit)
    return tuple(p.name for p in parameters)


class ChangeableParameters(Generic[Settings]):
    """Parameters that may change while the node runs, taken together as one validated object.

    A change is refused as a whole, with the reason, when ``build`` raises; else ``apply`` gets the new object
    before the next callback of the node.

    Parameters
    ----------
    node
        Node that has declared the parameters.
    names
        The parameters.
    build
        Makes the settings from the values by name.
    apply
        Takes the settings over; called for changes, not for the first values.

    Attributes
    ----------
    settings
        The settings in use.

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError
        What ``build`` raises for the first values.
    """

    def __init__(
        self,
        node: Node,
        names: Sequence[str],
        build: Callable[[dict[str, Any]], Settings],
        apply: Callable[[Settings], None],
    ) -> None:
        self._node = node
        self._names = tuple(names)
        self._build = build
        self._apply = apply
        self.settings = build(self._values())
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take_over)

    def _values(self) -> dict[str, Any]:
        return {name: self._node.get_parameter(name).value for name in self._names}

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        changes = {p.name: p.value for p in parameters if p.name in self._names}
        try:
            if changes:
                self._build(self._values() | changes)
        except (ControlError, KinematicsError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_over(self, parameters: list[Parameter]) -> None:
        if any(p.name in self._names for p in parameters):
            self.settings = self._build(self._values())
            self._apply(self.settings)
