"""The executable `workspace`: its files, its summary, its exit statuses."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from cspr_control.programs.workspace import main
from cspr_kinematics import Workspace

ROBOT = str(Path(__file__).parents[3] / "config" / "robot.yaml")
COARSE = ["--robot", ROBOT, "--spacing", "0.5"]


def test_files_and_summary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    stem = tmp_path / "new" / "space"
    arguments = [*COARSE, "--payload", "0", "200", "--acceleration", "1", "1", "1", "--output", str(stem)]
    more = [
        "--euler",
        "0",
        "0",
        "0",
        "--euler",
        "0",
        "0.1",
        "0",
        "--at",
        "0",
        "0",
        "1",
        "--upper",
        "1.4",
        "0.7",
        "2.8",
    ]
    assert main([*arguments, *more]) == 0
    workspace = Workspace.load(f"{stem}.npz")
    assert Path(f"{stem}.png").read_bytes().startswith(b"\x89PNG")
    printed = capsys.readouterr().out
    assert "payload 0 to 200 kg, acceleration 1, 1, 1 m/s^2" in printed
    assert f"{2 * workspace.margin.size} in " in printed
    assert f"{workspace.volume:.3f} of" in printed
    assert "at (0, 0, 1)" in printed
    assert "inside the border" in printed


def test_nothing_feasible(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stem, numbers = str(tmp_path / "none"), tmp_path / "numbers.json"
    payload = ["--payload", "9000", "9000"]
    assert main([*COARSE, *payload, "--no-picture", "--output", stem, "--json", str(numbers)]) == 0
    assert "0.0% of the positions" in capsys.readouterr().out
    content = json.loads(numbers.read_text(encoding="utf-8"))
    assert content["feasible_share"] == 0.0
    assert "largest_margin_n" not in content
    assert not Path(f"{stem}.png").exists()


def test_without_matplotlib(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    monkeypatch.setitem(sys.modules, "matplotlib.colors", None)
    assert main([*COARSE, "--output", str(tmp_path / "space")]) == 1
    assert "--no-picture" in capsys.readouterr().err
    assert (tmp_path / "space.npz").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--payload", "10", "5"], "payload_min"),
        (["--payload", "-1", "5"], "payload_min"),
        (["--spacing", "0"], "spacing"),
        (["--at", "0", "0", "9"], "--at = [0.0, 0.0, 9.0]: outside the grid"),
        (["--robot", "missing.yaml"], "name the robot's file with --robot FILE"),
    ],
)
def test_what_cannot_be_computed_is_one_line(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*COARSE, *arguments, "--output", str(tmp_path / "space")]) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_help_and_wrong_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, status in ((["--help"], 0), (["--payload", "1"], 2), (["--nonsense"], 2)):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == status
    assert "examples:" in capsys.readouterr().out
