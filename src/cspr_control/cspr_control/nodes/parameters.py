"""The robot of a node, and parameters that change together while it runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

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
    return Robot.from_yaml(declare(node, ROBOT_CONFIG), "name the robot's file with -p robot_config:=PATH")


def changeable_settings(
    node: Node, build: Callable[[dict[str, Any]], Settings], apply: Callable[[Settings], None]
) -> Settings:
    """Return the parameters of a node as one validated object, which changes with those that may change in operation.

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

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError
        What ``build`` raises for the first values.
    """
    declared = node_parameters(node.get_name())
    rows = {name: row for name, row in declared.items() if node.has_parameter(name)}

    def values() -> dict[str, Any]:
        return {name: node.get_parameter(name).value for name in rows}

    def check(parameters: list[Parameter]) -> SetParametersResult:
        try:
            changes = {p.name: rows[p.name].checked(p.value) for p in parameters if p.name in rows}
            if changes:
                build(values() | changes)
        except (ControlError, KinematicsError, ParameterError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def take_over(parameters: list[Parameter]) -> None:
        if any(p.name in rows for p in parameters):
            apply(build(values()))

    settings = build(values())
    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(take_over)
    return settings
