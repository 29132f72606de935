"""How much faster than real time the closed loop is simulated, on one core and without a bag."""

from __future__ import annotations

from dataclasses import replace

from studies.experiment import BARE

from cspr_control.closed_loop.run import run

AIMS = {False: 12.0, True: 4.0}


def main() -> None:
    """Print simulated seconds per second of processor time, for the plant alone and with all devices."""
    print(f"{'pdff-mass on paper-19':33}{'simulated':>11}{'processor':>11}{'ratio':>8}{'aim':>6}")
    for devices, aim in AIMS.items():
        scenario = replace(BARE, devices=devices)
        run(replace(scenario, duration=0.5))  # warms up
        record = run(scenario)
        name = "with drivers, buses and devices" if devices else "the plant alone"
        ratio = record.simulated / record.elapsed
        print(
            f"{name:50}{record.simulated:>9.1f} s{record.elapsed:>9.1f} s{ratio:>8.1f}{aim:>6g}", flush=True
        )
