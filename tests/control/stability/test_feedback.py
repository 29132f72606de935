"""The loop through the estimate, foretold, against the control graph on the simulated machine."""

from dataclasses import replace

import numpy as np
import pytest

from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_control.parameters.experiment import AddedPayload
from cspr_control.parameters.settings import estimator_settings
from cspr_control.stability.feedback import StaticFeedback
from cspr_control.stability.linear_plant import linear_plant
from cspr_control.stability.payload_path import PayloadLoop
from cspr_control.stability.sampled_loop import LoopGains, LoopTiming, SampledLoop
from cspr_kinematics import Payload
from cspr_msgs_py.parameters.table import parameter_values
from cspr_msgs_py.vocabulary import TrajectoryName

STATIC = estimator_settings(parameter_values("mass_estimator")).static
LIGHT = 0.1  # motors of a tenth of the inertia
KD = 0.03
_OPEN_GATES = {
    "mass_rate_limit": 1e4,
    "slack_tension": 0.1,
    "slack_hold": 0.0,
    "static.max_speed": 100.0,
    "static.max_angular_speed": 100.0,
    "static.max_sideways_ratio": 10.0,
}


def simulated(time_constant, config):
    """Standard deviation of the estimate, kg, over the last of three seconds after 100 kg were added at home."""
    scenario = Scenario(
        config=config,
        devices=False,
        trajectory=TrajectoryName.HOLD,
        added=(AddedPayload(100.0, 1.0),),
        motor_inertia_factor=LIGHT,
        parameters={
            "motor_control_gains": {"kd": KD},
            "mass_estimator": {"method": "static", "static.time_constant": time_constant, **_OPEN_GATES},
            "trajectory_publisher": {"hold_duration": 4.0},
        },
    )
    record = run(scenario)
    return np.std(record.mass_estimate[record.time > 3.0])


def static_feedback(plant, time_constant):
    loop = PayloadLoop(plant, 0.004, 0.0, FeedforwardSettings())
    return StaticFeedback(loop, replace(STATIC, time_constant=time_constant))


def foretold(time_constant, robot, mass):
    robot = replace(robot, motor=replace(robot.motor, inertia=LIGHT * robot.motor.inertia))
    plant = linear_plant(robot, robot.home, Payload(mass, np.zeros(3)))
    feedback = static_feedback(plant, time_constant)
    return SampledLoop(plant, LoopTiming(0.004, 0.0015)).growth(LoopGains(2.0, KD), feedback)


def test_light_motors_are_unstable_where_it_is_foretold(robot_file, robot):
    for time_constant, unstable in ((0.1, False), (0.01, True)):
        assert (foretold(time_constant, robot, 200.0) > 0.0) == unstable
        assert (simulated(time_constant, robot_file.parent) > 1.0) == unstable


def test_without_gain_there_is_no_loop(robot):
    """Filter and controllers alone: the slower of the two decays as it does by itself."""
    plant = linear_plant(robot, robot.home, Payload(100.0, np.zeros(3)))
    feedback = static_feedback(plant, 2.0)
    growth = SampledLoop(plant, LoopTiming(0.004, 0.0015)).growth(LoopGains(2.0, 0.1), feedback, gain=0.0)
    assert growth == pytest.approx(-1.0 / 2.0)
