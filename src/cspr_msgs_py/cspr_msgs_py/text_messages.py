"""Messages made of words as raw CDR: diagnostics, log lines, texts. For readers of bags, who need no ROS.

A node sends and receives them as message objects, see :mod:`cspr_msgs_py.conversions`.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from cspr_msgs_py.cdr import Bytes, Scanner


@dataclass(frozen=True)
class Status:
    """One ``diagnostic_msgs/DiagnosticStatus``.

    Attributes
    ----------
    level : int
        0 ok, 1 warning, 2 error, 3 stale.
    name, message, hardware_id : str
    values : mapping of str to str
    """

    level: int
    name: str
    message: str
    hardware_id: str
    values: Mapping[str, str]


@dataclass(frozen=True)
class LogLine:
    """One ``rcl_interfaces/Log``: stamp in ns, level (10 debug to 50 fatal), name of the logger, text."""

    stamp_ns: int
    level: int
    name: str
    text: str


def decode_status(buffer: Bytes) -> Status:
    """Return a DiagnosticStatus.

    Raises
    ------
    ValueError
        If the bytes are not one in little-endian CDR, here and below.
    """
    return _status(Scanner(buffer))


def decode_statuses(buffer: Bytes) -> tuple[Status, ...]:
    """Return the statuses of a DiagnosticArray."""
    scanner = Scanner(buffer)
    scanner.time()
    scanner.string()  # header.frame_id
    return tuple(_status(scanner) for _ in range(scanner.count()))


def decode_log_line(buffer: Bytes) -> LogLine:
    """Return a Log message of /rosout."""
    scanner = Scanner(buffer)
    return LogLine(scanner.time(), scanner.octet(), scanner.string(), scanner.string())


def decode_text(buffer: Bytes) -> str:
    """Return the text of a ``std_msgs/String``."""
    return Scanner(buffer).string()


def _status(scanner: Scanner) -> Status:
    level = scanner.octet()
    name, message, hardware_id = scanner.string(), scanner.string(), scanner.string()
    return Status(
        level,
        name,
        message,
        hardware_id,
        {scanner.string(): scanner.string() for _ in range(scanner.count())},
    )
