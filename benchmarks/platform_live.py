"""The whole graph live against the same case without ROS."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from studies.experiment import BARE
from studies.live_agreement import Compared, LiveRun, agreement

from benchmarks.platform_rows import Row
from cspr_control.errors import ControlError
from cspr_msgs_py.vocabulary import TrajectoryName

PACE = 0.3  # of real time, for two cores that something else uses too
_LONGEST = 600.0  # s
_MISSED = 0.5  # %; beyond it a run says something of the computer, not of the controllers


def live_against_simulated(name: str) -> list[Row]:
    """Follow smooth-19 with the whole graph, then in simulated time; how much the numbers differ."""
    with tempfile.TemporaryDirectory() as directory:
        command = [sys.executable, "-m", "cspr_control.programs.demo", "--runs", directory, f"--speed={PACE}"]
        command += ["--trajectory", TrajectoryName.SMOOTH_19, "--config", str(BARE.config)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST, check=False)
        if done.returncode != 0:
            raise ControlError(f"the demo ended with {done.returncode}: {done.stderr.strip()}")
        live = LiveRun.read(Path(directory) / "latest")
        missed = Row(name, "missed control cycles", 100.0 * live.missed, _MISSED, "%")
        return [missed, *(_row(name, one) for one in agreement(live).numbers())]


def _row(name: str, one: Compared) -> Row:
    what, _, unit = one.name.partition(", ")
    factor, unit = (100.0, "%") if one.share else (1.0, unit)
    note = f"live {one.live:.4g}, simulated {one.offline:.4g}"
    difference = factor * abs(one.deviation)
    return Row(name, f"{what}, difference", difference, factor * one.tolerance, unit, note=note)
