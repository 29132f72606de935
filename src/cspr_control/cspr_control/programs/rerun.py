"""Run the payload estimator and the feed-forward again over a recorded bag, with other parameters."""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from cspr_control.errors import ControlError
from cspr_control.estimation.payload import UPDATE_PERIOD
from cspr_control.parameters.settings import estimator_settings, feedforward_settings
from cspr_control.programs.arguments import parameter
from cspr_control.rerun.bag import write_rerun
from cspr_control.rerun.comparison import (
    Comparison,
    PayloadComparison,
    SetpointComparison,
    compare_payloads,
    compare_setpoints,
    format_comparison,
)
from cspr_control.rerun.recording import Recording, schedule
from cspr_control.rerun.rerun import (
    EstimatedPayloads,
    Progress,
    rerun_estimator,
    rerun_feedforward,
    update_times,
)
from cspr_kinematics import KinematicsError, Payload
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py import topics
from cspr_msgs_py.bag.columns import Inertias, JointStates
from cspr_msgs_py.bag.reader import Bag, find_bag
from cspr_msgs_py.errors import MessagesError
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.programs.command_line import (
    output_path,
    program_parser,
    run_program,
    show_progress,
)

NODES = ("mass_estimator", "feedforward")

DESCRIPTION = """\
Run the payload estimator and the feed-forward again over a recorded bag, sample by sample, with the parameters
of the recording or with others, and compare what comes out with what was recorded. No ROS graph is needed or touched.

The configuration is the one inside the bag. The inputs (/cable_tensions, /platform_pose, /reference) come at the
times at which they were received. The feed-forward counts on the estimates of the re-run. What the robot would have
done with the other torques is not simulated: the recorded motion stays.

Writes DIR/bag (/payload and /setpoint, MCAP) and DIR/comparison.json. The same bag gives the same bytes."""
EPILOG = """\
examples:
  cspr rerun runs/latest                                          how closely the recording is reproduced
  cspr rerun runs/latest --set mass_estimator.time_constant=0.2   a faster filter
  cspr rerun runs/latest --set feedforward.model=static --set feedforward.payload_source=nominal
  cspr rerun runs/latest --nodes feedforward                      with the estimates as they were recorded
  cspr rerun runs/latest --payload /simulation/payload            with the true mass, as in: cspr demo --exact-mass"""


def main(args: Sequence[str] | None = None) -> int:
    """Run the re-run; returns the exit status."""
    parser = _parser()
    options = parser.parse_args(args)
    changes: dict[str, dict[str, Any]] = {node: {} for node in options.nodes}
    for node, name, value in options.set:
        if node not in changes:
            parser.error(f"--set: {node} is not among the nodes to re-run: {', '.join(options.nodes)}")
        changes[node][name] = value
    errors = (ControlError, KinematicsError, MessagesError)
    return run_program("rerun", lambda: _run(options, changes), errors, "nothing was written")


def _run(options: argparse.Namespace, changes: dict[str, dict[str, Any]]) -> None:
    source: Path = options.bag
    output = _output(options.output, source)
    with Bag(source) as bag:
        recording = Recording(bag, options.config)
        for remark in recording.remarks:
            print(f"rerun: {remark}", file=sys.stderr)
        warm_up(recording.robot)
        payloads, payload_comparison, recorded_values = None, None, {}
        if "mass_estimator" in options.nodes:
            payloads, payload_comparison, recorded_values["mass_estimator"] = _estimate(
                recording, changes["mass_estimator"]
            )
        setpoints, setpoint_comparison = None, None
        if "feedforward" in options.nodes:
            setpoints, setpoint_comparison, recorded_values["feedforward"] = _answer(
                recording, changes["feedforward"], payloads, options.payload
            )
    parameters = {
        f"{node}.{name}": {"recorded": recorded_values[node][name], "rerun": value}
        for node, values in changes.items()
        for name, value in values.items()
    }
    comparison = Comparison(parameters, payload_comparison, setpoint_comparison)
    information = {
        "software": f"cspr_control {importlib.metadata.version('cspr_control')}",
        "rerun_of": source.resolve().name,
        "nodes": " ".join(sorted(options.nodes)),
        "payload": options.payload or "",
        **{name: json.dumps(values["rerun"]) for name, values in sorted(parameters.items())},
    }
    write_rerun(output / "bag", payloads, setpoints, information, recording.files)
    for file in filter(None, (output / "comparison.json", options.json)):
        write_json(file, comparison)
    print(f"re-run of {source}")
    print(format_comparison(comparison))
    print(f"  written to   {output}")


