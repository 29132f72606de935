"""Growth foretold by the linearised loop against that of the simulated machine under the same sampled control."""

import numpy as np
import pytest

from cspr_control.stability.linear_plant import linear_plant
from cspr_control.stability.sampled_loop import LoopGains, LoopTiming, SampledLoop
from cspr_kinematics import Payload, Pose

PERIOD = 0.004  # s
CORNER = (1.4, 0.7, 2.0)


def simulated_growth(machine, gains, latency, cycles):
    """Growth of the motors' speeds, 1/s, after a small push, under PD control of the machine in simulated time.

    Between the time when the slowest mode has outlived the others and the end.
    """
    plant, m = machine.plant(), machine.robot.number_of_cables
    held, rest = machine.robot.winch.motor_torque(plant.tensions()), plant.motor_angles()
    before = rest
    underway: list[tuple[float, np.ndarray]] = [(0.0, held + 1e-5 * np.arange(m))]
    size = np.empty(cycles)
    for cycle in range(cycles):
        sync = cycle * PERIOD
        while underway and underway[0][0] <= sync:
            time, torque = underway.pop(0)
            plant.advance(time)
            for index in range(m):
                plant.set_torque(index, torque[index])
        plant.advance(sync)
        angles = plant.motor_angles()
        speeds, before = (angles - before) / PERIOD, angles
        underway.append((sync + latency, held - gains.kp * (angles - rest) - gains.kd * speeds))
        size[cycle] = np.linalg.norm(speeds)
    blocks = size[cycles // 2 :].reshape(5, -1).max(axis=1)  # the largest of each tenth: the mode oscillates
    times = np.arange(5) * (cycles // 10) * PERIOD
    return np.polyfit(times, np.log(blocks), 1)[0]


@pytest.mark.parametrize(
    ("kd", "late", "position", "cycles"),
    [(0.2, 2, CORNER, 200), (0.2, 2, (0.0, 0.0, 1.0), 200), (0.1, 3, CORNER, 800), (0.1, 4, CORNER, 200)],
)
def test_unstable_loops_grow_as_foretold(machine, kd, late, position, cycles):
    made = machine(Pose(position, np.eye(3)), 300.0)
    gains, latency = LoopGains(2.0, kd), 0.0015 + late * PERIOD
    plant = linear_plant(made.robot, made.robot.home, Payload.none())
    foretold = SampledLoop(plant, LoopTiming(PERIOD, 0.0015)).growth(gains, None, late)
    whole = SampledLoop(plant, LoopTiming(PERIOD, latency)).growth(gains, None)
    assert foretold == pytest.approx(whole, rel=1e-6)
    assert foretold > 0.5
    assert simulated_growth(made, gains, latency, cycles) == pytest.approx(foretold, rel=0.1)


def test_stable_loops_decay_as_foretold(machine):
    made = machine(Pose((0.0, 0.7, 0.3), np.eye(3)), 300.0)
    gains = LoopGains(2.0, 0.1)
    plant = linear_plant(made.robot, made.robot.home, Payload.none())
    foretold = SampledLoop(plant, LoopTiming(PERIOD, 0.0015)).growth(gains, None)
    assert foretold < -1.0
    assert simulated_growth(made, gains, 0.0015, 800) == pytest.approx(foretold, rel=0.05)
