"""Run the control graph on a simulated robot in simulated time, faster than real time."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace

from cspr_control.analysis.numbers.run_summary import RunSummary, format_summary
from cspr_control.analysis.recording import recording_of
from cspr_control.analysis.run_analysis import analyse_recording
from cspr_control.closed_loop.record import LoopRecord
from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import FAULTS, PlannedFault, Scenario, soft_sling
from cspr_control.errors import ControlError
from cspr_control.programs.arguments import (
    add_experiment_arguments,
    chosen_experiment,
    parameter,
    seconds,
)
from cspr_kinematics import KinematicsError
from cspr_msgs_py.errors import MessagesError
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.programs.command_line import (
    number,
    output_path,
    program_parser,
    run_program,
    show_progress,
)

DESCRIPTION = """\
Run the control graph on a simulated robot in simulated time: what the demo does live, without ROS and without waiting.

The robot is enabled, measures its payload, follows the trajectory, stops and closes its brakes. Graph, drivers,
devices, buses and plant are those of the demo; with --plant the plant alone, which is faster still. Nothing
depends on how fast or how busy this computer is: the same command gives the same numbers, and the same bytes in the
bag."""
EPILOG = """\
examples:
  cspr closed_loop                                         pdff-mass, 100 kg aboard, 100 kg more at 3 s
  cspr closed_loop --plant --controller static --payload 200 --add-payload none
  cspr closed_loop --set motor_control_gains.kp=4          another gain than that of control.yaml
  cspr closed_loop --fault "drive_silent motor_3@4"        what happens when a drive falls silent 4 s after the start
  cspr closed_loop --bag runs/try/bag --json runs/try/summary.json && cspr analyze runs/try

--json FILE holds what summary.json of the demo holds, null for what was not measured:
  controller, exact_mass, trajectory, bag, cause               what was run, where it is recorded, what stopped it
  time_zero                                                    from when times count, s since 1970
  window                                                       what the numbers cover, s
  platform_judged_by                                           what the platform's numbers go by: its true pose
  rms_platform_error_mm, max_platform_error_mm                 distance of the platform from the reference
  mean_platform_error_z_mm                                     the same along z, negative where it is too low
  rms_platform_rotation_error_deg, max_platform_rotation_error_deg
  rms_platform_estimate_error_mm, max_platform_estimate_error_mm   distance of the estimated from the true pose
  rms_position_error_deg, max_position_error_deg               of each motor
  mean_rms_position_error_deg                                  of all
  mass_true_final_kg, mass_estimate_final_kg, mass_settling_time_s
  rate_hz, cycles_window, cycles, missed_cycles                of the control cycle
  command_latency_window, command_latency_us                   from motor states to torques: p50, p99, max

faults, each with the place that has it; `cspr faults` has these, and others of programs and commands:
"""
EXIT_STATUS = """\
exit status: 0 done, also if a --fault has stopped the robot: `cause` in --json FILE then says how; 1 not done, for
the reason on stderr, be it a fault that nobody planned; 2 wrong arguments, 130 interrupted"""


def main(args: Sequence[str] | None = None) -> int:
    """Run a scenario; returns the exit status."""
    options = _parse(sys.argv[1:] if args is None else args)
    return run_program("closed_loop", lambda: _run(options), (ControlError, KinematicsError, MessagesError))


def _run(options: argparse.Namespace) -> None:
    scenario = options.scenario
    record = run(
        scenario,
        options.bag,
        lambda step, time: show_progress(f"{scenario.label}: {time:5.1f} s  {step}"),
        keep=True,
    )
    show_progress("")
    summary = summary_of(record, str(options.bag or ""))
    print(format_summary(summary))
    print(
        f"  simulated             {record.simulated:.1f} s in {record.elapsed:.1f} s of processor time: "
        f"{record.simulated / record.elapsed:.1f} times real time"
    )
    if options.bag:
        print(f"  recorded in           {options.bag}")
    if options.json is not None:
        write_json(options.json, summary.as_mapping())


def summary_of(record: LoopRecord, bag: str = "") -> RunSummary:
    """Return the summary of a run that kept what was published, and of its bag if there is one."""
    assert record.published is not None  # it was asked for
    scenario = record.scenario
    recording = recording_of(record.published, directory=scenario.config)
    metrics = replace(analyse_recording(recording).metrics, bag=bag)
    return RunSummary.of(
        metrics, controller=scenario.controller, exact_mass=scenario.exact_mass, cause=record.cause
    )


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    faults = [f"  {name:20}{place:20}{meaning}" for name, (place, meaning) in FAULTS.items()]
    parser = program_parser(
        "closed_loop", DESCRIPTION, EPILOG + "\n".join(faults), EXIT_STATUS, json="what summary.json holds"
    )
    add = parser.add_argument
    add_experiment_arguments(parser)
    add(
        "--fault", type=_fault, action="append", default=[], metavar="'FAULT PLACE@S'",
        help="happens S seconds after the start of the trajectory; several; see below",
    )  # fmt: skip
    add(
        "--growth", type=number("a time in s, 0 or more", 0.0), default=0.0, metavar="S",
        help="how long what --add-payload adds takes to come aboard, as when lifted off a table; default: no time",
    )  # fmt: skip
    add(
        "--sling", type=number("a length in m, more than 0", 1e-3), metavar="M",
        help="hang what is carried on a sling of this length and 60 kN/m from the origin of the platform",
    )  # fmt: skip
    add(
        "--swing", type=number("an angle in degrees from -60 to 60", -60.0, 60.0), default=0.0, metavar="DEG",
        help="by which the sling is out of plumb at the start, towards x; default: none",
    )  # fmt: skip
    add(
        "--table", type=number("a height in m", -math.inf), metavar="M",
        help="height of what a load on a sling rests on; default: that of simulation.yaml",
    )  # fmt: skip
    add(
        "--duration", type=number("a time in s, 0.1 or more", 0.1), metavar="S",
        help="stop the trajectory after this time, without what --add-payload would add later; default: its end",
    )  # fmt: skip
    add("--plant", action="store_true", help="the plant alone, without drivers, buses and devices")
    add("--seed", type=_seed, help="of the noise; default: that of simulation.yaml")
    add(
        "--set", type=parameter(), action="append", default=[], metavar="NODE.NAME=VALUE",
        help="a parameter other than in control.yaml; several",
    )  # fmt: skip
    add("--bag", type=output_path, metavar="DIR", help="record all that is published, as the recorder does")
    options = parser.parse_args(arguments)
    if options.sling is None and (options.swing or options.table is not None):
        parser.error("--swing and --table are about a load on a sling: give --sling as well")
    sling = None if options.sling is None else soft_sling(options.sling, math.radians(options.swing))
    parameters: dict[str, dict[str, object]] = {}
    for node, name, value in options.set:
        parameters.setdefault(node, {})[name] = value
    try:
        options.scenario = Scenario(
            **chosen_experiment(parser, options),
            faults=tuple(options.fault),
            config=options.config,
            devices=not options.plant,
            seed=options.seed,
            growth=options.growth,
            sling=sling,
            table_height=options.table,
            duration=options.duration,
            parameters=parameters,
        )
    except ControlError as error:
        parser.error(str(error))
    return options


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, 0 or more")
    return int(text)


def _fault(text: str) -> PlannedFault:
    fault, separator, moment = text.rpartition("@")
    if not separator:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not of the form 'FAULT PLACE@S', such as 'bus_cut main@4'"
        )
    return PlannedFault(fault, seconds(moment))


if __name__ == "__main__":
    sys.exit(main())
