"""Reproduce the paper: `make paper`."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from time import monotonic

from cspr_control.closed_loop.record import LoopRecord
from cspr_control.errors import ControlError
from cspr_kinematics import KinematicsError
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py.errors import MessagesError
from cspr_msgs_py.programs.command_line import run_program
from studies.experiment import Case, all_cases, run_cases
from studies.experiment_statements import experiment_statements
from studies.geometries import SHIPPED, Geometry, second_geometry
from studies.live_agreement import Agreement, LiveRun, agreement
from studies.loop_results import LoopResults
from studies.paper_document import agreement_block, fill, loop_blocks, tension_blocks
from studies.paper_figures import (
    draw_geometries,
    draw_loop_figures,
    draw_platform_figure,
    draw_tension_figures,
)
from studies.paper_results import TensionResults, write_loop_tables, write_tension_tables
from studies.simulation_statements import simulation_statements
from studies.statement import Statement

ROOT = Path(__file__).parents[1]
DOCUMENT = ROOT / "docs" / "paper.md"
FIGURES = ROOT / "docs" / "paper"

DESCRIPTION = """\
Run the studies of the paper and compare them with what it states: the tensions by the static and the dynamic model
along its trajectories (figures 7 to 10), its controllers with its loads in closed loop on the simulated plant
(figures 11 and 12, faster than real time and without ROS), both with the shipped geometry and with a second one, whose
figure 9 is the paper's; and one of these cases live through the node graph.

Writes DIR/figure_NN.csv (the numbers), DIR/figure_NN.png and .svg, DIR/paper.md (the comparison), and the
configuration with the second geometry. Ends with status 1 if that one does not do all that the paper states, or if the
live run differs."""
EPILOG = """\
examples, as arguments of: make paper ARGS="..."
  --only tensions            figures 6 to 10: some seconds
  --live runs/latest         a run of the demo that is there already, instead of a new one
  --live none                without a live run
  --speed 0.5                the new live run at half its pace, on a slow or busy computer
  --update                   bring docs/paper.md and its figures up to date too"""


def main(args: Sequence[str] | None = None) -> int:
    """Run the studies; returns the exit status."""
    options = _parse(args)
    return run_program("paper", lambda: _run(options), (ControlError, KinematicsError, MessagesError))


def _run(options: argparse.Namespace) -> int:
    output = Path(options.output)
    output.mkdir(parents=True, exist_ok=True)
    geometries = (SHIPPED, second_geometry(output / "second_geometry"))
    warm_up(SHIPPED.robot)
    document = DOCUMENT.read_text(encoding="utf-8")

    began = monotonic()
    tensions = {geometry.name: TensionResults.compute(geometry.robot) for geometry in geometries}
    draw_geometries(geometries, output)
    for geometry in geometries:
        write_tension_tables(tensions[geometry.name], geometry, output)
        draw_tension_figures(tensions[geometry.name], geometry, output)
    document = fill(document, tension_blocks(tensions))
    agrees = _holds(simulation_statements(tensions[geometries[1].name]))
    print(f"figures 6 to 10: {monotonic() - began:.1f} s", flush=True)

    if options.only != "tensions":
        loops = _closed_loops(geometries)
        for result in loops.values():
            write_loop_tables(result, output)
            draw_loop_figures(result, output)
        draw_platform_figure(loops[SHIPPED.name], output)
        document = fill(document, loop_blocks(loops))
        agrees &= _holds(experiment_statements(loops[geometries[1].name]))
        if options.live != "none":
            try:
                compared = _compare_live(options.live, options.speed, output)
            except (ControlError, MessagesError) as error:  # what is done already must not be lost
                print(f"paper: {error}", file=sys.stderr)
                agrees = False
            else:
                document = fill(document, agreement_block(compared))
                agrees &= compared.within_tolerance
    (output / "paper.md").write_text(document.replace("](paper/", "]("), encoding="utf-8")
    if options.update:
        DOCUMENT.write_text(document, encoding="utf-8")
        FIGURES.mkdir(exist_ok=True)
        for picture in sorted(output.glob("*.png")):
            shutil.copyfile(picture, FIGURES / picture.name)
    print(f"written to {output}: tables, figures, paper.md")
    return 0 if agrees else 1


def _holds(statements: Sequence[Statement]) -> bool:
    """Return whether all statements hold with the second geometry; says which do not."""
    failed = [one for one in statements if one.agrees is False]
    for one in failed:
        print(
            f"paper: with the second geometry it does not hold that {one.claim}: {one.found}", file=sys.stderr
        )
    return not failed


def _closed_loops(geometries: Sequence[Geometry]) -> dict[str, LoopResults]:
    cases = [case for geometry in geometries for case in all_cases(geometry)]
    began = monotonic()
    records: dict[Case, LoopRecord] = {}
    for case, record in run_cases(cases):
        records[case] = record
        print(
            f"{len(records):3} of {len(cases)}  {case!s:70} {record.rms_deg.mean():6.2f} deg   "
            f"{record.simulated / record.elapsed:4.1f} x real time",
            flush=True,
        )
    simulated = sum(record.simulated for record in records.values())
    print(f"figures 11 and 12: {simulated:.0f} s of robot time in {monotonic() - began:.0f} s", flush=True)
    return {
        one.name: LoopResults(one, {case: record for case, record in records.items() if case.geometry == one})
        for one in geometries
    }


def _compare_live(live: str | None, speed: str, output: Path) -> Agreement:
    directory = Path(live) if live is not None else _run_demo(output / "live", speed)
    compared = agreement(LiveRun.read(directory))
    print(
        f"live against without ROS: platform {compared.live.platform_mm:.2f} and {compared.platform_mm:.2f} mm, "
        f"motors {compared.live.rms_deg.mean():.2f} and {compared.rms_deg.mean():.2f} deg, "
        f"{'within' if compared.within_tolerance else 'NOT within'} the tolerance",
        flush=True,
    )
    if not compared.within_tolerance:
        print(
            f"paper: the live run missed {compared.live.missed:.1%} of its control cycles; a stall while the "
            "trajectory jumps costs most. On a busy computer: --speed 0.5, or --live RUN with a run that kept its pace",
            file=sys.stderr,
        )
    return compared


def _run_demo(runs: Path, speed: str) -> Path:
    """Run the default case of the demo; returns the directory of the run."""
    command = [sys.executable, "-m", "cspr_control.programs.demo", "--runs", str(runs), "--speed", speed]
    if subprocess.run(command, cwd=ROOT, check=False).returncode != 0:
        raise ControlError(
            "the live run failed; --live none leaves it out, --live RUN takes another one, --speed 0.5 makes it slower"
        )
    return (runs / "latest").resolve()


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "paper", None, DESCRIPTION, EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--only", choices=["tensions"], help="what needs no plant: figures 6 to 10")
    add(
        "--live", metavar="RUN",
        help="directory of a run of the demo, or none; default: a new run, half a minute",
    )  # fmt: skip
    add(
        "--speed", default="1", metavar="FACTOR",
        help="pace of the simulated machine in a new live run, 0.1 to 1; default: %(default)s",
    )  # fmt: skip
    add(
        "--output",
        default="runs/paper",
        metavar="DIR",
        help="default: %(default)s; what is there is replaced",
    )
    add("--update", action="store_true", help="also replace the tables and figures in docs/")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
