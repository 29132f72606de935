"""Change of the distribution method while the robot moves, without a jump in the tensions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import non_negative_number, positive_number
from cspr_kinematics.errors import InvalidInputError
from cspr_kinematics.tensions.distribute import METHODS, Method, distribute_tensions
from cspr_kinematics.tensions.result import TensionResult


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

    Raises
    ------
    InvalidInputError
        If the method is unknown or the slew not positive.
    """

    def __init__(self, method: Method = "closest", *, slew: float) -> None:
        self.slew = slew
        # Share of each method in the present tensions; the last one is the one in use.
        self._shares: dict[Method, float] = {}
        self.select(method)
        self._shares[method] = 1.0

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
        return next(reversed(self._shares))

    @property
    def settled(self) -> bool:
        """Whether the last change is over."""
        return len(self._shares) == 1

    def select(self, method: Method) -> None:
        """Pass to another method, from the next distribution on."""
        if method not in METHODS:
            raise InvalidInputError("method", method, f"known are {', '.join(METHODS)}")
        self._shares[method] = self._shares.pop(method, 0.0)

    def distribute(
        self,
        wrench_matrix: ArrayLike,
        wrench: ArrayLike,
        t_min: ArrayLike,
        t_max: ArrayLike,
        time_step: float,
    ) -> TensionResult:
        """Return the tensions `time_step` seconds after the last ones, for one pose.

        Parameters are those of `distribute_tensions`, without batch axes. The result is that of the method,
        with the tensions of the mixture, their wrench error and margin; it is feasible if all its parts are.

        Raises
        ------
        InvalidInputError
            Where `distribute_tensions` does, for batches, or if the time step is negative.
        SingularWrenchMatrixError
            Where `distribute_tensions` does.
        """
        step = non_negative_number("time_step", time_step)
        results = {m: distribute_tensions(wrench_matrix, wrench, t_min, t_max, m) for m in self._shares}
        method, target = self.method, results[self.method]
        if target.feasible.ndim:
            raise InvalidInputError("wrench", wrench, "must be a single one, not a batch")
        if self.settled:
            return target
        tensions = np.zeros_like(target.tensions)
        for mixed, share in self._shares.items():
            tensions += share * results[mixed].tensions
        furthest = float(np.abs(target.tensions - tensions).max())
        if furthest <= self._slew * step:
            self._shares = {method: 1.0}
            return target
        progress = self._slew * step / furthest
        tensions += progress * (target.tensions - tensions)
        others = {m: share * (1.0 - progress) for m, share in self._shares.items() if m != method}
        self._shares = {**others, method: 1.0 - sum(others.values())}
        error = np.asarray(wrench_matrix) @ tensions - np.asarray(wrench)
        below, above = tensions - np.asarray(t_min), np.asarray(t_max) - tensions
        mixture = target._replace(
            tensions=tensions,
            feasible=np.asarray(all(bool(result.feasible) for result in results.values())),
            residual=np.asarray(np.linalg.norm(error)),
            margin=np.asarray(min(below.min(), above.min())),
        )
        for array in mixture:
            array.setflags(write=False)
        return mixture
