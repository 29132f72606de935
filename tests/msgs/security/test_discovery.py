"""What the environment asks for decides who can discover a process; nothing asked for is this computer alone."""

from __future__ import annotations

import pytest

from cspr_msgs_py.errors import StartError
from cspr_msgs_py.security.discovery import (
    LOOPBACK,
    PEERS,
    PROFILES,
    RANGE,
    TRANSPORTS,
    reach,
    stay,
    stay_by_default,
)

HERE = {RANGE: "SYSTEM_DEFAULT", PROFILES: str(LOOPBACK)}


def test_the_file_names_the_loopback_interface_and_no_shared_memory() -> None:
    text = LOOPBACK.read_text(encoding="utf-8")
    assert "127.0.0.1" in text
    assert "SHM" not in text


@pytest.mark.parametrize("given", [{}, {RANGE: ""}, {RANGE: "LOCALHOST"}, HERE, {PEERS[0]: ""}])
def test_who_asks_for_nothing_stays_here(given: dict[str, str]) -> None:
    environment = given | {"ROS_DOMAIN_ID": "7"}
    stay_by_default(environment)
    assert environment.items() >= HERE.items()
    assert environment["ROS_DOMAIN_ID"] == "7"
    assert reach(environment) == "ROS domain 7, this computer alone"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({RANGE: "SUBNET"}, "open beyond this computer: ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET"),
        ({PEERS[0]: "192.0.2.7"}, "open beyond this computer: ROS_STATIC_PEERS=192.0.2.7"),
        (HERE | {PEERS[1]: "192.0.2.7"}, "open beyond this computer: ROS_DISCOVERY_SERVER=192.0.2.7"),
        ({RANGE: "SYSTEM_DEFAULT"}, "ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT"),
    ],
)
def test_who_asks_for_more_gets_it_and_is_told(given: dict[str, str], words: str) -> None:
    environment = dict(given)
    stay_by_default(environment)
    assert PROFILES not in environment
    assert environment[TRANSPORTS] == "UDPv4"
    assert environment.items() >= (given.items() - HERE.items())
    assert reach(environment).startswith("ROS domain 0, ")
    assert words in reach(environment)


def test_peers_named_later_get_the_range_in_which_ros_looks_for_them() -> None:
    environment = HERE | {PEERS[0]: "192.0.2.7"}
    stay_by_default(environment)
    assert environment[RANGE] == "LOCALHOST"


def test_other_middleware_does_not_read_the_file_and_is_kept_here_by_the_range() -> None:
    environment = {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}
    stay_by_default(environment)
    assert environment[RANGE] == "LOCALHOST"
    environment = {"RMW_IMPLEMENTATION": "rmw_fastrtps_dynamic_cpp"}
    stay_by_default(environment)
    assert environment.items() >= HERE.items()


def test_transports_of_the_user_s_own_are_kept() -> None:
    environment = {PROFILES: "mine.xml"}
    stay_by_default(environment)
    assert environment[PROFILES] == "mine.xml"
    assert "by the transports of mine.xml" in reach(environment)


def test_what_must_never_meet_a_robot_stays_here_whatever_is_asked_for() -> None:
    environment = {
        RANGE: "SUBNET",
        PROFILES: "mine.xml",
        TRANSPORTS: "LARGE_DATA",
        **dict.fromkeys(PEERS, "192.0.2.7"),
        "ROS_DOMAIN_ID": "7",
    }
    stay(environment)
    assert environment == HERE | {"ROS_DOMAIN_ID": "7"}


def test_a_range_that_ros_does_not_know_is_an_error() -> None:
    with pytest.raises(StartError, match="=subnet: ROS knows LOCALHOST, SUBNET"):
        stay_by_default({RANGE: "subnet"})
