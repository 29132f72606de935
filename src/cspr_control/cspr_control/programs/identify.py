"""Identify what the robot's description lacks from one recorded run: the radius of its pulleys."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cspr_control.analysis.recording import read_recording
from cspr_control.calibration.pulley_radius import PulleyRadius, identify_pulley_radius
from cspr_control.calibration.samples import calibration_samples
from cspr_control.errors import ControlError
from cspr_kinematics import KinematicsError, Robot
from cspr_msgs_py.bag.reader import find_bag
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.programs.command_line import number, program_parser, run_program, show_progress

DESCRIPTION = """\
Identify the radius of the pulleys, one for all cables, from one recorded run.

Seven or more cables give more lengths than a pose has coordinates: they fit one only if the geometry in robot.yaml is
right. Pulleys that nobody configured show as a misfit of the lengths that grows away from home; pose_estimator warns of
it. Here it is found with which radius the lengths fit best, and how well this run tells. Needed are motor angles and,
for the stretch of the cables, tensions; the robot may carry anything. No ROS graph is needed or touched.

Printed are the radius with its standard deviation, the misfit of the lengths before and after, and what to write into
robot.yaml. The swivel axes are those of robot.yaml: upwards unless it says otherwise. Errors of exit and anchor points
look a little like pulleys; what that costs is in the standard deviation. robot.yaml is not changed."""
EPILOG = """\
examples:
  cspr closed_loop --trajectory smooth-19 --bag runs/try/bag && cspr identify runs/try     on the simulated robot
  cspr identify runs/latest                           the newest run of the demo
  cspr identify BAG --robot config/robot.yaml         with another description than the one recorded
  cspr identify BAG --deviation 2                     refuse what is not known to 2 mm"""
JSON = "radius_m, standard_deviation_m, misfit_before_m, misfit_after_m, samples and the YAML"


def main(args: Sequence[str] | None = None) -> int:
    """Identify the radius; returns the exit status."""
    options = _parse(sys.argv[1:] if args is None else args)
    return run_program(
        "identify", lambda: _run(options), (ControlError, KinematicsError), "nothing was written"
    )


def _run(options: argparse.Namespace) -> None:
    show_progress("reading the recording")
    recording = read_recording(options.bag, options.robot)
    robot = recording.configuration.robot
    samples = calibration_samples(recording, robot)
    show_progress(f"fitting {len(samples.motor_angles)} places")
    found = identify_pulley_radius(robot, samples, 1e-3 * options.deviation)
    show_progress("")
    if samples.tensions is None and robot.cables.stretch:
        print(
            "note: no tensions were recorded: the stretch of the cables is taken to be that at home",
            file=sys.stderr,
        )
    entry = _entry(robot, found)
    print(_described(robot, recording.configuration.robot_file, found, entry))
    if options.json is not None:
        write_json(options.json, _numbers(found, entry))


def _entry(robot: Robot, found: PulleyRadius) -> str:
    """Return the entry of robot.yaml."""
    axes = robot.pulleys.swivel_axis.tolist()
    return f"pulleys:\n  radius: {found.radius:.4f}\n  swivel_axis: {axes}\n"


def _described(robot: Robot, file: str, found: PulleyRadius, entry: str) -> str:
    configured = 1e3 * robot.pulleys.radii(robot.number_of_cables)
    low, high = configured.min(), configured.max()
    believed = f"{low:.1f} mm" if low == high else f"{low:.1f} to {high:.1f} mm"
    apart = max(abs(low - 1e3 * found.radius), abs(high - 1e3 * found.radius))
    verdict = f"Write into {file}:\n\n{entry}"
    if apart <= 2e3 * found.deviation:
        verdict = f"{file} agrees with this run: there is nothing to change.\n"
    return (
        f"radius of the pulleys   {1e3 * found.radius:.1f} mm, standard deviation {1e3 * found.deviation:.1f} mm\n"
        f"  in {file:<20} {believed}\n"
        f"misfit of the lengths   {1e3 * found.misfit_before:.3f} mm before, {1e3 * found.misfit_after:.3f} mm after "
        f"(RMS of {found.samples} places)\n\n{verdict}"
    )


def _numbers(found: PulleyRadius, entry: str) -> dict[str, Any]:
    values = asdict(found)
    names = {"radius": "radius_m", "deviation": "standard_deviation_m", "misfit_before": "misfit_before_m"}
    names["misfit_after"] = "misfit_after_m"
    return {names.get(name, name): value for name, value in values.items()} | {"yaml": entry}


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = program_parser("identify", DESCRIPTION, EPILOG, json=JSON)
    add = parser.add_argument
    add("bag", type=find_bag, metavar="BAG", help="the run: a bag, or the directory of one")
    add("--robot", type=Path, metavar="FILE", help="the robot's file; default: the one attached to the bag")
    add(
        "--deviation", type=number("a standard deviation", 0.0), default=5.0, metavar="MM",
        help="refuse a radius of a larger standard deviation, mm; default: %(default)s",
    )  # fmt: skip
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
