"""The tables of docs/paper.md: what the paper states, and what the studies gave.

The document is written by hand except for the blocks between ``<!-- begin NAME -->`` and ``<!-- end NAME -->``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from cspr_control.analysis.figures.style import controller_title
from cspr_control.reference.paper import paper_19
from cspr_kinematics import Robot
from cspr_msgs_py.vocabulary import TrajectoryName
from studies.experiment import CHANGING, COMPARED, LOADS, TRAJECTORIES, Case, tension_rms
from studies.live_agreement import Agreement
from studies.paper_results import SHOWN_CABLE, SHOWN_MOTOR, LoopResults, TensionResults
from studies.tension_deviation import PAYLOAD, SWITCH_18, SWITCH_19, along

_PRINTED, _SMOOTH = TRAJECTORIES
_PEAK = 0.25  # s after a jump of the velocity in which the error has its peak


def fill(document: str, blocks: dict[str, str]) -> str:
    """Return the document with its blocks replaced.

    Raises
    ------
    ValueError
        If the document lacks one of the blocks.
    """
    for name, text in blocks.items():
        pattern = re.compile(
            rf"(<!-- begin {re.escape(name)} -->\n).*?(<!-- end {re.escape(name)} -->)", re.DOTALL
        )
        if not (found := pattern.search(document)):
            raise ValueError(f"the document has no block {name}")
        document = f"{document[: found.end(1)]}{text}\n{document[found.start(2) :]}"
    return document


def tension_blocks(results: TensionResults, robot: Robot) -> dict[str, str]:
    """Return the blocks of figures 8 to 10."""
    return {
        "figure-9": _figure_9(results),
        "figure-10": _figure_10(results),
        "statements-simulation": _table(
            ("the paper states", "here", "why"), _simulation_statements(results, robot)
        ),
    }


def _figure_9(results: TensionResults) -> str:
    rows = []
    for name, one in results.accelerating.items():
        for what, values in (("maximum", one.maximum), ("median", one.median), ("RMS", one.rms)):
            rows.append((name, what, *(f"{value:.2f}" for value in values)))
    return _table(("trajectory", "N", *(f"cable {k + 1}" for k in range(len(rows[0]) - 2))), rows)


def _figure_10(results: TensionResults) -> str:
    rows = []
    for name, one in results.payload_change.items():
        k, named = SHOWN_CABLE - 1, "delta = before - after" if name == "delta" else name
        rows.append((named, f"{one.maximum[k]:.2f}", f"{one.median[k]:.2f}", f"{one.rms[k]:.2f}"))
    return _table((f"cable {SHOWN_CABLE}, N", "maximum", "median", "RMS"), rows)


def _simulation_statements(results: TensionResults, robot: Robot) -> list[tuple[str, ...]]:
    first, second = results.first, results.second
    moving, resting = first.between(0.0, SWITCH_18 + 0.05), first.between(SWITCH_18 + 0.05, np.inf)
    slow, quick = results.accelerating.values()
    ratio = quick.rms / slow.rms
    level = along(robot, paper_19(robot.trajectory_center), lambda t: PAYLOAD, "level")
    parts = second.between(0.0, SWITCH_19 + 0.05), level.between(0.0, SWITCH_19 + 0.05)
    turning = np.abs(parts[0].deviation - parts[1].deviation).max()
    late = np.abs(second.between(SWITCH_19 + 0.05, np.inf).deviation).max()
    (before, after, delta), k = results.payload_change.values(), SHOWN_CABLE - 1
    share = np.abs(moving.deviation / moving.dynamic).max()
    return [
        (
            "Fig. 8: the models deviate from 0 to 10 s, while x accelerates, and agree at once after",
            f"{np.abs(moving.deviation).min():.1f} to {np.abs(moving.deviation).max():.1f} N until 10 s, "
            f"{np.abs(resting.deviation).max():.1g} N after",
            _verdict(np.abs(moving.deviation).min() > 0.1 and not resting.deviation.any()),
        ),
        (
            "the inertial wrench has a significant impact on precision",
            f"{share:.2%} of the tension at most",
            "353 kg at 0.04 m/s² are 14 N against a weight of 3463 N",
        ),
        (
            "Fig. 9: much larger along (19) than along (18)",
            f"{ratio.min():.2f} to {ratio.max():.2f} times (RMS)",
            _verdict(ratio.min() > 2.0, "half the time is four times the acceleration"),
        ),
        (
            "Fig. 9: above all in cables 2, 3, 6 and 7",
            f"all cables within {ratio.max() / ratio.min() - 1.0:.1%} of one another",
            "depends on the geometry, whose coordinates are not published; the one assumed here is symmetrical",
        ),
        (
            "Coriolis effect, centrifugal force and turning add to the deviation",
            f"the 5° about x and y change it by {turning:.2f} N at most while the platform accelerates, and are "
            f"the whole deviation after that: {late:.2f} N",
            "the platform turns slowly and is small; the acceleration accounts for nearly all of it",
        ),
        (
            "Fig. 10: after +100 kg at 3 s all deltas are negative",
            f"{delta.maximum[k]:+.2f}, {delta.median[k]:+.2f}, {delta.rms[k]:+.2f} N (maximum, median, RMS)",
            _verdict(
                max(delta.maximum[k], delta.median[k], delta.rms[k]) < 0.0,
                f"the deviation grows {after.rms[k] / before.rms[k]:.2f} times, the mass {453 / 353:.2f} times; the "
                "rest is the pose",
            ),
        ),
    ]


def loop_blocks(results: LoopResults) -> dict[str, str]:
    """Return the blocks of figures 11 and 12."""
    return {
        "figure-11": _figure_11(results),
        "changing-load": _changing_load(results),
        "statements-experiment": _table(("the paper states", "here", "why"), _experiment_statements(results)),
    }


def _figure_11(results: LoopResults) -> str:
    rows = []
    for trajectory in TRAJECTORIES:
        for name in COMPARED:
            cells = []
            for load in LOADS:
                one = results[Case(name, trajectory, load)]
                cells.append(f"{one.rms_deg.mean():.2f} ({min(one.rms_deg):.1f} to {max(one.rms_deg):.1f})")
            rows.append((trajectory.value, controller_title(name), *cells))
    return _table(("trajectory", "controller", *(f"{load:g} kg" for load in LOADS)), rows)


def _changing_load(results: LoopResults) -> str:
    rows = []
    for name in CHANGING:
        one = results[Case(name, _PRINTED, 100.0, 100.0)]
        rows.append(
            (
                controller_title(name),
                f"{one.rms_deg.mean():.2f}",
                f"{max(one.errors.maximum):.0f}",
                f"{one.mass_error:+.2f}",
                f"{one.settling_time:.2f}",
            )
        )
    return _table(
        ("controller", "RMS, deg", "maximum, deg", "mass error, kg", "settled to 2 % after, s"), rows
    )


def _experiment_statements(results: LoopResults) -> list[tuple[str, ...]]:
    def rms(name: str, trajectory: TrajectoryName, load: float) -> float:
        return float(results[Case(name, trajectory, load)].rms_deg.mean())

    def against_load(name: str, trajectory: TrajectoryName) -> str:
        return ", ".join(f"{rms(name, trajectory, load):.1f}" for load in LOADS)

    heaviest = LOADS[-1]
    static, mass = (results[Case(name, _SMOOTH, heaviest)] for name in ("static", "pdff-mass"))
    k = SHOWN_MOTOR - 1
    larger = float((np.abs(static.position_error[:, k]) > np.abs(mass.position_error[:, k])).mean())
    printed = results[Case("pdff-mass", _PRINTED, heaviest)]
    error = np.degrees(np.abs(printed.position_error[:, k]))
    start, switch = (
        error[(printed.time >= begin) & (printed.time < begin + _PEAK)].max() for begin in (0.0, SWITCH_19)
    )
    calm = (printed.time > 1.0) & ((printed.time < SWITCH_19) | (printed.time > SWITCH_19 + 1.0))
    gap = max(
        abs(rms("pdff-mass", t, load) / rms("pdff (exact mass)", t, load) - 1.0)
        for t in TRAJECTORIES
        for load in LOADS
    )
    estimate = results[Case("pdff-mass", _PRINTED, 100.0, 100.0)]
    tensions = [tension_rms(results[Case("pdff-mass", t, heaviest)]) for t in (_SMOOTH, _PRINTED)]
    blind = {name: rms(name, _SMOOTH, heaviest) for name in ("static", "pdff")}
    exact = {name: rms(f"{name} (exact mass)", _SMOOTH, heaviest) for name in ("static", "pdff")}
    growing = all(np.diff([rms("static", t, load) for load in LOADS]).min() > 0.0 for t in TRAJECTORIES)
    return [
        (
            "the measured tensions are compared with the simulated ones",
            f"RMS {np.mean(tensions[0]):.1f} N between them along smooth-19, "
            f"{np.mean(tensions[1]):.0f} N along (19), with 200 kg",
            "the paper gives no number to compare with; along (19) the jumps slacken cables",
        ),
        (
            "Fig. 11: the errors of the static model are high, up to 15°",
            f"up to {max(results[Case('static', _PRINTED, heaviest)].rms_deg):.0f}° along (19), "
            f"{max(results[Case('static', _SMOOTH, heaviest)].rms_deg):.0f}° along smooth-19",
            "gains, motors and friction are not published",
        ),
        (
            "and grow with the load",
            f"{against_load('static', _PRINTED)}° along (19), {against_load('static', _SMOOTH)}° along smooth-19",
            _verdict(growing),
        ),
        (
            "the dynamic model does better than the static one, because the mass is compensated",
            f"with the nominal mass {blind['static']:.2f}° (static) and {blind['pdff']:.2f}° (dynamic), with the exact "
            f"one {exact['static']:.2f}° and {exact['pdff']:.2f}° (smooth-19, 200 kg)",
            "the mass makes the difference: the dynamics of these slow trajectories matter little",
        ),
        (
            "PDFF with the estimated mass performs like PDFF with the exact one",
            f"RMS errors within {gap:.1%} in every case",
            _verdict(gap < 0.02),
        ),
        (
            f"Fig. 12: the error of motor {SHOWN_MOTOR} peaks at the start and at the transition",
            f"{start:.0f}° and {switch:.0f}°, {error[calm].max():.0f}° elsewhere (PDFF + mass, 200 kg)",
            _verdict(
                min(start, switch) > 2.0 * error[calm].max(),
                "there the velocity of the printed trajectory jumps",
            ),
        ),
        (
            "Fig. 12: the static model's error is the larger one for almost all of the time",
            f"{larger:.0%} of the time (motor {SHOWN_MOTOR}, smooth-19, 200 kg)",
            _verdict(larger > 0.8),
        ),
        (
            "the mass estimate is compared with the actual mass",
            f"+100 kg: within 2 % after {estimate.settling_time:.2f} s, {estimate.mass_error:+.2f} kg at the end",
            "the paper gives no number to compare with; here the estimate is used during the trajectory, which the "
            "paper leaves to future work",
        ),
    ]


def agreement_block(agreement: Agreement) -> dict[str, str]:
    """Return the block that compares a live run."""
    live = agreement.live
    rows = [
        (
            one.name,
            f"{one.live:.2f}",
            f"{one.offline:.2f}",
            f"{one.deviation:+.1%}" if one.share else f"{one.deviation:+.2f}",
            f"{one.tolerance:.0%}" if one.share else f"{one.tolerance:g}",
        )
        for one in agreement.numbers()
    ]
    case = live.scenario
    more = "".join(f" and {added.mass:g} kg more at {added.time:g} s" for added in case.added)
    text = (
        f"`{live.name}` on {case.trajectory.value}, {case.payload:g} kg from the start{more}; the first set-point came "
        f"{(case.phase or 0.0) * 1e3:.1f} ms after the start, torques {case.reaction_time * 1e3:.1f} ms "
        f"after the states (median), {live.missed:.1%} of the control cycles were missed.\n\n"
    )
    table = _table(("", "live", "without ROS", "difference", "tolerance"), rows)
    verdict = (
        "The two agree." if agreement.within_tolerance else "The two do **not** agree within the tolerance."
    )
    return {"live": f"{text}{table}\n\n{verdict}"}


def _verdict(agrees: bool | np.bool_, reason: str = "") -> str:
    verdict = "agrees" if agrees else "**does not agree**"
    return f"{verdict}: {reason}" if reason else verdict


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
