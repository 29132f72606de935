"""The misfit of a run's lengths: of pulleys that nobody configured, and of what the stated uncertainty explains."""

import math

import numpy as np
import pytest

from cspr_control.estimation.length_misfit import LengthMisfit
from cspr_kinematics import Pose, Pulleys, cable_lengths, forward_kinematics


def run(believed, truth, swing=0.5, noise=0.0):
    """Move as smooth-19 does, with the lengths of a true robot; return the misfit that the believed one finds."""
    misfit, rng, pose = LengthMisfit(believed), np.random.default_rng(1), believed.home
    for s in np.linspace(0.0, 2.0 * np.pi, 200):
        place = believed.home.position + swing * np.array([np.sin(s), np.sin(2.0 * s), np.sin(s)])
        paid_out = cable_lengths(truth, Pose(place, np.eye(3))) - truth.winch.home_lengths
        lengths = believed.winch.home_lengths + paid_out + noise * rng.normal(size=8)
        pose = forward_kinematics(believed, lengths, pose)
        for _ in range(3):  # standing still does not count
            misfit.observe(lengths, lengths - cable_lengths(believed, pose))
    return misfit


def test_pulleys_that_nobody_configured_are_named_within_a_run(robot):
    misfit = run(robot, robot.with_geometry(pulleys=Pulleys(0.05)))
    assert misfit.rms > misfit.explained
    assert "pulleys that robot.yaml does not describe" in misfit.problem
    assert "cspr identify BAG" in misfit.problem
    assert 20 < misfit.places <= 200


def test_the_same_run_is_no_problem_where_the_pulleys_are_known(robot):
    known = robot.with_geometry(pulleys=Pulleys(0.05))
    assert run(known, known).rms < 1e-6
    assert not run(known, known, noise=0.5 * robot.length_deviation).problem


def test_the_misfit_is_that_of_its_definition(robot):
    noise = 0.5 * robot.length_deviation
    assert run(robot, robot, noise=noise).rms == pytest.approx(noise * math.sqrt(2.0), rel=0.1)


def test_a_robot_at_home_has_no_misfit(robot):
    misfit = LengthMisfit(robot)
    misfit.observe(robot.winch.home_lengths, np.zeros(8))
    assert misfit.places == 0
    assert math.isnan(misfit.rms)
    assert not misfit.problem
