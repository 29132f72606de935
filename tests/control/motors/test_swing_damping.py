"""The offset that damps a swing, on an ideal pendulum whose hook is where it should be."""

import math

import numpy as np
import pytest

from cspr_control.motors.swing_damping import SwingDamping, SwingSettings
from cspr_control.motors.swing_frequency import SwingFrequency
from cspr_msgs_py.parameters.table import defaults

PERIOD = 0.004
SHIPPED = SwingSettings.of(defaults("feedforward"))
SETTINGS = SwingSettings(0.35, SHIPPED.dead_zone, SHIPPED.reach, SHIPPED.acceleration, SHIPPED.delay)
TAU = 0.02  # s, of the two poles of the estimator


class Pendulum:
    """A load on a sling, integrated in steps of 0.5 ms, and what the estimator says of it: late, by two poles."""

    def __init__(self, length, mass=100.0, degrees=5.0, settings=SETTINGS, direction=1.0):
        self.damping = SwingDamping(settings)
        self.omega, self.mass, self.rigid = math.sqrt(9.81 / length), mass, False
        self.e, self.v = direction * length * math.radians(degrees), 0j
        self.cycle, self._first, self._second, self._waiting = 0, 0j, 0j, [0j, 0j]
        self.swings, self.offsets, self.error = [], [], 0j

    def run(self, duration, acts=True, pulls=True, halts=False, path=lambda t: 0.0):
        """Let time pass, s; return the amplitudes of the swing, m."""
        begin = self.cycle
        for _ in range(round(duration / PERIOD)):
            self.cycle += 1
            time, stamp = self.cycle * PERIOD, round(self.cycle * PERIOD * 1e9)
            offset = self.damping.advance(stamp, path(time), acts, halts)
            hook = offset.acceleration + path(time)
            u = 0j
            for _ in range(8):
                self.v += PERIOD / 8 * (-(self.omega**2) * self.e - hook)
                self.e += PERIOD / 8 * self.v
                u = 0j if self.rigid else self.omega**2 * self.e + hook
                self._first += (u + self.error - self._first) * PERIOD / 8 / TAU
                self._second += (self._first - self._second) * PERIOD / 8 / TAU
            self._waiting.append(self._second)
            if pulls:
                self.damping.observe(stamp, self.mass * self._waiting.pop(0), self.mass)
            self.swings.append(math.hypot(abs(self.e), abs(self.v) / self.omega))
            self.offsets.append(offset)
        return np.array(self.swings[begin:])


@pytest.mark.parametrize("length", [0.2, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("direction", [1.0, 1j, 0.6 - 0.8j])
def test_a_swing_decays(length, direction):
    pendulum = Pendulum(length, direction=direction)
    swings = pendulum.run(8.0)
    assert pendulum.damping.omega == pytest.approx(pendulum.omega, rel=0.05)
    assert swings[-1] < 0.2 * swings[0]
    offsets = np.array(pendulum.offsets)
    assert np.abs(offsets[:, 0]).max() < SETTINGS.reach
    assert np.abs(offsets[:, 2]).max() < SETTINGS.acceleration
    if length == 0.5:
        assert swings[round(3.0 / PERIOD) :].max() < 0.2 * swings[0]


def test_position_velocity_and_acceleration_belong_together():
    pendulum = Pendulum(0.5, degrees=15.0)
    pendulum.run(3.0)
    position, velocity, acceleration = np.array(pendulum.offsets).T
    assert np.abs(position).max() > 0.5 * SETTINGS.reach
    np.testing.assert_allclose(np.gradient(position, PERIOD)[1:-1], velocity[1:-1], atol=2e-4)
    np.testing.assert_allclose(np.diff(velocity) / PERIOD, acceleration[1:], atol=0.02)


@pytest.mark.parametrize("degrees", [15.0, 40.0])
def test_a_wide_swing_is_answered_within_the_limits(degrees):
    pendulum = Pendulum(0.5, degrees=degrees)
    swings = pendulum.run(12.0)
    assert swings[-1] < 0.5 * swings[0]
    assert max(abs(offset.position) for offset in pendulum.offsets) < SETTINGS.reach


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.3, 1.6])
@pytest.mark.parametrize("zeta", [0.1, 0.35])
def test_a_wrong_frequency_does_not_excite(ratio, zeta, monkeypatch):
    """`ratio` of the true one to the one that is believed, with the delay of the estimator."""
    settings = SwingSettings(zeta, 0.1, 1.0, 100.0, SETTINGS.delay)
    pendulum = Pendulum(0.5, settings=settings)
    monkeypatch.setattr(SwingFrequency, "update", lambda *arguments: pendulum.omega / ratio)
    swings = pendulum.run(15.0)
    assert swings[-1] < 0.6 * swings[0]
    assert swings[-500:].max() < swings[-1500:-1000].max()


