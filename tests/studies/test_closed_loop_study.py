"""The closed loop without ROS, and how it is compared with a live run."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from studies.experiment import BEYOND, CONTROLLERS, Case, all_cases, saturated, tension_rms
from studies.geometries import SHIPPED
from studies.live_agreement import Agreement, LiveRun

from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.errors import ControlError
from cspr_control.parameters.experiment import AddedPayload
from cspr_control.reference.paper import paper_19
from cspr_kinematics import Robot
from cspr_msgs_py import topics
from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.bag.metadata import RecordedTopic
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.vocabulary import TrajectoryName
from cspr_msgs_py.wire.reference import ReferenceCodec, ReferenceSample
from cspr_msgs_py.wire.stamped_doubles import INERTIA, StampedDoublesCodec

ROOT = Path(__file__).parents[2]
START = 1_700_000_000_000_000_000


def test_a_case_gives_what_the_document_says():
    case = Case("pdff-mass", TrajectoryName.SMOOTH_19, 200.0)
    record = run(case.scenario)
    document = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    row = re.search(r"\| smooth-19 \| PDFF \+ mass \|.*\| ([\d.]+) \([^|]*\|\n", document)
    # other releases of MuJoCo and numpy round otherwise
    assert record.rms_deg.mean() == pytest.approx(float(row[1]), rel=0.03)
    assert record.time[0] == pytest.approx(case.scenario.phase)
    assert record.time[-1] == pytest.approx(12.0, abs=0.01)
    assert record.mass_estimate[-1] == pytest.approx(200.0, abs=2.0)
    # eight cables carry the load; what the feed-forward asked for is near
    assert np.mean(tension_rms(record)) < 10.0
    assert saturated(record, Robot.from_yaml(ROOT / "config" / "robot.yaml").motor.torque_limit) == 0.0
    assert record.simulated > 14.0


def test_the_cases_are_those_of_the_paper_and_some_more(second):
    cases = all_cases(SHIPPED)
    assert len(cases) == len(set(cases)) == 42
    assert {case.load for case in cases} == {0.0, 100.0, 200.0}
    assert {case.controller for case in cases} == {*CONTROLLERS, *BEYOND}
    assert str(cases[-1]) == "pdff-mass (as shipped) on paper-19 with 100 kg + 100 kg at 3 s"
    others = all_cases(second)
    assert len(others) == len(set(others)) == 23
    assert {case.controller for case in others} == {*CONTROLLERS} - {"pd"}
    assert str(others[0]) == "static on paper-19 with 0 kg, second geometry"
    assert {case.scenario.config for case in others} == {second.config}


def test_the_paper_s_controllers_have_no_more_than_the_paper():
    """Nor do those beyond it leave out anything else."""
    for name, scenario in CONTROLLERS.items():
        parameters = scenario.read_parameters()
        assert parameters.values("mass_estimator")["method"] == "static", name
        assert parameters.values("feedforward")["winch_inertia"] is False, name
        assert parameters.values("feedforward")["stretch_compensation"] is False, name
        assert parameters.values("feedforward")["rope_weight"] is False, name
        assert parameters.values("motor_control_gains")["speed_delay"] == 0.0, name
    winches, shipped = BEYOND.values()
    differing = {"winch_inertia": (False, True)}
    printed = CONTROLLERS["pdff-mass"].read_parameters().values("feedforward")
    found = winches.read_parameters().values("feedforward")
    assert {key: (printed[key], found[key]) for key in found if printed[key] != found[key]} == differing
    assert shipped.parameters == {}


@pytest.fixture
def live(tmp_path):
    """Write what the demo leaves of a run: 100 kg, and 50 kg more 4 s after the start."""

    def write(pace=1.0, **changes):
        summary = {
            "controller": "pdff", "exact_mass": True, "trajectory": "paper-19",
            "rms_platform_error_mm": 2.0, "rms_position_error_deg": [10.0] * 8,
            "mass_true_final_kg": 150.0, "mass_estimate_final_kg": 150.5,
            "mass_settling_time_s": 1.25, "cycles": 1000, "missed_cycles": 20, "command_latency_us": {"p50": 1400.0},
        }  # fmt: skip
        (tmp_path / "summary.json").write_text(json.dumps(summary | changes), encoding="utf-8")
        bag = BagFile(tmp_path / "bag", {})
        used = (topics.REFERENCE, topics.SIMULATED_PAYLOAD)
        index = {
            t.name: bag.add_topic(RecordedTopic(t.name, t.type, message_definition(t.type))) for t in used
        }
        reference, inertia = ReferenceCodec(), StampedDoublesCodec("platform", INERTIA)
        point = paper_19(np.zeros(3)).sample(1.0)
        for cycle in range(-100, 1500):
            stamp = START + 1_300_000 + cycle * 4_000_000  # 1.3 ms after the start
            received = START + round((stamp - START) / pace)
            sample = ReferenceSample(
                stamp, max(stamp - START, 0) * 1e-9, point.pose.position, point.pose.quaternion,
                point.twist.linear, point.twist.angular, point.acceleration.linear, point.acceleration.angular,
            )  # fmt: skip
            bag.add_message(index["/reference"], received, received, reference.encode(sample))
            if cycle % 5 == 0:
                mass = 100.0 if cycle * 0.004 < 4.0 else 150.0
                data = inertia.encode(stamp, [mass, *np.zeros(9)])
                bag.add_message(index["/simulation/payload"], received, received, data)
        bag.close()
        return tmp_path

    return write


def test_a_live_run_tells_its_case(live):
    one = LiveRun.read(live())
    scenario = one.scenario
    assert one.name == "pdff (exact mass)"
    assert scenario.exact_mass
    assert (scenario.payload, scenario.added) == (100.0, (AddedPayload(50.0, 4.0),))
    assert scenario.phase == pytest.approx(0.0013, abs=1e-6)
    assert scenario.latency == pytest.approx(0.0014)
    assert one.missed == 0.02
    assert scenario.speed == 1.0


def test_agreement_is_judged_number_by_number(live):
    one = LiveRun.read(live())
    near = Agreement(one, 2.0, np.full(8, 10.3), 150.4, 1.3)
    assert near.within_tolerance
    assert [number.deviation for number in near.numbers()[:2]] == pytest.approx([0.0, 10.0 / 10.3 - 1.0])
    assert not Agreement(one, 2.3, np.full(8, 10.3), 150.4, 1.3).within_tolerance
    assert not Agreement(one, 2.0, np.full(8, 12.0), 150.4, 1.3).within_tolerance
    assert not Agreement(one, 2.0, np.array([10.0] * 7 + [13.0]), 150.4, 1.3).within_tolerance
    assert not Agreement(one, 2.0, np.full(8, 10.0), 152.0, 1.3).within_tolerance
    assert not Agreement(one, 2.0, np.full(8, 10.0), 150.4, np.inf).within_tolerance


def test_what_is_no_run_of_the_demo_is_said(tmp_path):
    with pytest.raises(ControlError, match="is not a run of the demo"):
        LiveRun.read(tmp_path / "nothing")


def test_a_slow_run_is_read_on_the_machine_s_clock(live):
    one = LiveRun.read(live(pace=0.4))
    assert (one.scenario.payload, one.scenario.added) == (100.0, (AddedPayload(50.0, 4.0),))
    assert one.scenario.speed == pytest.approx(0.4)


def test_the_default_is_that_of_the_demo():
    scenario = Scenario()
    assert (scenario.payload, scenario.added) == (100.0, (AddedPayload(100.0, 3.0),))
    assert scenario.trajectory is TrajectoryName.PAPER_19
