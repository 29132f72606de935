"""The test of closed brakes, before the torque goes."""

import pytest

from cspr_drivers.brakes.brake_proof import DURATION, BrakeProof


@pytest.fixture
def proof():
    proof = BrakeProof(2, 0.1)
    proof.observe(0, 7.0)
    proof.observe(1, -3.0)
    return proof


def test_the_torque_stays_until_all_brakes_are_closed(proof):
    assert proof.torque_share(10.0) == 1.0
    assert not proof.passed(10.0)


def test_the_torque_is_taken_back_and_brakes_that_hold_pass_after_a_fifth_of_a_second(proof):
    proof.begin(10.0)
    proof.begin(10.1)
    shares = [proof.torque_share(10.0 + 0.005 * k) for k in range(12)]
    assert shares[0] == 1.0
    assert shares == sorted(shares, reverse=True)
    assert shares[-2:] == [0.0, 0.0]
    proof.observe(0, 7.05)
    assert not proof.passed(10.0 + DURATION - 1e-6)
    assert proof.passed(10.0 + DURATION + 1e-6)


def test_a_brake_that_slips_has_the_torque_back_at_once_and_for_good(proof):
    proof.begin(10.0)
    assert proof.torque_share(10.06) == 0.0
    proof.observe(1, -3.2)
    assert proof.slipped == {1: pytest.approx(-0.2)}
    assert proof.torque_share(10.06) == 1.0
    proof.observe(1, -3.0)
    assert proof.torque_share(10.3) == 1.0
    assert not proof.passed(10.3)
