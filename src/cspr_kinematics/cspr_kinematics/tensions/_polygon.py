"""The feasible tensions of eight cables are a convex polygon in the 2-dimensional null space of the wrench matrix.

With t = p + N x, p the minimum-norm tensions and N (m, 2) an orthonormal basis of the null space, each cable
bounds x by two parallel lines. Any two cables with independent rows of N make a parallelogram, which the
others cut.
"""

from __future__ import annotations

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel

# A vertex this far outside a limit, relative to the largest tension, is on it to rounding.
_ON_LIMIT = 1e-13


@kernel
def feasible_polygon_kernel(
    particular: FloatArray, N: FloatArray, t_min: FloatArray, t_max: FloatArray, vertices: FloatArray
) -> int:
    """Write the vertices of the polygon of feasible tensions, in order around it, and return their number.

    Parameters
    ----------
    particular : numpy.ndarray, shape (m,)
        Tensions p at the origin of the null space.
    N : numpy.ndarray, shape (m, 2)
        Orthonormal basis of the null space.
    t_min, t_max : numpy.ndarray, shape (m,)
    vertices : numpy.ndarray, shape (2 m + 4, 2)
        Receives the vertices; 0 of them if no tensions are feasible. In degenerate cases some coincide.
    """
    m = particular.shape[0]
    first, second, largest = 0, 1, 0.0
    scale = 0.0
    for i in range(m):
        scale = max(scale, abs(t_min[i]), abs(t_max[i]), abs(particular[i]))
        for j in range(i + 1, m):
            determinant = abs(N[i, 0] * N[j, 1] - N[i, 1] * N[j, 0])
            if determinant > largest:
                first, second, largest = i, j, determinant
    tolerance = _ON_LIMIT * scale
    determinant = N[first, 0] * N[second, 1] - N[first, 1] * N[second, 0]
    for corner in range(4):
        upper_first = corner == 1 or corner == 2
        upper_second = corner >= 2
        a = (t_max[first] if upper_first else t_min[first]) - particular[first]
        b = (t_max[second] if upper_second else t_min[second]) - particular[second]
        vertices[corner, 0] = (a * N[second, 1] - b * N[first, 1]) / determinant
        vertices[corner, 1] = (b * N[first, 0] - a * N[second, 0]) / determinant
    count = 4
    cut = np.empty_like(vertices)
    slack = np.empty(vertices.shape[0])
    for i in range(m):
        if i in (first, second):
            continue
        for side in range(2):
            outside = False
            for k in range(count):
                tension = particular[i] + N[i, 0] * vertices[k, 0] + N[i, 1] * vertices[k, 1]
                slack[k] = tension - t_min[i] if side == 0 else t_max[i] - tension
                if slack[k] < -tolerance:
                    outside = True
            if not outside:
                continue
            kept = 0
            for k in range(count):
                following = k + 1 if k + 1 < count else 0
                inside = slack[k] >= -tolerance
                if inside:
                    cut[kept, 0] = vertices[k, 0]
                    cut[kept, 1] = vertices[k, 1]
                    kept += 1
                if inside != (slack[following] >= -tolerance):
                    share = slack[k] / (slack[k] - slack[following])
                    share = min(max(share, 0.0), 1.0)
                    cut[kept, 0] = vertices[k, 0] + share * (vertices[following, 0] - vertices[k, 0])
                    cut[kept, 1] = vertices[k, 1] + share * (vertices[following, 1] - vertices[k, 1])
                    kept += 1
            for k in range(kept):
                vertices[k, 0] = cut[k, 0]
                vertices[k, 1] = cut[k, 1]
            count = kept
            if count == 0:
                return 0
    return count


@kernel
def nearest_in_polygon_kernel(vertices: FloatArray, count: int, x: FloatArray) -> None:
    """Move x (2,), a point outside the polygon, to the nearest point of its boundary."""
    best = np.inf
    nearest_0 = vertices[0, 0]
    nearest_1 = vertices[0, 1]
    for k in range(count):
        following = k + 1 if k + 1 < count else 0
        edge_0 = vertices[following, 0] - vertices[k, 0]
        edge_1 = vertices[following, 1] - vertices[k, 1]
        offset_0 = x[0] - vertices[k, 0]
        offset_1 = x[1] - vertices[k, 1]
        squared = edge_0 * edge_0 + edge_1 * edge_1
        share = (offset_0 * edge_0 + offset_1 * edge_1) / squared if squared > 0.0 else 0.0
        share = min(max(share, 0.0), 1.0)
        distance = (offset_0 - share * edge_0) ** 2 + (offset_1 - share * edge_1) ** 2
        if distance < best:
            best = distance
            # A vertex exactly where it is one: both lines through it stay active.
            nearest_0 = vertices[following, 0] if share == 1.0 else vertices[k, 0] + share * edge_0
            nearest_1 = vertices[following, 1] if share == 1.0 else vertices[k, 1] + share * edge_1
    x[0] = nearest_0
    x[1] = nearest_1


@kernel
def polygon_centroid_kernel(vertices: FloatArray, count: int, x: FloatArray) -> None:
    """Write the centroid of the polygon's area to x (2,); of its edges where it has no area."""
    doubled_area = 0.0
    moment_0 = 0.0
    moment_1 = 0.0
    length = 0.0
    edges_0 = 0.0
    edges_1 = 0.0
    for k in range(count):
        following = k + 1 if k + 1 < count else 0
        # About the first vertex, so that a small polygon far from the origin keeps its digits.
        a_0 = vertices[k, 0] - vertices[0, 0]
        a_1 = vertices[k, 1] - vertices[0, 1]
        b_0 = vertices[following, 0] - vertices[0, 0]
        b_1 = vertices[following, 1] - vertices[0, 1]
        area = a_0 * b_1 - a_1 * b_0
        doubled_area += area
        moment_0 += area * (a_0 + b_0)
        moment_1 += area * (a_1 + b_1)
        edge = np.sqrt((b_0 - a_0) ** 2 + (b_1 - a_1) ** 2)
        length += edge
        edges_0 += edge * (a_0 + b_0)
        edges_1 += edge * (a_1 + b_1)
    x[0] = vertices[0, 0]
    x[1] = vertices[0, 1]
    if abs(doubled_area) > 1e-12 * length * length:
        x[0] += moment_0 / (3.0 * doubled_area)
        x[1] += moment_1 / (3.0 * doubled_area)
    elif length > 0.0:
        x[0] += edges_0 / (2.0 * length)
        x[1] += edges_1 / (2.0 * length)
