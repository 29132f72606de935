"""The linearised plant with its sampled controllers: motor states in, torques out some time later, and so on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cspr_control.stability.linear_plant import LinearPlant

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LoopTiming:
    """When things happen in a control cycle.

    Attributes
    ----------
    period
        Between two SYNCs, at which motor angles and tensions are latched, s.
    latency
        From SYNC until the torques that answer it act, s.
    """

    period: float
    latency: float


@dataclass(frozen=True)
class LoopGains:
    """What a controller makes of errors and set-points.

    Attributes
    ----------
    kp, kd
        N m/rad and N m s/rad.
    speed_delay
        By how much a desired speed is that of before, s.
    friction_slope
        Of the compensated friction over the desired speed at standstill, N m s/rad.
    """

    kp: float
    kd: float
    speed_delay: float = 0.0
    friction_slope: float = 0.0


class SetpointDeviation(NamedTuple):
    """Deviations of desired angles, speeds and accelerations, and of the feed-forward torques, all (m, ...)."""

    angle: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    torque: FloatArray


class Feedback(Protocol):
    """What makes set-points of angles and tensions, from one SYNC to the next: estimator and feed-forward, linearised.

    Attributes
    ----------
    size
        Of its state.
    """

    size: int

    def setpoint(self, state: FloatArray) -> SetpointDeviation:
        """Return what a state makes of the set-points."""

    def advance(self, state: FloatArray, angles: FloatArray, tensions: FloatArray, gain: float) -> FloatArray:
        """Return the state after a SYNC that latched these; ``gain`` multiplies what the estimate adds."""


class SampledLoop:
    """Platform, cables, winches and PD controllers from SYNC to SYNC.

    The state holds that of the plant, the angles of the SYNC before, of which the speeds are differences, torques on
    their way, and the state of the feedback through the estimate.

    Parameters
    ----------
    plant
        Linearised at a pose with a payload.
    timing
        Of its cycles.
    """

    def __init__(self, plant: LinearPlant, timing: LoopTiming) -> None:
        self.plant = plant
        self.timing = timing
        self._whole_cycles, until = divmod(timing.latency, timing.period)
        self._before = plant.between(until)
        self._after = plant.between(timing.period - until)

    def matrix(
        self, gains: LoopGains, feedback: Feedback | None, late: int = 0, gain: float = 1.0
    ) -> FloatArray:
        """Return the map (n, n) of the state over a cycle.

        Parameters
        ----------
        gains
            Of the controllers.
        feedback
            Through the estimate; None leaves the controllers alone.
        late
            By how many cycles the torques come later than the latency.
        gain
            Multiplies what the estimate adds to the set-points.
        """
        m, n = self.plant.robot.number_of_cables, len(self.plant.F)
        underway = int(self._whole_cycles) + late + 1
        own = feedback.size if feedback is not None else 0
        ends = np.cumsum([n, m, underway * m, own])
        (P1, G1), (P2, G2) = self._before, self._after
        x, before, line, state = np.split(np.eye(int(ends[-1])), ends[:-1])
        angles = x[self.plant.motors]
        torque = -gains.kp * angles - gains.kd / self.timing.period * (angles - before)
        if feedback is not None:
            desired = feedback.setpoint(state)
            speed = desired.speed - gains.speed_delay * desired.acceleration
            torque = torque + gains.kp * desired.angle + gains.kd * speed + desired.torque
            torque = torque + gains.friction_slope * desired.speed
            state = feedback.advance(state, angles, self.plant.C @ x, gain)
        line = np.concatenate((torque, line))
        x = P1 @ x + G1 @ line[underway * m :]
        x = P2 @ x + G2 @ line[(underway - 1) * m : underway * m]
        return np.concatenate((x, angles, line[: underway * m], state))

    def growth(self, gains: LoopGains, feedback: Feedback | None, late: int = 0, gain: float = 1.0) -> float:
        """Return by how much the slowest mode grows, 1/s; negative where everything decays. Parameters: `matrix`."""
        radius = np.abs(np.linalg.eigvals(self.matrix(gains, feedback, late, gain))).max()
        return float(np.log(radius)) / self.timing.period
