"""Compute the stability of a loop in a process of its own, and keep the result.

The configuration comes pickled on standard input. The margins are waited for before anything moves; what is asked for
later is computed when nobody else wants the CPU.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from contextlib import suppress

from cspr_control.errors import ControlError
from cspr_control.stability.kept_results import KeptResult, keep_result, kept_result
from cspr_control.stability.loop_configuration import LoopConfiguration
from cspr_control.stability.scan import LoopScan
from cspr_kinematics import KinematicsError
from cspr_msgs_py.programs.linear_algebra import ONE_THREAD

_SAFE_GAINS = "--safe-gains"


def start_computing(loop: LoopConfiguration, safe_gains: bool = False) -> subprocess.Popen[bytes]:
    """Start computing the margins of a loop, or besides, while the robot may move, the map of its safe gains.

    The reason of a failure is a line on the process's stderr.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", __name__, *([_SAFE_GAINS] if safe_gains else [])],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env=os.environ | ONE_THREAD,
        start_new_session=True,  # Ctrl-C is for those who started it, who then end it
    )
    if safe_gains:
        _let_others_first(process.pid)
    assert process.stdin is not None
    with process.stdin:
        pickle.dump(loop, process.stdin)
    process.stdin = None  # or its last words could not be heard
    return process


def main() -> int:
    """Compute margins and keep them; if it is asked for, the map of safe gains as well."""
    loop: LoopConfiguration = pickle.load(sys.stdin.buffer)
    try:
        known = kept_result(loop)
        scan = LoopScan(loop)
        report = scan.report() if known is None else known.report
        if known is None:
            keep_result(KeptResult(loop.fingerprint, report))
        if _SAFE_GAINS in sys.argv:
            keep_result(KeptResult(loop.fingerprint, report, scan.safe_gains()))
    except (ControlError, KinematicsError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _let_others_first(process: int) -> None:
    """Let a process that has just begun run when no other wants the CPU; it has inherited the priority of control."""
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(process, os.SCHED_IDLE, os.sched_param(0))
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process, 19)


if __name__ == "__main__":
    sys.exit(main())