def test_a_constant_error_of_the_pull_is_no_swing():
    pendulum = Pendulum(0.5, degrees=0.0)
    pendulum.error = 0.15
    pendulum.run(6.0)
    assert not np.any(pendulum.offsets)


def test_a_rigid_load_along_a_path_is_left_alone():
    pendulum = Pendulum(0.5, degrees=0.0)
    pendulum.rigid = True
    pendulum.run(10.0, path=lambda t: 2.0 * math.sin(3.0 * t))
    assert pendulum.damping.omega is None
    assert not np.any(pendulum.offsets)


def test_where_the_swinging_load_is_made_fast_the_offset_ends():
    pendulum = Pendulum(0.5)
    pendulum.run(1.5)
    assert abs(pendulum.offsets[-1].position) > 1e-3
    pendulum.rigid = True
    pendulum.run(8.0)
    assert pendulum.offsets[-1] == (0j, 0j, 0j)


def test_a_swing_is_damped_on_the_way():
    pendulum, free = Pendulum(0.5), Pendulum(0.5, settings=SHIPPED)
    for each in (pendulum, free):
        each.run(6.0, path=lambda t: 0.5 * math.sin(1.5 * t) if t < 4.0 * math.pi / 1.5 else 0.0)
    assert pendulum.run(3.0)[-1] < 0.3 * free.run(3.0)[-1]


@pytest.mark.parametrize("cause", ["gate", "silence", "another load", "switched off"])
def test_it_fades_without_a_jump(cause):
    pendulum = Pendulum(0.5, degrees=10.0)
    pendulum.run(1.6)
    before = len(pendulum.offsets)
    assert abs(pendulum.offsets[-1].position) > 5e-3
    if cause == "another load":
        pendulum.mass *= 1.5
    if cause == "switched off":
        pendulum.damping.settings = SHIPPED
    pendulum.run(0.7, acts=cause != "gate", pulls=cause != "silence")
    position, velocity, _ = np.array(pendulum.offsets[before - 1 :]).T
    assert np.abs(np.diff(position)).max() < 1.5 * PERIOD * np.abs(velocity).max()
    assert np.abs(np.diff(velocity)).max() < 1.5 * PERIOD * SETTINGS.acceleration
    if cause != "another load":  # which is found to swing as the one before
        pendulum.run(8.0, acts=cause != "gate", pulls=cause != "silence")
        assert pendulum.offsets[-1] == (0j, 0j, 0j)
    assert pendulum.damping.idle is (cause == "switched off")


def test_when_the_robot_stops_the_offset_comes_to_rest_where_it_is():
    pendulum = Pendulum(0.5, degrees=10.0)
    pendulum.run(1.6)
    there = pendulum.offsets[-1].position
    pendulum.run(0.5, acts=False, halts=True)
    assert abs(pendulum.offsets[-1].velocity) < 1e-4
    assert abs(pendulum.offsets[-1].position - there) < 0.02
    pendulum.damping.reset()
    assert pendulum.damping.offset.position == 0.0


def test_a_load_of_nothing_is_not_answered():
    pendulum = Pendulum(0.5, mass=0.5, degrees=20.0)
    pendulum.run(3.0)
    assert not np.any(pendulum.offsets)


def test_what_is_not_finite_is_not_answered():
    pendulum = Pendulum(0.5)
    pendulum.run(1.0)
    pendulum.error = complex("nan")
    pendulum.run(1.0)
    assert np.isfinite(np.array(pendulum.offsets)).all()


def test_it_is_off_by_default():
    assert SHIPPED.damping == 0.0
    assert SwingDamping(SHIPPED).idle
    assert not SwingDamping(SETTINGS).idle
