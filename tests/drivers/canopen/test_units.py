import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspr_drivers.canopen.cia404 import AUTOZERO_SIGNATURE, NEWTON, status_text
from cspr_drivers.canopen.units import DriveUnits, LoadCellUnits

FORWARD = DriveUnits(polarity=1, encoder_increments=131072, home_counts=0, rated_torque=5.0, torque_limit=7.5)
REVERSED = DriveUnits(
    polarity=-1, encoder_increments=4096, home_counts=1000, rated_torque=3.2, torque_limit=9.6
)


def test_a_revolution_that_pays_out_is_two_pi():
    assert FORWARD.angle(131072) == pytest.approx(2 * math.pi)
    assert REVERSED.angle(1000 - 4096) == pytest.approx(2 * math.pi)
    assert REVERSED.angle(1000) == 0.0


def test_thousandths_of_rated_torque():
    assert FORWARD.torque(-200) == pytest.approx(-1.0)
    assert FORWARD.per_mille(-1.0) == -200
    assert REVERSED.torque(500) == pytest.approx(-1.6)
    assert REVERSED.per_mille(-1.6) == 500


def test_torque_is_rounded_and_held_within_the_limit():
    assert FORWARD.max_torque == 1500
    assert FORWARD.per_mille(0.0124) == 2
    assert FORWARD.per_mille(7.5) == 1500
    assert FORWARD.per_mille(8.0) == 1500
    assert REVERSED.per_mille(50.0) == -3000
    assert DriveUnits(1, 4096, 0, 3.0, 1.0).max_torque == 333


@pytest.mark.parametrize("units", [FORWARD, REVERSED])
@given(counts=st.integers(-(2**31), 2**31 - 1))
def test_counts_survive_the_round_trip(units, counts):
    assert units.counts(units.angle(counts)) == counts


@pytest.mark.parametrize("units", [FORWARD, REVERSED])
@given(torque=st.floats(-7.0, 7.0))
def test_torque_survives_within_half_a_thousandth(units, torque):
    assert units.torque(units.per_mille(torque)) == pytest.approx(torque, abs=0.00051 * units.rated_torque)


def test_tension_of_a_process_value():
    units = LoadCellUnits(decimal_digits=1, scale=1.02, offset=3.0)
    assert units.tension(10_000) == pytest.approx(1017.0)
    assert units.process_value(1017.0) == 10_000


def test_newton_in_the_coding_of_units():
    # CiA 303-2: prefix 00h (none), numerator 21h (newton), denominator 00h.
    assert NEWTON == 0x00210000


def test_autozero_signature():
    # CiA 404, object 6125h: "zero" in ISO 8859 characters, the first one in the lowest byte.
    assert AUTOZERO_SIGNATURE == 0x6F72657A


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (0x00, "valid"),
        (0x01, "not valid"),
        (0x03, "not valid, positive overload"),
        (0x04, "negative overload"),
        (0x10, "reserved bits 0x10"),
    ],
)
def test_input_status_in_words(status, words):
    assert status_text(status) == words


def test_positions_go_on_where_the_counter_wraps():
    # 6064h is an INTEGER32: 7FFFFFFFh is followed by 80000000h.
    units = dataclasses.replace(FORWARD, home_counts=2**31 - 1)
    assert units.angle(-(2**31)) == pytest.approx(2 * math.pi / 131072)
    assert units.angle(-(2**31) + 131071) == pytest.approx(2 * math.pi)
    assert units.angle(2**31 - 1 - 131072) == pytest.approx(-2 * math.pi)
    assert units.counts(2 * math.pi) == -(2**31) + 131071
    below = dataclasses.replace(REVERSED, home_counts=-(2**31))
    assert below.angle(2**31 - 4096) == pytest.approx(2 * math.pi)
    assert below.counts(2 * math.pi) == 2**31 - 4096
