"""Diagnostic statuses as CDR, without ROS: they carry texts, so no template of constant layout fits them."""

from __future__ import annotations

from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.cdr import Bytes, Scanner, Writer
from cspr_msgs_py.wire.samples import Status, StatusArray


def encode_status(status: Status) -> bytes:
    """Return a diagnostic_msgs/DiagnosticStatus as CDR."""
    writer = Writer()
    _write(writer, status)
    return writer.finish()


def encode_status_array(array: StatusArray) -> bytes:
    """Return a diagnostic_msgs/DiagnosticArray as CDR, its ``frame_id`` empty."""
    writer = Writer()
    writer.time(array.stamp_ns)
    writer.string("")
    writer.count(len(array.statuses))
    for status in array.statuses:
        _write(writer, status)
    return writer.finish()


def decode_status(buffer: Bytes) -> Status:
    """Return what a diagnostic_msgs/DiagnosticStatus says; raises ValueError if the bytes are none."""
    return _read(Scanner(buffer))


def decode_status_array(buffer: Bytes) -> StatusArray:
    """Return what a diagnostic_msgs/DiagnosticArray says; raises ValueError if the bytes are none."""
    scanner = Scanner(buffer)
    stamp = scanner.time()
    scanner.string()
    return StatusArray(stamp, tuple(_read(scanner) for _ in range(scanner.count())))


def _write(writer: Writer, status: Status) -> None:
    writer.byte(status.level)
    for text in (status.name, status.message, status.hardware_id):
        writer.string(text)
    writer.count(len(status.values))
    for key, value in status.values.items():
        writer.string(key)
        writer.string(value)


def _read(scanner: Scanner) -> Status:
    level = Level(min(scanner.byte(), Level.STALE))
    name, message, hardware_id = scanner.string(), scanner.string(), scanner.string()
    values = {scanner.string(): scanner.string() for _ in range(scanner.count())}
    return Status(name, level, message, values, hardware_id)
