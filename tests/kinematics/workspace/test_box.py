import numpy as np

from cspr_kinematics import turned_outside, way_outside

LOW, HIGH = np.array([-1.0, -2.0, 0.0]), np.array([1.0, 2.0, 3.0])


def test_how_far_out_along_each_axis():
    positions = [(0.0, 0.0, 1.0), (1.0, 2.0, 3.0), (1.5, -2.25, 1.0), (0.0, 0.0, -0.125)]
    np.testing.assert_array_equal(
        way_outside(positions, LOW, HIGH),
        [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.5, 0.25, 0.0), (0.0, 0.0, 0.125)],
    )


def test_what_is_no_number_is_not_inside():
    assert not (way_outside((0.0, np.nan, 1.0), LOW, HIGH) <= 0.0).all()


def test_how_far_angles_are_out_the_shorter_way_round():
    low, high = np.array([2.8, -0.3, -0.3]), np.array([3.4, 0.3, 0.3])
    angles = [(3.1, 0.0, 0.3), (-3.0, -0.4, 0.0), (-2.5, 0.0, 0.5)]
    expected = [(0.0, 0.0, 0.0), (0.0, 0.1, 0.0), (2.0 * np.pi - 2.5 - 3.4, 0.0, 0.2)]
    np.testing.assert_allclose(turned_outside(angles, low, high), expected, atol=1e-12)
