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
    Progress,
    arriving_as_recorded,
    heard_by_estimator,
    rerun_estimator,
    rerun_feedforward,
    with_those_before,
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

The configuration is the one inside the bag. The inputs (/motor_states, /cable_tensions, /payload_in_use, /robot_state,
/reference) come at the times at which they were received. The feed-forward counts on the estimates of the re-run, which
arrive when the recorded ones did. What the robot would have done with the other torques is not simulated: the recorded
motion stays.

Writes DIR/bag (/payload and /setpoint, MCAP) and DIR/comparison.json. The same bag gives the same bytes."""
EPILOG = """\
examples:
  cspr rerun runs/latest                                          how closely the recording is reproduced
  cspr rerun runs/latest --set mass_estimator.time_constant=0.05  a slower filter
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
) -> tuple[Inertias, PayloadComparison, dict[str, Any]]:
    settings, values = schedule(recording, "mass_estimator", estimator_settings, given)
    m = recording.robot.number_of_cables
    states = recording.joints(topics.MOTOR_STATES, topics.motor_names(m))
    tensions = recording.joints(topics.CABLE_TENSIONS, topics.cable_names(m))
    recorded, in_use, truth = (
        recording.read(Bag.inertias, topic.name) if recording.holds(topic) else None
        for topic in (topics.PAYLOAD, topics.PAYLOAD_IN_USE, topics.SIMULATED_PAYLOAD)
    )
    inputs = states, tensions
    if recorded is not None and len(recorded):
        was, _ = schedule(recording, "mass_estimator", estimator_settings, {})
        inputs = heard_by_estimator(recording.robot, was, states, tensions, int(recorded.time_ns[0]))
    payloads = rerun_estimator(
        recording.robot,
        settings,
        *inputs,
        in_use,
        None if in_use is not None or recorded is None else _first(recorded),
        _progress("mass_estimator"),
        recording.samples(topics.ROBOT_STATE),
    )
    if len(payloads.mass) == 0:
        raise ControlError("nothing to re-run: the recording holds no valid measurement of the payload")
    return payloads, compare_payloads(payloads, recorded, truth, *recording.story(tensions)), values


def _answer(
    recording: Recording, given: dict[str, Any], rerun: Inertias | None, topic: str | None
) -> tuple[JointStates, SetpointComparison, dict[str, Any]]:
    m = recording.robot.number_of_cables
    build = partial(feedforward_settings, m)
    settings, values = schedule(recording, "feedforward", build, given)
    references = recording.read(Bag.references, topics.REFERENCE.name)
    first_stamp, first_received = _inputs_since(recording)
    payloads: Inertias | None = rerun
    if topic is None and rerun is None and recording.holds(topics.PAYLOAD):
        topic = topics.PAYLOAD.name
    if topic is not None:
        payloads = recording.read(Bag.inertias, topic)
    elif rerun is not None and recording.holds(topics.PAYLOAD):
        recorded_payloads = recording.read(Bag.inertias, topics.PAYLOAD.name)
        published = recording.publish_times(topics.PAYLOAD)
        payloads = arriving_as_recorded(rerun, recorded_payloads.time_ns.tolist(), published)
        payloads = with_those_before(payloads, recorded_payloads, published, first_stamp)
    initial = None if payloads is None else _known_before(recording, payloads)
    tensions = None
    if recording.holds(topics.CABLE_TENSIONS):
        tensions = recording.joints(topics.CABLE_TENSIONS, topics.cable_names(m))
    setpoints = rerun_feedforward(
        recording.robot,
        settings,
        references,
        payloads,
        initial,
        _progress("feedforward"),
        tensions,
        recording.samples(topics.ROBOT_STATE),
        recording.samples(topics.EXTERNAL_WRENCH),
    )
    recorded = None
    if recording.holds(topics.SETPOINT):
        recorded = recording.joints(topics.SETPOINT, topics.motor_names(m))
    # while the motors rest, set-points count on measured tensions
    return setpoints, compare_setpoints(setpoints, recorded, first_received), values


def _inputs_since(recording: Recording) -> tuple[int, int]:
    """Return from which stamp on motor states and tensions are recorded, as far as they are, and from when, ns."""
    held = filter(recording.holds, (topics.MOTOR_STATES, topics.CABLE_TENSIONS))
    inputs = [recording.read(Bag.joint_states, topic.name) for topic in held]
    stamp = max((int(joints.time_ns[0]) for joints in inputs), default=0)
    return stamp, max((int(joints.log_time_ns[0]) for joints in inputs), default=0)


def _known_before(recording: Recording, payloads: Inertias) -> Payload | None:
    """Return what was in use when the recording began, if it came of an estimate that was made before."""
    if not recording.holds(topics.PAYLOAD_IN_USE):
        return None
    in_use = recording.read(Bag.inertias, topics.PAYLOAD_IN_USE.name)
    estimated = in_use.time_ns[0] > 0  # the stamp of the nominal payload is none
    return _first(in_use) if estimated and in_use.log_time_ns[0] <= payloads.log_time_ns[0] else None


def _first(payloads: Inertias) -> Payload:
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
