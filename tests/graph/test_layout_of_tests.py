"""Tests stand where what they test stands: the folders of `tests/` are the rooms of the packages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = {
    ROOT / "tests" / name.removeprefix("cspr_").removesuffix("_py"): ROOT / "src" / name / name
    for name in ("cspr_kinematics", "cspr_msgs_py", "cspr_control", "cspr_drivers")
}
BESIDE = {"graph", "socketcan", "studies", "benchmarks", "workspace"}  # what no room holds alone
MODULES = sorted(path for folder in PACKAGES for path in folder.rglob("test_*.py"))


def test_every_folder_is_a_package_s_or_stands_beside_them() -> None:
    folders = {path for path in (ROOT / "tests").iterdir() if path.is_dir() and any(path.glob("**/*.py"))}
    assert folders - set(PACKAGES) <= {ROOT / "tests" / name for name in BESIDE}


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(ROOT / "tests").as_posix())
def test_a_test_stands_in_the_room_that_it_tests(path: Path) -> None:
    tests = next(folder for folder in PACKAGES if path.is_relative_to(folder))
    package, room = PACKAGES[tests], path.parent.relative_to(tests).parts
    assert package.joinpath(*room).is_dir(), f"there is no room {'/'.join(room)} in {package.name}"
    text = path.read_text(encoding="utf-8")
    named = set(re.findall(rf"\b{package.name}\.(\w+)", text))  # rooms, imported or started as programs
    public = re.search(rf"from {package.name} import", text)
    if room:
        assert public or not named or room[0] in named, f"it tests {', '.join(named)}"
    elif len(named) == 1 and not public:
        assert not (package / named.pop()).is_dir(), "all that it tests stands in one room"
