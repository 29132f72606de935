"""The program `cspr stability`: what it prints, keeps and refuses."""

import json
import shutil
from pathlib import Path

import pytest

from cspr_control.programs.stability import main
from cspr_control.stability import scan
from cspr_control.stability.kept_results import results_directory

CONFIG = Path(__file__).parents[3] / "config"


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    """Let it look at the corners alone, at few gains, and keep results here."""
    monkeypatch.setattr(scan, "POSES", 2)
    monkeypatch.setattr(scan, "RATIOS", (1.0, 2.0))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_table_map_and_json(tmp_path, capsys):
    file = tmp_path / "new" / "margins.json"
    assert main([str(CONFIG), "--json", str(file)]) == 0
    printed = capsys.readouterr().out
    assert "prototype: kp 2 N m/rad, kd 0.1 N m s/rad, 250 Hz, torques 1.5 ms after SYNC" in printed
    assert "late cycles until unstable                       3   at (" in printed
    assert "gain margin through the estimate             > 100\n" in printed
    assert "unstable below a time constant of        < 0.002 s\n" in printed
    assert "OK: stable until torques come 3 cycles late; gain margin > 100\n" in printed
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["verdict"]["level"] == "OK"
    assert content["margins"]["late_cycles"]["value"] == 3
    assert content["margins"]["late_cycles"]["payload"] in (0.0, 300.0)
    assert content["safe_gains"]["safe"][0][0] is True
    assert len(list(results_directory().iterdir())) == 1


def test_what_is_refused_is_named(tmp_path, capsys):
    config = tmp_path / "config"
    shutil.copytree(CONFIG, config)
    file = config / "control.yaml"
    file.write_text(file.read_text().replace("kd: 0.1 ", "kd: 0.35 "))
    assert main([str(config)]) == 1
    error = capsys.readouterr().err
    assert "ERROR: kd is 0.35 N m s/rad" in error
    assert "lower kd" in error


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--help"], 0, "examples:"),
        (["missing"], 2, "missing/robot.yaml is not there"),
        (["--latency", "-1"], 2, "not a time in s"),
    ],
)
def test_help_and_wrong_arguments(arguments, status, said, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == status
    captured = capsys.readouterr()
    assert said in captured.out + captured.err
