"""Let every fault happen in simulated time: what it is called, how soon the brakes hold, how far the load sinks."""

from __future__ import annotations

import argparse
import math
import sys
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from cspr_control.closed_loop.fault_outcome import PAYLOAD, Outcome, outcome_of
from cspr_control.closed_loop.fault_scenarios import SCENARIOS, FaultScenario, fault_pairs
from cspr_control.closed_loop.loop import ClosedLoopError
from cspr_control.closed_loop.signal_faults import KINDS, SIGNALS, signal_scenarios
from cspr_control.errors import ControlError
from cspr_control.programs.arguments import add_configuration_argument
from cspr_kinematics import KinematicsError
from cspr_kinematics.configuration.structure import did_you_mean
from cspr_msgs_py.errors import MessagesError
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.programs.command_line import program_parser, run_program

DESCRIPTION = f"""\
Let faults happen to a simulated robot, in simulated time, and print what becomes of each as a table.

Each one happens to a fresh robot that holds {PAYLOAD:g} kg still, and to one that moves them level, at the speed of
control.yaml. It must end held, brakes closed, latched, with a named cause; then the operator resets and enables the
robot. The table shows the cause, how the robot came to rest, the time until all brakes hold, the height lost until
then, and the lowest tension of a cable. What is harmless must change nothing: the robot goes on, brakes open."""
EPILOG = """\
examples:
  cspr faults                               all of them, some minutes; the table of docs/operation.md
  cspr faults drive_silent bus_cut          two of them
  cspr faults setpoint_stuck                a signal, and what happens to it
  cspr faults --signals                     seven kinds of faults on every signal: a quarter of an hour
  cspr faults --pairs 20 --seed 7           20 times two of them at once, drawn at random
  cspr faults --live                        what needs the middleware: real processes, one of them frozen
  cspr faults --json faults.json            numbers for another program: a row for each, held and moving

Faults of devices, cables and buses have the names under which `cspr closed_loop --fault` injects them. It has one
more, brake_weak: what does not hold cannot end held.

Signals, the topics of the graph and the frames of one device, may be
{kinds}. Of these the robot may bear some: it goes on, brakes open, and
leaves its path by less than a centimetre.

One more, {live}, is about the middleware, and needs --live: recorder, control and simulated robot run as in
`cspr demo`, and the recorder is frozen (SIGSTOP) for two seconds, again and again. Nothing must come of it.

faults:
"""
LIVE = "reader_frozen"
"""The fault that needs real processes."""

_FREEZES = 20  # unless said otherwise
EXIT_STATUS = """\
exit status: 0 every fault ended as it must, 1 one did not, or nothing could be simulated, 2 wrong arguments,
130 interrupted"""


@dataclass(frozen=True)
class Row:
    """What became of a fault, held still and in motion; None where it cannot happen, in words where it ended wrong."""

    scenario: FaultScenario
    held: Outcome | str | None
    moving: Outcome | str | None

    def __str__(self) -> str:
        """Return the row of the table."""
        both = (self.held, self.moving)
        outcomes = [outcome for outcome in both if isinstance(outcome, Outcome)]
        cause = way = ""
        for outcome in outcomes:
            if outcome.duration is None:
                cause, way = "none", "none"
                continue
            cause = outcome.cause
            way = "along the path" if outcome.controlled else "quick stop"
            way += ", then quick stop" if outcome.controlled and "; then " in cause else ""
        lowest = max(0.0, min((outcome.lowest_tension for outcome in outcomes), default=math.inf))
        cells = (
            f"{'open' if o.duration is None else f'{1e3 * o.duration:.0f}'} | {1e3 * max(o.drop, 0.0):.1f}"
            if isinstance(o, Outcome)
            else o or "- | -"
            for o in both
        )
        return f"| {self.scenario.name} | {cause} | {way} | {' | '.join(cells)} | {lowest:.0f} |"

    def numbers(self) -> Iterator[dict[str, object]]:
        """Yield the numbers of the robot that is held still, and of the one that moves."""
        for moving, outcome in ((False, self.held), (True, self.moving)):
            if outcome is not None:
                yield {"name": self.scenario.name, "moving": moving, **_numbers(self.scenario, outcome)}


def _numbers(scenario: FaultScenario, outcome: Outcome | str) -> dict[str, object]:
    if isinstance(outcome, str):
        return {"state": outcome}
    harmless = outcome.duration is None
    return {
        "state": "enabled" if harmless else "fault",
        "cause": outcome.cause,
        "culprit_right": scenario.is_named(outcome.cause),
        "noticed_ms": _ms(outcome.noticed),
        "brakes_ms": _ms(outcome.duration),
        "height_lost_mm": 1e3 * outcome.drop,
        "moved_mm": 1e3 * outcome.moved,
        "min_tension_N": outcome.lowest_tension,
        "max_tension_N": outcome.highest_tension,
    }


def _ms(duration: float | None) -> float | None:
    return None if duration is None else 1e3 * duration


