"""What the paper states of its experiment, section IV-B and figures 11 and 12, and in its conclusion."""

from __future__ import annotations

import numpy as np

from cspr_control.analysis.figures.style import controller_title
from cspr_msgs_py.vocabulary import TrajectoryName
from studies.experiment import BEYOND, LOADS, TRAJECTORIES, tension_rms
from studies.geometries import SHIPPED
from studies.loop_results import LoopResults, sampled_rms, size_mm, speed_errors
from studies.paper_results import SHOWN_MOTOR
from studies.statement import Statement
from studies.tension_deviation import SWITCH_19

_PRINTED, _SMOOTH = TRAJECTORIES
_HEAVIEST = LOADS[-1]
_PEAK = 0.25  # s after a jump of the velocity in which the error has its peak
_MOTOR = SHOWN_MOTOR - 1


def experiment_statements(results: LoopResults) -> list[Statement]:
    """Return the statements in the order of the paper."""
    return [*_measured(results), *_figure_11(results), *_figure_12(results), *_conclusion(results)]


def _measured(results: LoopResults) -> list[Statement]:
    tensions = [tension_rms(results.record("pdff-mass", each, _HEAVIEST)) for each in (_SMOOTH, _PRINTED)]
    heavy = results.record("pdff-mass", _SMOOTH, _HEAVIEST)
    printed = results.record("static", _PRINTED, _HEAVIEST)
    seldom = sampled_rms(printed)
    estimate = results.record("pdff-mass", _PRINTED, 100.0, 100.0)
    return [
        Statement(
            "the measured tensions are compared with the simulated ones",
            f"RMS {np.mean(tensions[0]):.1f} N between them along smooth-19, {np.mean(tensions[1]):.0f} N along (19), "
            "with 200 kg",
            None,
            "the paper gives no number; along (19) the jumps slacken cables",
        ),
        Statement(
            "the experiment is sampled every 0.5 s",
            f"PD + static along (19) with 200 kg: {printed.rms_deg.mean():.1f}° by every cycle, {seldom[0]:.1f} to "
            f"{seldom[1]:.1f}° by such samples, as the first one falls",
            None,
            "the peaks after the jumps last a tenth of a second",
        ),
        Statement(
            "the errors of position and velocity of the motors tell those of the platform",
            f"PDFF + mass with 200 kg: {heavy.rms_deg.mean():.2f}°, {speed_errors(heavy).mean():.2f} rad/s; by them "
            f"the platform is {size_mm(results.platform_by_motors(heavy)):.2f} mm off, in truth "
            f"{size_mm(heavy.platform_error):.2f} mm",
            None,
            "the paper could not measure the platform; cables stretch",
        ),
        Statement(
            "the mass estimate is compared with the actual mass",
            f"+100 kg along (19): within 2 % after {estimate.settling_time:.2f} s, {estimate.mass_error:+.2f} kg at "
            "the end",
            bool(abs(estimate.mass_error) < 2.0 and np.isfinite(estimate.settling_time)),
            "by (16) and (17); here the estimate is used during the trajectory, which the paper leaves to future work",
        ),
    ]


