"""The sensitivity study: what is varied, what counts as unstable, and what the correlations say."""

import os
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from studies import sensitivity
from studies.experiment import BARE
from studies.sensitivity import OUTCOMES, RANGES, Outcome, Varied, outcome, rank_correlations, rings, tornado

MIDDLE = [0.5 * (low + high) for low, high, _ in RANGES.values()]
NOMINAL = {"kp": 2.0, "kd": 0.1, "inertia": 1.0, "friction": 1.0, "viscous": 1.0, "stiffness": 1.0}
QUIET = Outcome(1.0, 0.5, 0.3, 0.1, 0.2, -2.0, "")


def row(**values):
    return list((dict.fromkeys(RANGES, 0.0) | NOMINAL | values).values())


def test_a_loop_in_which_nothing_is_varied_is_the_shipped_one():
    machine, shipped = Varied.of(1, row()).read_machine(), BARE.read_machine()
    np.testing.assert_array_equal(machine.robot.exit_points, shipped.robot.exit_points)
    assert machine.robot.motor == shipped.robot.motor
    assert machine.cables == shipped.cables
    assert Varied.of(1, row()).reaction_time == BARE.reaction_time


def test_what_is_varied_is_in_the_machine():
    scenario = Varied.of(3, MIDDLE)
    machine, shipped = scenario.read_machine(), BARE.read_machine()
    value = dict(scenario.varied)
    assert machine.robot.motor.inertia == pytest.approx(value["inertia"] * shipped.robot.motor.inertia)
    assert machine.robot.pulleys.radii(8)[0] == value["pulley"]
    assert 0.0 < np.abs(machine.robot.exit_points - shipped.robot.exit_points).max() < 5 * value["exits"]
    assert np.asarray(machine.load_cells.offset).std() > 0.0
    assert scenario.reaction_time == pytest.approx(BARE.reaction_time + 0.004)
    assert scenario.payload_center == (value["offset"], 0.0, 0.0)
    assert scenario.read_parameters().values("motor_control_gains")["kp"] == value["kp"]
    np.testing.assert_array_equal(
        Varied.of(3, MIDDLE).read_machine().robot.exit_points, machine.robot.exit_points
    )


def test_what_counts_as_unstable():
    several = [
        *[QUIET] * 5,
        replace(QUIET, ringing=1.0),
        replace(QUIET, motors=40.0),
        replace(QUIET, stopped="following error of motor 3"),
        replace(QUIET, motors=np.nan, ringing=np.nan),
    ]
    assert rings(several).tolist() == [False] * 5 + [True] * 4


def test_correlations_and_figure():
    lower, upper = (np.array([limits[end] for limits in RANGES.values()]) for end in (0, 1))
    rows = lower + (upper - lower) * np.random.default_rng(5).random((60, len(RANGES)))
    names = list(RANGES)
    outcomes = [
        replace(QUIET, motors=1.0 / values[names.index("kp")], mass=values[names.index("pulley")])
        if values[names.index("kd")] < 0.18
        else replace(QUIET, ringing=9.0)
        for values in rows
    ]
    table = rank_correlations(rows, outcomes)
    column = list(OUTCOMES).index
    assert table[names.index("kp"), column("motors")] == pytest.approx(-1.0)
    assert table[names.index("pulley"), column("mass")] == pytest.approx(1.0)
    assert not table[:, column("settling")].any()
    assert np.argmax(table[:, column("unstable")]) == names.index("kd")
    panels = tornado(table).axes
    assert [panel.get_title(loc="right") for panel in panels[:5]] == list(OUTCOMES.values())
    assert panels[0].get_yticklabels()[-1].get_text() == RANGES["kp"][2]


def test_the_document_tells_how_long_it_took_and_on_how_many_cores(monkeypatch, tmp_path, capsys):
    document = tmp_path / "stability.md"
    document.write_text(
        "before\n<!-- begin sensitivity -->\nold\n<!-- end sensitivity -->\nafter\n", encoding="utf-8"
    )
    clock = iter([0.0, 40.0, 80.0, 120.0, 160.0, 200.0])  # s: begin, each of four loops, end
    for name, value in (
        ("DOCUMENT", document),
        ("FIGURE", tmp_path / "sensitivity.png"),
        ("monotonic", lambda: next(clock)),
        (
            "get_context",
            lambda kind: SimpleNamespace(Pool=lambda *arguments: nullcontext(SimpleNamespace(imap=map))),
        ),
        ("outcome", lambda scenario: replace(QUIET, motors=dict(scenario.varied)["kp"])),
    ):
        monkeypatch.setattr(sensitivity, name, value)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1})
    assert sensitivity.main(["--loops", "4", "--output", str(tmp_path / "out"), "--update"]) == 0
    took = "4 loops in 3 min 20 s on 2 cores\n"
    assert took in capsys.readouterr().out
    text = document.read_text(encoding="utf-8")
    assert took in text
    assert text.startswith("before\n")
    assert text.endswith("after\n")


def test_a_loop_is_run_and_foretold():
    came = outcome(Varied.of(1, row()))
    assert came.stopped == ""
    assert came.foretold < 0.0
    assert came.motors < 3.0
    assert came.mass < 2.0
    assert 0.0 < came.platform < 5.0
