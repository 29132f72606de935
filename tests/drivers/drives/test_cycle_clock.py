import time

from cspr_drivers.devices.setup_thread import SetupThread
from cspr_drivers.drives.cycle_clock import CycleClock
from cspr_drivers.errors import DeviceError


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


def test_a_call_that_takes_too_long_leaves_moments_out(wait_until):
    ticks = []

    def tick(now):
        ticks.append(now)
        if len(ticks) == 2:
            time.sleep(0.1)

    clock = CycleClock(0.01, tick)
    clock.start()
    wait_until(lambda: len(ticks) >= 5)
    clock.stop()
    assert clock.skipped >= 8
    assert clock.worst_lateness >= 0.0
    assert ticks[2] - ticks[1] >= 0.1
    assert (ticks[4] - ticks[3]) > 0.001  # no burst
    clock.clear()
    assert (clock.skipped, clock.worst_lateness) == (0, 0.0)


def test_devices_are_tried_again_and_each_cause_is_reported_once(wait_until, monkeypatch):
    monkeypatch.setattr("cspr_drivers.devices.setup_thread.RETRY_INTERVAL", 0.01)
    attempts = []
    problems = ["does not answer", "does not answer", "refuses", ""]
    lines = []

    def configure(index):
        attempts.append(index)
        problem = problems[min(len(attempts), len(problems)) - 1]
        if problem:
            raise DeviceError("motor_1", problem)

    setup = SetupThread(["motor_1"], configure, lambda: True, lines.append)
    assert setup.problems == {"motor_1": "not configured yet"}
    setup.start()
    wait_until(lambda: not setup.problems)
    assert lines == ["motor_1: does not answer", "motor_1: refuses", "motor_1: ready"]
    setup.request(0, "restarted")
    wait_until(lambda: len(attempts) == 5)
    setup.stop()


def test_nothing_is_configured_while_it_is_not_allowed(wait_until, monkeypatch):
    monkeypatch.setattr("cspr_drivers.devices.setup_thread.RETRY_INTERVAL", 0.01)
    allowed = []
    attempts = []
    setup = SetupThread(["motor_1"], attempts.append, lambda: bool(allowed), print)
    setup.start()
    time.sleep(0.05)
    assert attempts == []
    allowed.append(True)
    wait_until(lambda: attempts == [0])
    setup.stop()


def test_a_restart_during_configuration_asks_for_one_more_round(wait_until):
    attempts = []

    def configure(index):
        attempts.append(index)
        if len(attempts) == 1:
            setup.request(0, "restarted")

    setup = SetupThread(["motor_1"], configure, lambda: True, print)
    setup.start()
    wait_until(lambda: len(attempts) == 2 and not setup.problems)
    setup.stop()
