"""Messages on ``/parameter_events``: which parameters a node declared, and how they were changed while it ran."""

from dataclasses import dataclass
from typing import Any, Final

from cspr_msgs_py.wire.cdr import Bytes, Scanner

TOPIC: Final = "/parameter_events"
TYPE: Final = "rcl_interfaces/msg/ParameterEvent"

# rcl_interfaces/msg/ParameterType, in the order of the fields of rcl_interfaces/msg/ParameterValue
_NOT_SET: Final = 0
_SCALARS: Final = ("bool", "integer", "double", "string")
_ARRAYS: Final = ("byte", "bool", "integer", "double", "string")


@dataclass(frozen=True)
class ParameterEvent:
    """One message.

    Attributes
    ----------
    node : str
        Name of the node, without the leading slash.
    declared, changed : dict
        Values by name; None for a parameter that is not set.
    """

    node: str
    declared: dict[str, Any]
    changed: dict[str, Any]


def decode_parameter_event(buffer: Bytes) -> ParameterEvent:
    """Decode a message.

    Raises
    ------
    ValueError
        If the bytes are not a ParameterEvent in little-endian CDR.
    """
    scanner = Scanner(buffer)
    scanner.time()
    node = scanner.string().strip("/")
    declared, changed, _deleted = (
        dict(_parameter(scanner) for _ in range(scanner.count())) for _ in range(3)
    )
    return ParameterEvent(node, declared, changed)


def _parameter(scanner: Scanner) -> tuple[str, Any]:
    name, kind = scanner.string(), scanner.byte()
    values = [_NOT_SET, *(_value(scanner, scalar) for scalar in _SCALARS)]
    values += [[_value(scanner, array) for _ in range(scanner.count())] for array in _ARRAYS]
    if kind >= len(values):
        raise ValueError(f"parameter {name} is of type {kind}, which does not exist")
    return name, None if kind == _NOT_SET else values[kind]


def _value(scanner: Scanner, kind: str) -> Any:
    if kind == "bool":
        return bool(scanner.byte())
    return getattr(scanner, kind)()
