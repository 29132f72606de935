"""Child processes: ended in order, killed when they do not listen, their last words kept."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from cspr_control.demo.child_processes import ChildProcesses
from cspr_control.errors import ControlError

OBEDIENT = """
import signal, sys, time
name, journal = sys.argv[1:]
def stop(*_):
    with open(journal, "a") as file:
        file.write(name + "\\n")
    sys.exit(0)
signal.signal(signal.SIGINT, stop)
print("ready", flush=True)
while True:
    time.sleep(0.05)
"""
DEAF = "import signal, time\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\nprint('ready', flush=True)\ntime.sleep(60)\n"
DYING = "print('so long'); raise SystemExit(3)\n"


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in (("obedient", OBEDIENT), ("deaf", DEAF), ("dying", DYING)):
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path


def wait_for_log(children: ChildProcesses, name: str, text: str) -> None:
    deadline = time.monotonic() + 120.0
    while text not in (children.log(name).read_text(encoding="utf-8")):
        assert time.monotonic() < deadline, f"{name} did not say {text!r}"
        time.sleep(0.01)


def test_children_end_in_the_reverse_order_of_their_start(modules: Path, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    with ChildProcesses(tmp_path / "log") as children:
        for name in ("first", "second", "third"):
            children.start(name, "obedient", [name, str(journal)])
        for name in ("first", "second", "third"):
            wait_for_log(children, name, "ready")
        children.check()
    assert journal.read_text(encoding="utf-8").split() == ["third", "second", "first"]


def test_a_frozen_child_stands_still_and_goes_on(modules: Path, tmp_path: Path) -> None:
    def state() -> str:
        stat = Path(f"/proc/{children.pids()['first']}/stat").read_text(encoding="utf-8")
        return stat.rpartition(") ")[2][0]

    def wait_until(frozen: bool) -> None:
        deadline = time.monotonic() + 120.0
        while (state() == "T") != frozen:
            assert time.monotonic() < deadline
            time.sleep(0.01)

    journal = tmp_path / "journal"
    with ChildProcesses(tmp_path / "log") as children:
        children.start("first", "obedient", ["first", str(journal)])
        wait_for_log(children, "first", "ready")
        with children.frozen("first"):
            wait_until(frozen=True)
        wait_until(frozen=False)
    assert journal.read_text(encoding="utf-8").split() == ["first"]


def test_a_child_that_does_not_listen_is_killed(modules: Path, tmp_path: Path) -> None:
    with ChildProcesses(tmp_path / "log", grace=0.2) as children:
        children.start("deaf", "deaf")
        wait_for_log(children, "deaf", "ready")
        process = children._children["deaf"]
    assert process.returncode == -9


def test_a_dead_child_is_named_with_its_last_words(modules: Path, tmp_path: Path) -> None:
    with ChildProcesses(tmp_path / "log") as children:
        children.start("the_node", "dying")
        children._children["the_node"].wait(timeout=120.0)
        children.check(["another"])
        with pytest.raises(ControlError, match=r"the_node ended with exit status 3") as error:
            children.check()
    assert "so long" in str(error.value)
    assert str(tmp_path / "log" / "the_node.log") in str(error.value)


def test_a_killed_child_is_reported_with_its_signal(modules: Path, tmp_path: Path) -> None:
    with ChildProcesses(tmp_path / "log") as children:
        children.start("victim", "deaf")
        wait_for_log(children, "victim", "ready")
        os.kill(children._children["victim"].pid, 9)
        children._children["victim"].wait()
        with pytest.raises(ControlError, match="signal SIGKILL"):
            children.check()
