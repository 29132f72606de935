"""Lines of the log as CDR, without ROS."""

from __future__ import annotations

from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.cdr import Bytes, Scanner, Writer
from cspr_msgs_py.wire.samples import LogLine

SEVERITY = {Level.OK: 20, Level.WARN: 30, Level.ERROR: 40}  # INFO, WARN and ERROR of rcl_interfaces/Log
_LEVELS = {severity: level for level, severity in SEVERITY.items()}


def encode_log(line: LogLine) -> bytes:
    """Return an rcl_interfaces/Log as CDR, without a place in the source."""
    writer = Writer()
    writer.time(line.stamp_ns)
    writer.byte(SEVERITY[line.level])
    for text in (line.name, line.text, "", ""):
        writer.string(text)
    writer.count(0)
    return writer.finish()


def decode_log(buffer: Bytes) -> LogLine:
    """Return what an rcl_interfaces/Log says; raises ValueError if the bytes are none."""
    scanner = Scanner(buffer)
    stamp, severity = scanner.time(), scanner.byte()
    name, text, _, _ = (scanner.string() for _ in range(4))
    scanner.count()
    return LogLine(stamp, _LEVELS.get(severity, Level.ERROR), name, text)
