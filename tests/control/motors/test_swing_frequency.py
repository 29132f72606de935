"""The frequency of a pendulum whose hook moves, of loads that are none, and of what changes."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cspr_control.motors.swing_frequency import SwingFrequency

PERIOD = 0.004


def found(pulls, hooks, smallest=0.02):
    """Return times, s, and frequencies that are found along samples of both."""
    frequency, results = SwingFrequency(), []
    for cycle, (pull, hook) in enumerate(zip(pulls, hooks, strict=True)):
        omega = frequency.update(cycle * PERIOD, complex(pull), complex(hook), smallest)
        if omega is not None:
            results.append((cycle * PERIOD, omega))
    return np.array(results).reshape(-1, 2)


def pendulum(omega, duration, hook, begin=(0.05, 0.0)):
    """Return w and a of a pendulum, by scipy: e'' = -omega^2 e - a along x and, a quarter period later, along y."""
    times = np.arange(0.0, duration, PERIOD)

    def motion(phase):
        e, v = begin[0] * math.cos(phase), begin[0] * omega * math.sin(phase)
        right = solve_ivp(
            lambda t, y: [y[1], -(omega**2) * y[0] - hook(t)],
            (0.0, duration), [e, v], t_eval=times, rtol=1e-9, atol=1e-12,
        )  # fmt: skip
        return omega**2 * right.y[0]

    return motion(0.0) + 1j * motion(1.0), np.array([complex(hook(t), hook(t)) for t in times])


@pytest.mark.parametrize("length", [0.1, 0.3, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("moves", [False, True])
def test_a_pendulum_is_found_however_its_hook_moves(length, moves):
    omega = math.sqrt(9.81 / length)
    pulls, hooks = pendulum(omega, 4.0, lambda t: 0.8 * math.sin(2.0 * t + t**2) if moves else 0.0)
    noise = np.random.default_rng(3).normal(0.0, 0.01, (2, len(pulls)))
    results = found(pulls + noise[0] + 1j * noise[1] + 0.05, hooks)
    assert results[0, 0] < 0.6 + math.tau / omega * 0.6
    np.testing.assert_allclose(results[:, 1], omega, rtol=0.15)
    np.testing.assert_allclose(results[results[:, 0] > 2.0, 1], omega, rtol=0.035)


@pytest.mark.parametrize("seed", range(5))
def test_a_rigid_load_has_none(seed):
    """It pulls by its inertia, -a, with noise and an error that drifts, as where a survey is wrong."""
    rng, times = np.random.default_rng(seed), np.arange(0.0, 20.0, PERIOD)
    hooks = np.sin(1.3 * times) + 1j * np.sin(4.0 * times + 0.1 * times**2)
    drift = 0.1 * np.sin(0.5 * times) * (1.0 + 1j)
    noise = np.array([1.0, 1j]) @ rng.normal(0.0, 0.03, (2, times.size))
    assert len(found(-hooks + drift + noise, hooks, smallest=0.02)) == 0


def test_a_swing_that_is_too_small_is_none():
    pulls, hooks = pendulum(4.4, 4.0, lambda t: 0.0)
    assert len(found(0.01 * pulls, hooks, smallest=0.05)) == 0
    assert len(found(pulls, hooks, smallest=0.05)) > 50


def test_what_bounces_faster_than_two_hertz_is_none():
    pulls, hooks = pendulum(2.0 * math.pi * 8.0, 4.0, lambda t: 0.0, (1e-3, 0.0))
    assert len(found(pulls, hooks)) == 0


def test_after_a_gap_it_begins_anew():
    pulls, _ = pendulum(4.4, 3.0, lambda t: 0.0)
    frequency = SwingFrequency()
    for cycle, pull in enumerate(pulls):
        frequency.update(cycle * PERIOD, complex(pull), 0j, 0.02)
    later = [
        frequency.update(5.0 + cycle * PERIOD, complex(pull), 0j, 0.02)
        for cycle, pull in enumerate(pulls[:130])
    ]
    assert not any(later)  # 0.52 s
