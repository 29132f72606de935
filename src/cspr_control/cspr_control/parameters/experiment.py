"""What is run, live by the demo or in simulated time: a controller, a trajectory and a load."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, NamedTuple

from cspr_control.errors import SettingError
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.parameters.table import ALL_NODES
from cspr_msgs_py.vocabulary import Controller, PayloadSource, TrajectoryName, controller_label

_DECIDED = {
    ("feedforward", "model"): "--controller",
    ("feedforward", "payload_source"): "--controller and --exact-mass",
    ("trajectory_publisher", "trajectory"): "--trajectory",
}
"""The parameters that an experiment itself decides, and the options that say how."""

_FILES = {"can_config": "can.yaml", "simulation_config": "simulation.yaml"}
MEASURING = 2.0  # s for the load to be measured before the trajectory begins
SETTLING = 1.5  # s for which a run goes on after the end of the trajectory, or after a fault

TRAJECTORIES = [
    name.value for name in TrajectoryName if name not in (TrajectoryName.HOLD, TrajectoryName.MOVE)
]


class AddedPayload(NamedTuple):
    """A payload change: mass in kg, time in s after the start of the trajectory."""

    mass: float
    time: float


@dataclass(frozen=True)
class Experiment:
    """A controller on a trajectory with a load.

    Attributes
    ----------
    controller, exact_mass
        The controller, and whether its feed-forward is given the true mass.
    trajectory
        What the platform follows.
    payload, added
        Mass aboard from the start, kg, and what comes on top of it.
    """

    controller: Controller = Controller.PDFF_MASS
    exact_mass: bool = False
    trajectory: TrajectoryName = TrajectoryName.PAPER_19
    payload: float = 100.0
    added: tuple[AddedPayload, ...] = (AddedPayload(100.0, 3.0),)

    @property
    def label(self) -> str:
        """The controller in words."""
        return controller_label(self.controller.value, self.exact_mass)

    def loads(self) -> Iterator[tuple[float, float]]:
        """Yield when the payload changes, s after the start of the trajectory, and the mass aboard from then on, kg."""
        mass = self.payload
        for added in sorted(self.added, key=lambda added: added.time):
            mass += added.mass
            yield added.time, mass

    def choose(self, parameters: ParameterFile) -> None:
        """Let parameters of the control nodes be those of the controller and the trajectory.

        Raises
        ------
        SettingError
            If the file names other files for the machine than those that a simulated run takes.
        """
        for node in ("can_drives", "load_cells", "simulated_robot"):
            for name, file in _FILES.items():
                given = parameters.of(node).get(name, file)
                if PurePath(str(given)).name != file:
                    raise SettingError(
                        f"{parameters.name}: {name} of {node} is {given}; here it is {file} in the directory of the "
                        "configuration: leave the parameter out, and give that directory with --config"
                    )
        # the truth comes over the same path as the estimate would
        source = PayloadSource.ESTIMATED if self.exact_mass else self.controller.payload_source
        parameters.change("feedforward", {"model": str(self.controller.model), "payload_source": str(source)})
        parameters.change("trajectory_publisher", {"trajectory": self.trajectory.value})


def require_undecided(parameters: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse parameters, by node, that an `Experiment` decides; raises SettingError naming the option to use."""
    for (node, name), option in _DECIDED.items():
        if any(name in parameters.get(each, {}) for each in (node, ALL_NODES)):
            raise SettingError(f"{node}.{name} is decided by {option}: use that instead")
