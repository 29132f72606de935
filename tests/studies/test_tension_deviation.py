"""The simulation studies against a formula of their own, and the document against the studies."""

import csv
from pathlib import Path

import numpy as np
import pytest
from studies.geometries import SHIPPED
from studies.paper_document import fill, tension_blocks
from studies.paper_results import write_tension_tables

from cspr_control.reference.paper import paper_18
from cspr_kinematics import inverse_kinematics

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def robot():
    return SHIPPED.robot


@pytest.fixture(scope="module")
def results(tension_results):
    return tension_results["shipped"]


def test_the_deviation_is_what_mass_times_acceleration_asks_of_the_cables(robot, results):
    trajectory = paper_18(robot.trajectory_center)
    for sample in (0, 37, 100):
        A = inverse_kinematics(robot, trajectory.sample(0.1 * sample).pose).wrench_matrix
        inertial = np.linalg.pinv(A) @ [353.0 * 0.040, 0.0, 0.0, 0.0, 0.0, 0.0]
        np.testing.assert_allclose(results.first.deviation[sample], inertial, atol=1e-9)
    np.testing.assert_array_equal(results.first.deviation[101:], 0.0)
    assert results.first.feasible
    assert results.first.time[-1] == pytest.approx(20.0)
    carried = [
        inverse_kinematics(robot, trajectory.sample(t).pose).wrench_matrix @ tensions
        for t, tensions in zip(results.first.time.tolist(), results.first.static, strict=True)
    ]
    np.testing.assert_allclose(carried, np.tile([0, 0, 353.0 * 9.81, 0, 0, 0], (201, 1)), atol=1e-6)


def test_half_the_time_is_four_times_the_deviation(results):
    slow, quick = results.accelerating.values()
    np.testing.assert_allclose(quick.rms / slow.rms, 4.0, rtol=0.02)  # the rest is the tilt


def test_the_added_load_deviates_by_its_mass(results):
    third = results.third
    assert third.time[-1] == pytest.approx(5.0)
    np.testing.assert_array_equal(third.payload, np.where(third.time < 2.99, 200.0, 300.0))
    same = results.second.between(0.0, 5.05)
    np.testing.assert_allclose(third.deviation[:30], same.deviation[:30])
    ratio = np.median(third.deviation[30:] / same.deviation[30:])
    assert ratio == pytest.approx(453.0 / 353.0, rel=0.01)


def test_the_document_is_up_to_date(tension_results):
    document = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    assert fill(document, tension_blocks(tension_results)) == document, "make paper ARGS=--update"
    with pytest.raises(ValueError, match="no block nothing"):
        fill(document, {"nothing": ""})
    for name in ("figure-11", "changing-load", "statements-experiment", "live"):
        assert f"<!-- begin {name} -->\n<!-- end" not in document


def test_the_tables_hold_what_the_figures_show(results, tmp_path):
    write_tension_tables(results, SHIPPED, tmp_path)
    with open(tmp_path / "figure_09.csv", encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == 16
    rms = [float(row["rms_N"]) for row in table if row["simulation"] == "(18)"]
    np.testing.assert_allclose(rms, results.accelerating["(18)"].rms, rtol=1e-4)
    lines = (tmp_path / "figure_08.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + 201 + 101 + 51
    assert len(lines[0].split(",")) == 3 + 16