def _figure_11(results: LoopResults) -> list[Statement]:
    rms, largest = (
        results.rms,
        [float(max(results.record("static", each, _HEAVIEST).rms_deg)) for each in TRAJECTORIES],
    )
    against_load = [[rms("static", each, load) for load in results.loads] for each in TRAJECTORIES]
    named = [[rms(name, each, _HEAVIEST) for name in ("static", "pdff-mass")] for each in TRAJECTORIES]
    blind = [rms(name, _SMOOTH, _HEAVIEST) for name in ("static", "pdff")]
    exact = [rms(f"{name} (exact mass)", _SMOOTH, _HEAVIEST) for name in ("static", "pdff")]
    beyond = ""
    if results.geometry == SHIPPED:
        (name, *_) = BEYOND
        beyond = f"; {rms(name, _SMOOTH, _HEAVIEST):.2f}° where the feed-forward accelerates the winches too"
    return [
        Statement(
            "Fig. 11: the errors of the static model are high, up to 15°",
            f"up to {largest[0]:.0f}° along (19), {largest[1]:.0f}° along smooth-19",
            min(largest) > 15.0,
            "gains, motors and friction are not published",
        ),
        Statement(
            "and grow with the load",
            f"{_degrees(against_load[0])} along (19), {_degrees(against_load[1])} along smooth-19",
            all(np.diff(each).min() > 0.0 for each in against_load),
        ),
        Statement(
            "the dynamic model with the estimated mass does clearly better than the static one",
            f"{_degrees(named[0])} along (19), {_degrees(named[1])} along smooth-19 (200 kg)",
            all(static > 1.2 * dynamic for static, dynamic in named),
        ),
        Statement(
            "because the mass is compensated",
            f"with the nominal mass {blind[0]:.2f}° (static) and {blind[1]:.2f}° (dynamic) along smooth-19 with 200 kg",
            abs(blind[0] - blind[1]) < 0.1 * (blind[0] - exact[1]),
            "without the mass the two models are alike",
        ),
        Statement(
            "the inertial wrench has a significant impact on precision",
            f"with the exact mass {exact[0]:.2f}° (static) and {exact[1]:.2f}° (dynamic) along smooth-19 with 200 kg"
            f"{beyond}",
            exact[0] > 1.1 * exact[1],
            "(15) has the platform's inertia alone; the winches' is twelve times as large",
        ),
    ]


def _figure_12(results: LoopResults) -> list[Statement]:
    printed = results.record("pdff-mass", _PRINTED, _HEAVIEST)
    error = np.degrees(np.abs(printed.position_error[:, _MOTOR]))
    start, switch = (
        error[(printed.time >= begin) & (printed.time < begin + _PEAK)].max() for begin in (0.0, SWITCH_19)
    )
    calm = (printed.time > 1.0) & ((printed.time < SWITCH_19) | (printed.time > SWITCH_19 + 1.0))
    larger = [_share_larger(results, each) for each in TRAJECTORIES]
    return [
        Statement(
            f"Fig. 12: the error of motor {SHOWN_MOTOR} peaks at the start and at the transition",
            f"{start:.0f}° and {switch:.0f}°, {error[calm].max():.0f}° elsewhere (PDFF + mass, 200 kg)",
            bool(min(start, switch) > 2.0 * error[calm].max()),
            "there the velocity of the printed trajectory jumps",
        ),
        Statement(
            "the static model's error is the larger one for almost all of the time",
            f"{larger[0]:.0%} of the time along (19), {larger[1]:.0%} along smooth-19 (200 kg)",
            min(larger) > 0.8,
        ),
    ]


def _conclusion(results: LoopResults) -> list[Statement]:
    rms = results.rms
    gap = max(
        abs(rms("pdff-mass", each, load) / rms("pdff (exact mass)", each, load) - 1.0)
        for each in TRAJECTORIES
        for load in results.loads
    )
    adapted = [rms("pdff-mass", _SMOOTH, load) for load in results.loads]
    return [
        Statement(
            f"{controller_title('pdff-mass')} performs like PDFF with the exact mass",
            f"RMS errors within {gap:.1%} in every case",
            gap < 0.02,
        ),
        Statement(
            "and adapts to any payload",
            f"{_degrees(adapted)} along smooth-19, whatever the load",
            max(adapted) < 1.1 * min(adapted),
        ),
    ]


def _share_larger(results: LoopResults, trajectory: TrajectoryName) -> float:
    static, mass = (
        np.abs(results.record(name, trajectory, _HEAVIEST).position_error[:, _MOTOR])
        for name in ("static", "pdff-mass")
    )
    return float((static > mass).mean())


def _degrees(values: list[float]) -> str:
    return f"{', '.join(f'{value:.1f}' for value in values)}°"
