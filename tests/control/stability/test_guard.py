"""The guard of the gains: what it lets pass and when, with and without a process that computes."""

import os
from dataclasses import replace

import pytest

from cspr_control.errors import StabilityError
from cspr_control.stability import guard as guard_module
from cspr_control.stability.guard import StabilityGuard
from cspr_control.stability.kept_results import KeptResult, keep_result, kept_result
from cspr_control.stability.safe_gains import SafeGains
from cspr_control.stability.scan import Margin
from cspr_kinematics import CableProperties
from cspr_msgs_py.vocabulary import Level

SAFE = SafeGains((2.0, 4.0), (0.1, 0.2), ((True, True), (True, False)))


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_what_is_known_is_answered_at_once(loop, report, monkeypatch):
    monkeypatch.setattr(guard_module, "start_computing", lambda loop: pytest.fail("it is known"))
    keep_result(KeptResult(loop.fingerprint, report, SAFE))
    guard = StabilityGuard(loop)
    assert guard.wait().level is Level.OK
    guard.require(replace(loop.gains, kd=0.15))
    with pytest.raises(StabilityError, match=r"kp = 4 N m/rad with kd = 0\.2"):
        guard.require(replace(loop.gains, kp=4.0, kd=0.2))
    status = guard.status()
    assert (status.name, status.level, status.values["safe_gains"]) == ("stability", Level.OK, "known")
    assert status.values["gain_margin"] == "17"
    assert status.values["gain_margin_at"] == "(0, 0.7, 2) m with 300 kg"
    guard.close()


def test_bad_settings_are_named(loop, report):
    keep_result(KeptResult(loop.fingerprint, replace(report, late_cycles=Margin(1, None)), SAFE))
    guard = StabilityGuard(loop)
    assert guard.wait().refused
    assert guard.status().level is Level.ERROR


def test_a_process_computes_what_is_not_known(loop):
    guard = StabilityGuard(loop)
    try:
        with pytest.raises(StabilityError, match="being computed now"):
            guard.require(replace(loop.gains, kp=2.1))
        assert guard.status().level is Level.STALE
        assert guard.wait().level in (Level.OK, Level.WARN)
        assert kept_result(loop) is not None
        process = guard._process
    finally:
        guard.close()
    assert process is None or process.returncode is not None


def test_the_map_is_computed_when_somebody_asks_and_nobody_else_wants_the_cpu(loop, report):
    keep_result(KeptResult(loop.fingerprint, report))
    guard = StabilityGuard(loop)
    try:
        assert guard._process is None
        with pytest.raises(StabilityError, match="being computed now"):
            guard.require(replace(loop.gains, kp=2.1))
        assert os.sched_getscheduler(guard._process.pid) == os.SCHED_IDLE
        assert guard.status().values["safe_gains"] == "computing"
    finally:
        guard.close()


def test_what_cannot_be_computed_is_said_and_refuses_nothing(loop):
    stiff = replace(loop, robot=replace(loop.robot, cables=CableProperties().for_each(8)))
    guard = StabilityGuard(stiff)
    judged = guard.wait()
    assert judged.level is Level.WARN
    assert "give cables.axial_stiffness in robot.yaml" in judged.text
    guard.require(replace(loop.gains, kp=100.0))
    assert guard.status().level is Level.WARN
    guard.close()


def test_nothing_is_read_once_all_is_known(loop, report, monkeypatch):
    keep_result(KeptResult(loop.fingerprint, report, SAFE))
    guard = StabilityGuard(loop)
    monkeypatch.setattr(guard_module, "kept_result", lambda loop: pytest.fail("it is known"))
    guard.require(loop.gains)
    guard.status()
