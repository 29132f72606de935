"""Change of the distribution method while the robot moves, without a jump in the tensions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import FloatArray, checked, frozen, non_negative_number, positive_number
from cspr_kinematics.errors import InvalidInputError
from cspr_kinematics.tensions.distribute import METHODS, Method, distribute_tensions
from cspr_kinematics.tensions.result import TensionResult


@dataclass(frozen=True, eq=False)
class _Choice:
    """A method with its reference, and its share in the present tensions."""

    method: Method
    reference: FloatArray
    share: float

    def is_like(self, method: Method, reference: FloatArray) -> bool:
        return self.method == method and np.array_equal(self.reference, reference)


class TensionBlend:
    """Distributes wrenches by a method that may be changed while the robot moves.

    After a change the tensions pass from the old method's to the new one's as mixtures of the two. Both give
    the wrench and stay within the limits, hence so does every mixture: the platform does not feel the change.
    The change moves no tension faster than `slew`; what the trajectory does to the tensions comes on top
    and is not limited.

    Parameters
    ----------
    method : {"minimum_norm", "closest", "centroid", "analytic_center"}
        The first method.
    slew : float
        Fastest change of a tension due to a change of method, N/s.
    reference : float or array_like, shape (m,), optional
        Tensions that `closest` approaches, N.

    Raises
    ------
    InvalidInputError
        If the method is unknown, the slew not positive or the reference not finite.
    """

    def __init__(self, method: Method = "closest", *, slew: float, reference: ArrayLike = 0.0) -> None:
        self.slew = slew
        self._choices: list[_Choice] = []
        self.select(method, reference)
        self._choices = [replace(self._choices[0], share=1.0)]

    @property
    def slew(self) -> float:
        """Fastest change of a tension due to a change of method, N/s; it may be set at any time."""
        return self._slew

    @slew.setter
    def slew(self, value: float) -> None:
        self._slew = positive_number("slew", value)

    @property
    def method(self) -> Method:
        """The method in use, or the one to which the tensions are passing."""
        return self._choices[-1].method

    @property
    def settled(self) -> bool:
        """Whether the last change is over."""
        return len(self._choices) == 1

    def select(self, method: Method, reference: ArrayLike = 0.0) -> None:
        """Pass to another method or another reference, from the next distribution on."""
        if method not in METHODS:
            raise InvalidInputError("method", method, f"known are {', '.join(METHODS)}")
        near = frozen(checked("reference", reference))
        share = sum(choice.share for choice in self._choices if choice.is_like(method, near))
        others = [choice for choice in self._choices if not choice.is_like(method, near)]
        self._choices = [*others, _Choice(method, near, share)]

    def distribute(
        self,
        wrench_matrix: ArrayLike,
        wrench: ArrayLike,
        t_min: ArrayLike,
        t_max: ArrayLike,
        time_step: float,
        *,
        weights: ArrayLike | None = None,
    ) -> TensionResult:
        """Return the tensions `time_step` seconds after the last ones, for one pose.

        Parameters are those of `distribute_tensions`, without batch axes. The result is that of the method,
        with the tensions of the mixture, their wrench error, margin, and active limits; it is feasible if all
        its parts are.

        Raises
        ------
        InvalidInputError
            Where `distribute_tensions` does, for batches, or if the time step is negative.
        SingularWrenchMatrixError
            Where `distribute_tensions` does.
        """
        step = non_negative_number("time_step", time_step)
        results = [
            distribute_tensions(
                wrench_matrix, wrench, t_min, t_max, c.method, reference=c.reference, weights=weights
            )
            for c in self._choices
        ]
        target = results[-1]
        if target.feasible.ndim:
            raise InvalidInputError("wrench", wrench, "must be a single one, not a batch")
        if self.settled:
            return target
        tensions = np.zeros_like(target.tensions)
        for choice, result in zip(self._choices, results, strict=True):
            tensions += choice.share * result.tensions
        furthest = float(np.abs(target.tensions - tensions).max())
        if furthest <= self._slew * step:
            self._choices = [replace(self._choices[-1], share=1.0)]
            return target
        progress = self._slew * step / furthest
        tensions += progress * (target.tensions - tensions)
        *others, last = self._choices
        others = [replace(choice, share=choice.share * (1.0 - progress)) for choice in others]
        self._choices = [*others, replace(last, share=1.0 - sum(choice.share for choice in others))]
        return _mixed(tensions, results, wrench_matrix, wrench, t_min, t_max)


def _mixed(
    tensions: FloatArray,
    results: list[TensionResult],
    wrench_matrix: ArrayLike,
    wrench: ArrayLike,
    t_min: ArrayLike,
    t_max: ArrayLike,
) -> TensionResult:
    """Return the last result with other tensions."""
    last = results[-1]
    error = np.asarray(wrench_matrix) @ tensions - np.asarray(wrench)
    below, above = tensions - np.asarray(t_min), np.asarray(t_max) - tensions
    feasible = np.asarray(all(bool(result.feasible) for result in results))
    residual, margin = np.asarray(np.linalg.norm(error)), np.asarray(min(below.min(), above.min()))
    active = np.asarray(above <= 0.0).astype(np.int8) - np.asarray(below <= 0.0).astype(np.int8)
    for array in (tensions, feasible, residual, margin, active):
        array.setflags(write=False)
    return last._replace(
        tensions=tensions, feasible=feasible, residual=residual, margin=margin, active=active
    )
