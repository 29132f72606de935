"""The radius of pulleys from lengths along a path, of robots whose points are not quite where they are believed."""

import dataclasses

import numpy as np
import pytest

from cspr_control.calibration.pulley_radius import identify_pulley_radius
from cspr_control.calibration.samples import CalibrationSamples
from cspr_control.errors import ControlError
from cspr_kinematics import CableProperties, Payload, Pose, Pulleys, cable_lengths, holding_tensions

LIMIT = 0.01


def way(robot, count=60, size=1.0):
    """A way through the workspace, tilted a little, from the home pose on."""
    s = np.linspace(0.0, 2.0 * np.pi, count)
    span = robot.workspace_max - robot.workspace_min
    swing = np.stack((np.sin(s), np.sin(2.0 * s), np.sin(3.0 * s)), axis=-1)
    return Pose.from_euler(robot.home.position + 0.3 * size * span * swing, *(0.05 * size * swing.T))


def samples_of(truth, believed, pose, tensions=None):
    return CalibrationSamples(truth.motor_angles(cable_lengths(truth, pose), tensions), tensions)


@pytest.mark.parametrize("radius", [0.0, 0.02, 0.05, 0.08])
def test_an_exact_run_gives_the_radius(robot, radius):
    truth = robot.with_geometry(pulleys=Pulleys(radius))
    found = identify_pulley_radius(robot, samples_of(truth, robot, way(robot)), LIMIT)
    assert found.radius == pytest.approx(radius, abs=1e-5)
    assert found.misfit_after < 1e-6
    assert found.samples == 60
    if radius:
        assert found.misfit_before > 5e-3 * radius


def test_the_radius_of_the_file_is_what_the_misfit_before_is_of(robot):
    truth = robot.with_geometry(pulleys=Pulleys(0.05))
    found = identify_pulley_radius(truth, samples_of(truth, truth, way(robot)), LIMIT)
    assert found.misfit_before < 1e-9
    assert found.radius == pytest.approx(0.05, abs=1e-5)


def test_the_stretch_under_a_payload_is_not_taken_for_pulleys(robot):
    stretching = dataclasses.replace(robot, cables=CableProperties(1.2e6, dead_length=1.5))
    truth, pose = stretching.with_geometry(pulleys=Pulleys(0.05)), way(robot)
    tensions = holding_tensions(truth, pose, Payload(200.0, np.zeros(3))).tensions
    found = identify_pulley_radius(stretching, samples_of(truth, stretching, pose, tensions), LIMIT)
    assert found.radius == pytest.approx(0.05, abs=1e-5)


def test_the_deviation_covers_survey_errors(robot, rng):
    """Of points surveyed to a millimetre; the deviation is neither too small nor the width of the answer's range."""
    errors = []
    for _ in range(12):
        truth = robot.with_geometry(
            exit_points=robot.exit_points + 0.7e-3 * rng.normal(size=(8, 3)),
            anchor_points=robot.anchor_points + 0.3e-3 * rng.normal(size=(8, 3)),
            pulleys=Pulleys(0.05),
        )
        found = identify_pulley_radius(robot, samples_of(truth, robot, way(robot)), LIMIT)
        errors.append((found.radius - 0.05) / found.deviation)
        assert found.misfit_after < 0.3 * found.misfit_before
    assert 0.05 < np.sqrt(np.mean(np.square(errors))) < 2.0  # of 60 seeds 0.12 to 0.42


@pytest.mark.parametrize(("count", "size"), [(1, 1.0), (60, 0.02)])
def test_a_motion_that_does_not_tell_is_refused(robot, count, size):
    truth = robot.with_geometry(pulleys=Pulleys(0.05))
    with pytest.raises(ControlError, match=r"this motion tells the radius .*Record a longer way"):
        identify_pulley_radius(robot, samples_of(truth, robot, way(robot, count, size)), 0.005)


def test_what_is_no_pulley_is_not_called_one(robot):
    """A frame that is wider than described: some radius fits best, and not well."""
    exits = robot.exit_points.copy()
    exits[:, 1] *= 1.15
    truth = robot.with_geometry(exit_points=exits)
    with pytest.raises(ControlError, match="not the pulleys alone"):
        identify_pulley_radius(robot, samples_of(truth, robot, way(robot)), LIMIT)
