"""Run the whole robot on this computer: the node graph on simulated drives, recorded and analysed."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import Any

from cspr_control.analysis.numbers.run_summary import RunSummary, format_comparison, format_summary
from cspr_control.analysis.numbers.tables import format_runs
from cspr_control.analysis.recording import read_recording
from cspr_control.analysis.results import FIGURES, REPORT, default_directory, write_results
from cspr_control.analysis.run_analysis import RunAnalysis, analyse_recording
from cspr_control.demo.ros_domain import claim_domain
from cspr_control.demo.scenario import Scenario
from cspr_control.errors import ControlError
from cspr_control.nodes.live_graph import live_graph
from cspr_control.parameters.experiment import MEASURING, SETTLING
from cspr_control.programs.arguments import add_experiment_arguments, chosen_experiment
from cspr_msgs_py.errors import StartError
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.programs.command_line import number, program_parser, run_program
from cspr_msgs_py.security.discovery import stay
from cspr_msgs_py.security.enforcement import enforce
from cspr_msgs_py.vocabulary import Controller, FeedforwardModel, TrajectoryPhase

COMPARED = [*((controller, False) for controller in Controller), (Controller.PDFF, True)]
DESCRIPTION = """\
Run the complete node graph on a simulated robot, record it, and report how well it did.

