"""The command that reproduces the paper: what it runs and what it says; the studies have tests of their own."""

import subprocess

import pytest
from studies import paper
from studies.paper_results import TensionResults

from cspr_kinematics import Robot


@pytest.fixture(scope="module")
def tensions():
    """Compute what figures 7 to 10 show once for all tests."""
    return TensionResults.compute(Robot.from_yaml(paper.ROOT / "config" / "robot.yaml"))


@pytest.fixture(autouse=True)
def computed_once(monkeypatch, tensions):
    monkeypatch.setattr(TensionResults, "compute", lambda robot: tensions)


@pytest.fixture
def without_closed_loops(monkeypatch):
    """Leave out the closed loops, which take minutes, and all figures; what comes after them stays."""
    monkeypatch.setattr(paper, "draw_tension_figures", lambda tensions, robot, output: None)
    monkeypatch.setattr(paper, "_closed_loops", lambda: None)
    monkeypatch.setattr(paper, "write_loop_tables", lambda loops, robot, output: None)
    monkeypatch.setattr(paper, "draw_loop_figures", lambda loops, output: None)
    monkeypatch.setattr(paper, "loop_blocks", lambda loops: {})


def test_figures_7_to_10_alone(tmp_path, capsys):
    assert paper.main(["--only", "tensions", "--output", str(tmp_path)]) == 0
    names = {path.name for path in tmp_path.iterdir()}
    pictures = {f"figure_{k:02}.{kind}" for k in (7, 8, 9, 10) for kind in ("png", "svg")}
    assert names >= {*pictures, "figure_08.csv", "figure_09.csv", "figure_10.csv", "paper.md"}
    assert "figures 7 to 10: " in capsys.readouterr().out


@pytest.mark.parametrize(("arguments", "speed"), [([], "1"), (["--speed", "0.5"], "0.5")])
def test_a_live_run_that_fails_costs_nothing_else(
    tmp_path, monkeypatch, capsys, without_closed_loops, arguments, speed
):
    commands = []

    def run(command, **options):
        commands.append(command)
        return subprocess.CompletedProcess(command, 1)

    monkeypatch.setattr(subprocess, "run", run)
    assert paper.main(["--output", str(tmp_path), *arguments]) == 1
    (command,) = commands
    assert command[command.index("--speed") + 1] == speed
    assert "paper: the live run failed; --live none leaves it out" in capsys.readouterr().err
    assert (tmp_path / "paper.md").exists()


def test_without_a_live_run(tmp_path, without_closed_loops):
    assert paper.main(["--output", str(tmp_path), "--live", "none"]) == 0


def test_the_help_names_every_option(capsys):
    with pytest.raises(SystemExit):
        paper.main(["--help"])
    text = capsys.readouterr().out
    for option in ("--only", "--live", "--speed", "--output", "--update"):
        assert option in text
