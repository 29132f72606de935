"""Distances between straight cables, and between a cable and a box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel


@kernel
def cable_distances_kernel(
    starts: FloatArray, spans: FloatArray, pairs: NDArray[np.int64], distances: FloatArray
) -> None:
    """Write the distance of the cables of each pair at n poses.

    Parameters
    ----------
    starts, spans : numpy.ndarray, shape (n, m, 3)
        Where each cable begins, and the vector to its end.
    pairs : numpy.ndarray of int, shape (p, 2)
    distances : numpy.ndarray, shape (n, p)
        Receives the distances.
    """
    for k in range(starts.shape[0]):
        for pair in range(pairs.shape[0]):
            i, j = pairs[pair, 0], pairs[pair, 1]
            distances[k, pair] = segment_distance_kernel(starts[k, i], spans[k, i], starts[k, j], spans[k, j])


@kernel
def segment_distance_kernel(
    start_1: FloatArray, span_1: FloatArray, start_2: FloatArray, span_2: FloatArray
) -> float:
    """Return the distance between two segments, each from `start` to `start + span` (3,).

    The squared distance is convex in the two shares along the segments: its minimum is at the stationary point
    or on one of the four edges.
    """
    a, b, c, d, e, f = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        offset = start_1[k] - start_2[k]
        a += span_1[k] * span_1[k]
        b += span_1[k] * span_2[k]
        c += span_2[k] * span_2[k]
        d += span_1[k] * offset
        e += span_2[k] * offset
        f += offset * offset
    best = np.inf
    determinant = a * c - b * b
    if determinant > 1e-12 * a * c:
        s, t = (b * e - c * d) / determinant, (a * e - b * d) / determinant
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            best = _squared_kernel(start_1, span_1, s, start_2, span_2, t)
    for end in range(2):
        s = float(end)
        t = min(max((b * s + e) / c, 0.0), 1.0) if c > 0.0 else 0.0
        best = min(best, _squared_kernel(start_1, span_1, s, start_2, span_2, t))
        t = float(end)
        s = min(max((b * t - d) / a, 0.0), 1.0) if a > 0.0 else 0.0
        best = min(best, _squared_kernel(start_1, span_1, s, start_2, span_2, t))
    return float(np.sqrt(best))


@kernel
def _squared_kernel(
    start_1: FloatArray,
    span_1: FloatArray,
    s: float,
    start_2: FloatArray,
    span_2: FloatArray,
    t: float,
) -> float:
    total = 0.0
    for k in range(3):
        difference = start_1[k] + s * span_1[k] - start_2[k] - t * span_2[k]
        total += difference * difference
    return total


@kernel
def box_distances_kernel(
    starts: FloatArray, spans: FloatArray, half_size: FloatArray, zone: float, distances: FloatArray
) -> None:
    """Write the distance (n, m) of each cable to a box about the origin, leaving out its first `zone` metres.

    `starts` and `spans` (n, m, 3) in the axes of the box, `half_size` (3,).
    """
    for k in range(starts.shape[0]):
        for i in range(starts.shape[1]):
            length = 0.0
            for axis in range(3):
                length += spans[k, i, axis] ** 2
            length = np.sqrt(length)
            skipped = min(zone / length, 1.0) if length > 0.0 else 1.0
            distances[k, i] = segment_box_distance_kernel(starts[k, i], spans[k, i], skipped, half_size)


@kernel
def segment_box_distance_kernel(
    start: FloatArray, span: FloatArray, first: float, half_size: FloatArray
) -> float:
    """Return the distance of the points start + s span, first <= s <= 1, to a box about the origin.

    The squared distance is convex in s and quadratic between the planes of the box's faces. Its slope is
    therefore increasing and linear between them, and changes sign in one of the intervals.
    """
    breaks = np.empty(8)
    count = 0
    for axis in range(3):
        if span[axis] != 0.0:
            for side in (-1.0, 1.0):
                s = (side * half_size[axis] - start[axis]) / span[axis]
                if first < s < 1.0:
                    place = count
                    while place > 0 and breaks[place - 1] > s:
                        breaks[place] = breaks[place - 1]
                        place -= 1
                    breaks[place] = s
                    count += 1
    breaks[count] = 1.0
    left = first
    left_slope = _slope_kernel(start, span, left, half_size)
    best = left
    if left_slope < 0.0:
        best = 1.0
        for part in range(count + 1):
            right = breaks[part]
            right_slope = _slope_kernel(start, span, right, half_size)
            if right_slope >= 0.0:
                best = left - left_slope * (right - left) / (right_slope - left_slope)
                break
            left, left_slope = right, right_slope
    total = 0.0
    for axis in range(3):
        beyond = max(abs(start[axis] + best * span[axis]) - half_size[axis], 0.0)
        total += beyond * beyond
    return float(np.sqrt(total))


@kernel
def _slope_kernel(start: FloatArray, span: FloatArray, s: float, half_size: FloatArray) -> float:
    """Return half the derivative of the squared distance to the box."""
    slope = 0.0
    for axis in range(3):
        value = start[axis] + s * span[axis]
        if value > half_size[axis]:
            slope += (value - half_size[axis]) * span[axis]
        elif value < -half_size[axis]:
            slope += (value + half_size[axis]) * span[axis]
    return slope
