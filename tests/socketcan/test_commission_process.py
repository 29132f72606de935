"""The executable `commission` against the hanging platform: however it ends, no brake stays open."""

import re
import signal

import pytest
import yaml


@pytest.fixture
def walking(bench, executable, root):
    """A walk that turns the same winch again and again, and the bench without drivers."""
    bench.drivers.end()
    answers = bench.directory / "answers.yaml"
    answers.write_text(yaml.safe_dump({"keep": False, "winch.bus_0-node-1": ["again"] * 100}))
    walk = executable(
        "commission",
        "cspr_drivers.commission.program",
        "--config", bench.config,
        "--robot", root / "config" / "robot.yaml",
        "--answers", answers,
        "--torque", 0.3,
        "--restart",
        ros=False,
    )  # fmt: skip
    bench.until(lambda: bench.probe.brakes_open == 1 or not walk.running, "no brake opens")
    assert walk.running, walk.log.read_text()
    yield walk
    walk.end()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_it_closes_the_brake_and_says_so(bench, walking, number):
    walking.send(number)
    assert walking.wait() == 130
    bench.until(lambda: bench.probe.brakes_open == 0, "a brake is open")
    assert "interrupted; all brakes are closed. The same command resumes from here" in walking.log.read_text()


def test_killed_the_drive_misses_its_heartbeat_and_closes_the_brake(bench, walking):
    walking.send(signal.SIGKILL)
    walking.wait()
    bench.until(lambda: bench.probe.brakes_open == 0, "a brake stays open")


def test_it_does_not_start_beside_the_drivers(bench, executable, root):
    walk = executable("commission", "cspr_drivers.commission.program", "--config", bench.config, ros=False)
    assert walk.wait() == 1
    assert re.search(
        r"a driver is active on the CAN bus bus_[01]: its heartbeat as node 127 was seen; stop it first",
        walk.log.read_text(),
    )
