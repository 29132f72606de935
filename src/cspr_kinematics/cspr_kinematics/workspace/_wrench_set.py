"""Faces of the set of available wrenches, and the margins of required wrenches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel

# Five columns whose elimination meets a pivot below this share of the first do not span a face.
_INDEPENDENT = 1e-9
# A set of wrenches thinner than this share of the sum of the tension ranges is flat.
_FLAT = 1e-9


@kernel
def faces_kernel(A: FloatArray, t_min: FloatArray, t_max: FloatArray, faces: FloatArray) -> int:
    """Write outward unit normals and offsets of {A t : t_min <= t <= t_max}, and return their number.

    Parameters
    ----------
    A : numpy.ndarray, shape (6, m)
        Moments divided by the lever.
    t_min, t_max : numpy.ndarray, shape (m,)
    faces : numpy.ndarray, shape (2 binomial(m, 5), 7)
        Receives rows [normal, offset]; two opposite ones for any five independent columns.
    """
    m = A.shape[1]
    chosen = np.arange(5)
    normal = np.empty(6)
    work = np.empty((5, 6))
    order = np.empty(6, dtype=np.int64)
    count = 0
    while True:
        for row in range(5):
            for k in range(6):
                work[row, k] = A[k, chosen[row]]
        if _orthogonal_kernel(work, order, normal):
            lower, upper = 0.0, 0.0
            for i in range(m):
                slope = 0.0
                for k in range(6):
                    slope += normal[k] * A[k, i]
                lower += min(slope * t_min[i], slope * t_max[i])
                upper += max(slope * t_min[i], slope * t_max[i])
            for k in range(6):
                faces[count, k] = normal[k]
                faces[count + 1, k] = -normal[k]
            faces[count, 6] = upper
            faces[count + 1, 6] = -lower
            count += 2
        # The next five of m in lexicographic order.
        place = 4
        while place >= 0 and chosen[place] == m - 5 + place:
            place -= 1
        if place < 0:
            return count
        chosen[place] += 1
        for k in range(place + 1, 5):
            chosen[k] = chosen[k - 1] + 1


@kernel
def _orthogonal_kernel(work: FloatArray, order: NDArray[np.int64], normal: FloatArray) -> bool:
    """Write the unit vector (6,) orthogonal to the rows of `work` (5, 6), which is destroyed.

    By elimination with complete pivoting. Returns False if the rows are dependent.
    """
    for k in range(6):
        order[k] = k
    first = 0.0
    for step in range(5):
        row, column, pivot = step, step, 0.0
        for i in range(step, 5):
            for k in range(step, 6):
                if abs(work[i, k]) > pivot:
                    row, column, pivot = i, k, abs(work[i, k])
        if step == 0:
            first = pivot
        if pivot <= _INDEPENDENT * first:
            return False
        for k in range(6):
            work[step, k], work[row, k] = work[row, k], work[step, k]
        for i in range(5):
            work[i, step], work[i, column] = work[i, column], work[i, step]
        order[step], order[column] = order[column], order[step]
        for i in range(step + 1, 5):
            factor = work[i, step] / work[step, step]
            for k in range(step + 1, 6):
                work[i, k] -= factor * work[step, k]
    # Last unknown 1, the others by back substitution.
    normal[order[5]] = 1.0
    squared = 1.0
    for step in range(4, -1, -1):
        value = -work[step, 5]
        for k in range(step + 1, 5):
            value -= work[step, k] * normal[order[k]]
        normal[order[step]] = value / work[step, step]
        squared += normal[order[step]] ** 2
    for k in range(6):
        normal[k] /= np.sqrt(squared)
    return True


@kernel
def task_kernel(
    faces: FloatArray,
    count: int,
    wrench: FloatArray,
    wrench_per_kg: FloatArray,
    box: FloatArray,
    box_per_kg: FloatArray,
    payload_min: float,
    payload_max: float,
    payload_range: FloatArray,
) -> float:
    """Return the margin of a task, and write the range of payloads with which it is possible.

    The task: every payload mass p from payload_min to payload_max with every acceleration of a box. Its
    wrenches are (wrench + p wrench_per_kg) + sum_j s_j (box_j + p box_per_kg_j), |s_j| <= 1.

    Parameters
    ----------
    faces : numpy.ndarray, shape (f, 7)
        As `faces_kernel` writes them; the first `count` rows count.
    wrench, wrench_per_kg : numpy.ndarray, shape (6,)
    box, box_per_kg : numpy.ndarray, shape (6, 6)
        Row j: the wrench of the largest acceleration along axis j.
    payload_range : numpy.ndarray, shape (2,)
        Receives the smallest and largest mass with which every acceleration of the box is possible, kg; NaN if
        there is none. Negative where the platform itself could be lighter.

    Returns
    -------
    float
        Smallest distance of the task's wrenches from a face, negative if some lie outside.
    """
    margin = np.inf
    lowest, highest = -np.inf, np.inf
    share = np.empty(6)
    share_per_kg = np.empty(6)
    breaks = np.empty(6)
    for face in range(count):
        constant, slope = -faces[face, 6], 0.0
        for k in range(6):
            constant += faces[face, k] * wrench[k]
            slope += faces[face, k] * wrench_per_kg[k]
        at_min, at_max = constant + slope * payload_min, constant + slope * payload_max
        for j in range(6):
            share[j], share_per_kg[j] = 0.0, 0.0
            for k in range(6):
                share[j] += faces[face, k] * box[j, k]
                share_per_kg[j] += faces[face, k] * box_per_kg[j, k]
            at_min += abs(share[j] + share_per_kg[j] * payload_min)
            at_max += abs(share[j] + share_per_kg[j] * payload_max)
        margin = min(margin, -at_min, -at_max)  # the excess is convex in the payload
        # Where constant + slope p + sum |share + share_per_kg p| <= 0: an interval of p, by its breakpoints.
        number = 0
        for j in range(6):
            if share_per_kg[j] != 0.0:
                position = -share[j] / share_per_kg[j]
                place = number
                while place > 0 and breaks[place - 1] > position:
                    breaks[place] = breaks[place - 1]
                    place -= 1
                breaks[place] = position
                number += 1
        for part in range(number + 1):
            start = breaks[part - 1] if part > 0 else -np.inf
            end = breaks[part] if part < number else np.inf
            if number == 0:
                inside = 0.0
            elif part == 0:
                inside = end - 1.0
            elif part == number:
                inside = start + 1.0
            else:
                inside = 0.5 * (start + end)
            a, b = constant, slope
            for j in range(6):
                sign = 1.0 if share[j] + share_per_kg[j] * inside >= 0.0 else -1.0
                a += sign * share[j]
                b += sign * share_per_kg[j]
            # On this part the excess is a + b p, and never above it elsewhere.
            if b > 0.0:
                highest = min(highest, -a / b)
            elif b < 0.0:
                lowest = max(lowest, -a / b)
            elif a > 0.0:
                lowest, highest = np.inf, -np.inf
    payload_range[0] = lowest if lowest <= highest else np.nan
    payload_range[1] = highest if lowest <= highest else np.nan
    return margin


@kernel
def grid_batch(
    A: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    wrench: FloatArray,
    wrench_per_kg: FloatArray,
    box: FloatArray,
    box_per_kg: FloatArray,
    payload_min: float,
    payload_max: float,
    margin: FloatArray,
    payload_range: FloatArray,
) -> None:
    """Write margins (n,) and payload ranges (n, 2) of the same task at n poses.

    A (n, 6, m), wrench and wrench_per_kg (n, 6), box and box_per_kg (n, 6, 6), moments divided by the lever.
    A pose at which the cables span no wrench set has the margin -inf.
    """
    m = A.shape[2]
    span = 0.0
    for i in range(m):
        span += t_max[i] - t_min[i]
    combinations = m * (m - 1) * (m - 2) * (m - 3) * (m - 4) // 120
    faces = np.empty((2 * combinations, 7))
    for k in range(A.shape[0]):
        count = faces_kernel(A[k], t_min, t_max, faces)
        flat = count == 0
        for face in range(0, count, 2):
            flat |= faces[face, 6] + faces[face + 1, 6] <= _FLAT * span
        if flat:
            margin[k] = -np.inf
            payload_range[k] = np.nan
            continue
        margin[k] = task_kernel(
            faces,
            count,
            wrench[k],
            wrench_per_kg[k],
            box[k],
            box_per_kg[k],
            payload_min,
            payload_max,
            payload_range[k],
        )
