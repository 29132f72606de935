"""No spelling of ROS's variables is taken for protection where there is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from cspr_msgs_py.errors import StartError
from cspr_msgs_py.security.enforcement import (
    ENABLE,
    KEYSTORE,
    OVERRIDE,
    STRATEGY,
    enclave_arguments,
    enforce,
    unprotected,
)

OWN = ["--ros-args", "--enclave", "/cspr/control"]


@pytest.fixture
def keystore(tmp_path: Path) -> Path:
    (tmp_path / "enclaves" / "cspr" / "control").mkdir(parents=True)
    return tmp_path


def test_without_security_nothing_is_added() -> None:
    for environment in ({}, {ENABLE: ""}, {ENABLE: "false", STRATEGY: "Enforce"}):
        assert enclave_arguments(environment, ["control"], "control") == []
        assert unprotected(environment) == ""


def test_a_process_is_in_the_enclave_of_its_name(keystore: Path) -> None:
    environment = {OVERRIDE: "/other"}
    enforce(environment, keystore)
    assert environment == {ENABLE: "true", STRATEGY: "Enforce", KEYSTORE: str(keystore)}
    assert enclave_arguments(environment, ["control"], "control") == OWN
    assert unprotected(environment) == ""


def test_nothing_is_enforced_without_keys(tmp_path: Path) -> None:
    with pytest.raises(StartError, match="no keys for /cspr in"):
        enforce({}, tmp_path)


def test_an_enclave_that_is_given_counts(keystore: Path) -> None:
    environment: dict[str, str] = {}
    enforce(environment, keystore)
    given = ["anything", *OWN]
    assert enclave_arguments(environment, given, "anything") == []
    assert enclave_arguments(environment | {OVERRIDE: "/cspr/control"}, ["anything"], "anything") == []
    with pytest.raises(StartError, match="no keys for /mine in"):
        enclave_arguments(environment, ["control", "--ros-args", "-e", "/mine"], "control")


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({ENABLE: "1"}, "ROS_SECURITY_ENABLE=1: ROS knows true and false only"),
        ({ENABLE: "True"}, "ROS_SECURITY_ENABLE=True: ROS knows true and false only"),
        ({ENABLE: "true", STRATEGY: "enforce"}, "ROS_SECURITY_STRATEGY=enforce: ROS knows Enforce and Permissive only"),
        ({ENABLE: "true", STRATEGY: "Enforce"}, "but ROS_SECURITY_KEYSTORE names no directory"),
        ({ENABLE: "true", STRATEGY: "Enforce", KEYSTORE: "/nowhere"}, "no keys for /cspr/control in /nowhere"),
    ],
)  # fmt: skip
def test_what_ros_would_let_run_open_is_an_error(environment: dict[str, str], words: str) -> None:
    with pytest.raises(StartError, match=words):
        enclave_arguments(environment, ["control"], "control")


def test_permissive_is_said_to_be_no_protection() -> None:
    for environment in ({ENABLE: "true"}, {ENABLE: "true", STRATEGY: "Permissive"}):
        assert enclave_arguments(environment, ["control"], "control") == OWN
        assert "a process without keys runs open" in unprotected(environment)
