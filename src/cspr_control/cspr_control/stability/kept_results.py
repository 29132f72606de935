"""Results that are kept from one start to the next, in a file for each configuration."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import msgspec

from cspr_control.stability.loop_configuration import LoopConfiguration
from cspr_control.stability.safe_gains import SafeGains
from cspr_control.stability.scan import StabilityReport


@dataclass(frozen=True)
class KeptResult:
    """What has been computed of a configuration.

    Attributes
    ----------
    fingerprint
        Of the configuration.
    report
        Its margins.
    safe_gains
        None while they are still being computed.
    """

    fingerprint: str
    report: StabilityReport
    safe_gains: SafeGains | None = None


def results_directory() -> Path:
    """Return the directory of the results, in that of the user's caches (XDG base directory specification)."""
    caches = os.environ.get("XDG_CACHE_HOME", "")
    base = Path(caches) if os.path.isabs(caches) else Path.home() / ".cache"
    return base / "cspr" / "stability"


def kept_result(loop: LoopConfiguration) -> KeptResult | None:
    """Return what is known of a configuration; None if that is nothing, or cannot be read: then compute it again."""
    fingerprint = loop.fingerprint
    try:
        result = msgspec.json.decode(_file(fingerprint).read_bytes(), type=KeptResult)
    except (OSError, msgspec.DecodeError):
        return None
    return result if result.fingerprint == fingerprint else None


def keep_result(result: KeptResult) -> None:
    """Keep a result; whoever reads meanwhile finds the one before or this one, whole.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    path = _file(result.fingerprint)
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, name = tempfile.mkstemp(dir=path.parent)
    try:
        with open(descriptor, "wb") as file:
            file.write(msgspec.json.encode(result))
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


def _file(fingerprint: str) -> Path:
    return results_directory() / f"{fingerprint}.json"
