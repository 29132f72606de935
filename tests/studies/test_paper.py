"""The command that reproduces the paper: what it runs and what it says; the studies have tests of their own."""

import subprocess

import pytest
from studies import paper
from studies.geometries import SHIPPED
from studies.paper_results import TensionResults
from studies.statement import Statement


@pytest.fixture(autouse=True)
def computed_once(monkeypatch, tension_results):
    by_name = {SHIPPED.robot.name: "shipped"}
    monkeypatch.setattr(
        TensionResults, "compute", lambda robot: tension_results[by_name.get(robot.name, "second")]
    )


@pytest.fixture
def without_closed_loops(monkeypatch):
    """Leave out the closed loops, which take minutes, and all figures; what comes after them stays."""
    monkeypatch.setattr(paper, "draw_geometries", lambda geometries, output: None)
    monkeypatch.setattr(paper, "draw_tension_figures", lambda tensions, geometry, output: None)
    monkeypatch.setattr(paper, "_closed_loops", lambda geometries: {one.name: None for one in geometries})
    for name in ("write_loop_tables", "draw_loop_figures", "draw_platform_figure"):
        monkeypatch.setattr(paper, name, lambda results, output: None)
    monkeypatch.setattr(paper, "loop_blocks", lambda loops: {})
    monkeypatch.setattr(paper, "experiment_statements", lambda results: [])


def test_figures_6_to_10_alone(tmp_path, capsys):
    assert paper.main(["--only", "tensions", "--output", str(tmp_path)]) == 0
    names = {path.name for path in tmp_path.iterdir()}
    both = [f"{k:02}{suffix}" for k in (8, 9, 10) for suffix in ("", "_second")]
    assert names >= {f"figure_{k}.{kind}" for k in ("06", "07", *both) for kind in ("png", "svg")}
    assert names >= {*(f"figure_{k}.csv" for k in both), "paper.md", "second_geometry"}
    assert "figures 6 to 10: " in capsys.readouterr().out


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


def test_a_statement_that_fails_with_the_second_geometry_is_named(
    tmp_path, monkeypatch, capsys, without_closed_loops
):
    failed = Statement("figure 11 grows with the load", "it falls", False)
    monkeypatch.setattr(
        paper, "experiment_statements", lambda results: [failed, Statement("no measure", "1 N", None)]
    )
    assert paper.main(["--output", str(tmp_path), "--live", "none"]) == 1
    assert "it does not hold that figure 11 grows with the load: it falls" in capsys.readouterr().err


def test_the_help_names_every_option(capsys):
    with pytest.raises(SystemExit):
        paper.main(["--help"])
    text = capsys.readouterr().out
    for option in ("--only", "--live", "--speed", "--output", "--update"):
        assert option in text
