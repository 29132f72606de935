"""The record of what has been verified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cspr_control.supervision.verified_configuration import VerifiedConfiguration
from cspr_kinematics import Robot


def test_every_change_asks_for_another_verification(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "verified.json"
    record = VerifiedConfiguration(path, robot)
    assert "no verification is on record" in record.problem("a")
    assert record.confirm("a") == ""
    assert record.problem("a") == ""
    assert record.problem("b") == "can.yaml or the home pose changed since the last verification"
    assert VerifiedConfiguration(path, robot).problem("a") == ""
    heavier = replace(robot, platform=replace(robot.platform, mass=robot.platform.mass + 0.1))
    assert (
        VerifiedConfiguration(path, heavier).problem("a") == "robot.yaml changed since the last verification"
    )


def test_a_file_that_says_nothing_is_no_verification(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "verified.json"
    for text in ("", "[]", "{", "\x00"):
        path.write_text(text, encoding="utf-8")
        assert "no verification is on record" in VerifiedConfiguration(path, robot).problem("a")
    nowhere = VerifiedConfiguration(tmp_path / "missing" / "verified.json", robot)
    assert "cannot be written: No such file" in nowhere.confirm("a")
