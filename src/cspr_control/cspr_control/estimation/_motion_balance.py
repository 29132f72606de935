"""The balance of forces and moments on a moving platform, from successive cycles (docs/model.md, section 10)."""

from __future__ import annotations

import math

from cspr_kinematics.arrays import FloatArray, IntArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.dynamics._dynamics import required_wrenches

# Below this sine of an angle the rotation vector is the vector of the sines, to rounding.
_SMALL_SINE = 1e-9


@kernel
def rotation_between(before: FloatArray, after: FloatArray, vector: FloatArray) -> None:
    """Fill in the rotation vector (3,), in base, that turns one orientation (3, 3) into another."""
    trace = -1.0
    for i in range(3):
        vector[i] = 0.0
        for k in range(3):
            trace += after[i, k] * before[i, k]
    for k in range(3):  # the part of after before^T that changes its sign when transposed
        vector[0] += 0.5 * (after[2, k] * before[1, k] - after[1, k] * before[2, k])
        vector[1] += 0.5 * (after[0, k] * before[2, k] - after[2, k] * before[0, k])
        vector[2] += 0.5 * (after[1, k] * before[0, k] - after[0, k] * before[1, k])
    sine = math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    if sine > _SMALL_SINE:
        longer = math.atan2(sine, 0.5 * trace) / sine
        for i in range(3):
            vector[i] *= longer


@kernel
def balance_in_motion(
    step: float,
    delay: float,
    position: FloatArray,
    rotation: FloatArray,
    wrench: FloatArray,
    parameters: FloatArray,
    counts: IntArray,
    steps: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
    wrenches: FloatArray,
    turning: FloatArray,
    twist: FloatArray,
    acceleration: FloatArray,
    column: FloatArray,
    line: FloatArray,
    pull: FloatArray,
    model: FloatArray,
) -> bool:
    """Take what one cycle measured, and fill in both sides of the balance one cycle before it.

    Velocity and acceleration there are differences of three poses. What those differences mean of the acceleration is
    a mean that weighs it as a triangle over the two steps does; the wrenches are weighed alike, so that the balance
    holds for the means too.

    Parameters
    ----------
    step
        Time since the cycle before, s; of no account in the first cycle.
    delay
        By how much the wrenches are older than the poses, s.
    position, rotation, wrench
        Of this cycle: pose (3,), (3, 3) and wrench of the cables (6,), in base.
    parameters
        (5, 10): inertial parameters of the platform, then those of which each unknown is one, with the value 1.
    counts
        (3,): cycles taken; place of the newest entry in the line; entries in it. The first and last are 0 to begin.
    steps, positions, rotations, wrenches, turning
        Memory: the step before (1,), poses (2, 3), (1, 3, 3) and wrenches (2, 6), the newer first, and the angular
        velocity (3,) over the step before.
    twist, acceleration
        Results, (1, 6) both.
    column
        For use inside, (1, 6).
    line
        Memory, (n, 6, 5): models of the last n cycles, which must span the delay.
    pull
        Result (6,): mean wrench of the cables.
    model
        Result (6, 5): wrench that the platform alone would need, and what a unit of each unknown adds.

    Returns
    -------
    bool
        Whether there are enough cycles for a balance.
    """
    vector = column[0, :3]
    taken = counts[0]
    before = steps[0]
    if taken >= 1:
        rotation_between(rotations[0], rotation, vector)
        for i in range(3):
            vector[i] /= step
    if taken >= 2:
        span = step + before
        for i in range(3):
            late = (position[i] - positions[0, i]) / step
            early = (positions[0, i] - positions[1, i]) / before
            twist[0, i] = (before * late + step * early) / span
            acceleration[0, i] = 2.0 * (late - early) / span
            twist[0, 3 + i] = (before * vector[i] + step * turning[i]) / span
            acceleration[0, 3 + i] = 2.0 * (vector[i] - turning[i]) / span
        for i in range(6):
            sides = before * wrenches[1, i] + step * wrench[i]
            pull[i] = (sides + 2.0 * span * wrenches[0, i]) / (3.0 * span)
    if taken >= 1:
        for i in range(3):
            turning[i] = vector[i]
    if taken >= 2:
        newest = (counts[1] + 1) % line.shape[0]
        counts[1] = newest
        counts[2] = min(counts[2] + 1, line.shape[0])
        for k in range(5):
            required_wrenches(parameters[k], rotations, twist, acceleration, column)
            for i in range(6):
                line[newest, i, k] = column[0, i]
    steps[0] = step
    for i in range(3):
        positions[1, i] = positions[0, i]
        positions[0, i] = position[i]
        for j in range(3):
            rotations[0, i, j] = rotation[i, j]
    for i in range(6):
        wrenches[1, i] = wrenches[0, i]
        wrenches[0, i] = wrench[i]
    counts[0] = taken + 1
    behind = delay / step if taken >= 2 else 0.0
    whole = int(behind)
    if taken < 2 or whole + 2 > counts[2]:
        return False
    share = behind - whole
    newer = (counts[1] - whole) % line.shape[0]
    older = (newer - 1) % line.shape[0]
    for i in range(6):
        for k in range(5):
            model[i, k] = (1.0 - share) * line[newer, i, k] + share * line[older, i, k]
    return True
