"""Commission a new robot in a terminal, winch by winch, and write its can.yaml; without ROS."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType

from cspr_drivers.bus.opening import open_ports
from cspr_drivers.commission.configuration_file import difference, new_text
from cspr_drivers.commission.findings import Findings, FindingsFile
from cspr_drivers.commission.master_heartbeat import master_heartbeat
from cspr_drivers.commission.operator import QUESTIONS, FileOperator, Operator, WalkStoppedError
from cspr_drivers.commission.walk import Walk
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.config.file_errors import as_configuration_error
from cspr_drivers.config.file_replacement import replace_and_keep
from cspr_drivers.errors import DriverError
from cspr_kinematics.configuration.structure import structured, unknown_key
from cspr_kinematics.configuration.yaml_file import read_yaml
from cspr_kinematics.errors import ConfigurationFileError
from cspr_kinematics.robot.robot_description import RobotDescription
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.programs.command_line import program_parser, run_program

DESCRIPTION = """\
Commission a new robot, winch by winch and load cell by load cell, and write what is found into can.yaml.

  1 find the nodes on the bus          5 tare
  2 which drive turns which winch,     6 calibration with dead weights,
    and which way                        and the brakes
  3 encoder scale                      7 home pose
  4 which amplifier is which cable's   8 the difference to the present can.yaml, then the new one

One brake opens at a time, with little torque. Ctrl-C closes it, at any moment. What was found out is kept: the same
command resumes where it was stopped. The drivers must not run meanwhile."""
EPILOG = """\
examples:
  cspr commission                          config/can.yaml, from the repository's root
  cspr commission --torque 0.2             up to 20 % of the rated torque, for stiff winches
  cspr commission --answers answers.yaml   without a person: an answer for each key; one that is missing is named
  cspr commission --restart                forget what was found before"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the walk; returns the exit status."""
    options = _parse(arguments)
    previous = {number: signal.signal(number, _interrupt) for number in (signal.SIGINT, signal.SIGTERM)}

    def walk() -> int:
        operator = Operator() if options.answers is None else _answers(options.answers)
        given: Path = options.config
        config = given / "can.yaml" if given.is_dir() else given
        robot = options.robot or config.with_name("robot.yaml")
        findings = commission(config, robot, operator, options.torque, options.restart)
        if options.json is not None:
            write_json(options.json, findings)
        return 0

    try:
        closed = "all brakes are closed. The same command resumes from here"
        return run_program("commission", walk, (DriverError,), closed)
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def commission(
    config: Path,
    robot: Path,
    operator: Operator,
    torque: float,
    restart: bool = False,
    walk: Callable[..., Walk] = Walk,
) -> Findings:
    """Commission the robot and write its configuration; return what was found.

    Parameters
    ----------
    config, robot
        Files `can.yaml` and `robot.yaml`.
    operator
        Who answers.
    torque
        Largest torque, in units of the rated torque of the motors.
    restart
        Whether earlier findings are forgotten.
    walk
        Makes the walk.

    Raises
    ------
    DriverError
        In one line: what is wrong, and where. What was found until then is kept.
    """
    can = CanConfig.from_yaml(config, "name its directory with --config DIR")
    kept = FindingsFile(config.with_name(config.name + ".commission"))
    if restart:
        kept.remove()
    findings = kept.load()
    if (findings.winches or findings.cells) and not operator.yes(
        "resume",
        f"Go on with {kept.path} ({len(findings.winches)} winches, {len(findings.cells)} load cells)?",
    ):
        findings = Findings()
    ports = open_ports(can, filtered=False)
    try:
        ports.require_no_driver(can.master_node_id, 10.0 * can.timeouts.heartbeat_producer)
        with master_heartbeat(ports, can.master_node_id, can.timeouts.heartbeat_producer):
            ratio, limit = _winch(robot)
            walk(can, ports, ratio, limit, torque, operator, findings, kept.save).run()
    finally:
        ports.close()
    _write(config, can, findings, operator, kept)
    return findings


def _write(path: Path, config: CanConfig, findings: Findings, operator: Operator, kept: FindingsFile) -> None:
    old = path.read_text(encoding="utf-8")
    new = new_text(old, config, findings)
    operator.tell(f"8. {path}")
    changes = difference(old, new, path)
    if not changes:
        operator.tell("   nothing changes: the file describes the robot as it is")
    else:
        operator.tell(changes)
        if not operator.yes("write", "   Write it?"):
            raise WalkStoppedError(f"{path} is unchanged; the findings are kept in {kept.path}")
        operator.tell(f"   written; the old file is {replace_and_keep(path, new)}")
    kept.remove()


def _winch(robot: Path) -> tuple[float, float]:
    """Return the cable per radian of the motor, m/rad, and the motor's torque limit, N m, of a robot file."""
    with as_configuration_error():
        described = structured(RobotDescription, read_yaml(robot), str(robot))
    return described.winch.transmission_ratio, described.motor.torque_limit


def _answers(path: Path) -> FileOperator:
    with as_configuration_error():
        content = {str(key): value for key, value in read_yaml(path).items()}
        for key, value in content.items():
            if key.partition(".")[0] not in QUESTIONS:
                raise ConfigurationFileError(
                    str(path), key, value, unknown_key(key.partition(".")[0], QUESTIONS)
                )
    return FileOperator(content, str(path))


def _interrupt(number: int, frame: FrameType | None) -> None:
    # Once: while the brakes close a second signal must not get in between.
    for other in (signal.SIGINT, signal.SIGTERM):
        signal.signal(other, signal.SIG_IGN)
    raise KeyboardInterrupt


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = program_parser(
        "commission", DESCRIPTION, EPILOG, json="what was found of each winch and load cell"
    )
    parser.add_argument(
        "--config",
        type=Path,
        default=Path("config"),
        metavar="DIR",
        help="directory of the configuration, or its file if that is not can.yaml; default: %(default)s",
    )
    parser.add_argument(
        "--robot",
        type=Path,
        metavar="FILE",
        help="the robot, for its winch; default: robot.yaml beside can.yaml",
    )
    parser.add_argument(
        "--torque",
        type=float,
        default=0.1,
        help="largest torque, share of the rated one (default: %(default)s)",
    )
    parser.add_argument(
        "--answers", type=Path, help="YAML file with an answer for each key, in place of a person"
    )
    parser.add_argument("--restart", action="store_true", help="forget what was found before")
    options = parser.parse_args(arguments)
    if not 0.01 <= options.torque <= 0.5:
        parser.error("--torque must be from 0.01 to 0.5")
    return options


if __name__ == "__main__":
    sys.exit(main())
