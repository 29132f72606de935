"""The command: what it writes, what it says, how it ends."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from cspr_control.analysis.report import write_report
from cspr_control.analysis.run_analysis import RunAnalysis, analyse_bags, analyse_recording
from cspr_control.programs.analyze import main

from .conftest import CONFIG, ROOT, START

QUIET = ("--no-figures", "--config", str(CONFIG))


def test_results_lie_beside_the_bag(record: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    bag = record()
    numbers = bag.parent / "numbers.json"
    assert main([str(bag), "--json", str(numbers), *QUIET]) == 0
    directory = bag.parent / "analysis"
    assert numbers.read_bytes() == (directory / "metrics.json").read_bytes()
    shown = capsys.readouterr()
    assert "PDFF + mass" in shown.out
    assert str(directory / "report.html") in shown.out
    assert shown.err == ""
    (stored,) = json.loads((directory / "metrics.json").read_text(encoding="utf-8"))["runs"]
    assert stored["name"] == "pdff-mass"
    assert stored["position_error_deg"]["rms"] == pytest.approx([1, 2, 3, 4, 5, 6, 7, 8])
    assert stored["time_zero"] == pytest.approx(START * 1e-9, abs=1e-6)
    began = datetime.fromtimestamp(START * 1e-9, UTC)
    assert f"{began:%Y-%m-%d %H:%M:%S}.000\n" in shown.out
    assert f"{START * 1e-9:.3f}\n" in shown.out
    assert sorted(path.name for path in directory.iterdir()) == ["metrics.json", "report.html"]


def test_several_bags_are_compared_in_one_table(
    recorded_bag: Path, record: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = ("--label", "kp 2", "--label", "kp 4")
    assert main([str(recorded_bag), str(record()), "--output", str(tmp_path / "out"), *labels, *QUIET]) == 0
    assert "kp 4, by motor and cable" in capsys.readouterr().out
    stored = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))["runs"]
    assert [one["name"] for one in stored] == ["kp 2", "kp 4"]


def test_notes_go_to_the_other_stream(
    record: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(record(omitted=("/cable_tensions",))), *QUIET]) == 0
    assert "has no messages on /cable_tensions: no measured tensions" in capsys.readouterr().err


def test_what_cannot_be_analysed_is_said_in_one_line(
    tmp_path: Path, record: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path / "nothing"), *QUIET]) == 1
    said = capsys.readouterr().err
    assert said == f"analyze: there is no bag {tmp_path / 'nothing'}\n"
    (tmp_path / "file").write_text("")
    assert main([str(record()), "--output", str(tmp_path / "file"), *QUIET]) == 1
    assert "analyze: cannot read or write" in capsys.readouterr().err


def test_wrong_arguments(recorded_bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([str(recorded_bag), "--label", "a", "--label", "b"])
    assert ended.value.code == 2
    assert "2 labels for 1 bags" in capsys.readouterr().err


def test_help_teaches_and_starts_no_ros() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    code = "import sys\nfrom cspr_control.programs.analyze import main\n"
    code += "try: main(['--help'])\nexcept SystemExit: pass\n"
    code += "print('rclpy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert "examples:" in done.stdout
    assert "--robot" in done.stdout
    assert done.stdout.endswith("False\n")


def test_the_report_is_one_small_file_that_names_no_other(run: RunAnalysis, tmp_path: Path) -> None:
    path = tmp_path / "deep" / "report.html"
    write_report([run], path)
    text = path.read_text(encoding="utf-8")
    assert "://" not in text.replace("http://www.w3.org", "")
    for reference in ('<link rel="stylesheet"', "<script src", "@import", "url("):
        assert reference not in text
    assert "second </script> lift" not in text  # it would end the script that holds it
    assert "/*" not in text.split("<style>")[0]
    assert path.stat().st_size < 1_000_000


def test_the_size_of_a_report_is_bounded(record: Callable[..., Path], tmp_path: Path) -> None:
    """A minute at 250 Hz, eight motors, noise on everything that is measured."""
    (analysis,) = analyse_bags([record()], configuration_directory=CONFIG)
    recording, rng = analysis.recording, np.random.default_rng(2)
    stamps = recording.origin_ns + 4_000_000 * np.arange(15_000)

    def noisy(states):  # type: ignore[no-untyped-def]
        fields = {
            name: rng.normal(0.0, 100.0, (15_000, value.shape[1]))
            for name, value in (
                ("position", states.position),
                ("velocity", states.velocity),
                ("effort", states.effort),
            )
        }
        return replace(states, time_ns=stamps, log_time_ns=stamps, **fields)

    long = replace(
        recording, states=noisy(recording.states), setpoints=noisy(recording.setpoints),
        tensions=noisy(recording.tensions), command_torque=None,
    )  # fmt: skip
    write_report([analyse_recording(long, "noise")], tmp_path / "report.html")
    assert 1_000_000 < (tmp_path / "report.html").stat().st_size < 5_000_000
