"""Seven kinds of faults on every signal: the robot is held, brakes closed, or it goes on along its path.

All of them take a quarter of an hour: `cspr faults --signals`. Here is one of each kind, of different signals.
"""

from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from cspr_control.closed_loop.fault_outcome import LARGEST_DROP, LARGEST_MOVEMENT, outcome_of
from cspr_control.closed_loop.signal_faults import SIGNALS, signal_scenarios
from cspr_drivers.simulation.disturbance import DisturbanceKind

CONFIG = Path(__file__).parents[2] / "config"
SCENARIOS = {scenario.name: scenario for scenario in signal_scenarios()}


def test_each_signal_has_each_kind():
    names = {f"{signal}_{kind.value}" for signal in SIGNALS for kind in DisturbanceKind}
    assert set(SCENARIOS) == names
    assert len(DisturbanceKind) == 7


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("platform_pose_off", "stale topic: /platform_pose"),
        ("setpoint_stuck", ""),
        ("motor_states_stuck", "stale topic: /motor_states of can_drives shows the same angles of motor_1, "),
        ("reference_wrong", "following error: the set-point of motor_"),
        ("drive_frames_garbage", "motor_3"),
        ("motor_states_wrong", "motor_3"),
        ("cable_tensions_slow", None),
        ("supervisor_alive_delayed", "no sign of life of the supervisor"),
        ("payload_intermittent", None),
    ],
)
def test_a_robot_that_moves_is_held_or_goes_on(name, cause):
    outcome = outcome_of(SCENARIOS[name], True, CONFIG)
    assert outcome.drop <= LARGEST_DROP
    if cause is None:
        assert outcome.duration is None
        assert outcome.moved <= LARGEST_MOVEMENT
    else:
        assert outcome.duration is not None
        assert cause in outcome.cause
        assert outcome.moved <= 0.035  # of an encoder or of a position at which all motors stand still
