"""Results on disk: found again, whole or not at all, and never those of another configuration."""

from dataclasses import replace

import numpy as np
import pytest

from cspr_control.stability.kept_results import KeptResult, keep_result, kept_result, results_directory
from cspr_control.stability.safe_gains import SafeGains
from cspr_msgs_py.vocabulary import PayloadMethod

SAFE = SafeGains((1.0, 2.0), (0.1, 0.2), ((True, False), (False, True)))


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "cspr" / "stability"


def test_found_again(place, loop, report):
    assert kept_result(loop) is None
    for result in (KeptResult(loop.fingerprint, report), KeptResult(loop.fingerprint, report, SAFE)):
        keep_result(result)
        assert kept_result(loop) == result
    assert [path.name for path in place.iterdir()] == [f"{loop.fingerprint}.json"]


def test_what_matters_is_in_the_fingerprint(loop):
    robot = loop.robot
    points = robot.exit_points + np.eye(8, 3) * 1e-9
    others = [
        replace(loop, gains=replace(loop.gains, kp=2.1)),
        replace(loop, control_rate=500.0),
        replace(loop, latency=0.002),
        replace(loop, robot=replace(robot, motor=replace(robot.motor, inertia=1.6e-3))),
        replace(loop, robot=robot.with_geometry(exit_points=points)),
        replace(loop, feedforward=replace(loop.feedforward, tension_method="centroid")),
        replace(loop, payload=replace(loop.payload, method=PayloadMethod.STATIC)),
    ]
    assert len({loop.fingerprint, *(other.fingerprint for other in others)}) == len(others) + 1
    assert replace(loop, robot=replace(robot)).fingerprint == loop.fingerprint


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\x00", b'{"fingerprint": 1}', None])
def test_damaged_is_not_there(place, loop, report, content):
    result = KeptResult(loop.fingerprint, report, SAFE)
    keep_result(result)
    (file,) = place.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] if content is None else content)
    assert kept_result(loop) is None
    keep_result(result)
    assert kept_result(loop) == result


def test_of_another_configuration_is_not_there(place, loop, report):
    keep_result(KeptResult("0" * 64, report, SAFE))
    (file,) = place.iterdir()
    file.rename(place / f"{loop.fingerprint}.json")
    assert kept_result(loop) is None


def test_what_cannot_be_written_leaves_nothing(place, loop, report, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="No space left"):
        keep_result(KeptResult(loop.fingerprint, report, SAFE))
    assert not list(place.iterdir())


def test_where_it_is(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    for value in ("", "relative"):  # which the specification has ignored
        monkeypatch.setenv("XDG_CACHE_HOME", value)
        assert results_directory() == tmp_path / ".cache" / "cspr" / "stability"
