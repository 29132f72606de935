"""Where torque and tension contradict each other, what fits is named: a cell only if the balance says so too."""

import math

import numpy as np
import pytest

from cspr_control.supervision.torque_check import Contradiction

SOUND = np.array([732.0, 778.0, 690.0, 815.0, 740.0, 760.0, 700.0, 790.0])  # N
ALLOWED = 250.0  # N


def blamed(shown, held, *, cable=2, at_limit=(), unexplained=0.2):
    limited = np.isin(np.arange(len(shown)), at_limit)
    return Contradiction(shown, held, np.abs(shown - held) > ALLOWED, limited, unexplained).culprit(cable)


def one(value):
    held = SOUND.copy()
    held[2] = value
    return held


@pytest.mark.parametrize(("unexplained", "of_cell"), [(0.2, False), (3.0, True), (math.nan, False)])
def test_a_single_one_is_the_cell_where_the_balance_contradicts_it_and_else_the_winch(unexplained, of_cell):
    cell, words = blamed(SOUND, one(200.0), unexplained=unexplained)
    assert cell is of_cell
    assert ("load cell of cable_3" in words) is not (unexplained == 0.2)
    assert ("gear, brake or friction of motor_3" in words) is not of_cell


def test_a_motor_at_its_limit_that_its_cable_does_not_feel_is_blocked_whatever_the_balance_says():
    cell, words = blamed(one(248.0), one(5874.0), at_limit=[2], unexplained=5.0)
    assert not cell
    assert words == "motor_3 is at its torque limit and its cable does not feel it: winch or brake blocked"


def test_flipped_polarities_are_opposite_signs():
    held = SOUND.copy()
    held[[2, 5]] *= -1.0
    cell, words = blamed(SOUND, held)
    assert not cell
    assert (
        words
        == "torque and tension of motor_3, motor_6 have opposite signs: polarity of drives or load cells"
    )


def test_swapped_ones_show_what_the_other_holds():
    held = SOUND.copy()
    held[[2, 5]] = 300.0, 900.0
    shown = SOUND.copy()
    shown[[2, 5]] = 900.0, 300.0
    cell, words = blamed(shown, held)
    assert not cell
    assert words.startswith("cable_3 and cable_6 show what the other's motor holds: drives or load cells")


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_wrong_transmission_is_the_same_factor_everywhere(factor):
    cell, words = blamed(factor * SOUND, SOUND)
    assert not cell
    assert (
        f"cells of 8 cables show {factor:.2f} times what their motors hold: gear_ratio, drum_radius" in words
    )


def test_what_has_nothing_in_common_is_named_with_all_that_it_concerns():
    held = SOUND.copy()
    held[[1, 2, 6]] = 100.0, 1500.0, 300.0
    assert "several at once, motor_2, motor_3, motor_7" in blamed(SOUND, held)[1]
