"""The programs closed_loop and faults."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import MultiDOFJointTrajectory

pytest.importorskip("mujoco")

from cspr_control.analysis.numbers.cycles import CycleMetrics
from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.mass import MassMetrics
from cspr_control.analysis.numbers.run_summary import RunSummary
from cspr_control.analysis.recording import Window
from cspr_control.closed_loop.fault_scenarios import SCENARIOS, fault_pairs
from cspr_control.closed_loop.scenario import FAULTS
from cspr_control.programs import analyze, closed_loop, faults, rerun
from cspr_msgs_py.bag.reader import Bag

CONFIG = str(Path(__file__).parents[3] / "config")


def test_a_scenario_from_the_command_line(tmp_path, capsys):
    bag, numbers = tmp_path / "bag", tmp_path / "summary.json"
    arguments = [
        "--config", CONFIG, "--controller", "pdff", "--exact-mass", "--trajectory", "smooth-19", "--duration", "1",
        "--payload", "50", "--add-payload", "25@0.5", "--set", "motor_control_gains.kp=3", "--seed", "7",
        "--bag", str(bag), "--json", str(numbers),
    ]  # fmt: skip
    assert closed_loop.main(arguments) == 0
    said = json.loads(numbers.read_text(encoding="utf-8"))
    assert (said["controller"], said["exact_mass"], said["trajectory"]) == ("pdff", True, "smooth-19")
    assert (said["mass_true_final_kg"], said["missed_cycles"], said["bag"]) == (75.0, 0, str(bag))
    out = capsys.readouterr().out
    assert "pdff (exact mass) on smooth-19" in out
    assert "times real time" in out
    with Bag(bag) as reader:
        control = next(data for name, data in reader.attachments.items() if name.endswith("control.yaml"))
        assert b"kp: 3" in control
        assert {"/motor_states", "/setpoint", "/robot_state", "/drive_states", "/diagnostics"} <= set(
            reader.counts
        )


@pytest.mark.parametrize(
    "fault",
    [(), ("--fault", "load_cell_offset cable_4@1")],  # by what its motor carries the cell is doubted
)
def test_a_bag_of_simulated_time_is_analysed_and_rerun_alike(fault, tmp_path, capsys):
    arguments = ["--config", CONFIG, "--plant", "--duration", "3", "--add-payload", "25@0.5", *fault]
    assert closed_loop.main([*arguments, "--bag", str(tmp_path / "bag")]) == 0
    assert analyze.main([str(tmp_path), "--config", CONFIG, "--no-figures"]) == 0
    assert rerun.main([str(tmp_path)]) == 0
    assert "to the last bit" in capsys.readouterr().out
    (run,) = json.loads((tmp_path / "analysis" / "metrics.json").read_text(encoding="utf-8"))["runs"]
    comparison = json.loads((tmp_path / "rerun" / "comparison.json").read_text(encoding="utf-8"))
    compared, setpoint = comparison["payload"], comparison["setpoint"]
    assert compared["recorded_quality"] == {
        "settling_time": run["mass"]["settling"],
        "final_error": run["mass"]["estimate"] - run["mass"]["true"],
    }
    assert compared["mass"]["maximum"] == compared["center_of_mass"]["maximum"] == 0.0
    # all but the few that bridge the first estimate, by times that a bag keeps to the nanosecond
    assert setpoint["identical"] > setpoint["recorded"] - 20
    assert setpoint["position"]["maximum"] == setpoint["velocity"]["maximum"] == 0.0
    assert setpoint["effort"]["maximum"] < 1e-7
    with Bag(tmp_path / "bag") as bag:
        (state,) = bag["/recorder_state"].messages
        assert state.message == "recording"
        channels = [channel for file in bag.files for channel in file.channels.values()]
        assert all(channel.metadata["topic_type_hash"].startswith("RIHS01_") for channel in channels)


def platform_error_by_hand(bag: Path, end: float) -> tuple[float, float]:
    """RMS and maximum of the true less the wanted position of equal stamps, mm, as ROS reads the messages."""
    with Bag(bag) as reader:
        truth, wanted = (
            [deserialize_message(data, kind) for _, _, data in reader.messages(topic)]
            for topic, kind in (("/true_pose", PoseStamped), ("/reference", MultiDOFJointTrajectory))
        )
    stamp = {id(one): one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in (*truth, *wanted)}
    since = {stamp[id(one)]: one.points[0].time_from_start for one in wanted}
    begins = [at - s.sec * 10**9 - s.nanosec for at, s in since.items() if s.sec or s.nanosec]
    places = {stamp[id(one)]: one.points[0].transforms[0].translation for one in wanted}
    errors = [
        math.dist((p.x, p.y, p.z), (places[at].x, places[at].y, places[at].z))
        for one, p, at in ((one, one.pose.position, stamp[id(one)]) for one in truth)
        if begins[0] <= at <= begins[0] + round(end * 1e9) and at in places
    ]
    assert len(errors) > 0.99 * end / 0.004
    return 1e3 * math.sqrt(sum(e * e for e in errors) / len(errors)), 1e3 * max(errors)


@pytest.mark.parametrize(
    "options",
    [
        ["--plant", "--duration", "4"],
        ["--duration", "4"],
        ["--fault", "emergency_stop@1.5"],
        ["--controller", "pdff", "--exact-mass", "--duration", "2", "--add-payload", "none"],
    ],
)
def test_a_summary_is_what_the_analysis_of_the_bag_says(options, tmp_path, capsys):
    numbers, bag = tmp_path / "said.json", tmp_path / "bag"
    arguments = ["--config", CONFIG, "--bag", str(bag), "--json", str(numbers), *options]
    assert closed_loop.main(arguments) == 0
    said = json.loads(numbers.read_text(encoding="utf-8"))
    assert (
        analyze.main([str(bag), "--config", CONFIG, "--no-figures", "--json", str(tmp_path / "found.json")])
        == 0
    )
    (found,) = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))["runs"]
    cycle, mass, errors = found["cycle"], found["mass"], found["position_error_deg"]
    error, estimate = found["platform"]["error"], found["platform"]["estimate"]
    fault = "--fault" in options
    assert ("emergency stop" in said["cause"]) == fault
    assert said == {
        "controller": found["controller"].removesuffix(" (exact mass)"),
        "exact_mass": found["controller"].endswith(" (exact mass)"),
        "trajectory": found["trajectory"],
        "time_zero": found["time_zero"],
        "window": found["window"],
        "platform_judged_by": "true pose",
        "rms_platform_error_mm": error["rms_mm"],
        "max_platform_error_mm": error["max_mm"],
        "mean_platform_error_z_mm": error["mean_mm"][2],
        "rms_platform_rotation_error_deg": error["rotation_rms_deg"],
        "max_platform_rotation_error_deg": error["rotation_max_deg"],
        "rms_platform_estimate_error_mm": estimate["rms_mm"],
        "max_platform_estimate_error_mm": estimate["max_mm"],
        "rms_position_error_deg": errors["rms"],
        "max_position_error_deg": errors["maximum"],
        "mean_rms_position_error_deg": pytest.approx(sum(errors["rms"]) / len(errors["rms"]), rel=1e-12),
        "mass_true_final_kg": mass["true"],
        "mass_estimate_final_kg": mass["estimate"],
        "mass_settling_time_s": mass["settling"],
        "rate_hz": cycle["rate"],
        "cycles_window": cycle["counted"],
        "cycles": cycle["cycles"],
        "missed_cycles": cycle["missed"],
        "command_latency_window": "since the drives were enabled",
        "command_latency_us": {name: cycle[f"latency_{name}_us"] for name in ("p50", "p99", "max")},
        "bag": found["bag"],
        "cause": said["cause"],
    }
    rms, largest = platform_error_by_hand(bag, found["window"]["end"])
    assert said["rms_platform_error_mm"] == pytest.approx(rms, rel=1e-9)
    assert said["max_platform_error_mm"] == pytest.approx(largest, rel=1e-9)
    assert 0.05 < rms < 20.0
    assert (said["cycles"] is None) == ("--plant" in options)
    if "--duration" in options:
        assert said["window"]["end"] == pytest.approx(
            float(options[options.index("--duration") + 1]), abs=0.05
        )


def test_help_names_every_key_of_the_json(capsys):
    with pytest.raises(SystemExit):
        closed_loop.main(["--help"])
    text = capsys.readouterr().out
    nothing = ErrorStatistics(*np.zeros((3, 8)))
    mass = MassMetrics(0.0, 0.0, 0.0, 0.0, 0.0, (), None)
    cycle = CycleMetrics.of(np.zeros(0), None, None, None, None, *3 * [math.nan])
    keys = RunSummary("pd", False, "", Window("", 0.0, 0.0), nothing, mass, cycle).as_mapping().keys()
    assert [key for key in keys if key not in text] == []


def test_what_stopped_the_robot_is_said(tmp_path, capsys):
    numbers, bag = tmp_path / "summary.json", tmp_path / "bag"
    arguments = ["--config", CONFIG, "--duration", "1", "--json", str(numbers), "--bag", str(bag)]
    assert closed_loop.main([*arguments, "--fault", "drive_silent motor_3@0.2"]) == 0
    cause = json.loads(numbers.read_text(encoding="utf-8"))["cause"]
    assert cause.startswith("drive fault: motor_3: silent")
    (verdict,) = [line for line in capsys.readouterr().out.splitlines() if "verdict" in line]
    assert verdict.split(maxsplit=1)[1] == f"stopped: {cause}"
    with Bag(bag) as reader:
        lines = {(line.name, line.level, line.msg) for line in reader["/rosout"].messages}
    assert any(name == "supervisor" and level >= 30 and cause in text for name, level, text in lines)


@pytest.mark.parametrize("planned", [(), ("--fault", "drive_silent motor_3@0.9")])
def test_a_fault_that_was_not_asked_for_is_a_failure(planned, capsys):
    limit = ["--set", "supervisor.following_error=0.05"]  # rad: not yet at rest
    assert closed_loop.main(["--config", CONFIG, "--duration", "1", *limit, *planned]) == 1
    assert "closed_loop: the robot stopped: following error: motor_" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (
            "drive_slient motor_3@1",
            "'drive_slient'; did you mean drive_silent? `cspr closed_loop --help` lists",
        ),
        ("sabotage motor_3@1", "'sabotage'; `cspr closed_loop --help` lists them"),
        ("drive_silent motor_9@1", "'motor_9'"),
    ],
)
def test_a_fault_that_cannot_be_injected_is_refused_at_once(fault, words, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("cspr_control.closed_loop.loop.ClosedLoop.begin", None)
    bag = tmp_path / "bag"
    assert closed_loop.main(["--config", CONFIG, "--fault", fault, "--bag", str(bag)]) == 1
    assert words in capsys.readouterr().err
    assert not bag.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--fault", "drive_silent motor_3"], "FAULT PLACE@S"),
        (["--fault", "bus_cut main@1", "--plant"], "needs devices"),
        (["--swing", "5"], "give --sling as well"),
        (["--sling", "0.5", "--growth", "1"], "by being lifted"),
        (["--set", "feedforward.modle=static"], "did you mean model"),
        (["--set", "kp"], "NODE.NAME=VALUE"),
        (["--set", "feedforward.model=none"], "feedforward.model is decided by --controller"),
        (
            ["--set", "/**.payload_source=nominal"],
            "payload_source is decided by --controller and --exact-mass",
        ),
        (["--set", "trajectory_publisher.trajectory=move"], "trajectory is decided by --trajectory"),
        (["--trajectory", "hold"], "choose from 'paper-18'"),
        (["--payload", "-3"], "not a mass"),
        (["--duration", "soon"], "not a time"),
        (["--duration", "0"], "not a time in s, 0.1 or more"),
        (["--seed", "-1"], "not a whole number"),
        (["--seed", "4294967296"], "must lie in [0, 4294967295]"),
        (["--controller", "pid"], "(choose from 'pd', 'static'"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(arguments, words, capsys):
    with pytest.raises(SystemExit):
        closed_loop.main(["--config", CONFIG, *arguments])
    assert words in capsys.readouterr().err.replace("\n", " ")


def test_a_fault_after_the_trajectory_is_refused(capsys):
    assert closed_loop.main(["--config", CONFIG, "--duration", "1", "--fault", "bus_cut main@30"]) == 1
    assert "would come too late: the trajectory is over after 1 s" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("motor_controller_3.kp=4", "motor_controller_3 takes no kp here; motor_control_gains does"),
        ("recorder.nice=3", "recorder is not here; the nodes here are motor_control_gains, "),
        (
            "supervisor.robot_config=x",
            "is x, of motor_control_gains config/robot.yaml; it must be the same for all",
        ),
        ("/**.control_rate=500", "control_rate is 500 Hz, but "),
    ],
)
def test_a_parameter_that_nothing_takes_is_refused(given, words, capsys):
    assert closed_loop.main(["--config", CONFIG, "--set", given]) == 1
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("program", [closed_loop, faults])
def test_a_configuration_that_is_not_there(program, capsys, tmp_path):
    with pytest.raises(SystemExit):
        program.main(["--config", str(tmp_path)])
    assert "robot.yaml is not there" in capsys.readouterr().err
    (tmp_path / "robot.yaml").touch()
    with pytest.raises(SystemExit):
        program.main(["--config", str(tmp_path)])
    assert "control.yaml is not there" in capsys.readouterr().err


def test_the_table_of_faults_is_the_same_whatever_is_in_it(tmp_path, capsys):
    numbers = tmp_path / "faults.json"
    assert faults.main(["--config", CONFIG, "emergency_stop", "--json", str(numbers)]) == 0
    row = capsys.readouterr().out.splitlines()[-1]
    assert row.startswith("| emergency_stop | drive fault: emergency stop: input of motor_1 | quick stop | ")
    held, moving = json.loads(numbers.read_text(encoding="utf-8"))
    assert (held["name"], held["moving"], moving["moving"]) == ("emergency_stop", False, True)
    assert held["state"] == moving["state"] == "fault"
    assert held["culprit_right"]
    assert moving["culprit_right"]
    assert 0.0 < held["noticed_ms"] < held["brakes_ms"] < moving["brakes_ms"] < 300.0
    assert abs(held["height_lost_mm"]) <= held["moved_mm"] < 0.1
    assert 0.0 < moving["height_lost_mm"] <= moving["moved_mm"] < 2.0
    assert moving["min_tension_N"] < held["min_tension_N"] < held["max_tension_N"] < moving["max_tension_N"]
    assert faults.main(["--config", CONFIG, "emergency_stop", "drive_reset"]) == 0
    assert row in capsys.readouterr().out.splitlines()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("sabotage", "there is no fault 'sabotage'; `cspr faults --help` lists them"),
        ("drive silent", "there is no fault 'drive silent'; did you mean drive_silent?"),
    ],
)
def test_a_fault_that_is_not_known(name, words, capsys):
    with pytest.raises(SystemExit):
        faults.main([name])
    assert words in capsys.readouterr().err


def test_two_faults_at_once_end_held_too_and_the_draw_is_that_of_the_seed(tmp_path, capsys):
    numbers = tmp_path / "pairs.json"
    pair = ["--config", CONFIG, "drive_reset", "load_cell_silent", "--pairs", "1", "--seed", "5"]
    assert faults.main([*pair, "--json", str(numbers)]) == 0
    held, moving = json.loads(numbers.read_text(encoding="utf-8"))
    assert held["name"] == moving["name"]
    assert {"drive_reset", "load_cell_silent"} < set(held["name"].split())
    assert held["culprit_right"]
    assert moving["culprit_right"]
    first = capsys.readouterr().out
    assert faults.main(pair) == 0
    assert capsys.readouterr().out == first


def test_pairs_are_of_two_faults_that_can_come_together():
    pairs = [*fault_pairs(SCENARIOS, 200, 1)]
    assert len({pair.name for pair in pairs}) > 150
    for pair in pairs:
        first, _, second = pair.name.partition(" + ")
        assert first != second.split()[0]
        assert {"encoder_wrap", "clock_back", "platform_caught"}.isdisjoint({first, second.split()[0]})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--pairs", "0"], "--pairs 0: must be at least 1"),
        (["quick_stop", "--pairs", "2"], "two faults"),
        (["--live", "0"], "--live 0: must be at least 1"),
        (["reader_frozen"], "reader_frozen needs the middleware: give --live as well"),
        (["--live", "quick_stop"], "invalid int value: 'quick_stop'"),
        (["--live", "3", "quick_stop"], "--live is about reader_frozen alone"),
        (["--live", "--pairs", "2"], "--live is about reader_frozen alone"),
    ],
)
def test_options_that_make_no_sense_together(options, words, capsys):
    with pytest.raises(SystemExit):
        faults.main(options)
    assert words in capsys.readouterr().err


def test_injected_faults_bear_one_name():
    names = {scenario.name for scenario in SCENARIOS}
    assert set(FAULTS) - names == {"brake_weak"}
    assert all(name.replace("_", "").isalpha() for name in names)
