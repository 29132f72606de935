"""The tables of docs/paper.md: what the paper states, and what the studies gave.

The document is written by hand except for the blocks between ``<!-- begin NAME -->`` and ``<!-- end NAME -->``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from cspr_control.analysis.figures.style import controller_title
from studies.experiment import BEYOND, CHANGING, COMPARED, LOADS, TRAJECTORIES, controllers_of
from studies.experiment_statements import experiment_statements
from studies.live_agreement import Agreement
from studies.loop_results import LoopResults, sampled_rms, size_mm, speed_errors
from studies.paper_results import SHOWN_CABLE, TensionResults
from studies.simulation_statements import simulation_statements
from studies.statement import statements_table, table

_PRINTED, _SMOOTH = TRAJECTORIES


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


def tension_blocks(results: Mapping[str, TensionResults]) -> dict[str, str]:
    """Return the blocks of figures 8 to 10, with the results of each geometry by its name."""
    statements = {name: simulation_statements(one) for name, one in results.items()}
    return {
        "geometries": _geometries(results),
        "figure-9": _figure_9(results),
        "figure-10": _figure_10(results),
        "statements-simulation": statements_table(statements),
    }


def _geometries(results: Mapping[str, TensionResults]) -> str:
    suitable = [one.suitability for one in results.values()]
    rows = [
        (
            "tensions asked for, N",
            *(f"{one.least_tension:.0f} to {one.largest_tension:.0f}" for one in suitable),
        ),
        ("condition number of the wrench matrix", *(f"{one.condition_number:.1f}" for one in suitable)),
        ("cables apart, mm", *(f"{1e3 * one.between_cables:.0f}" for one in suitable)),
        ("cables from the platform, mm", *(f"{1e3 * one.to_platform:.0f}" for one in suitable)),
    ]
    return table(("the worst along (18) and (19)", *results), rows)


def _figure_9(results: Mapping[str, TensionResults]) -> str:
    rows = [
        (geometry, trajectory, what, *(f"{value:.2f}" for value in values))
        for geometry, one in results.items()
        for trajectory, statistics in one.accelerating.items()
        for what, values in zip(
            ("maximum", "median", "RMS"), (statistics.maximum, statistics.median, statistics.rms), strict=True
        )
    ]
    return table(("geometry", "trajectory", "N", *(f"cable {k + 1}" for k in range(len(rows[0]) - 3))), rows)


def _figure_10(results: Mapping[str, TensionResults]) -> str:
    rows = []
    for geometry, result in results.items():
        for name, one in result.payload_change.items():
            k, named = SHOWN_CABLE - 1, "delta = before - after" if name == "delta" else name
            numbers = (f"{values[k]:.2f}" for values in (one.maximum, one.median, one.rms))
            rows.append((geometry, named, *numbers))
    return table(("geometry", f"cable {SHOWN_CABLE}, N", "maximum", "median", "RMS"), rows)


def loop_blocks(results: Mapping[str, LoopResults]) -> dict[str, str]:
    """Return the blocks of figures 11 and 12, with the results of each geometry by its name."""
    shipped, *_ = results.values()
    statements = {name: experiment_statements(one) for name, one in results.items()}
    return {
        "figure-11": _figure_11(results),
        "observed": _observed(shipped),
        "changing-load": _changing_load(shipped),
        "statements-experiment": statements_table(statements),
    }


def _figure_11(results: Mapping[str, LoopResults]) -> str:
    rows = []
    for geometry, each in results.items():
        for trajectory in TRAJECTORIES:
            for name in controllers_of(each.geometry):
                ones = (each.record(name, trajectory, load).rms_deg for load in LOADS)
                cells = (f"{one.mean():.2f} ({one.min():.1f} to {one.max():.1f})" for one in ones)
                rows.append((geometry, trajectory.value, controller_title(name), *cells))
    return table(("geometry", "trajectory", "controller", *(f"{load:g} kg" for load in LOADS)), rows)


def _observed(results: LoopResults) -> str:
    rows = []
    for trajectory in TRAJECTORIES:
        for name in (*COMPARED, *BEYOND):
            one = results.record(name, trajectory, LOADS[-1])
            least, largest = sampled_rms(one)
            by_motors = size_mm(results.platform_by_motors(one))
            rows.append(
                (
                    trajectory.value,
                    controller_title(name),
                    f"{size_mm(one.platform_error):.2f}",
                    f"{by_motors:.2f}",
                    f"{one.rms_deg.mean():.2f}",
                    f"{least:.2f} to {largest:.2f}",
                    f"{speed_errors(one).mean():.2f}",
                )
            )
    head = ("platform, mm", "by the motors, mm", "motors, deg", "by samples, deg", "speed of motors, rad/s")
    return table(("trajectory", "controller", *head), rows)


def _changing_load(results: LoopResults) -> str:
    rows = []
    for name in (*CHANGING, *BEYOND):
        one = results.record(name, _PRINTED, 100.0, 100.0)
        rows.append(
            (
                controller_title(name),
                f"{one.rms_deg.mean():.2f}",
                f"{max(one.errors.maximum):.0f}",
                f"{one.mass_error:+.2f}",
                f"{one.settling_time:.2f}",
            )
        )
    return table(
        ("controller", "RMS, deg", "maximum, deg", "mass error, kg", "settled to 2 % after, s"), rows
    )


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
    numbers = table(("", "live", "without ROS", "difference", "tolerance"), rows)
    verdict = (
        "The two agree." if agreement.within_tolerance else "The two do **not** agree within the tolerance."
    )
    return {"live": f"{text}{numbers}\n\n{verdict}"}
