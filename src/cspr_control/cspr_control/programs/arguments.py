"""Arguments that several programs take."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cspr_control.parameters.experiment import TRAJECTORIES, AddedPayload, Experiment
from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.parameters.file import value_from_text
from cspr_msgs_py.programs.command_line import number
from cspr_msgs_py.vocabulary import Controller, TrajectoryName

_DEFAULT = Experiment()
_CONFIGURATION = ("robot.yaml", "control.yaml", "can.yaml", "simulation.yaml")


seconds = number("a time in s, 0 or more", 0.0)


def parameter(nodes: Sequence[str] = ()) -> Callable[[str], tuple[str, str, Any]]:
    """Return a reader of ``NODE.NAME=VALUE``: a parameter of one of the nodes, or of any of ours if none are named."""

    def read(text: str) -> tuple[str, str, Any]:
        name, separator, value = text.partition("=")
        node, _, parameter = name.partition(".")
        if not separator or not parameter:
            raise argparse.ArgumentTypeError(
                f"{text!r} is not of the form NODE.NAME=VALUE, such as mass_estimator.time_constant=0.05"
            )
        try:
            if nodes and node not in nodes:
                raise ParameterError(
                    f"parameters of {node!r} cannot be set here; choose from {', '.join(nodes)}"
                )
            return node, parameter, value_from_text(node, parameter, value)
        except ParameterError as error:
            raise argparse.ArgumentTypeError(f"{text}: {error}") from error

    return read


def add_configuration_argument(parser: argparse.ArgumentParser) -> None:
    """Add ``--config``."""
    parser.add_argument(
        "--config", type=_configuration, default="config", metavar="DIR",
        help="directory of the configuration; default: %(default)s",
    )  # fmt: skip


def add_experiment_arguments(parser: argparse.ArgumentParser, controllers: Any = None) -> None:
    """Add the arguments of an `Experiment`.

    Parameters
    ----------
    parser
        Of the program.
    controllers
        The group of arguments that ``--controller`` belongs to, if it belongs to one.
    """
    (controllers or parser).add_argument(
        "--controller",
        choices=[one.value for one in Controller],
        default=_DEFAULT.controller.value,
        help="default: %(default)s",
    )
    add = parser.add_argument
    add("--exact-mass", action="store_true", help="tell the feed-forward the true mass at all times")
    add(
        "--trajectory", choices=TRAJECTORIES, default=_DEFAULT.trajectory.value, metavar="NAME",
        help=f"one of {', '.join(TRAJECTORIES)}; default: %(default)s (hold and move, by which a robot is "
        "commissioned, are no tests of a controller)",
    )  # fmt: skip
    mass = number("a mass in kg, 0 or more", 0.0)
    add(
        "--payload", type=mass, default=_DEFAULT.payload, metavar="KG",
        help="aboard from the start; default: %(default)s",
    )  # fmt: skip
    add(
        "--add-payload", type=_added_payload, action="append", metavar="KG@S",
        help="added S seconds after the start of the trajectory, or taken away, as in --add-payload=-50@3; several, or "
        "none; default: " + ", ".join(f"{mass:g}@{time:g}" for mass, time in _DEFAULT.added),
    )  # fmt: skip
    add_configuration_argument(parser)


def chosen_experiment(parser: argparse.ArgumentParser, options: argparse.Namespace) -> dict[str, Any]:
    """Return what an `Experiment` is made of; ends the program when the arguments do not fit together."""
    added = tuple(filter(None, options.add_payload or _DEFAULT.added))
    mass = options.payload
    for change in sorted(added, key=lambda change: change.time):
        if mass + change.mass < 0.0:
            parser.error(f"--add-payload takes {-change.mass:g} kg away from --payload {mass:g}")
        mass += change.mass
    return {
        "controller": Controller(options.controller),
        "exact_mass": options.exact_mass,
        "trajectory": TrajectoryName(options.trajectory),
        "payload": options.payload,
        "added": added,
    }


def _configuration(text: str) -> Path:
    for name in _CONFIGURATION:
        if not Path(text, name).is_file():
            raise argparse.ArgumentTypeError(
                f"{text}/{name} is not there: start from the repository's root or name --config DIR"
            )
    return Path(text)


def _added_payload(text: str) -> AddedPayload | None:
    if text == "none":
        return None
    kilograms, separator, moment = text.partition("@")
    try:
        change = AddedPayload(float(kilograms), float(moment))
    except ValueError:
        separator = ""
    if not separator or not math.isfinite(change.mass) or not 0.0 <= change.time < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form KG@S, such as 100@3, or none")
    return change
