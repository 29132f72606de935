"""Times of short functions and tables of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter


def microseconds(function: Callable[[], object], repetitions: int) -> float:
    """Best mean time of many short series, us: on a busy machine most series are disturbed, some are not."""
    function()
    series = max(1, min(50, repetitions // 20))
    times = []
    for _ in range(20):
        start = perf_counter()
        for _ in range(series):
            function()
        times.append((perf_counter() - start) / series)
        if sum(times) * series > 3.0:
            break
    return min(times) * 1e6


def print_table(title: str, rows: Sequence[tuple[str, float]], base: float, limits: dict[str, float]) -> None:
    """Print times in us with their ratios to `base` and, where there is one, to what is aimed at."""
    print(f"\n{title:62}{'us':>10}{'ratio':>9}{'aim':>9}")
    for name, time in rows:
        aim = f"{limits[name]:>9.4g}" + ("" if time <= limits[name] else " missed") if name in limits else ""
        print(f"{name:62}{time:>10.2f}{time / base:>9.2f}{aim}")
