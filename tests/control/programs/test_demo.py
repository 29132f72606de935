"""What the demo says to a command line that it cannot carry out, before any process is started."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from cspr_control.programs.demo import main

ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def command_line(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Start where a user does, and put back what the program changes for the whole process."""
    monkeypatch.chdir(ROOT)
    monkeypatch.delenv("ROS_DOMAIN_ID")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    handlers = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, handlers, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--payload", "-5"], "is not a mass in kg"),
        (["--payload", "nan"], "is not a mass in kg"),
        (["--add-payload", "100"], "not of the form KG@S"),
        (["--add-payload", "inf@3"], "not of the form KG@S"),
        (["--payload", "10", "--add-payload=-50@3"], "takes 50 kg away from --payload 10"),
        (["--controller", "pid"], "invalid choice"),
        (["--controller", "pd", "--exact-mass"], "has no meaning"),
        (["--compare", "--exact-mass"], "has no meaning"),
        (["--compare", "--controller", "pd"], "not allowed with argument"),
        (["--trajectory", "figure-8"], "invalid choice"),
        (["--speed", "0"], "is not a number from 0.1 to 1"),
        (["--config", "nowhere"], "nowhere/robot.yaml is not there"),
        (["fast"], "unrecognized arguments"),
    ],
)
def test_wrong_options_are_refused(
    capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert words in capsys.readouterr().err


def test_a_place_for_runs_that_is_none_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "runs").write_text("a file", encoding="utf-8")
    assert main(["--runs", str(tmp_path / "runs")]) == 1
    said = capsys.readouterr().err
    assert said.startswith("demo: ")
    assert said.count("\n") == 1


def test_real_time_priority_without_the_privilege_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert main(["--realtime"]) == 2
    assert "/etc/security/limits.d/realtime.conf" in capsys.readouterr().err
