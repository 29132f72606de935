"""Which cables are slack, when the lengths of the others fit a pose (docs/model.md, section 5)."""

from __future__ import annotations

import math

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.kinematics._iteration import CONVERGED, improve_pose
from cspr_kinematics.motion._linear import assign_matrix, assign_vector, fill_vector

# Outcome of the search for slack cables.
NO_SLACK_FOUND = 0
SLACK_FOUND = 1
SLACK_OF_ONE = 2  # of one cable, and it cannot be told which


@kernel
def find_slack(
    geometry: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    limits: FloatArray,
    rivalry: float,
    max_iterations: int,
    position: FloatArray,
    rotation: FloatArray,
    home: FloatArray,
    slack: FloatArray,
) -> int:
    """Look for cables without which the others fit; fill in by how much they are slack.

    Cables are left out one after the other, each time the one without which the rest fits best; at least seven
    are left, because six cables fit any lengths. k cables fit at a cost within `limits[k]`. Only a cable that is
    longer than its path can be slack. Where one cable is left out and the rest fits about as well without another
    one instead, it may be either: `slack` then says how slack each of them would be.
    """
    m = geometry.shape[0]
    left = np.empty(m)
    assign_vector(left, weights)
    p, Q, e, J = np.empty(3), np.empty((3, 3)), np.empty(m), np.empty((m, 6))
    best_error = np.empty(m)
    own_costs, own_slacks = np.empty(m), np.empty(m)
    fill_vector(slack, 0.0)
    count = m
    while count > 7:
        best, best_cost = -1, math.inf
        count -= 1
        fill_vector(own_costs, math.inf)
        for k in range(m):
            if left[k] == 0.0:
                continue
            left[k] = 0.0
            for start in range(2):
                if start == 0:
                    assign_vector(p, position)
                    assign_matrix(Q, rotation)
                else:
                    for j in range(3):
                        p[j] = home[j]
                        for i in range(3):
                            Q[j, i] = home[3 + 3 * j + i]
                status, _, cost = improve_pose(geometry, target, left, J.shape[1], max_iterations, p, Q, e, J)
                if status == CONVERGED and cost < own_costs[k] and e[k] < 0.0:
                    own_costs[k], own_slacks[k] = cost, -e[k]
                    if cost < best_cost:
                        best, best_cost = k, cost
                        assign_vector(best_error, e)
            left[k] = weights[k]
        if best < 0:
            return NO_SLACK_FOUND
        left[best] = 0.0
        if best_cost > limits[count]:
            continue
        if count == m - 1:
            acceptable = min(float(limits[count]), best_cost + rivalry)
            candidates = 0
            for k in range(m):
                if own_costs[k] <= acceptable:
                    slack[k] = own_slacks[k]
                    candidates += 1
            return SLACK_FOUND if candidates == 1 else SLACK_OF_ONE
        longest = True
        for k in range(m):
            if left[k] == 0.0:
                slack[k] = -best_error[k]
                longest = longest and slack[k] > 0.0
        if longest:
            return SLACK_FOUND
        fill_vector(slack, 0.0)
        return NO_SLACK_FOUND
    return NO_SLACK_FOUND
