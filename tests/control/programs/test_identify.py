"""The program identify, on runs of the simulated robot over pulleys that its file does not describe."""

import json
import shutil
from pathlib import Path

import pytest
import yaml

pytest.importorskip("mujoco")

from cspr_control.programs import closed_loop, identify

CONFIG = Path(__file__).parents[3] / "config"


@pytest.fixture(scope="module", params=[0.0, 0.05])
def run(request, tmp_path_factory):
    """A radius, and the directory of a run of a robot with pulleys of it; the plant's geometry is its own."""
    directory = tmp_path_factory.mktemp("identify")
    shutil.copytree(CONFIG, directory / "config")
    simulation = directory / "config" / "simulation.yaml"
    content = yaml.safe_load(simulation.read_text(encoding="utf-8"))
    content["true_values"]["pulleys"] = {"radius": request.param}
    simulation.write_text(yaml.safe_dump(content), encoding="utf-8")
    arguments = [
        "--config",
        str(directory / "config"),
        "--plant",
        "--trajectory",
        "smooth-19",
        "--duration",
        "8",
        "--set",
        "supervisor.length_misfit=0.001",
    ]
    closed_loop.main([*arguments, "--bag", str(directory / "bag")])
    return request.param, directory


def test_the_radius_of_a_simulated_robot(run, capsys, tmp_path):
    radius, directory = run
    assert identify.main([str(directory), "--json", str(tmp_path / "found.json")]) == 0
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert found["radius_m"] == pytest.approx(radius, abs=2e-3)
    assert found["standard_deviation_m"] < 4e-3
    assert found["misfit_after_m"] < 0.1e-3
    entry = yaml.safe_load(found["yaml"])["pulleys"]
    assert entry == {"radius": pytest.approx(radius, abs=2e-3), "swivel_axis": [0.0, 0.0, 1.0]}
    said = capsys.readouterr().out
    assert ("Write into robot.yaml" in said) == (radius > 0.0)
    assert ("agrees with this run" in said) == (radius == 0.0)
    if radius:
        assert found["misfit_before_m"] > 5.0 * found["misfit_after_m"]


def test_what_the_run_does_not_tell_as_well_as_wanted_is_refused(run, capsys):
    _, directory = run
    assert identify.main([str(directory), "--deviation", "0.1"]) == 1
    assert "where 0.1 mm are wanted" in capsys.readouterr().err
