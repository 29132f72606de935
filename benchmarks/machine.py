"""What this computer can keep up with at best: a bare loop at the rate of the control cycle, on all CPUs at once.

The loop has no middleware and no input or output. It sleeps until its moment and then does a fixed piece of work, which
on this computer usually takes as long as the control cycle from SYNC to the last command. A cycle in which the work is
not done at the next moment is missed, and no control loop with as much work can hold it. The causes show in two
columns: the loop woke up late, or the CPU was slow: on a virtual machine the host can take time that no clock of the
guest counts as stolen.
"""

from __future__ import annotations

import multiprocessing
import os
import statistics
import time
from dataclasses import dataclass

PERIOD = 0.004  # s: 250 Hz
WORK = 0.0013  # s from SYNC to the last command on a quiet computer
DURATION = 20.0  # s
_PRIORITY = 50
_TRIALS = 200


@dataclass(frozen=True)
class Loop:
    """What one loop saw: cycles, those missed, those at less than a third of the usual speed; longest times, s."""

    cycles: int
    missed: int
    slow: int
    latest_start: float
    longest_work: float
    realtime: bool


def work(rounds: int) -> int:
    """Keep the interpreter busy."""
    total = 0
    for number in range(rounds):
        total += number & 3
    return total


def calibrated_rounds() -> int:
    """Return the rounds of `work` that take `WORK` with the pauses of a control cycle between them."""
    rounds = 5000
    for _ in range(3):
        times = []
        for _ in range(_TRIALS):
            time.sleep(PERIOD - WORK)
            start = time.monotonic()
            work(rounds)
            times.append(time.monotonic() - start)
        rounds = max(1, round(rounds * WORK / statistics.median(times)))
    return rounds


def bare_loop(cpu: int, rounds: int, realtime: bool) -> Loop:
    """Run the loop on one CPU, under SCHED_FIFO if it is wanted and allowed."""
    os.sched_setaffinity(0, {cpu})
    if realtime:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        except PermissionError:
            realtime = False
    cycles = missed = slow = 0
    latest = longest = 0.0
    due = time.monotonic()
    end = due + DURATION
    while due < end:
        due += PERIOD
        time.sleep(max(0.0, due - time.monotonic()))
        start = time.monotonic()
        work(rounds)
        done = time.monotonic()
        cycles += 1
        missed += done - due > PERIOD
        slow += done - start > 3.0 * WORK
        latest = max(latest, start - due)
        longest = max(longest, done - start)
        due = max(due, done - PERIOD)
    return Loop(cycles, missed, slow, latest, longest, realtime)


def main() -> None:
    """Run the loops without and with real-time priority and print what they missed."""
    cpus = sorted(os.sched_getaffinity(0))
    rounds = calibrated_rounds()
    print(
        f"\n{f'{1e3 * WORK:g} ms of work at 250 Hz':28}{'cycles':>8}{'missed':>8}{'share':>9}"
        f"{'slow CPU':>10}{'latest start, ms':>18}{'longest work, ms':>18}"
    )
    for realtime in (False, True):
        with multiprocessing.get_context("spawn").Pool(len(cpus)) as pool:
            loops = pool.starmap(bare_loop, [(cpu, rounds, realtime) for cpu in cpus])
        for cpu, loop in zip(cpus, loops, strict=True):
            if realtime and not loop.realtime:
                print("with real-time priority: not allowed to this user")
                return
            name = f"CPU {cpu}, {'SCHED_FIFO' if realtime else 'normal priority'}"
            print(
                f"{name:28}{loop.cycles:>8}{loop.missed:>8}{loop.missed / loop.cycles:>9.3%}"
                f"{loop.slow / loop.cycles:>10.3%}{1e3 * loop.latest_start:>18.1f}{1e3 * loop.longest_work:>18.1f}"
            )
