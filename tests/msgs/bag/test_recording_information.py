import os
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest

from cspr_msgs_py.bag.recording_information import git_revision, recording_information


def git(directory: Path, *arguments: str) -> str:
    identity = ["-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "commit.gpgsign=false"]
    done = subprocess.run(
        ["git", "-C", str(directory), *identity, *arguments], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.fixture
def work_tree(tmp_path: Path) -> Path:
    package = tmp_path / "src" / "cspr_msgs_py"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package/>")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "-m", "x")
    git(tmp_path, "tag", "-a", "v1", "-m", "x")
    return tmp_path


def test_the_revision_is_the_commit(work_tree: Path) -> None:
    assert git_revision(work_tree / "src") == git(work_tree, "rev-parse", "HEAD")


def test_files_that_differ_from_it_are_told(work_tree: Path) -> None:
    (work_tree / "src" / "cspr_msgs_py" / "package.xml").write_text("<other/>")
    assert git_revision(work_tree) == f"{git(work_tree, 'rev-parse', 'HEAD')}-dirty"


def test_the_revision_of_another_project_is_not_ours(tmp_path: Path) -> None:
    assert git_revision(tmp_path) is None
    git(tmp_path, "init", "--quiet")
    (tmp_path / "file").touch()
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "-m", "x")
    assert git_revision(tmp_path) is None


def test_what_a_bag_says_about_its_recording() -> None:
    information = recording_information(datetime(2026, 1, 2, tzinfo=UTC), 500.0)
    assert information["control_rate"] == "500.0"
    assert information["start_time"] == "2026-01-02T00:00:00+00:00"
    assert information["kernel"].split() == [os.uname().sysname, os.uname().release]
    assert {"software", "python", "host"} <= information.keys()


def test_background_scheduling_spares_the_threads_that_are_there() -> None:
    script = """
import os, threading
from cspr_msgs_py.runtime.scheduling import set_background
release = threading.Event()
middleware = threading.Thread(target=release.wait)
middleware.start()
print(set_background(7))
own = threading.Thread(target=lambda: print(os.getpriority(os.PRIO_PROCESS, threading.get_native_id())))
own.start()
own.join()
print(os.getpriority(os.PRIO_PROCESS, middleware.native_id))
print(os.sched_getscheduler(middleware.native_id) == os.sched_getscheduler(0) == os.SCHED_BATCH)
release.set()
"""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    if before > 7:
        pytest.skip("this process is niced already")
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=30, check=True
    )
    assert done.stdout.split() == ["None", "7", str(before), "True"]
