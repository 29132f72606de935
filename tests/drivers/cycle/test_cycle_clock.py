import time

from cspr_drivers.clock import Clock
from cspr_drivers.cycle.cycle_clock import CycleClock


def test_the_clock_keeps_its_grid(wait_until):
    ticks = []
    clock = CycleClock(0.01, ticks.append)
    clock.start()
    wait_until(lambda: len(ticks) + clock.skipped >= 30)
    assert clock.running
    clock.stop()
    count = len(ticks)
    assert not clock.running
    moments = round((ticks[-1] - ticks[0]) / 0.01) + 1
    assert abs(moments - (count + clock.skipped)) <= 1
    time.sleep(0.03)
    assert len(ticks) == count


class SteppedTime(Clock):
    """Time that passes only where somebody waits."""

    now = 0.0

    def monotonic(self):
        return self.now

    def sleep(self, duration):
        self.now += duration


def test_a_call_that_takes_too_long_leaves_moments_out(wait_until):
    ticks, time = [], SteppedTime()

    def tick(now):
        ticks.append(now)
        if len(ticks) == 2:
            time.now += 0.1
        if len(ticks) == 5:
            clock.stop()

    clock = CycleClock(0.01, tick, time)
    clock.start()
    wait_until(lambda: not clock.running)
    assert clock.skipped >= 8
    assert clock.worst_lateness >= 0.0
    assert ticks[2] - ticks[1] >= 0.1
    assert (ticks[4] - ticks[3]) > 0.001  # no burst
    clock.clear()
    assert (clock.skipped, clock.worst_lateness) == (0, 0.0)


def test_a_clock_that_ends_tells_why(wait_until, capsys):
    told = []
    clock = CycleClock(0.01, lambda now: {}["6064h"], on_end=told.append)
    clock.start()
    wait_until(lambda: told)
    assert told == ["the driver's thread 'cycle clock' has ended (KeyError: '6064h'): start the driver again"]
    assert "Traceback" in capsys.readouterr().err
    wait_until(lambda: not clock.running)
