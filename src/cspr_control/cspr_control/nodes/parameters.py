"""The robot of a node, and parameters that change together while it runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from cspr_control.errors import ControlError
from cspr_kinematics import KinematicsError, Robot
from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.parameters.table import ROBOT_CONFIG, node_parameters
from cspr_msgs_py.runtime.parameters import declare

Settings = TypeVar("Settings")


def declare_robot(node: Node) -> Robot:
    """Declare ``robot_config`` and read the robot from the file it names.

    Raises
    ------
    cspr_kinematics.ConfigurationFileError
        If the file is missing or does not describe a robot.
    """
    return Robot.from_yaml(declare(node, ROBOT_CONFIG))


class ChangeableParameters(Generic[Settings]):
    """The parameters of a node as one validated object, which changes with those that may change while it runs.

    A change is refused as a whole, with the reason, when a value does not fit the table or ``build`` raises; else
    ``apply`` gets the new object before the next callback of the node.

    Parameters
    ----------
    node
        Node that has declared its parameters.
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
        self, node: Node, build: Callable[[dict[str, Any]], Settings], apply: Callable[[Settings], None]
    ) -> None:
        self._node = node
        rows = node_parameters(node.get_name())
        self._rows = {name: row for name, row in rows.items() if node.has_parameter(name)}
        self._build = build
        self._apply = apply
        self.settings = build(self._values())
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take_over)

    def _values(self) -> dict[str, Any]:
        return {name: self._node.get_parameter(name).value for name in self._rows}

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            changes = {
                p.name: self._rows[p.name].checked(p.value) for p in parameters if p.name in self._rows
            }
            if changes:
                self._build(self._values() | changes)
        except (ControlError, KinematicsError, ParameterError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_over(self, parameters: list[Parameter]) -> None:
        if any(p.name in self._rows for p in parameters):
            self.settings = self._build(self._values())
            self._apply(self.settings)
