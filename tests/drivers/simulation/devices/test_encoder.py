import pytest

from cspr_drivers.simulation.devices.encoder import Encoder


def test_a_sound_encoder_shows_the_shaft():
    encoder = Encoder()
    assert [encoder.angle(time, 3.0 * time) for time in (1.0, 2.0)] == [3.0, 6.0]
    assert encoder.speed(3.0) == 3.0


def test_a_frozen_encoder_shows_what_it_showed_last_and_no_speed():
    encoder = Encoder()
    encoder.angle(1.0, 3.0)
    encoder.frozen = True
    assert [encoder.angle(time, 3.0 * time) for time in (2.0, 3.0)] == [3.0, 3.0]
    assert encoder.speed(3.0) == 0.0
    encoder.frozen = False
    assert encoder.angle(4.0, 12.0) == 12.0


def test_a_drifting_encoder_turns_against_its_shaft_until_it_is_referenced_anew():
    encoder = Encoder()
    encoder.angle(10.0, 1.0)
    encoder.drift = 2.0
    assert [encoder.angle(time, 1.0) for time in (10.5, 11.0, 11.0)] == pytest.approx([2.0, 3.0, 3.0])
    assert encoder.speed(-2.0) == 0.0
    encoder.drift = 0.0
    assert encoder.angle(11.5, 1.0) == 1.0
