"""How kernels are compiled, cached and announced."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "src" / "cspr_kinematics"


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    path = {"PYTHONPATH": str(PACKAGE), **environment}
    return subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **path}, capture_output=True, text=True, check=True
    )


def test_the_first_call_says_that_it_compiles_and_later_ones_do_not(tmp_path: Path) -> None:
    code = (
        "import numpy as np; from cspr_kinematics import Pose;"
        "Pose(np.zeros(3), np.eye(3)); Pose(np.zeros((2, 3)), np.eye(3))"
    )
    runs = [run_python(code, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    assert runs[0].stderr.count("compiling its kernels") == 1
    assert runs[1].stderr == ""


def test_without_a_place_for_the_cache_the_kernels_run_and_say_so_once() -> None:
    """numba finds no directory, as in an installation that cannot be written by a user without a home."""
    code = (
        "from numba.core import caching; caching.CacheImpl._locator_classes.clear();"
        "import numpy as np; from cspr_kinematics import Pose; print(Pose(np.zeros(3), np.eye(3)).batch_shape)"
    )
    run = run_python(code)
    assert run.stdout == "()\n"
    assert run.stderr.count("NUMBA_CACHE_DIR=DIRECTORY") == 1
    assert "compiling its kernels for this machine, in every process" in run.stderr
    assert run.stderr.count("\n") == 2


def test_import_is_quick_and_leaves_scipy_alone() -> None:
    code = (
        "import sys; from time import process_time as t; import numpy; a = t(); import cspr_kinematics;"
        "print(t() - a, 'scipy.optimize' in sys.modules, 'scipy.spatial' in sys.modules)"
    )
    seconds, *loaded = run_python(code).stdout.split()
    # of the processor's time: what else the machine does is not counted
    assert float(seconds) < 1.0
    assert loaded == ["False", "False"]
