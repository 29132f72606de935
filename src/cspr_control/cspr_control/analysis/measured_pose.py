"""The platform's pose as an instrument measured it: a topic of the bag, or the file of a total station."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.alignment import align, closest_motion
from cspr_control.analysis.pose_file import read_pose_file
from cspr_control.analysis.pose_track import PoseTrack
from cspr_control.analysis.recording import ActualPose, Recording, recorded_time
from cspr_control.errors import ControlError
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.errors import BagError
from cspr_msgs_py.topics import BASE_FRAME, POSE_STAMPED
from cspr_msgs_py.wire.cdr import Scanner

Floats = NDArray[np.float64]

_FIRST_ROS_TIME = 1e9  # s: smaller times are no ROS times, but count from a moment of their own
_MILLIMETRES = 100.0  # times as far as the reference moves: not in metres
_LEAST_EXTENT = 0.01  # m; of a reference that hardly moves
_MISALIGNED = 0.05  # times as far as the reference moves: more than a platform is ever off its path
_LATE = 0.2  # s that the first or the last pose may lack before it is said
_LARGEST_SHIFT, _SHIFT_STEP = 1.0, 0.01  # s; by how much clocks are tried against each other
_SHIFT_SAMPLES = 1000
_FITS_BETTER = 0.8  # times the distance that is left: a shift that gains less is not worth a word


@dataclass(frozen=True)
class MeasuredPose:
    """What measured the pose, and how it relates to the robot.

    Attributes
    ----------
    source
        A topic, or the path of a file that ends in ``.csv``.
    offset
        Added to its times, s. Times of a file that are no ROS times count from time zero of the analysis, and need it.
    point
        Whose position was measured, in platform, m: of a total station the prism.
    aligned
        Whether its frame is brought to the robot's by the rigid motion that fits the reference best.
    """

    source: str
    offset: float | None = None
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    aligned: bool = False

    @property
    def is_file(self) -> bool:
        """Whether it is a file."""
        return self.source.endswith(".csv")


def judged_by(recording: Recording, measured: MeasuredPose) -> Recording:
    """Return a recording whose platform is judged by a measured pose in place of the true one.

    Raises
    ------
    ControlError
        If the pose cannot be read, is of another time, not in metres, or not in the frame of the robot.
    """
    remarks: list[str] = []
    track = _from_file(recording, measured) if measured.is_file else _from_topic(recording, measured, remarks)
    track = _overlapping(recording, track, measured.source, remarks)
    point, alignment = np.array(measured.point), None
    if recording.references is not None:
        wanted = PoseTrack.of(recording.references).of_point(point)
        pairs = _pairs(recording, track, wanted)
        if len(pairs[0]):
            _require_metres(recording, measured, *pairs)
            _compare_clocks(recording, track, wanted, measured, remarks)
        if measured.aligned:
            try:
                alignment = align(*pairs)
            except ControlError as problem:
                raise ControlError(f"{measured.source} cannot be aligned: {problem}") from problem
            turned = None if track.rotation is None else alignment.rotation * track.rotation
            track = PoseTrack(track.time_ns, alignment.apply(track.position), turned)
            remarks.append(
                f"{measured.source} was aligned with the reference, which hides what is wrong in the same way "
                f"everywhere: {alignment}"
            )
            if 1e-3 * alignment.residual_rms_mm > _MISALIGNED * _extent(pairs[1]):
                remarks.append(
                    f"that is no platform's error: {measured.source} is of another run, or its times are off by more "
                    f"than the {_LARGEST_SHIFT:g} s that are tried; place them with --measured-offset"
                )
    elif measured.aligned:
        raise ControlError(f"{recording.path} has no reference with which {measured.source} could be aligned")
    if track.rotation is not None:
        track, point = track.of_point(-point), np.zeros(3)
    actual = ActualPose(measured.source, track, point, alignment)
    return replace(recording, actual=actual, remarks=(*recording.remarks, *remarks))


def _from_topic(recording: Recording, measured: MeasuredPose, remarks: list[str]) -> PoseTrack:
    path, topic = recording.path, measured.source
    try:
        with Bag(path) as bag:
            kind = bag.topics.get(topic)
            if kind != POSE_STAMPED or not bag.counts[topic]:
                problem = (
                    "no topic" if kind is None else "no message on" if kind == POSE_STAMPED else f"{kind} on"
                )
                known = [name for name, each in sorted(bag.topics.items()) if each == POSE_STAMPED]
                raise ControlError(
                    f"{path} has {problem} {topic}; of type {POSE_STAMPED} it has {', '.join(known) or 'nothing'}: "
                    "name another, or a file that ends in .csv"
                )
            poses = bag.poses(topic)
            frame = _frame(next(bag.messages(topic))[2])
    except (BagError, ValueError) as error:
        raise ControlError(str(error)) from error
    if frame not in ("", BASE_FRAME) and not measured.aligned:
        remarks.append(
            f"{topic} is in the frame '{frame}': it is compared as if that were '{BASE_FRAME}'; --align brings it there"
        )
    track = PoseTrack.of(poses)
    if track.rotation is None:
        remarks.append(f"{topic} has no orientation: all quaternions are zero")
    unusable = len(poses) - track.time_ns.size
    if unusable:
        remarks.append(
            f"{topic}: {unusable} of {len(poses)} poses are not used: not finite, no rotation, or twice"
        )
    return replace(track, time_ns=track.time_ns + round(1e9 * (measured.offset or 0.0)))


def _frame(message: bytes) -> str:
    scanner = Scanner(message)
    scanner.time()
    return scanner.string()


def _from_file(recording: Recording, measured: MeasuredPose) -> PoseTrack:
    seconds, position, rotation = read_pose_file(Path(measured.source))
    begin = 0
    if seconds[0] < _FIRST_ROS_TIME:
        begin = recording.origin_ns
        if measured.offset is None:
            raise ControlError(
                f"{measured.source}: time = {seconds[0]:g} is no ROS time (s since 1970): say with --measured-offset "
                "how many seconds after the start of the first trajectory, which was at "
                f"{recorded_time(recording.origin_ns)} UTC, the file's time zero is"
            )
    time_ns = begin + np.rint(1e9 * (seconds + (measured.offset or 0.0))).astype(np.int64)
    return PoseTrack(time_ns, position, rotation)


def _overlapping(recording: Recording, track: PoseTrack, source: str, remarks: list[str]) -> PoseTrack:
    """Return the poses of the time of the recording; say if they cover only a part of what is evaluated."""
    poses, states = track.time_ns, recording.states.time_ns
    chosen = (poses >= states[0]) & (poses <= states[-1])
    if not chosen.any():
        own = f"its poses are of {_span(poses)}" if poses.size else "it has no usable pose"
        raise ControlError(
            f"{source} has no pose of the time of {recording.path}, which is {_span(states)}: {own}; what "
            "--measured-offset says is added to its times, s"
        )
    part, window = track.part(chosen), recording.window
    inside = recording.seconds(part.time_ns[recording.in_window(part.time_ns)])
    if inside.size == 0 or inside[0] > window.start + _LATE or inside[-1] < window.end - _LATE:
        covered = f"{inside[0]:.1f} to {inside[-1]:.1f} s" if inside.size else "nothing"
        remarks.append(
            f"{source} covers {covered} of the {window.name} from {window.start:.1f} to {window.end:.1f} s: the "
            "platform's numbers are of that part"
        )
    return part


def _span(time_ns: NDArray[np.int64]) -> str:
    first, last = (datetime.fromtimestamp(1e-9 * time, UTC) for time in (time_ns[0], time_ns[-1]))
    return f"{first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC"


def _pairs(
    recording: Recording, track: PoseTrack, wanted: PoseTrack, shift_ns: int = 0
) -> tuple[Floats, Floats]:
    """Return measured positions that are evaluated, and the wanted ones of the same, or earlier or later, times."""
    counted = track.part(recording.in_window(track.time_ns))
    times = counted.time_ns + shift_ns
    known = wanted.at(times)
    return counted.position[np.isin(times, known.time_ns)], known.position


def _extent(places: Floats) -> float:
    """Return the diagonal of the box that holds places (n, 3), m."""
    return float(np.linalg.norm(np.ptp(places, axis=0)))


def _require_metres(recording: Recording, measured: MeasuredPose, places: Floats, wanted: Floats) -> None:
    """Refuse positions that can only be millimetres, or in another frame than the robot's."""
    extents = _extent(places), _extent(wanted)
    if extents[0] > _MILLIMETRES * max(extents[1], _LEAST_EXTENT):
        raise ControlError(
            f"{measured.source}: the positions extend over {extents[0]:.4g} m, where the reference moves over "
            f"{extents[1]:.3g} m: they look like millimetres; divide them by 1000, positions are in m"
        )
    away = float(np.linalg.norm(np.median(places - wanted, axis=0)))
    frame = float(np.linalg.norm(recording.robot.frame_size))
    if away > frame and not measured.aligned:
        raise ControlError(
            f"{measured.source}: the positions are {away:.4g} m away from the reference, farther than the robot's "
            f"frame is wide: they are in millimetres or in another frame than '{BASE_FRAME}'; divide them by 1000, or "
            "let --align bring their frame there"
        )


