"""The hook of a commit: it formats and lints what is committed, and touches nothing else."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UGLY, PRETTY, WRONG = "x = {  'a':1}\n", 'x = {"a": 1}\n', "import os\n"


class Clone:
    """A repository with the project's hook and its rules."""

    def __init__(self, path: Path) -> None:
        self.file = path / "one.py"
        self.environment = {
            **{name: value for name, value in os.environ.items() if not name.startswith("GIT_")},
            "VENV": str(Path(sys.executable).parents[1]),
        }
        shutil.copytree(ROOT / ".githooks", path / ".githooks")
        shutil.copy(ROOT / "pyproject.toml", path)
        self.git("init", "--quiet")
        for name, value in {
            "user.name": "a", "user.email": "a@b", "core.hooksPath": ".githooks", "commit.gpgsign": "false",
        }.items():  # fmt: skip
            self.git("config", name, value)
        self.write('"""One."""\n')
        assert self.commit("--message=first").returncode == 0

    def git(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["git", *words], cwd=self.file.parent, env=self.environment, capture_output=True, text=True, check=False
        )  # fmt: skip

    def write(self, text: str, add: bool = True) -> None:
        self.file.write_text('"""One."""\n\n' * (text[:3] != '"""') + text, encoding="utf-8")
        if add:
            self.git("add", "one.py")

    def commit(self, *words: str) -> subprocess.CompletedProcess[str]:
        return self.git("commit", "--quiet", *(words or ["--message=second"]))

    @property
    def committed(self) -> str:
        return self.git("show", "HEAD:one.py").stdout.removeprefix('"""One."""\n').lstrip()

    @property
    def status(self) -> str:
        return self.git("status", "--short", "--untracked-files=no").stdout


def test_make_sets_the_hook_unless_there_are_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", os.devnull)

    def hooks() -> str:
        done = subprocess.run(
            ["git", "config", "core.hooksPath"], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    def make() -> None:
        subprocess.run(["make", "--file", ROOT / "Makefile", "hook"], cwd=tmp_path, check=True)

    make()  # in no repository: no hook, and no failure
    subprocess.run(["git", "init", "--quiet"], cwd=tmp_path, check=True)
    make()
    assert hooks() == ".githooks"
    subprocess.run(["git", "config", "core.hooksPath", "mine"], cwd=tmp_path, check=True)
    make()
    assert hooks() == "mine"


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    return Clone(tmp_path)


@pytest.mark.parametrize("all_changes", [False, True], ids=["added", "all"])
def test_what_is_committed_is_formatted(clone: Clone, all_changes: bool) -> None:
    clone.write(UGLY, add=not all_changes)
    done = clone.commit("--message=second", *["--all"] * all_changes)
    assert done.returncode == 0, done.stderr
    assert clone.committed == PRETTY
    assert clone.status == ""


def test_what_is_wrong_is_not_committed(clone: Clone) -> None:
    clone.write(WRONG)
    done = clone.commit()
    assert done.returncode == 1
    assert "F401" in done.stdout + done.stderr
    assert clone.committed == ""


def test_changes_that_are_not_added_stay_as_they_are(clone: Clone) -> None:
    clone.write(UGLY)
    clone.write(UGLY + WRONG, add=False)
    done = clone.commit()
    assert done.returncode == 1
    assert "format one.py and add it again" in done.stdout + done.stderr
    assert clone.file.read_text(encoding="utf-8").endswith(UGLY + WRONG)
    clone.write(PRETTY)
    clone.write(PRETTY + WRONG, add=False)
    assert clone.commit().returncode == 0  # what is wrong is not in the commit
    assert clone.committed == PRETTY


def test_a_commit_of_named_files_does_not_leave_the_index_behind(clone: Clone) -> None:
    clone.write(UGLY, add=False)
    assert clone.commit("--message=second", "one.py").returncode == 1
    assert clone.committed == ""
    clone.write(PRETTY, add=False)
    assert clone.commit("--message=second", "one.py").returncode == 0
    assert clone.status == ""


def test_without_ruff_nothing_is_checked(clone: Clone) -> None:
    clone.write(UGLY)
    clone.environment |= {"VENV": "nowhere", "PATH": "/usr/bin:/bin"}
    done = clone.commit()
    assert done.returncode == 0
    assert "no ruff" in done.stdout + done.stderr
    assert clone.committed == UGLY
