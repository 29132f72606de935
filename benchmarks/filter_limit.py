"""How fast may the filter of the static mass estimate be? The closed loop through the feed-forward answers.

The estimate weighs what the cables pull, the feed-forward pulls what the estimate weighs: a loop with positive
feedback, whose gain falls with the inertia of the winches. For each time constant the load is stepped by 100 kg on
the smooth trajectory, the gates and the rate limit of the estimator open, and the estimate is watched.
"""

from __future__ import annotations

from dataclasses import replace
from multiprocessing import get_context

import numpy as np
from studies.experiment import BARE, EQUATION_15

from cspr_control.closed_loop.run import run
from cspr_control.errors import ControlError
from cspr_msgs_py.vocabulary import TrajectoryName

TIME_CONSTANTS = (0.4, 0.2, 0.1, 0.05, 0.03, 0.01)  # s
INERTIA_FACTORS = (1.0, 0.1)
_OPEN_GATES = {
    "mass_rate_limit": 1e4,
    "slack_tension": 0.1,
    "static.max_speed": 100.0,
    "static.max_angular_speed": 100.0,
    "static.max_sideways_ratio": 10.0,
}


def _row(factor: float, time_constant: float) -> str:
    # the derivative gain must suit the inertia: Kd < 2 J / T
    gains = {"kd": 0.1 if factor == 1.0 else 0.03}
    estimator = {"method": "static", "static.time_constant": time_constant, **_OPEN_GATES}
    scenario = replace(
        BARE,
        motor_inertia_factor=factor,
        trajectory=TrajectoryName.SMOOTH_19,
        # the controllers do not know that the winches are lighter
        parameters={"motor_control_gains": gains, "mass_estimator": estimator, "feedforward": EQUATION_15},
    )
    row = f"{factor:>8g} {time_constant:>10g}"
    try:
        record = run(scenario)
    except ControlError as error:
        return f"{row}   unstable: {error}"
    late = record.mass_estimate[(record.time > 7.0) & (record.time < 9.5)]
    final = record.mass_true[-1]
    overshoot = record.mass_estimate.max() - final
    state = "unstable" if np.std(late) > 0.02 * final else "stable"
    return f"{row} {record.settling_time:>10.2f} {overshoot:>12.1f} {np.std(late):>12.2f}   {state}"


def main() -> None:
    """Print the table."""
    print("inertia  time const.  settled in    overshoot    standard dev.")
    print(" factor           s           s           kg    at the end, kg")
    cases = [(factor, constant) for factor in INERTIA_FACTORS for constant in TIME_CONSTANTS]
    with get_context("spawn").Pool() as pool:
        for row in pool.starmap(_row, cases, chunksize=1):
            print(row, flush=True)
