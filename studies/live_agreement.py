"""A run that was recorded live, through the whole graph, against the same case run here without ROS."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.numbers.platform_error import PoseDeviation, platform_error
from cspr_control.analysis.recording import recording_of
from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.errors import ControlError
from cspr_control.parameters.experiment import AddedPayload
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.topics import SIMULATED_PAYLOAD
from cspr_msgs_py.vocabulary import TrajectoryName, controller_label
from studies.experiment import CONTROLLERS

PLATFORM_TOLERANCE = 0.1  # of the platform's RMS error
MEAN_TOLERANCE = 0.07  # of the mean RMS error
MOTOR_TOLERANCE = 0.2  # of the RMS error of each motor
MASS_TOLERANCE = 0.5  # kg, of the final estimate
SETTLING_TOLERANCE = 0.1  # s


@dataclass(frozen=True)
class LiveRun:
    """What a directory of the demo says of its run."""

    scenario: Scenario
    name: str
    platform_mm: float  # RMS error of the platform
    rms_deg: NDArray[np.float64]  # (m,)
    mass_estimate: float  # kg, at the end
    settling_time: float  # s
    missed: float  # share of the control cycles

    @staticmethod
    def read(directory: Path) -> LiveRun:
        """Read a run: its case, when in a control cycle it began, its latency and its outcome.

        Raises
        ------
        ControlError, cspr_msgs_py.errors.BagError
            If it is not a run of the demo, or its bag cannot be read.
        """
        try:
            summary = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
            name = controller_label(summary["controller"], summary["exact_mass"])
            chosen = CONTROLLERS[name]
            trajectory = TrajectoryName(summary["trajectory"])
            latency = summary["command_latency_us"]["p50"] * 1e-6
            settled = summary["mass_settling_time_s"]
            platform = float(summary["rms_platform_error_mm"])
            with Bag(directory / "bag") as bag:
                references, truth = bag.references(), bag.inertias(SIMULATED_PAYLOAD.name)
        except (OSError, TypeError, ValueError, KeyError) as error:
            raise ControlError(
                f"{directory} is not a run of the demo: {type(error).__name__} {error}"
            ) from error
        moving = np.flatnonzero(references.time_from_start > 0.0)
        if moving.size == 0:
            raise ControlError(f"{directory}: the platform followed no trajectory")
        phase = float(references.time_from_start[moving[0]])
        start = int(references.time_ns[moving[0]]) - round(phase * 1e9)
        # the simulated machine may have run slower than the clock by which the recorder counts
        pace = float(np.ptp(references.time_ns[moving]) / np.ptp(references.log_time_ns[moving]))
        told = np.interp(truth.log_time_ns, references.log_time_ns, references.time_ns)
        masses = truth.mass[told <= references.time_ns[moving[-1]]]
        changes = np.flatnonzero(np.abs(np.diff(masses)) > 1e-6)
        added_at = (told[changes[-1] + 1] - start) * 1e-9 if changes.size else 0.0
        added = float(masses[-1] - masses[0])
        period = float(np.median(np.diff(references.time_ns))) * 1e-9
        scenario = replace(
            chosen,
            config=directory / "config",
            parameters={},  # those of the run
            trajectory=trajectory,
            payload=float(masses[0]),
            # the truth is published 50 times a second
            added=(AddedPayload(added, round(float(added_at), 1)),) if changes.size else (),
            latency=latency,
            phase=phase % period,
            speed=pace if abs(pace - 1.0) > 0.02 else 1.0,
        )
        return LiveRun(
            scenario,
            name,
            platform,
            np.array(summary["rms_position_error_deg"]),
            summary["mass_estimate_final_kg"],
            np.inf if settled is None else settled,
            summary["missed_cycles"] / max(summary["cycles"], 1),
        )


class Compared(NamedTuple):
    """A number of both outcomes, and by how much they may differ: as a share of the offline one, or in its unit."""

    name: str
    live: float
    offline: float
    tolerance: float
    share: bool = False

    @property
    def deviation(self) -> float:
        """Live less offline."""
        if self.share:
            return self.live / self.offline - 1.0
        return 0.0 if self.live == self.offline else self.live - self.offline  # both may be infinite


@dataclass(frozen=True)
class Agreement:
    """Both outcomes of one case."""

    live: LiveRun
    platform_mm: float  # without ROS, as all that follows
    rms_deg: NDArray[np.float64]  # (m,)
    mass_estimate: float
    settling_time: float

    def numbers(self) -> list[Compared]:
        """Return what is compared; first the platform's error, then the mean of the motors'."""
        live, motors = self.live, zip(self.live.rms_deg, self.rms_deg, strict=True)
        mean = live.rms_deg.mean(), self.rms_deg.mean()
        return [
            Compared(
                "platform's RMS error, mm",
                live.platform_mm,
                self.platform_mm,
                PLATFORM_TOLERANCE,
                share=True,
            ),
            Compared("mean RMS error, deg", *mean, MEAN_TOLERANCE, share=True),
            *(Compared(f"motor {k}", *both, MOTOR_TOLERANCE, share=True) for k, both in enumerate(motors, 1)),
            Compared("final mass estimate, kg", live.mass_estimate, self.mass_estimate, MASS_TOLERANCE),
            Compared("settled to 2 % after, s", live.settling_time, self.settling_time, SETTLING_TOLERANCE),
        ]

    @property
    def within_tolerance(self) -> bool:
        """Whether every number agrees within its tolerance."""
        return all(abs(one.deviation) <= one.tolerance for one in self.numbers())


def agreement(live: LiveRun) -> Agreement:
    """Run the case of a live run without ROS, with the configuration of that run."""
    record = run(live.scenario, keep=True)
    assert record.published is not None  # it was asked for
    recording = recording_of(record.published, directory=live.scenario.config)
    error = platform_error(recording)
    assert error is not None  # the plant tells where it is, and the trajectory was played
    size = PoseDeviation.of(error.part(recording.in_window(error.time_ns)))
    assert size is not None
    return Agreement(live, size.rms_mm, record.rms_deg, float(record.mass_estimate[-1]), record.settling_time)
