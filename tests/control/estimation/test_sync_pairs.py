import numpy as np

from cspr_control.estimation.sync_pairs import SyncPairs
from cspr_msgs_py.wire.joint_state import JointStateSample

ONE, OTHER, TORQUE = np.full(8, 1.0), np.full(8, 2.0), np.full(8, 3.0)
PERIOD = 500_000  # ns, the shortest


def motors(cycle):
    return JointStateSample(cycle * PERIOD, ONE, np.zeros(8), TORQUE)


def test_what_has_the_same_stamp_is_a_pair_whichever_comes_first():
    pairs = SyncPairs()
    assert pairs.motors(motors(1)) is None
    pair = pairs.tensions(PERIOD, OTHER)
    assert pair.stamp == PERIOD
    assert pair.motor_angles is ONE
    assert pair.tensions is OTHER
    assert pair.torques is TORQUE
    assert pairs.tensions(2 * PERIOD, OTHER) is None
    assert pairs.motors(motors(2)).stamp == 2 * PERIOD
    assert pairs.unpaired == 0


def test_a_sample_belongs_to_one_pair_at_most():
    pairs = SyncPairs()
    pairs.motors(motors(1))
    assert pairs.tensions(PERIOD, OTHER) is not None
    assert pairs.tensions(PERIOD, OTHER) is None


def test_what_waits_in_vain_is_counted_and_forgotten():
    pairs = SyncPairs()
    pairs.motors(motors(1))
    assert pairs.motors(motors(2)) is None
    assert pairs.tensions(PERIOD, OTHER) is None
    assert pairs.tensions(2 * PERIOD, OTHER).stamp == 2 * PERIOD
    assert pairs.unpaired == 2


def test_stamps_of_another_process_may_differ_by_less_than_half_a_cycle():
    pairs = SyncPairs()
    pairs.motors(motors(3))
    assert pairs.tensions(3 * PERIOD + 240_000, OTHER).stamp == 3 * PERIOD
    pairs.motors(motors(4))
    assert pairs.tensions(4 * PERIOD - 260_000, OTHER) is None
