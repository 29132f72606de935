"""Whether the margins of the loop are enough, and what to change where they are not."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_control.stability.loop_configuration import LoopConfiguration
from cspr_control.stability.scan import REFUSED_GAIN_MARGIN, REFUSED_LATE, TIME_CONSTANTS, StabilityReport
from cspr_msgs_py.vocabulary import Level, PayloadMethod

WARNED_GAIN_MARGIN = 4.0
"""Below this margin of the loop through the estimate, settings are warned of."""


@dataclass(frozen=True)
class Verdict:
    """What the margins of a loop mean.

    Attributes
    ----------
    level
        OK, WARN, or ERROR where such settings must not drive a robot.
    text
        What is too small, and how small.
    remedy
        What to change; empty where nothing need be.
    """

    level: Level
    text: str
    remedy: str = ""

    @property
    def refused(self) -> bool:
        """Whether the settings must not drive a robot."""
        return self.level is Level.ERROR

    def __str__(self) -> str:
        """Say it in one line."""
        return f"{self.text}: {self.remedy}" if self.remedy else self.text


def verdict(report: StabilityReport, loop: LoopConfiguration) -> Verdict:
    """Judge the margins of a loop."""
    gains = loop.gains
    filter_time = (
        f"{'static.' * (loop.payload.method is PayloadMethod.STATIC)}time_constant of mass_estimator"
    )
    kd = f"kd is {gains.kd:g} N m s/rad, kp {gains.kp:g} N m/rad"
    motor = f"with a motor inertia of {loop.robot.motor.inertia:g} kg m^2 at {loop.control_rate:g} Hz"
    filtered = f"{filter_time} is {loop.time_constant:g} s"
    lower = f"lower kd, and kp with its square, or raise control_rate ({motor})"
    slower = f"raise {filter_time}, or lower kp"
    late, gain, limit = report.late_cycles, report.gain_margin, report.smallest_time_constant
    if report.mechanical_decay.value <= 0.0:
        grows = f"{kd}: the loop is unstable, worst at {report.mechanical_decay.place}"
        return Verdict(Level.ERROR, f"{grows}, growing by {-report.mechanical_decay.value:.3g} 1/s", lower)
    if report.decay.value <= 0.0:
        grows = f"{filtered}, {kd}: the loop through the estimate is unstable, worst at {report.decay.place}"
        return Verdict(
            Level.ERROR, f"{grows}, stable above {limit.value or TIME_CONSTANTS[-1]:.2g} s", slower
        )
    if late.value <= REFUSED_LATE:
        text = f"{kd}: unstable when torques come {late.value:.0f} cycle late, worst at {late.place}"
        return Verdict(Level.ERROR, text, lower)
    if gain.value < WARNED_GAIN_MARGIN:
        level = Level.ERROR if gain.value < REFUSED_GAIN_MARGIN else Level.WARN
        least = REFUSED_GAIN_MARGIN if level is Level.ERROR else WARNED_GAIN_MARGIN
        margin = (
            f"the gain margin of the loop through the estimate is {gain.value:.2g}, worst at {gain.place}"
        )
        return Verdict(level, f"{filtered}, {kd}: {margin}, and should be {least:g}", slower)
    if late.value <= REFUSED_LATE + 1:
        text = f"{kd}: unstable when torques come {late.value:.0f} cycles late, worst at {late.place}"
        return Verdict(Level.WARN, text, lower)
    words = report.words()
    text = f"stable until torques come {words['late_cycles']} cycles late; gain margin {words['gain_margin']}"
    return Verdict(Level.OK, text)
