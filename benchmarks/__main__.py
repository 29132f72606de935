"""Run the benchmarks: `make bench`, or one of them with `make bench ARGS=kinematics`."""

from __future__ import annotations

import argparse
from importlib import import_module

BENCHMARKS = {
    "machine": "what this computer can keep up with at best: a bare loop at 250 Hz (a minute)",
    "kinematics": "the mathematics of the control cycle",
    "tensions": "bounded tensions against other solvers, from 6 to 16 cables",
    "scaling": "growth of our own times with the number of cables and poses",
    "reading": "a bag into numpy arrays, against other readers (half a minute)",
    "recorder": "the recorder under the whole graph at 500 Hz (20 s; longer: python -m benchmarks.recorder --help)",
    "controllers": "the controllers in closed loop without ROS (half a minute)",
    "platform": "where the platform is and what it carries, against what is aimed at (four minutes on two cores; "
    "--live: two more for the whole graph)",
    "filter_limit": "the fastest filter of the mass estimate (about a minute)",
    "closed_loop": "how much faster than real time the closed loop is simulated (half a minute)",
}

parser = argparse.ArgumentParser(prog="benchmarks", description=__doc__)
parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(BENCHMARKS)}; all by default")
parser.add_argument(
    "--live", action="store_true", help="platform: the whole graph live as well, against simulated time"
)
options = parser.parse_args()
chosen = options.names or list(BENCHMARKS)
if options.live and "platform" not in chosen:
    parser.error("--live says something of platform")
for name in chosen:
    if name not in BENCHMARKS:
        parser.error(f"there is no benchmark {name!r}; there are {', '.join(BENCHMARKS)}")
for name in chosen:
    print(f"\n{name}: {BENCHMARKS[name]}")
    import_module(f"benchmarks.{name}").main(*([["--live"]] if options.live and name == "platform" else []))
