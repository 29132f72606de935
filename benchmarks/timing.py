"""Times of short functions and tables of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import thread_time

_FEWEST_SERIES, _MOST_SERIES = 3, 200
_LONGEST = 0.3  # s of all series


def microseconds(function: Callable[[], object], repetitions: int) -> float:
    """Best mean CPU time of many short series, us: on a busy machine most series are disturbed, some are not."""
    function()
    series = max(1, min(50, repetitions // 20))
    times: list[float] = []
    while len(times) < _FEWEST_SERIES or (len(times) < _MOST_SERIES and sum(times) * series < _LONGEST):
        start = thread_time()
        for _ in range(series):
            function()
        times.append((thread_time() - start) / series)
    return min(times) * 1e6


def seconds(
    function: Callable[[], object], clock: Callable[[], float] = thread_time, repetitions: int = 5
) -> float:
    """Best of some times, s; on the clock of this thread, which work on others does not count on."""
    times = []
    for _ in range(repetitions):
        start = clock()
        function()
        times.append(clock() - start)
    return min(times)


def print_table(title: str, rows: Sequence[tuple[str, float]], base: float, limits: dict[str, float]) -> None:
    """Print times in us with their ratios to `base` and, where there is one, to what is aimed at."""
    print(f"\n{title:62}{'us':>10}{'ratio':>9}{'aim':>9}")
    for name, time in rows:
        aim = f"{limits[name]:>9.4g}" + ("" if time <= limits[name] else " missed") if name in limits else ""
        print(f"{name:62}{time:>10.2f}{time / base:>9.2f}{aim}")
