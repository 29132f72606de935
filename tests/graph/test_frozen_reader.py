"""A reader that stands still holds up no controller: the whole graph, with its recorder stopped and continued."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_a_frozen_recorder_holds_up_no_controller(tmp_path: Path) -> None:
    rows = tmp_path / "rows.json"
    program = [sys.executable, "-m", "cspr_control.programs.faults", "--live", "4", "--json", str(rows)]
    run = subprocess.run(
        program, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False, env=os.environ
    )
    assert run.returncode == 0, run.stdout + run.stderr
    found = json.loads(rows.read_text(encoding="utf-8"))
    assert [row["moving"] for row in found] == [False, False, True, True]
    assert {row["state"] for row in found} == {"enabled"}
    # of the two seconds; a controller that is held up publishes nothing in all of them
    assert max(row["longest_pause_ms"] for row in found) < 500.0
    assert max(row["moved_mm"] for row in found if not row["moving"]) < 10.0
    assert "0 of 4 stopped the robot" in run.stdout
