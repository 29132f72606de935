"""How far the platform is from where it should be, and from where it was estimated to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.alignment import Alignment
from cspr_control.analysis.pose_track import PoseDifference, PoseTrack, pose_difference
from cspr_control.analysis.recording import Recording

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PoseDeviation:
    """Size of the difference between two tracks of poses; NaN for what is not known.

    Attributes
    ----------
    rms_mm, median_mm, max_mm
        Of the distance.
    mean_mm
        Along x, y and z of base, with sign (3,).
    rotation_rms_deg, rotation_max_deg
        Of the angle between the two.
    """

    rms_mm: float
    median_mm: float
    max_mm: float
    mean_mm: Floats
    rotation_rms_deg: float
    rotation_max_deg: float

    @classmethod
    def of(cls, difference: PoseDifference) -> PoseDeviation | None:
        """Return the size of a difference; None without samples."""
        distance, angle = 1e3 * difference.distance, difference.angle
        if distance.size == 0:
            return None
        turned = np.full(1, np.nan) if angle is None else np.degrees(angle)
        return cls(
            float(np.sqrt((distance**2).mean())),
            float(np.median(distance)),
            float(distance.max()),
            1e3 * difference.position.mean(axis=0),
            float(np.sqrt((turned**2).mean())),
            float(turned.max()),
        )


@dataclass(frozen=True, eq=False)
class PlatformMetrics:
    """What the true or measured pose says of a run.

    Attributes
    ----------
    judged_by
        ``true pose``, or the topic or file of the measured one.
    point
        Whose position was compared, in platform (3,), m.
    error
        True or measured pose less the reference.
    estimate
        Estimated pose less the true or measured one.
    alignment
        What was done to the measured pose before; None if nothing was.
    """

    judged_by: str
    point: Floats
    error: PoseDeviation | None
    estimate: PoseDeviation | None
    alignment: Alignment | None


def platform_error(recording: Recording) -> PoseDifference | None:
    """Return where the platform was less where it should have been; None if one of both is not known."""
    actual, references = recording.actual, recording.references
    if actual is None or references is None:
        return None
    return pose_difference(actual.track, PoseTrack.of(references).of_point(actual.point))


def platform_metrics(recording: Recording, error: PoseDifference | None) -> PlatformMetrics | None:
    """Return the numbers of the platform, on the trajectories; None without a true or measured pose.

    Parameters
    ----------
    recording
        The run.
    error
        Its `platform_error`.
    """
    actual = recording.actual
    if actual is None:
        return None

    def deviation(difference: PoseDifference | None) -> PoseDeviation | None:
        if difference is None:
            return None
        return PoseDeviation.of(difference.part(recording.in_window(difference.time_ns)))

    estimate = None
    if recording.poses is not None:
        estimated = PoseTrack.of(recording.poses).of_point(actual.point)
        # the one with more poses is interpolated
        if actual.track.time_ns.size >= estimated.time_ns.size:
            estimate = pose_difference(estimated, actual.track)
        else:
            estimate = -pose_difference(actual.track, estimated)
    return PlatformMetrics(
        actual.source, actual.point, deviation(error), deviation(estimate), actual.alignment
    )
