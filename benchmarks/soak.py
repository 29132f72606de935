"""An hour in simulated time and 20 minutes live, with all that a day's work has: what grows in memory and in handles.

python -m benchmarks.soak                            both, about 40 minutes; make soak
python -m benchmarks.soak --simulated 0.1 --live 0   six simulated minutes alone
python -m benchmarks.soak --json FILE                the numbers for another program
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import time
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cspr_control.closed_loop.fault_scenarios import RobotLoop, sideways
from cspr_control.closed_loop.run import closed_loop
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.demo.scenario import Scenario as LiveScenario
from cspr_control.errors import ControlError
from cspr_control.nodes.live_graph import passing_graph
from cspr_control.reference.point_to_point import PointToPoint
from cspr_kinematics import Payload
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.vocabulary import RobotState, TrajectoryName

Numbers = dict[str, Any]
CONFIG = Path("config")
_WARM_UP = 0.2  # of the duration, in which caches fill
_GROWTH = 10.0  # MB an hour, of one process, below which it is noise
_HANDLES = ("descriptors", "threads", "shared_memory_files")  # of which none must be added
_SAMPLES = 60  # of a run
_LOAD = 200.0  # kg
_LIFTING = 2.0  # s in which it comes aboard or goes
_WAY = 0.6  # m along x, there and back
_STOPPED = 10  # motions from one stop by the operator to the next
_BROKEN = 25  # motions from one fault to the next
_FAULT = "drive_silent motor_3"


@dataclass(frozen=True)
class Resources:
    """What a process has: memory, MB, descriptors, threads, and files in /dev/shm of all of them."""

    memory: float
    descriptors: int
    threads: int
    shared_memory_files: int

    @classmethod
    def of(cls, pid: int) -> Resources:
        """Read them from /proc."""
        process = Path("/proc") / str(pid)
        lines = (process / "status").read_text(encoding="utf-8").splitlines()
        status = dict(line.split(":", 1) for line in lines)
        return cls(
            memory=int(status["VmRSS"].split()[0]) * 1024e-6,
            descriptors=len(os.listdir(process / "fd")),
            threads=int(status["Threads"]),
            shared_memory_files=len(os.listdir("/dev/shm")),
        )


@dataclass
class Course:
    """The resources of one process in the course of time."""

    name: str
    times: list[float] = field(default_factory=list)  # s
    found: list[Resources] = field(default_factory=list)

    def look(self, moment: float, pid: int) -> None:
        """Add what it has at a moment, s."""
        self.times.append(moment)
        self.found.append(Resources.of(pid))

    def numbers(self, duration: float) -> Numbers:
        """Return what it had once it was warm, and what has been added until the end.

        The growth is the slope of the straight line through all samples since then, as memory comes in steps.
        """
        warm = min(bisect_left(self.times, _WARM_UP * duration), len(self.times) - 1)
        moments, found = self.times[warm:], self.found[warm:]
        slope = np.polyfit(moments, [each.memory for each in found], 1)[0] if len(moments) > 2 else 0.0
        first, last = asdict(found[0]), asdict(found[-1])
        return {
            "process": self.name,
            "memory_MB": last["memory"],
            "memory_growth_MB_per_h": float(3600.0 * slope),
            **{name: last[name] for name in _HANDLES},
            **{f"{name}_more": last[name] - first[name] for name in _HANDLES},
        }


def simulated(duration: float) -> list[Numbers]:
    """Work with drivers, buses and devices in simulated time, s; a load comes and goes, robot and drives stop."""
    course = Course("closed loop in simulated time")
    loop = closed_loop(Scenario(payload=0.0, added=(), config=CONFIG))
    began = time.monotonic()
    try:
        loop.begin()
        begin = loop.time.monotonic()
        motions, elapsed = 0, 0.0
        while elapsed < duration:
            if not course.times or elapsed >= course.times[-1] + duration / _SAMPLES:
                gc.collect()  # what is left over is a leak
                course.look(elapsed, os.getpid())
                pace = elapsed / (time.monotonic() - began)
                print(
                    f"  {elapsed / 60.0:5.1f} of {duration / 60.0:g} min simulated, {pace:.1f} times real time, "
                    f"{motions} motions, {course.found[-1].memory:.0f} MB",
                    flush=True,
                )
            _move(loop, motions)
            motions += 1
            elapsed = loop.time.monotonic() - begin
        course.look(elapsed, os.getpid())
    finally:
        loop.machine.close()
    return [course.numbers(duration)]


def _move(loop: RobotLoop, number: int) -> None:
    """Let a load come or go, move it, and stop or fail now and then."""
    load = Payload(_LOAD * (number // 2 % 2), np.zeros(3))
    loop.machine.change_payload(load, loop.time.system_ns(), _LIFTING)
    if loop.state is not RobotState.ENABLED:
        loop.time.wait(_LIFTING)
        loop.enable(60.0)
    loop.time.wait(2.0 * _LIFTING)  # the estimate follows
    way = -_WAY if number % 2 else _WAY
    loop.play(lambda here: PointToPoint(here, sideways(here, way), loop.player.limits))
    if number % _BROKEN == _BROKEN - 1:
        loop.machine.faults.inject(loop.machine.faults.read(_FAULT))
        loop.wait_for(RobotState.FAULT, 10.0)
        loop.machine.faults.clear()
        loop.time.wait(_LIFTING)
        loop.order("/supervisor/reset")
        loop.wait_for(RobotState.DISABLED, 10.0)
        return
    loop.wait_until(lambda: loop.player.phase.at_rest, 60.0, lambda: "the motion does not end")
    if number % _STOPPED == _STOPPED - 1:
        loop.order("/supervisor/stop")
        loop.wait_for(RobotState.DISABLED, 10.0)


def live(duration: float) -> list[Numbers]:
    """Let the processes of the demo run for a time, s, the robot following one trajectory after the other."""
    courses: dict[str, Course] = {}
    causes: list[str] = []
    scenario = LiveScenario(trajectory=TrajectoryName.SMOOTH_19, payload=_LOAD, added=())
    with passing_graph("soak", scenario, CONFIG) as graph:
        pids = {**graph.children.pids(), "operator": os.getpid()}
        begin = time.monotonic()
        while (elapsed := time.monotonic() - begin) < duration:
            for name, pid in pids.items():
                courses.setdefault(name, Course(f"{name}, live")).look(elapsed, pid)
            try:
                graph.make_ready(moving=True)
                graph.operator.pause("moving", duration / _SAMPLES)
            except ControlError as problem:
                if graph.client.robot_state != RobotState.FAULT:
                    raise
                causes.append(str(problem))
                graph.progress.end()
                print(f"  {elapsed / 60.0:5.1f} min: {problem}", flush=True)
    print(f"  {len(causes)} times the robot stopped of itself")
    return [course.numbers(duration) for course in courses.values()]


def main(arguments: Sequence[str] | None = None) -> int:
    """Soak, print what grew; return 1 if something did that must not."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.soak", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--simulated", type=float, default=1.0, metavar="H", help="hours in simulated time; default: 1")
    add("--live", type=float, default=20.0, metavar="MIN", help="minutes live; default: 20")
    add("--json", type=Path, metavar="FILE", help="the numbers for another program")
    options = parser.parse_args(arguments)
    rows = []
    if options.live > 0.0:
        print(f"live, {options.live:g} min", flush=True)
        rows += live(60.0 * options.live)
    if options.simulated > 0.0:
        print(f"in simulated time, {options.simulated:g} h", flush=True)
        rows += simulated(3600.0 * options.simulated)
    print(
        f"\n{'':34}{'memory, MB':>12}{'growth, MB/h':>14}{'descriptors':>13}{'threads':>12}{'/dev/shm':>10}"
    )
    for row in rows:
        descriptors, threads, files = (f"{row[name]} ({row[f'{name}_more']:+d})" for name in _HANDLES)
        print(
            f"{row['process']:34}{row['memory_MB']:>12.1f}{row['memory_growth_MB_per_h']:>14.1f}"
            f"{descriptors:>13}{threads:>12}{files:>10}"
        )
    if options.json is not None:
        write_json(options.json, rows)
    grown = [
        row["process"]
        for row in rows
        if row["memory_growth_MB_per_h"] > _GROWTH or any(row[f"{name}_more"] > 0 for name in _HANDLES)
    ]
    print(f"growing: {', '.join(grown) or 'nothing'}")
    return int(bool(grown))


if __name__ == "__main__":
    sys.exit(main())
