"""Who can discover a process, and reach it: this computer alone, unless the user asks for more.

LOCALHOST by itself only ends the search: a host that names this one in its ROS_STATIC_PEERS still reaches sockets that
listen on all interfaces. So Fast DDS is told to listen on the loopback interface alone. Whoever asks for more, by
ROS's own variables, gets it.

Nor is shared memory used: its queues have locks, and a process that is stopped while it holds one, as by a debugger,
holds up all others that publish to it: for 2 s of 2 s in one of about ten tries, with LOCALHOST, for which ROS adds
shared memory to whatever a file says. Where the file says all of it, the range is therefore SYSTEM_DEFAULT, "as the
middleware's own configuration says".
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from pathlib import Path

from cspr_msgs_py.errors import StartError

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PEERS = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
LOOPBACK = Path(__file__).with_name("loopback.xml")
"""The transports of Fast DDS that do not leave this computer."""

TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"

_HERE = "LOCALHOST"
_AS_FILED = "SYSTEM_DEFAULT"
_FAST_DDS = "rmw_fastrtps"
_RANGES = (_HERE, "SUBNET", "OFF", _AS_FILED)


def stay_by_default(environment: MutableMapping[str, str]) -> None:
    """Choose this computer alone where the user has not chosen; comes before the first node.

    Raises
    ------
    StartError
        If ROS does not know the range that is set.
    """
    chosen = environment.get(RANGE) or _HERE
    if chosen not in _RANGES:
        raise StartError(f"{RANGE}={chosen}: ROS knows {', '.join(_RANGES)}")
    environment[RANGE] = _HERE if _is_ours(environment) else chosen
    if environment.get(PROFILES) not in (None, "", str(LOOPBACK)):
        return  # the user's own transports
    if _beyond(environment):
        environment.pop(PROFILES, None)
        environment[TRANSPORTS] = environment.get(TRANSPORTS) or "UDPv4"
        return
    environment[PROFILES] = str(LOOPBACK)
    reads_it = (environment.get("RMW_IMPLEMENTATION") or _FAST_DDS).startswith(_FAST_DDS)
    if environment[RANGE] == _HERE and reads_it:
        environment[RANGE] = _AS_FILED


def stay(environment: MutableMapping[str, str]) -> None:
    """Choose this computer alone, whatever the user has chosen: for what must never meet a robot."""
    for name in (RANGE, PROFILES, TRANSPORTS, *PEERS):
        environment.pop(name, None)
    stay_by_default(environment)


def reach(environment: Mapping[str, str]) -> str:
    """Return in words who can discover the process, once `stay_by_default` has chosen."""
    domain = f"ROS domain {environment.get('ROS_DOMAIN_ID') or 0}"
    if beyond := _beyond(environment):
        return f"{domain}, open beyond this computer: {', '.join(beyond)}"
    if environment[PROFILES] != str(LOOPBACK):
        return f"{domain}, this computer, by the transports of {environment[PROFILES]}"
    return f"{domain}, this computer alone"


def _beyond(environment: Mapping[str, str]) -> list[str]:
    """Return what the user has set to reach beyond this computer."""
    asked = [] if _is_ours(environment) or environment[RANGE] in (_HERE, "OFF") else [RANGE]
    asked += [name for name in PEERS if environment.get(name)]
    return [f"{name}={environment[name]}" for name in asked]


def _is_ours(environment: Mapping[str, str]) -> bool:
    """Return whether `stay_by_default` has chosen already, here or in the process that started this one."""
    return environment.get(RANGE) == _AS_FILED and environment.get(PROFILES) == str(LOOPBACK)