def _compare_clocks(
    recording: Recording, track: PoseTrack, wanted: PoseTrack, measured: MeasuredPose, remarks: list[str]
) -> None:
    """Say if the positions fit the reference better at other times, wherever their frame lies."""
    every = np.zeros(track.time_ns.size, dtype=bool)
    every[:: -(-track.time_ns.size // _SHIFT_SAMPLES)] = True
    few = track.part(every)

    def left(shift: float) -> float:
        places, there = _pairs(recording, few, wanted, round(1e9 * shift))
        if len(places) < max(1, 0.5 * every.sum()):
            return np.inf
        return closest_motion(places, there).residual_rms_mm

    steps = round(_LARGEST_SHIFT / _SHIFT_STEP)
    shifts = _SHIFT_STEP * np.arange(-steps, steps + 1)
    errors = np.array([left(shift) for shift in shifts])
    best = int(errors.argmin())
    if errors[best] < _FITS_BETTER * errors[steps]:
        offset = (measured.offset or 0.0) + float(shifts[best])
        remarks.append(
            f"{measured.source} fits the path best when its times are {abs(shifts[best]):.2f} s "
            f"{'later' if shifts[best] > 0 else 'earlier'}: {errors[best]:.1f} instead of {errors[steps]:.1f} mm RMS "
            f"are left. The clocks may differ: try --measured-offset {offset:.3g}"
        )