def _estimate(
    recording: Recording, given: dict[str, Any]
) -> tuple[EstimatedPayloads, PayloadComparison, dict[str, Any]]:
    settings, values = schedule(recording, "mass_estimator", estimator_settings, given)
    tensions = recording.joints(topics.CABLE_TENSIONS, topics.cable_names(recording.robot.number_of_cables))
    poses = recording.read(Bag.poses, topics.PLATFORM_POSE.name)
    recorded, initial, first = None, None, 0
    published: Sequence[int] = []
    if recording.holds(topics.PAYLOAD):
        recorded = recording.read(Bag.inertias, topics.PAYLOAD.name)
        published = recording.publish_times(topics.PAYLOAD)
    updates = update_times(tensions, poses, recorded, published)
    if recorded is not None:
        # a recorder that is new in the graph meets one topic after the other, the inputs perhaps last
        inputs = max(tensions.log_time_ns[0], poses.log_time_ns[0])
        first = next((index for index, time in enumerate(updates) if time >= inputs), len(updates) - 1)
        initial = Payload(float(recorded.mass[first]), recorded.center_of_mass[first])
    payloads = rerun_estimator(
        recording.robot, settings, tensions, poses, updates, initial, first, _progress("mass_estimator")
    )
    if len(payloads.mass) == 0:
        raise ControlError("nothing to re-run: the recording holds no valid measurement of the payload")
    truth = None
    if recording.holds(topics.SIMULATED_PAYLOAD):
        truth = recording.read(Bag.inertias, topics.SIMULATED_PAYLOAD.name)
    return payloads, compare_payloads(payloads, recorded, truth, *recording.story(tensions)), values


def _answer(
    recording: Recording, given: dict[str, Any], rerun: EstimatedPayloads | None, topic: str | None
) -> tuple[JointStates, SetpointComparison, dict[str, Any]]:
    m = recording.robot.number_of_cables
    build = partial(feedforward_settings, m)
    settings, values = schedule(recording, "feedforward", build, given)
    references = recording.read(Bag.references, topics.REFERENCE.name)
    payloads: Inertias | None = rerun
    if topic is None and rerun is None and recording.holds(topics.PAYLOAD):
        topic = topics.PAYLOAD.name
    if topic is not None:
        payloads = recording.read(Bag.inertias, topic)
    initial = None if payloads is None else _known_before(recording, payloads)
    setpoints = rerun_feedforward(
        recording.robot, settings, references, payloads, initial, _progress("feedforward")
    )
    recorded = None
    if recording.holds(topics.SETPOINT):
        recorded = recording.joints(topics.SETPOINT, topics.motor_names(m))
    return setpoints, compare_setpoints(setpoints, recorded), values


def _known_before(recording: Recording, payloads: Inertias) -> Payload | None:
    """Return the first payload if it must have been told before the recording began.

    An estimator that begins leaves zero at a limited rate; a first estimate beyond that is not its first one.
    """
    rate_limit = recording.parameters.values("mass_estimator")["mass_rate_limit"]
    if payloads.mass[0] <= 2.0 * rate_limit * UPDATE_PERIOD:
        return None
    return Payload(float(payloads.mass[0]), payloads.center_of_mass[0])


def _parser() -> argparse.ArgumentParser:
    parser = program_parser("rerun", DESCRIPTION, EPILOG, json="what comparison.json holds")
    add = parser.add_argument
    add("bag", type=find_bag, metavar="BAG", help="a bag, one of its files, or a run's directory")
    add(
        "--set", type=parameter(NODES), action="append", default=[], metavar="NODE.PARAMETER=VALUE",
        help="a parameter of mass_estimator or feedforward; may be given several times",
    )  # fmt: skip
    add(
        "--nodes", nargs="+", choices=NODES, default=list(NODES), metavar="NODE",
        help="which to re-run: mass_estimator, feedforward; default: both",
    )  # fmt: skip
    add(
        "--payload", metavar="TOPIC",
        help="recorded topic on whose payload the feed-forward counts; default: the re-run estimates",
    )  # fmt: skip
    add("--config", type=Path, metavar="DIR", help="configuration to use instead of the one in the bag")
    add(
        "--output",
        type=output_path,
        metavar="DIR",
        help="must not exist yet; default: rerun, rerun-2 ... beside the bag",
    )
    return parser


def _output(given: Path | None, source: Path) -> Path:
    """Return the directory to write, which is not there yet."""
    if given is not None:
        if given.exists():
            raise ControlError(f"{given} exists already and is not overwritten: name another --output")
        return given
    parent = source.parent if source.name else source.resolve().parent
    output, number = parent / "rerun", 2
    while output.exists():
        output, number = parent / f"rerun-{number}", number + 1
    return output


def _progress(name: str) -> Progress:
    return lambda share: show_progress("" if share >= 1.0 else f"{name}: {share:4.0%}")


if __name__ == "__main__":
    sys.exit(main())
