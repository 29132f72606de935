"""The numbers behind the figures: everything that the studies gave, and the files they go into."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cspr_control.analysis.numbers.error_statistics import ErrorStatistics, before_and_after
from cspr_control.reference.paper import paper_18, paper_19, paper_19_tilt
from cspr_kinematics import Robot
from studies.experiment import saturated, tension_rms
from studies.geometries import Geometry
from studies.loop_results import LoopResults, sampled_rms, size_mm, speed_errors
from studies.suitability import Suitability
from studies.tension_deviation import (
    ADDED_AT,
    SAMPLE_TIME,
    SWITCH_18,
    SWITCH_19,
    TensionStudy,
    first_simulation,
    level_simulation,
    second_simulation,
    third_simulation,
)

SHOWN_MOTOR = 3  # of figure 12
SHOWN_CABLE = 1  # of figure 10


@dataclass(frozen=True)
class TensionResults:
    """The three simulations of figures 8 to 10 with one robot."""

    robot: Robot
    first: TensionStudy
    level: TensionStudy  # the second one without its rotation
    second: TensionStudy
    third: TensionStudy
    suitability: Suitability

    @staticmethod
    def compute(robot: Robot) -> TensionResults:
        """Run them."""
        return TensionResults(
            robot,
            first_simulation(robot),
            level_simulation(robot),
            second_simulation(robot),
            third_simulation(robot),
            Suitability.of(robot),
        )

    @property
    def accelerating(self) -> dict[str, ErrorStatistics]:
        """Statistics of the first and the second simulation while the platform accelerates.

        Over the whole trajectory the median would say little: half of the samples are zero.
        """
        return {
            study.name: ErrorStatistics.of(study.between(0.0, switch + SAMPLE_TIME).deviation)
            for study, switch in ((self.first, SWITCH_18), (self.second, SWITCH_19))
        }

    @property
    def payload_change(self) -> dict[str, ErrorStatistics]:
        """Statistics of the third simulation before and after the load is added, and by how much they differ."""
        return before_and_after(self.third.time, self.third.deviation, ADDED_AT)


def write_tension_tables(results: TensionResults, geometry: Geometry, directory: Path) -> None:
    """Write the numbers of figures 7 to 10 of a geometry as CSV."""
    robot, suffix = geometry.robot, geometry.suffix
    cables = range(1, robot.number_of_cables + 1)
    rows = []
    for make in (paper_18, paper_19, paper_19_tilt):
        trajectory = make(robot.trajectory_center)
        for k in range(round(trajectory.duration / SAMPLE_TIME) + 1):
            point = trajectory.sample(k * SAMPLE_TIME)
            values = np.concatenate((point.pose.position, np.degrees(point.pose.euler), point.twist.linear))
            rows.append([trajectory.name, k * SAMPLE_TIME, *values, *point.acceleration.linear])
    vectors = [f"{name}{axis}" for name in ("", "v", "a") for axis in "xyz"]
    names = [*vectors[:3], "alpha_deg", "beta_deg", "gamma_deg", *vectors[3:]]
    _write(directory / "figure_07.csv", ["trajectory", "time_s", *names], rows)
    rows = [
        [study.name, time, payload, *dynamic, *(dynamic - static)]
        for study in (results.first, results.second, results.third)
        for time, payload, dynamic, static in zip(
            study.time, study.payload, study.dynamic, study.static, strict=True
        )
    ]
    names = [f"{what}_{k}_N" for what in ("dynamic", "deviation") for k in cables]
    _write(directory / f"figure_08{suffix}.csv", ["simulation", "time_s", "payload_kg", *names], rows)
    for number, kind, statistics in (
        ("09", "simulation", results.accelerating),
        ("10", "interval", results.payload_change),
    ):
        rows = [
            [name, k, one.maximum[k - 1], one.median[k - 1], one.rms[k - 1]]
            for name, one in statistics.items()
            for k in cables
        ]
        _write(
            directory / f"figure_{number}{suffix}.csv", [kind, "cable", "max_N", "median_N", "rms_N"], rows
        )


def write_loop_tables(results: LoopResults, directory: Path) -> None:
    """Write the numbers of figures 11 and 12 with a geometry as CSV, and the mass estimates over time."""
    robot, suffix = results.geometry.robot, results.geometry.suffix
    motors = range(1, robot.number_of_cables + 1)
    names = [f"{what}_{k}" for what in ("rms_deg", "max_deg", "rms_rad_s", "tension_rms_N") for k in motors]
    rows = []
    for case, one in results.records.items():
        errors, limit = one.errors, robot.motor.torque_limit
        numbers = (*errors.rms, *errors.maximum, *speed_errors(one), *tension_rms(one))
        quality = (
            float(errors.rms.mean()),
            *sampled_rms(one),
            size_mm(one.platform_error),
            size_mm(results.platform_by_motors(one)),
            saturated(one, limit),
            one.mass_error,
            one.settling_time,
        )
        rows.append([case.controller, case.trajectory.value, case.load, case.added, *numbers, *quality])
    head = ["controller", "trajectory", "load_kg", "added_kg"]
    quality_names = [
        "mean_rms_deg",
        "sampled_rms_least_deg",
        "sampled_rms_largest_deg",
        "platform_rms_mm",
        "platform_by_motors_rms_mm",
        "saturated_share",
        "mass_error_kg",
        "settling_time_s",
    ]
    _write(directory / f"figure_11{suffix}.csv", [*head, *names, *quality_names], rows)
    rows = [
        [case.controller, case.trajectory.value, case.load, case.added, *numbers]
        for case, record in results.records.items()
        for numbers in zip(
            record.time,
            np.degrees(record.position_error[:, SHOWN_MOTOR - 1]),
            record.velocity_error[:, SHOWN_MOTOR - 1],
            1e3 * np.linalg.norm(record.platform_error, axis=1),
            record.mass_estimate,
            record.mass_true,
            strict=True,
        )
    ]
    names = [
        f"error_{SHOWN_MOTOR}_deg",
        f"error_{SHOWN_MOTOR}_rad_s",
        "platform_error_mm",
        "mass_estimate_kg",
    ]
    _write(directory / f"figure_12{suffix}.csv", [*head, "time_s", *names, "mass_true_kg"], rows)


def _write(path: Path, names: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        for row in rows:
            writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in row])
