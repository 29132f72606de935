"""Analyse recorded runs: numbers, figures and one page to look at, from one bag or several."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from cspr_control.analysis.measured_pose import MeasuredPose
from cspr_control.analysis.numbers.tables import format_runs
from cspr_control.analysis.recording import CONFIGURATION_DIRECTORY
from cspr_control.analysis.results import (
    FIGURES,
    METRICS,
    REPORT,
    default_directory,
    metrics_mapping,
    write_results,
)
from cspr_control.analysis.run_analysis import analyse_bags
from cspr_control.errors import ControlError
from cspr_msgs_py.bag.reader import find_bag
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.programs.command_line import (
    number,
    output_path,
    program_parser,
    run_program,
    show_progress,
)

DESCRIPTION = """\
Analyse recorded runs: how well platform and motors followed, what the cables carried, how good the mass estimate was.

BAG is a bag (a directory, or one of its .mcap files) or the directory of a run. Several bags of one robot
are compared side by side. No ROS graph is needed or touched. The numbers cover the trajectory that was followed,
or the whole recording if there was none. Written into the output directory:

  report.html      everything in one page that works from the file: tables, figures to zoom into, the robot in motion
  metrics.json     the numbers
  figures/         the paper's figures 7 to 12 and others, each as PNG and SVG"""
EPILOG = """\
examples:
  cspr analyze runs/latest                                  the newest run of the demo
  cspr analyze runs/A runs/B --label "kp 2" --label "kp 4"  two runs side by side
  cspr analyze BAG --robot config/robot.yaml                a bag that no configuration was attached to
  cspr analyze BAG --measured-pose /tracker/pose            the platform's error by what measured it
  cspr analyze BAG --measured-pose prism.csv --measured-point 0.2,0,-0.15 --align
  cspr analyze BAG --no-figures --json numbers.json         numbers for another program"""


def main(args: Sequence[str] | None = None) -> int:
    """Analyse the bags; returns the exit status."""
    options = _parse(sys.argv[1:] if args is None else args)
    return run_program("analyze", lambda: _run(options), (ControlError,), "what had been written stays")


def _run(options: argparse.Namespace) -> None:
    show_progress(f"reading {len(options.bags)} bag{'s' if len(options.bags) > 1 else ''}")
    runs = analyse_bags(
        options.bags,
        options.label or (),
        options.robot,
        options.config or CONFIGURATION_DIRECTORY,
        options.measured,
    )
    show_progress("")
    for remark in dict.fromkeys(remark for run in runs for remark in run.remarks):
        print(f"note: {remark}", file=sys.stderr)
    print(format_runs(runs))
    directory = options.output or default_directory(options.bags)
    pictures = write_results(
        runs,
        directory,
        figures=not options.no_figures,
        progress=lambda name: show_progress(f"writing {name}"),
    )
    if options.json is not None:
        write_json(options.json, metrics_mapping(runs))
    show_progress("")
    print(f"\nmetrics  {directory / METRICS}")
    if pictures:
        print(f"figures  {directory / FIGURES} ({len(pictures)}, each as PNG and SVG)")
    print(f"report   {directory / REPORT}")


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = program_parser("analyze", DESCRIPTION, EPILOG, json="what metrics.json holds")
    add = parser.add_argument
    add("bags", nargs="+", type=find_bag, metavar="BAG", help="what to analyse")
    add(
        "--output", type=output_path, metavar="DIR",
        help="where results are written; default: analysis/ beside the bag, comparison/ beside the first of several",
    )  # fmt: skip
    add(
        "--label", action="append", metavar="NAME",
        help="name of a run, once for each bag in their order; default: the controller that was recorded",
    )  # fmt: skip
    add("--robot", type=Path, metavar="FILE", help="the robot; default: the one attached to the bag")
    add(
        "--config", type=Path, metavar="DIR",
        help="configuration on disk, to say where the recorded one differs; default: config",
    )  # fmt: skip
    add(
        "--measured-pose", metavar="TOPIC|CSV",
        help="what measured the platform, in place of the true pose of a simulation: a topic of type "
        "geometry_msgs/msg/PoseStamped in the bag, or a file with the columns time (s), x, y, z (m, in base), and qx, "
        "qy, qz, qw if it has the orientation",
    )  # fmt: skip
    add(
        "--measured-offset", type=number("a time in s", -math.inf), metavar="S",
        help="added to the times of --measured-pose; those of a file that are no ROS times count from the start of the "
        "first trajectory, which is printed as time zero, and need it",
    )  # fmt: skip
    add(
        "--measured-point", type=_point, metavar="X,Y,Z",
        help="what was measured, in the platform's frame, m, such as the prism of a total station; default: its origin",
    )  # fmt: skip
    add(
        "--align", action="store_true",
        help="bring the frame of --measured-pose to the robot's by the rigid motion that fits the reference best",
    )  # fmt: skip
    add("--no-figures", action="store_true", help="no pictures: they take most of the time")
    options = parser.parse_args(arguments)
    if options.label and len(options.label) != len(options.bags):
        parser.error(
            f"{len(options.label)} labels for {len(options.bags)} bags: give --label once for each bag"
        )
    options.measured = _measured(parser, options)
    return options


def _measured(parser: argparse.ArgumentParser, options: argparse.Namespace) -> MeasuredPose | None:
    if options.measured_pose is None:
        for name in ("measured_offset", "measured_point", "align"):
            if getattr(options, name):
                parser.error(
                    f"--{name.replace('_', '-')} says something about --measured-pose, which is missing"
                )
        return None
    measured = MeasuredPose(
        options.measured_pose,
        options.measured_offset,
        options.measured_point or (0.0, 0.0, 0.0),
        options.align,
    )
    if measured.is_file and len(options.bags) > 1:
        parser.error(f"{measured.source} is of one run: analyse {len(options.bags)} bags one by one")
    return measured


def _point(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise argparse.ArgumentTypeError(f"{text!r} is not a point X,Y,Z in m, such as 0.2,0,-0.15")
    return x, y, z


if __name__ == "__main__":
    sys.exit(main())
