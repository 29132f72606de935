"""The package's public names, each of which is imported when it is first asked for."""

from __future__ import annotations

import subprocess
import sys

import pytest

import cspr_kinematics


def test_every_public_name_is_there() -> None:
    names = dir(cspr_kinematics)
    assert names == cspr_kinematics.__all__  # type: ignore[attr-defined]  # that of the stub is implicit
    assert {"GRAVITY", "Robot", "inverse_kinematics"} < set(names)
    for name in names:
        value = getattr(cspr_kinematics, name)
        assert vars(cspr_kinematics)[name] is value
    with pytest.raises(AttributeError, match="'cspr_kinematics' has no attribute 'Robbot'"):
        cspr_kinematics.Robbot  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize("module", ["cspr_kinematics.configuration.yaml_file", "cspr_drivers.nodes.drivers"])
def test_who_reads_files_alone_imports_no_compiler(module: str) -> None:
    program = f"import sys, {module}; print(sorted({{'numba', 'scipy'}} & set(sys.modules)))"
    output = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout
    assert output == "[]\n"
