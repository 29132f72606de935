"""Tracks of poses between their samples, and how far two of them are apart."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspr_control.analysis.pose_track import PoseTrack, pose_difference
from cspr_msgs_py.bag.columns import Poses

STEP = 4_000_000  # ns


def about_z(angles: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) of rotations about z, rad."""
    zero = np.zeros_like(angles)
    return np.stack([zero, zero, np.sin(angles / 2.0), np.cos(angles / 2.0)], axis=-1)


def track(times: np.ndarray, speed: float = 1.0, rate: float = 1.0) -> PoseTrack:
    """A platform that moves along x and turns about z, m/s and rad/s."""
    seconds = times * 1e-9
    position = np.stack([speed * seconds, 0.0 * seconds, 2.0 + 0.0 * seconds], axis=-1)
    return PoseTrack.of(Poses(0, times, times, position, about_z(rate * seconds)))


def test_between_its_poses_a_track_is_where_a_steady_motion_is() -> None:
    times = STEP * np.arange(100)
    asked = times[:-1] + 1_234_567
    found = track(times).at(asked)
    np.testing.assert_array_equal(found.time_ns, asked)
    np.testing.assert_allclose(found.position[:, 0], asked * 1e-9, atol=1e-12)
    assert found.rotation is not None
    np.testing.assert_allclose(found.rotation.as_quat(), about_z(asked * 1e-9), atol=1e-12)


def test_nothing_is_said_of_times_before_after_and_in_gaps() -> None:
    times = STEP * np.concatenate((np.arange(10, 20), np.arange(60, 70)))  # 160 ms without a pose
    asked = STEP * np.arange(0, 100, 5)
    assert (track(times).at(asked).time_ns // STEP).tolist() == [10, 15, 60, 65]
    assert track(times[:1]).at(asked).time_ns.tolist() == [10 * STEP]
    assert track(times[:0]).at(asked).time_ns.size == 0


def test_poses_that_are_none_are_left_out() -> None:
    times = STEP * np.array([0, 1, 1, 2, 3, 4])
    position, quaternion = np.zeros((6, 3)), about_z(np.zeros(6))
    position[2] = 9.0  # twice at the same time
    position[3, 1] = np.nan
    quaternion[4] *= 1.01
    found = PoseTrack.of(Poses(0, times, times, position, quaternion))
    assert (found.time_ns // STEP).tolist() == [0, 1, 4]
    assert not found.position.any()
    unknown = PoseTrack.of(Poses(0, times, times, np.zeros((6, 3)), np.zeros((6, 4))))
    assert unknown.rotation is None
    assert unknown.time_ns.size == 5


def test_a_point_of_a_platform_that_turns_goes_round() -> None:
    times = STEP * np.arange(50)
    place = track(times, rate=3.0).of_point(np.array([0.2, 0.0, -0.1])).position
    angle = 3.0 * times * 1e-9
    np.testing.assert_allclose(place[:, 0], times * 1e-9 + 0.2 * np.cos(angle), atol=1e-12)
    np.testing.assert_allclose(place[:, 1], 0.2 * np.sin(angle), atol=1e-12)
    np.testing.assert_allclose(place[:, 2], 1.9, atol=1e-12)
    with pytest.raises(ValueError, match="not known"):
        PoseTrack(times, place, None).of_point(np.ones(3))


def test_difference_of_two_tracks() -> None:
    """Also at stamps between those of the second; the angle by the quaternions' own product."""
    times = STEP * np.arange(1, 50)
    first = track(times)
    turned = Rotation.from_rotvec([0.01, 0.02, -0.03])
    assert first.rotation is not None
    second = PoseTrack(times - 777, first.position - [1.0, 2.0, 2.0], turned * first.rotation)
    found = pose_difference(first, second)
    assert found.time_ns.size == times.size - 1  # the last one is after the second's end
    np.testing.assert_allclose(found.position[:, 1:], [[2.0, 2.0]] * found.time_ns.size)
    np.testing.assert_allclose(found.distance, 3.0, atol=1e-6)
    assert found.angle is not None
    product = abs((first.rotation[0].as_quat() * second.rotation[0].as_quat()).sum())
    assert found.angle[0] == pytest.approx(2.0 * math.acos(product), abs=1e-6)
    assert found.angle[0] == pytest.approx(math.sqrt(14.0) * 0.01, abs=1e-6)
    np.testing.assert_allclose((-found).position, -found.position)
    prism = pose_difference(PoseTrack(times, first.position, None), second)
    assert prism.rotation is None
    assert prism.angle is None
