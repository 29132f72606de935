"""Compute how far the closed loop is from instability, and what to change."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cspr_control.errors import ControlError
from cspr_control.parameters.control_settings import control_settings, robot_file
from cspr_control.stability.kept_results import KeptResult, keep_result
from cspr_control.stability.loop_configuration import LATENCY, LoopConfiguration
from cspr_control.stability.safe_gains import SafeGains
from cspr_control.stability.scan import (
    REFUSED_GAIN_MARGIN,
    REFUSED_LATE,
    LoopScan,
    Margin,
    StabilityReport,
)
from cspr_control.stability.verdict import WARNED_GAIN_MARGIN, verdict
from cspr_kinematics import KinematicsError, Robot
from cspr_msgs_py.errors import MessagesError
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.programs.command_line import number, program_parser, run_program, show_progress

DESCRIPTION = f"""\
Compute the stability of the closed loop: platform, elastic cables, winches and sampled controllers, with the
estimate of the payload that the feed-forward uses. From the configuration alone; nothing is simulated.

The loop is linearised at 27 poses of the workspace, level, empty and with max_payload. What is printed is the worst
of them, and where that is. `control` refuses to start with settings that are unstable when torques come
{REFUSED_LATE} cycle late, or whose gain margin is below {REFUSED_GAIN_MARGIN:g}, and warns below
{WARNED_GAIN_MARGIN:g}; while it runs it refuses changes of kp and kd that are not on the map printed last. The results
are kept, so that `control` need not compute them. docs/stability.md explains them."""
EPILOG = """\
examples:
  cspr stability                          the configuration in config/
  cspr stability my_robot/config --json margins.json
  cspr stability --latency 0.003          torques that come later, as over a slow bus"""
EXIT_STATUS = (
    "exit status: 0 enough, 1 not enough or not computed, for the reason on stderr, 2 wrong arguments, "
    "130 interrupted"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute and print; returns the exit status."""
    parser = program_parser("stability", DESCRIPTION, EPILOG, EXIT_STATUS, json="margins, verdict and map")
    parser.add_argument(
        "config", type=_directory, nargs="?", default="config", metavar="DIR",
        help="directory with robot.yaml and control.yaml; default: %(default)s",
    )  # fmt: skip
    parser.add_argument(
        "--latency", type=number("a time in s, 0 or more", 0.0, 1.0), default=LATENCY, metavar="S",
        help="from SYNC until the torques that answer it act; default: %(default)s",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    return run_program(
        "stability", lambda: _run(options), (ControlError, KinematicsError, MessagesError), "nothing was kept"
    )


def _run(options: argparse.Namespace) -> int:
    parameters = ParameterFile.from_yaml(options.config / "control.yaml")
    robot = Robot.from_yaml(options.config / robot_file(parameters))
    loop = LoopConfiguration.of(robot, control_settings(robot, parameters), options.latency)
    scan = LoopScan(loop, show_progress)
    report, safe = scan.report(), scan.safe_gains()
    show_progress("")
    keep_result(KeptResult(loop.fingerprint, report, safe))
    judged = verdict(report, loop)
    print("\n".join(_table(report, loop)))
    print()
    print("\n".join(_map(safe)))
    print()
    if options.json is not None:
        values: dict[str, Any] = {"margins": _json(report), "safe_gains": safe}
        values["verdict"] = {"level": judged.level.name, "text": judged.text, "remedy": judged.remedy}
        write_json(options.json, values)
    print(f"{judged.level.name}: {judged}", file=sys.stderr if judged.refused else sys.stdout)
    return int(judged.refused)


def _table(report: StabilityReport, loop: LoopConfiguration) -> list[str]:
    rows = (
        ("decay of the slowest mode", "decay", " 1/s"),
        ("  of the controllers alone", "mechanical_decay", " 1/s"),
        ("late cycles until unstable", "late_cycles", ""),
        ("gain margin through the estimate", "gain_margin", ""),
        ("unstable below a time constant of", "smallest_time_constant", " s"),
        ("least stiffness of the held platform", "held_stiffness", " N/m"),
    )
    words = report.words()
    heading = f"{loop.robot.name}: kp {loop.gains.kp:g} N m/rad, kd {loop.gains.kd:g} N m s/rad, "
    heading += f"{loop.control_rate:g} Hz, torques {loop.latency * 1e3:g} ms after SYNC"
    return [heading, *(_row(what, words[name] + unit, getattr(report, name)) for what, name, unit in rows)]


def _row(name: str, value: str, margin: Margin) -> str:
    place = "" if margin.place is None else f"   at {margin.place}"
    return f"  {name:<38}{value:>12}{place}"


def _map(safe: SafeGains) -> list[str]:
    lines = ["gains with margins (+) and without (.); kp downwards, kd to the right:"]
    lines.append("  " + " " * 8 + "".join(f"{kd:>8.3g}" for kd in safe.kd))
    for kp, row in zip(safe.kp, safe.safe, strict=True):
        lines.append(f"  {kp:>8.3g}" + "".join(f"{'+' if each else '.':>8}" for each in row))
    return lines


def _json(report: StabilityReport) -> dict[str, Any]:
    return {
        name: {
            "value": margin.value,
            "position": None if margin.place is None else margin.place.position,
            "payload": None if margin.place is None else margin.place.payload,
        }
        for name, margin in vars(report).items()
    }


def _directory(text: str) -> Path:
    for name in ("robot.yaml", "control.yaml"):
        if not Path(text, name).is_file():
            raise argparse.ArgumentTypeError(
                f"{text}/{name} is not there: start from the repository's root or name the directory"
            )
    return Path(text)


if __name__ == "__main__":
    sys.exit(main())