Three processes are started, on this computer alone (control, the simulated robot, the recorder). The robot is enabled,
moves to the start of the trajectory, follows it with a payload that the controller does not know of, picks up
another one on the way, stops and closes its brakes. Everything lies in runs/<UTC time>/, runs/latest points there:
bag/ (MCAP), config/ (what was used), log/, summary.json, analysis/ (report.html, figures, metrics.json)."""
EPILOG = """\
examples:
  cspr demo                                    the feed-forward with the estimated mass, 100 kg aboard, +100 kg at 3 s
  cspr demo --controller static --payload 200 --add-payload none
  cspr demo --controller pdff --exact-mass     for comparison: the controller always knows the true mass
  cspr demo --compare                          all controllers one after the other, in one table
  cspr demo --trajectory smooth-19 --realtime  at rest at both ends; with real-time priority"""


def main(args: list[str] | None = None) -> int:
    """Run the demo; returns the exit status."""
    options = _parse(sys.argv[1:] if args is None else args)
    if options.realtime and (problem := _realtime_problem()):
        print(f"demo: {problem}", file=sys.stderr)
        return 2
    _stop_on_signals()
    return run_program(
        "demo",
        lambda: _run_chosen(options),
        (ControlError, StartError),
        "brakes are closed, every process has ended, the bag is readable",
    )


def _run_chosen(options: argparse.Namespace) -> None:
    """Run what the options ask for, one after the other; what was run is compared, whatever becomes of the next."""
    one = options.experiment
    compared = COMPARED if options.compare else [(one["controller"], one["exact_mass"])]
    summaries: list[RunSummary] = []
    analyses: list[RunAnalysis] = []
    # On loopback, in a domain of its own: no robot in the same network hears a word of this.
    stay(os.environ)
    if options.security is not None:
        enforce(os.environ, options.security)
    try:
        with claim_domain():
            for controller, exact_mass in compared:
                chosen = {**options.experiment, "controller": controller, "exact_mass": exact_mass}
                scenario = Scenario(**chosen, realtime=options.realtime, speed=options.speed)
                summary, analysis = _run_and_report(scenario, options)
                summaries.append(summary)
                analyses.append(analysis)
    except (ControlError, OSError):
        if len(summaries) > 1:
            print(format_comparison(summaries))
        raise
    if options.json is not None:
        found = [summary.as_mapping() for summary in summaries]
        write_json(options.json, found if options.compare else found[0])
    if options.compare:
        print(format_runs(analyses), format_comparison(summaries), sep="\n\n")
        _report(analyses)


def _run_and_report(scenario: Scenario, options: argparse.Namespace) -> tuple[RunSummary, RunAnalysis]:
    directory = _new_run_directory(Path(options.runs))
    summary, analysis = _run(scenario, directory, options.config, options.markers)
    if not options.compare:
        print(f"\n{format_runs([analysis])}")
    print(f"\n{format_summary(summary)}")
    if scenario.speed < 1.0:
        print(
            f"  pace                  {scenario.speed:g} of real time; times are on the simulated machine's clock"
        )
    print(f"  recorded in           {directory}", flush=True)
    _report([analysis], figures=not options.compare)
    return summary, analysis


def _stop_on_signals() -> None:
    """Let Ctrl-C, SIGTERM and the end of the terminal interrupt the demo, once.

    Whatever is pressed while it closes the brakes and ends its processes must not keep it from that.
    """

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        for each in numbers:
            signal.signal(each, signal.SIG_IGN)
        raise KeyboardInterrupt

    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # not under nohup
        numbers.append(signal.SIGHUP)
    for each in numbers:
        signal.signal(each, interrupt)


def _parse(arguments: list[str]) -> argparse.Namespace:
    parser = program_parser(
        "demo", DESCRIPTION, EPILOG, json="what summary.json holds (--compare: the list of all runs)"
    )
    controllers = parser.add_mutually_exclusive_group()
    add_experiment_arguments(parser, controllers)
    controllers.add_argument(
        "--compare", action="store_true", help="run all controllers and compare them in one table"
    )
    add = parser.add_argument
    add("--realtime", action="store_true", help="SCHED_FIFO for control and drivers (needs the privilege)")
    add(
        "--speed", type=number("a number from 0.1 to 1", 0.1, 1.0), default=1.0, metavar="FACTOR",
        help="pace of the simulated machine, 0.1 to 1, for a computer that is too slow for it; default: %(default)s",
    )  # fmt: skip
    add(
        "--markers", action="store_true",
        help="also publish /robot_markers, for RViz and Foxglove (config/views)",
    )  # fmt: skip
    add(
        "--security", type=Path, metavar="KEYSTORE",
        help="enforce SROS 2 security with the keys in this directory (docs/security.md)",
    )  # fmt: skip
    add("--runs", default="runs", metavar="DIR", help="where runs are stored; default: %(default)s")
    options = parser.parse_args(arguments)
    if options.exact_mass and Controller(options.controller).model is FeedforwardModel.NONE:
        parser.error("--exact-mass has no meaning for --controller pd, which has no feed-forward")
    if options.exact_mass and options.compare:
        parser.error("--exact-mass has no meaning for --compare, which runs pdff with the exact mass as well")
    if options.exact_mass and options.security is not None:
        parser.error("--exact-mass remaps a topic, which the policies of --security do not allow")
    options.experiment = chosen_experiment(parser, options)
    return options


def _realtime_problem() -> str | None:
    """Why this user may not use real-time priorities, or None."""
    policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        return (
            "--realtime needs the privilege CAP_SYS_NICE or a real-time limit: add the line '@realtime - rtprio 80' to "
            "/etc/security/limits.d/realtime.conf, join the group realtime and log in again, or run without --realtime"
        )
    os.sched_setscheduler(0, policy, parameter)
    return None


def _new_run_directory(runs: Path) -> Path:
    """Make runs/<UTC time>/ and let runs/latest point there."""
    stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H-%M-%SZ")
    directory = runs / stamp
    number = 2
    while directory.exists():
        directory = runs / f"{stamp}-{number}"
        number += 1
    directory.mkdir(parents=True)
    link = runs / f".latest-{os.getpid()}"
    link.unlink(missing_ok=True)
    link.symlink_to(directory.name)
    link.replace(runs / "latest")
    return directory


def _run(scenario: Scenario, directory: Path, source: Path, markers: bool) -> tuple[RunSummary, RunAnalysis]:
    with live_graph(scenario.label, scenario, source, directory, markers) as graph:
        run, client = graph.operator, graph.client
        run.enable(30.0)
        run.pause("measuring the payload", MEASURING)
        run.call("/trajectory_publisher/start", 10.0)
        run.wait("moving to the start", lambda: client.trajectory_times is not None, 5.0, client.phase_text)
        assert client.trajectory_times is not None  # the line above waited for it
        start, end = client.trajectory_times
        for time, mass in scenario.loads():
            client.set_payload(mass, start + round(time * 1e9))
        run.wait(
            "moving to the start",
            lambda: client.phase == TrajectoryPhase.RUNNING,
            30.0,
            client.phase_text,
        )
        run.wait(
            "running",
            lambda: client.phase == TrajectoryPhase.FINISHED,
            (end - start) * 1e-9 + 10.0,
            client.phase_text,
        )
        run.pause("settling", SETTLING)
        run.stop()
    recorded = read_recording(directory / "bag", configuration_directory=directory / "config")
    chosen: dict[str, Any] = {"controller": scenario.controller, "exact_mass": scenario.exact_mass}
    analysis = analyse_recording(replace(recorded, outcome=chosen), scenario.label)
    summary = RunSummary.of(analysis.metrics, **chosen)
    write_json(directory / "summary.json", summary.as_mapping())
    return summary, analysis


def _report(runs: Sequence[RunAnalysis], figures: bool = True) -> None:
    """Write figures and report beside the bag, and say where; a run without them is a good run all the same."""
    directory = default_directory([run.recording.path for run in runs])
    try:
        pictures = write_results(runs, directory, figures=figures)
    except (ControlError, OSError) as problem:
        print(f"  report                none: {problem}\n")
    else:
        if pictures:
            print(
                f"  figures               {_shown(directory / FIGURES)} ({len(pictures)}, each as PNG and SVG)"
            )
        print(f"  report                {_shown(directory / REPORT)}\n")


def _shown(path: Path) -> Path:
    """Return a path as it is shown: from here on, if it lies here."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path


if __name__ == "__main__":
    sys.exit(main())