def main(args: Sequence[str] | None = None) -> int:
    """Print the table; returns the exit status."""
    options = _parse(sys.argv[1:] if args is None else args)
    return run_program("faults", lambda: _run(options), (ControlError, KinematicsError, MessagesError))


def _run(options: argparse.Namespace) -> int:
    if options.live is not None:
        return _run_live(options)
    rows = []
    print("| fault | cause on `/robot_state` | stop | held: brakes, ms | height, mm ", end="")
    print("| moving: brakes, ms | height, mm | lowest tension, N |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for scenario in _chosen(options):
        held, moving = (_outcome(scenario, moving, options.config) for moving in (False, True))
        rows.append(Row(scenario, held, moving))
        print(rows[-1], flush=True)
    if options.json is not None:
        write_json(options.json, [numbers for row in rows for numbers in row.numbers()])
    return int(any(isinstance(outcome, str) for row in rows for outcome in (row.held, row.moving)))


def _run_live(options: argparse.Namespace) -> int:
    """Freeze a reader of a live graph; only this needs the middleware, and imports it."""
    from cspr_control.nodes.frozen_reader import freezes

    rows: list[dict[str, object]] = []
    for number, each in enumerate(freezes(options.config, options.live), 1):
        rows.append({
            "name": LIVE,
            "moving": each.moving,
            "state": "fault" if each.cause else "enabled",
            "cause": each.cause,
            "culprit_right": not each.cause,
            "height_lost_mm": None if each.moving else 1e3 * each.drop,
            "moved_mm": None if each.moving else 1e3 * each.moved,
            "min_tension_N": each.lowest_tension,
            "max_tension_N": each.highest_tension,
            "longest_pause_ms": 1e3 * each.pause,
            "longest_pause_before_ms": 1e3 * each.pause_before,
        })  # fmt: skip
        what = f"{LIVE} {number:3d} of {options.live}, {'moving' if each.moving else 'held  '}"
        pause = f"{1e3 * each.pause:.0f} ms at most ({1e3 * each.pause_before:.0f} ms before)"
        print(
            f"{what}: torque commands paused for {pause}; {each.cause or 'the robot goes on'}",
            flush=True,
        )
    stopped = sum(bool(row["cause"]) for row in rows)
    print(f"{LIVE}: {stopped} of {len(rows)} stopped the robot")
    if options.json is not None:
        write_json(options.json, rows)
    return int(stopped > 0)


def _chosen(options: argparse.Namespace) -> Iterator[FaultScenario]:
    known = (*SCENARIOS, *signal_scenarios())
    default = [scenario.name for scenario in known if options.signals is scenario.tolerable]
    chosen = [scenario for scenario in known if scenario.name in (options.faults or default)]
    return iter(chosen) if options.pairs is None else fault_pairs(chosen, options.pairs, options.seed)


def _outcome(scenario: FaultScenario, moving: bool, config: Path) -> Outcome | str | None:
    if not (scenario.moving if moving else scenario.held):
        return None
    try:
        return outcome_of(scenario, moving, config)
    except ClosedLoopError as failure:
        return f"FAILED: {failure}"


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    names = [scenario.name for scenario in SCENARIOS]
    epilog = EPILOG.format(kinds=", ".join(KINDS), live=LIVE) + "\n\n".join(
        textwrap.fill(", ".join(listed), 110, initial_indent="  ", subsequent_indent="  ")
        for listed in (names, [f"{signal}_KIND" for signal in SIGNALS])
    )
    names += [scenario.name for scenario in signal_scenarios()]
    parser = program_parser("faults", DESCRIPTION, epilog, EXIT_STATUS, json="the numbers of the table")
    parser.add_argument("faults", nargs="*", metavar="FAULT", help="which; default: all")
    add_configuration_argument(parser)
    parser.add_argument("--signals", action="store_true", help="all faults of signals instead of all others")
    parser.add_argument(
        "--pairs",
        type=int,
        metavar="N",
        help="let N pairs happen instead, the second up to 0.3 s after the first",
    )
    parser.add_argument(
        "--live", type=int, nargs="?", const=_FREEZES, metavar="N",
        help=f"freeze the recorder of a live graph N times, half of them in motion; default: {_FREEZES}",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the draw of pairs; default: 0")
    options = parser.parse_args(arguments)
    for option in ("pairs", "live"):
        if (number := getattr(options, option)) is not None and number < 1:
            parser.error(f"--{option} {number}: must be at least 1")
    if options.live is None and LIVE in options.faults:
        parser.error(f"{LIVE} needs the middleware: give --live as well")
    if options.live is not None and (options.signals or options.pairs or set(options.faults) - {LIVE}):
        parser.error(f"--live is about {LIVE} alone")
    for name in options.faults if options.live is None else ():
        if name not in names:
            parser.error(
                f"there is no fault '{name}'{did_you_mean(name, names)} `cspr faults --help` lists them"
            )
    if options.pairs is not None and len(options.faults) == 1:
        parser.error("--pairs: two faults at least are needed, or none named for all")
    return options


if __name__ == "__main__":
    sys.exit(main())
