import time

from cspr_drivers.devices.setup_thread import SetupThread
from cspr_drivers.errors import DeviceError


def test_devices_are_tried_again_and_each_cause_is_reported_once(wait_until):
    attempts = []
    problems = ["does not answer", "does not answer", "refuses", ""]
    lines = []

    def configure(index):
        attempts.append(index)
        problem = problems[min(len(attempts), len(problems)) - 1]
        if problem:
            raise DeviceError("motor_1", problem)

    setup = SetupThread(["motor_1"], configure, lambda index: True, lines.append, retry_interval=0.01)
    assert setup.problems == {"motor_1": "not configured yet"}
    setup.start()
    wait_until(lambda: not setup.problems)
    assert lines == ["motor_1: does not answer", "motor_1: refuses", "motor_1: ready"]
    setup.request(0, "restarted")
    wait_until(lambda: len(attempts) == 5)
    setup.stop()


def test_nothing_is_configured_while_it_is_not_allowed(wait_until):
    allowed = []
    attempts = []
    setup = SetupThread(["motor_1"], attempts.append, lambda index: bool(allowed), print, retry_interval=0.01)
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

    setup = SetupThread(["motor_1"], configure, lambda index: True, print)
    setup.start()
    wait_until(lambda: len(attempts) == 2 and not setup.problems)
    setup.stop()


def test_a_defect_is_told_and_the_other_devices_are_set_up(wait_until, capsys):
    lines, attempts = [], []

    def configure(index):
        attempts.append(index)
        if attempts.count(0) == index + 1 < 3:
            {}["6075h"]

    setup = SetupThread(
        ["motor_1", "motor_2"], configure, lambda index: True, lines.append, retry_interval=0.01
    )
    setup.start()
    wait_until(lambda: not setup.problems)
    setup.stop()
    assert lines == ["motor_1: KeyError: '6075h'", "motor_1: ready"]
    assert "Traceback" in capsys.readouterr().err


def test_a_thread_that_ends_tells_why(wait_until, capsys):
    told = []

    def report(line):
        raise RuntimeError("no log")

    def configure(index):
        raise DeviceError("motor_1", "does not answer")

    setup = SetupThread(["motor_1"], configure, lambda index: True, report, on_end=told.append)
    setup.start()
    wait_until(lambda: told)
    assert told == [
        "the driver's thread 'device set-up' has ended (RuntimeError: no log): start the driver again"
    ]
    assert "Traceback" in capsys.readouterr().err
    setup.stop()
