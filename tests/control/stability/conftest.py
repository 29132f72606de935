from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from cspr_control.parameters.control_settings import control_settings
from cspr_control.stability.loop_configuration import LoopConfiguration
from cspr_control.stability.scan import Margin, Place, StabilityReport
from cspr_drivers.simulation.plant.plant import Plant
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import CableProperties, Payload, Pose, RigidBody, Robot
from cspr_msgs_py.parameters.file import ParameterFile

CONFIG = Path(__file__).parents[3] / "config"


@dataclass(frozen=True)
class Machine:
    """The simulated machine without dry friction, and the robot as a controller who knew it all would believe it."""

    config: SimulationConfig
    robot: Robot

    def plant(self) -> Plant:
        """The machine at rest at home, brakes open, its motors holding the tensions."""
        plant = Plant(self.config)
        held = self.robot.winch.motor_torque(plant.tensions())
        for index, torque in enumerate(held):
            plant.set_brake(index, closed=False)
            plant.set_torque(index, torque)
        return plant


@pytest.fixture(scope="session")
def machine():
    """Return what makes a `Machine` with a home pose, a mass, kg, that is part of its platform, and ropes, kg/m."""
    shipped = SimulationConfig.from_yaml(CONFIG / "simulation.yaml")

    def make(home: Pose, mass: float, ropes: float = 0.0) -> Machine:
        config = replace(shipped, cables=replace(shipped.cables, mass_per_metre=ropes))
        true = config.robot
        motor = replace(true.motor, coulomb_friction=0.0)
        body = true.platform.inertial_parameters + Payload(mass, np.zeros(3)).inertial_parameters
        platform = RigidBody.from_inertial_parameters(body)
        robot = replace(true.with_geometry(home=home), motor=motor, platform=platform)
        made = replace(config, robot=robot, payload=Payload.none(), time_step=5e-5)
        return Machine(made, robot_with_cables(robot, config))

    return make


def robot_with_cables(robot, config):
    """Return a robot whose cables are those of the simulated machine."""
    cables = config.cables
    known = CableProperties(
        cables.axial_stiffness, cables.damping_time, cables.dead_length, cables.mass_per_metre
    )
    return replace(robot, cables=known.for_each(robot.number_of_cables))


@pytest.fixture(scope="session")
def loop():
    """The shipped loop."""
    parameters = ParameterFile.from_yaml(CONFIG / "control.yaml")
    robot = Robot.from_yaml(CONFIG / "robot.yaml")
    return LoopConfiguration.of(robot, control_settings(robot, parameters))


@pytest.fixture(scope="session")
def report():
    """Margins that are enough, made up."""
    place = Place((0.0, 0.7, 2.0), 300.0)
    return StabilityReport(
        decay=Margin(2.1, place),
        mechanical_decay=Margin(2.2, place),
        late_cycles=Margin(3, place),
        smallest_time_constant=Margin(0.0, None),
        gain_margin=Margin(17.0, place),
        held_stiffness=Margin(3300.0, place),
    )
