"""What this computer can keep to at best: a bare loop at the rate of the control cycle, on each CPU at once.

The loop has no middleware and next to no work. It sleeps until its moment, then keeps its CPU busy for as long as the
control cycle needs, and watches its clock. What it misses, no control loop on this computer can hold: mostly what
other guests of a virtual machine's host take.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from dataclasses import dataclass

PERIOD = 0.004  # s: 250 Hz
BUSY = 0.0015  # s: from SYNC to the last command on a quiet computer
SLACK = PERIOD - BUSY
DURATION = 20.0  # s
_PRIORITY = 50


@dataclass(frozen=True)
class Loop:
    """What one loop saw: cycles, those late by more than the slack, and the longest delay, s."""

    cycles: int
    missed: int
    worst: float
    realtime: bool


def bare_loop(cpu: int, realtime: bool) -> Loop:
    """Run the loop on one CPU, under SCHED_FIFO if it is wanted and allowed."""
    os.sched_setaffinity(0, {cpu})
    if realtime:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        except PermissionError:
            realtime = False
    cycles = missed = 0
    worst = 0.0
    due = time.monotonic()
    end = due + DURATION
    while due < end:
        due += PERIOD
        time.sleep(max(0.0, due - time.monotonic()))
        now = time.monotonic()
        delay = now - due
        done = now + BUSY
        while now < done:
            before, now = now, time.monotonic()
            delay = max(delay, now - before)
        cycles += 1
        missed += delay > SLACK
        worst = max(worst, delay)
        due = max(due, now - PERIOD)
    return Loop(cycles, missed, worst, realtime)


def main() -> None:
    """Run the loops without and with real-time priority and print what they missed."""
    cpus = sorted(os.sched_getaffinity(0))
    print(f"\n{'bare loop at 250 Hz':40}{'cycles':>9}{'missed':>9}{'share':>10}{'worst, ms':>12}")
    for realtime in (False, True):
        with multiprocessing.get_context("spawn").Pool(len(cpus)) as pool:
            loops = pool.starmap(bare_loop, [(cpu, realtime) for cpu in cpus])
        for cpu, loop in zip(cpus, loops, strict=True):
            if realtime and not loop.realtime:
                print("with real-time priority: not allowed to this user")
                return
            name = f"CPU {cpu}, {'SCHED_FIFO' if realtime else 'normal priority'}"
            share = loop.missed / loop.cycles
            print(f"{name:40}{loop.cycles:>9}{loop.missed:>9}{share:>10.3%}{1e3 * loop.worst:>12.1f}")


if __name__ == "__main__":
    main()
