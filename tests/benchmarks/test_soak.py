"""The soak: what a process has is read as it is, growth is told from steps, and the work goes on."""

from __future__ import annotations

import os
import threading

import pytest
from benchmarks.soak import Course, Resources, simulated


def test_what_this_process_has() -> None:
    before = Resources.of(os.getpid())
    ballast = bytearray(os.urandom(20_000_000))
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    with open(os.devnull, "rb"):
        after = Resources.of(os.getpid())
    end.set()
    thread.join()
    assert after.memory - before.memory == pytest.approx(len(ballast) * 1e-6, abs=5.0)
    assert (after.threads - before.threads, after.descriptors - before.descriptors) == (1, 1)


def test_growth_is_that_after_the_warm_up() -> None:
    course = Course("leaky")
    for moment in range(0, 1001, 10):
        course.times.append(float(moment))
        warming = 100.0 * min(moment, 150) / 150.0
        course.found.append(Resources(warming + 0.01 * moment, 5 + (moment >= 900), 4, 0))
    numbers = course.numbers(1000.0)
    assert numbers["memory_growth_MB_per_h"] == pytest.approx(36.0)
    assert (numbers["descriptors_more"], numbers["threads_more"], numbers["shared_memory_files_more"]) == (
        1,
        0,
        0,
    )


def test_the_work_in_simulated_time() -> None:
    (numbers,) = simulated(8.0)
    assert numbers["threads_more"] == numbers["descriptors_more"] == 0
