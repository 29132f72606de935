"""Runs in simulated time: the same bytes each time, the bag of a live run, and what goes wrong."""

from collections import Counter
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cspr_control.analysis.recording import read_recording
from cspr_control.analysis.run_analysis import analyse_recording
from cspr_control.closed_loop.run import closed_loop, run
from cspr_control.closed_loop.scenario import PlannedFault, Scenario
from cspr_control.errors import ControlError
from cspr_control.parameters.experiment import AddedPayload
from cspr_drivers.simulation.simulation_config import Sling
from cspr_kinematics import forward_kinematics
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.topics import CABLE_TENSIONS, DIAGNOSTICS
from cspr_msgs_py.vocabulary import Controller, RobotState, TrajectoryName

CONFIG = Path(__file__).parents[3] / "config"
SHORT = Scenario(config=CONFIG, trajectory=TrajectoryName.SMOOTH_19, duration=1.0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Record a fault on the way; the same run twice."""
    scenario = replace(SHORT, faults=(PlannedFault("load_cell_saturated cable_2", 0.7),))
    directory = tmp_path_factory.mktemp("runs")
    return [(run(scenario, directory / str(k) / "bag"), directory / str(k) / "bag") for k in range(2)]


def test_the_same_run_gives_the_same_bytes(recorded):
    (first, first_bag), (second, second_bag) = recorded
    for field in fields(first):
        if field.name != "elapsed":
            one, other = getattr(first, field.name), getattr(second, field.name)
            assert np.array_equal(one, other, equal_nan=True) if isinstance(one, np.ndarray) else one == other
    names = sorted(path.name for path in first_bag.iterdir())
    assert names == sorted(path.name for path in second_bag.iterdir())
    for name in names:
        assert (first_bag / name).read_bytes() == (second_bag / name).read_bytes()


def test_a_planned_fault_stops_the_robot_and_is_named(recorded):
    record, bag = recorded[0]
    assert "cable_2: positive overload" in record.cause
    with Bag(bag) as reader:
        states = [message.message for message in reader.read("/robot_state").messages]
    assert states[-1] == "fault"


def test_the_example_of_the_document_reads_a_bag(recorded):
    text = (CONFIG.parent / "docs" / "operation.md").read_text(encoding="utf-8")
    section = text.partition("\n## Reading a bag\n")[2].partition("\n## ")[0]
    code = "\n".join(line[4:] for line in section.splitlines() if line.startswith("    "))
    assert "runs/latest/bag" in code
    read = {}
    exec(code.replace("runs/latest/bag", str(recorded[0][1])), read)
    assert read["states"].position.shape == (len(read["states"].time), 8)
    assert list(read["texts"])[-1] == "fault"
    assert read["marks"] is None


@pytest.mark.parametrize("devices", [True, False])
def test_the_analysis_of_the_bag_says_what_the_record_says(tmp_path, devices):
    scenario = replace(
        SHORT,
        controller=Controller.STATIC,
        devices=devices,
        duration=None,
        trajectory=TrajectoryName.PAPER_19,
        parameters={"trajectory_publisher": {"dwell": 0.0}},
    )
    record = run(scenario, tmp_path / "bag")
    assert record.published is None
    recording = read_recording(tmp_path / "bag", configuration_directory=CONFIG)
    analysis = analyse_recording(recording, "static")
    assert recording.controller == "static"
    metrics = analysis.metrics
    np.testing.assert_allclose(metrics.position_error.rms, record.rms_deg, rtol=0.01)
    assert metrics.mass.estimate == pytest.approx(record.mass_estimate[-1], abs=0.1)
    assert metrics.cycle.rate == pytest.approx(250.0)
    assert metrics.cycle.missed == (0 if devices else None)


@pytest.mark.parametrize("devices", [True, False])
def test_the_true_pose_is_of_the_moment_of_the_motor_states(devices):
    """Every motor state has a true pose of its stamp; less what the motor angles tell, nothing grows with the speed."""
    scenario = replace(SHORT, devices=devices)
    published = run(scenario, keep=True).published
    states, truth = published.joint_states("/motor_states"), published.poses("/true_pose")
    common, rows, places = np.intersect1d(states.time_ns, truth.time_ns, return_indices=True)
    assert common.size == states.time_ns.size > 500
    assert np.unique(truth.time_ns).size == truth.time_ns.size
    true = truth.position[places]
    velocity = np.gradient(true, states.time_ns[rows] * 1e-9, axis=0)
    moving = np.linalg.norm(velocity, axis=1) > 0.1  # m/s
    assert moving.sum() > 50
    robot = scenario.read_machine().robot  # as it truly is, but that cables stretch
    told, pose = [], robot.home
    for angles in states.position[rows][moving]:
        pose = forward_kinematics(robot, robot.cable_lengths(angles), pose)
        told.append(pose.position)
    difference = true[moving] - np.array(told)
    difference -= difference.mean(axis=0)
    late = (difference * velocity[moving]).sum() / (velocity[moving] ** 2).sum()  # s
    assert (
        abs(late) < 1e-3
    )  # half of the plant's step; what is left is stretch that comes and goes with the motion


def test_devices_and_the_plant_alone_agree():
    errors = [run(replace(SHORT, duration=None, devices=devices)).rms_deg.mean() for devices in (True, False)]
    assert errors[0] == pytest.approx(errors[1], rel=0.1)


def test_a_stop_that_nobody_planned_is_an_error():
    weak = {"supervisor": {"following_error": 0.01, "starting_error": 2.0}}
    with pytest.raises(ControlError, match=r"the robot stopped: .*following error"):
        run(replace(SHORT, devices=False, trajectory=TrajectoryName.PAPER_19, parameters=weak))


def test_faults_need_devices():
    with pytest.raises(
        ControlError, match="bus_cut needs devices that can have it; the plant alone can have cable_slack, "
    ):
        replace(SHORT, devices=False, faults=(PlannedFault("bus_cut main", 1.0),))
    with pytest.raises(ControlError, match="there is no fault 'bus_cot'"):
        run(replace(SHORT, faults=(PlannedFault("bus_cot main", 1.0),)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"/**": {"control_rate": 500.0}}, r"control_rate is 500 Hz, but .*can\.yaml: rate = 250: make them"),
        (
            {"pose_estimator": {"control_rate": 100.0}},
            "control_rate of pose_estimator is 100.0, of",
        ),
    ],
)
def test_rates_that_differ_are_refused_as_by_the_robot(changes, words):
    with pytest.raises(ControlError, match=words):
        run(replace(SHORT, parameters=changes))


def test_a_bus_that_cannot_carry_the_cycle_is_refused_as_by_the_robot(tmp_path):
    for file in CONFIG.glob("*.yaml"):
        (tmp_path / file.name).write_text(file.read_text().replace("rate: 250.0", "rate: 500.0"))
    with pytest.raises(
        ControlError, match=r"rate = 500: bus main: .* \(137 %\), more than the limit of 90 %"
    ):
        run(replace(SHORT, config=tmp_path))


def test_payloads_come_and_go():
    added = (AddedPayload(50.0, 0.3), AddedPayload(-20.0, 0.6))
    record = run(replace(SHORT, devices=False, added=added))
    assert sorted(set(record.mass_true)) == [100.0, 130.0, 150.0]
    assert record.mass_true[-1] == 130.0


def test_a_payload_after_the_end_stays_away():
    record = run(replace(SHORT, devices=False, added=(AddedPayload(50.0, 0.5), AddedPayload(50.0, 1.0))))
    assert set(record.mass_true) == {100.0, 150.0}


def test_a_latency_of_nothing_is_nothing():
    assert replace(SHORT, latency=0.0).reaction_time == 0.0
    assert replace(SHORT, latency=None).reaction_time > 0.0


def test_a_slow_computer_sees_more_of_the_machine_in_a_second():
    """Durations count on the computer's clock: at half the speed reports come twice as often for the machine."""
    reports = []
    loop = closed_loop(replace(SHORT, devices=False, speed=0.5))
    loop.listeners.append(
        lambda topic, sample: reports.extend(sample.statuses) if topic is DIAGNOSTICS else None
    )
    loop.begin()
    loop.enable()
    loop.time.wait(1.0)
    assert loop.state is RobotState.ENABLED
    reports.clear()
    loop.time.wait(1.0)
    by_name = Counter(report.name for report in reports)
    assert {by_name[name] for name in ("feedforward", "mass_estimator", "motor_controller_1")} == {2}
    loop.machine.close()


def shown_by_the_plant_alone(fault: str = "", **changes: object) -> np.ndarray:
    """What load cells show while the brakes hold: half a second, and half a second with a fault."""
    loop = closed_loop(Scenario(payload=100.0, devices=False, config=CONFIG, **changes))
    shown = []
    loop.listeners.append(
        lambda topic, sample: shown.append(sample.effort) if topic is CABLE_TENSIONS else None
    )
    loop.begin()
    loop.time.wait(0.5)
    if fault:
        loop.machine.faults.inject(loop.machine.faults.read(fault))
    loop.time.wait(0.5)
    return np.array(shown)


def test_load_cells_of_the_plant_alone_have_faults() -> None:
    sound = shown_by_the_plant_alone()
    half, later = len(sound) // 2, len(sound) // 2 + 5
    offset = shown_by_the_plant_alone("load_cell_offset cable_4") - sound
    np.testing.assert_array_equal(offset[: half - 2], 0.0)
    np.testing.assert_allclose(
        offset[later:], 60.0 * np.eye(8)[[3] * len(offset[later:])], rtol=0.0, atol=1e-9
    )
    lost = sound - shown_by_the_plant_alone("load_cell_gain cable_1")
    np.testing.assert_allclose(lost[later:, 0], 0.1 * sound[later:, 0].mean(), atol=1.0)
    assert np.abs(shown_by_the_plant_alone("load_cell_zero cable_8")[later:, 7]).max() < 15.0
    assert np.ptp(shown_by_the_plant_alone("load_cell_stuck cable_2")[later:, 1]) == 0.0
    assert np.ptp(sound[later:, 1]) > 2.0


def test_a_load_on_a_sling_pulls_to_and_fro() -> None:
    """Half of half a period after its release it pulls straight down, and harder than at rest."""
    sling = Sling(0.5, 60e3, deflection=(0.2, 0.0))
    swinging, still = (shown_by_the_plant_alone(sling=each).sum(axis=1) for each in (sling, Sling(0.5, 60e3)))
    assert np.argmax(swinging[:175]) * 4e-3 == pytest.approx(np.pi / 2 * np.sqrt(0.516 / 9.81), abs=0.1)
    assert (swinging - still)[60:120].max() > 20.0
    on_table = shown_by_the_plant_alone(sling=Sling(2.0, 60e3), table_height=0.5).sum(axis=1)
    assert on_table.mean() < 0.75 * still.mean()
