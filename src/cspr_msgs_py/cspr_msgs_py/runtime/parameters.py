"""Declaring the parameters of the table, with description, unit and range."""

import math
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node

from cspr_msgs_py.errors import ParameterError, StartError
from cspr_msgs_py.parameters.row import NodeParameter
from cspr_msgs_py.parameters.table import TABLE


def declare(node: Node, row: NodeParameter, default: Any = None) -> Any:
    """Declare a parameter and return its value.

    Parameters
    ----------
    node : Node
    row : NodeParameter
    default
        In place of that of the table, where it depends on the robot or on the buses.

    Raises
    ------
    StartError
        If the value given on the command line or in a parameter file has another type, lies outside the range,
        is none of the choices or is not finite.
    """
    descriptor = ParameterDescriptor(description=row.description, read_only=not row.changeable)
    if row.minimum is not None or row.maximum is not None:
        if row.kind is float:
            low = -math.inf if row.minimum is None else float(row.minimum)
            high = math.inf if row.maximum is None else float(row.maximum)
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        else:
            least = -(2**63) if row.minimum is None else int(row.minimum)
            most = 2**63 - 1 if row.maximum is None else int(row.maximum)
            descriptor.integer_range = [IntegerRange(from_value=least, to_value=most, step=1)]
    try:
        value = node.declare_parameter(
            row.name, row.default if default is None else default, descriptor
        ).value
        if value is None:  # what ROS makes of an empty list
            row.checked([])
            raise ParameterError(f"{row.name} is []; leave it out for the default")
        row.checked(value)
    except ParameterException as error:
        integer_for_double = row.kind is float and "'INTEGER" in str(error)
        hint = "; a double is written with a decimal point: write 2.0 for 2" if integer_for_double else ""
        raise StartError(f"parameter {row.name}: {error}{hint}") from error
    except ParameterError as error:
        raise StartError(f"parameter {error}") from error
    return value


def declare_all(node: Node, table_name: str = "", **node_defaults: Any) -> dict[str, Any]:
    """Declare the parameters that the table has for a node, but for those declared before; raises as `declare` does.

    Parameters
    ----------
    node : Node
    table_name : str
        Under which the table has them; by default the name of the node.
    **node_defaults
        Defaults, by parameter, that depend on the robot or on the buses.

    Returns
    -------
    dict
        The value of every parameter of the table by name.
    """
    return {
        row.name: node.get_parameter(row.name).value
        if node.has_parameter(row.name)
        else declare(node, row, node_defaults.get(row.name))
        for row in TABLE[table_name or node.get_name()]
    }
