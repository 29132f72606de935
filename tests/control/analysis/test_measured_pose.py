"""The platform judged by what measured it: prisms, trackers, other frames, other clocks."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspr_control.analysis.measured_pose import MeasuredPose
from cspr_control.analysis.numbers.platform_error import PlatformMetrics
from cspr_control.analysis.run_analysis import RunAnalysis, analyse_bags
from cspr_control.errors import ControlError
from cspr_control.programs.analyze import main
from cspr_kinematics import Robot

from .conftest import CONFIG, START, Motion

PRISM = (0.2, 0.1, -0.15)  # m, in platform
ASIDE = np.array([0.001, -0.002, -0.003])  # m, of the platform's origin
TURN = Rotation.from_euler("z", 0.4, degrees=True)  # of the platform
SETUP = Rotation.from_euler("zyx", [120.0, 1.0, -2.0], degrees=True)  # of the instrument's frame
PLACE = np.array([3.0, -40.0, 1.5])  # m


@dataclass
class TotalStation:
    """Writes what a total station would have seen of the plain scenario, ten times a second."""

    directory: Path

    def __call__(
        self, *, zero: float = 0.0, late: float = 0.0, until: float = 4.4, factor: float = 1.0, turned: bool = False,
        elsewhere: bool = False, rest: bool = False,
    ) -> str:  # fmt: skip
        time = np.arange(-0.9, until, 0.1)
        pose, _, _ = Motion(Robot.from_yaml(CONFIG / "robot.yaml"), 4.0).at(time * (not rest))
        place = pose.position + ASIDE + TURN.apply(PRISM)
        rotation = Rotation.concatenate([TURN] * len(time))
        if elsewhere:
            place, rotation = SETUP.inv().apply(place - PLACE), SETUP.inv() * rotation
        columns = [place * factor, rotation.as_quat()] if turned else [place * factor]
        rows = np.column_stack(columns)
        path = self.directory / "prism.csv"
        lines = ["time,x,y,z" + (",qx,qy,qz,qw" if turned else "")]
        lines += [
            f"{t + late + zero:.9f}," + ",".join(map(repr, row))
            for t, row in zip(time, rows.tolist(), strict=True)
        ]
        path.write_text("\n".join(lines))
        return str(path)


@pytest.fixture
def station(tmp_path: Path) -> TotalStation:
    return TotalStation(tmp_path)


def judged(bag: Path, *arguments: object, **options: object) -> tuple[PlatformMetrics, RunAnalysis]:
    measured = MeasuredPose(*arguments, **options)  # type: ignore[arg-type]
    (run,) = analyse_bags([bag], configuration_directory=CONFIG, measured=measured)
    assert run.metrics.platform is not None
    return run.metrics.platform, run


def test_a_prism_is_compared_where_it_sits(recorded_bag: Path, station: TotalStation) -> None:
    """The platform stands aside and is turned: the prism is off by both, and its orientation is not known."""
    path = station(zero=START * 1e-9)
    platform, run = judged(recorded_bag, path, None, PRISM)
    assert run.remarks == ()
    assert platform.judged_by == path
    off = 1e3 * (ASIDE + TURN.apply(PRISM) - PRISM)
    assert platform.error is not None
    assert platform.error.mean_mm == pytest.approx(off, abs=0.02)
    assert platform.error.rms_mm == pytest.approx(np.linalg.norm(off), abs=0.02)
    assert np.isnan(platform.error.rotation_rms_deg)
    # the estimate, 50 a second, is linear in between
    assert platform.estimate is not None
    assert platform.estimate.mean_mm == pytest.approx(-off, abs=0.05)
    wrong, _ = judged(recorded_bag, path)
    assert wrong.error is not None
    assert wrong.error.mean_mm == pytest.approx(1e3 * (ASIDE + TURN.apply(PRISM)), abs=0.02)


def test_with_the_orientation_the_prism_tells_where_the_origin_is(
    recorded_bag: Path, station: TotalStation
) -> None:
    platform, _ = judged(recorded_bag, station(zero=START * 1e-9, turned=True), None, PRISM)
    assert platform.error is not None
    assert platform.error.mean_mm == pytest.approx(1e3 * ASIDE, abs=0.02)
    assert platform.error.rotation_rms_deg == pytest.approx(0.4, abs=1e-3)
    assert not platform.point.any()


def test_times_of_its_own_need_to_be_placed(recorded_bag: Path, station: TotalStation) -> None:
    path = station(late=7.25)
    with pytest.raises(
        ControlError, match=r"prism\.csv: time = 6\.35 is no ROS time .* --measured-offset .* UTC"
    ):
        judged(recorded_bag, path, None, PRISM)
    platform, _ = judged(recorded_bag, path, -7.25, PRISM)
    assert platform.error is not None
    assert platform.error.rms_mm == pytest.approx(
        1e3 * np.linalg.norm(ASIDE + TURN.apply(PRISM) - PRISM), abs=0.02
    )


def test_a_clock_that_is_off_is_noticed_and_left_as_it_is(recorded_bag: Path, station: TotalStation) -> None:
    path = station(zero=START * 1e-9, late=0.3)
    platform, run = judged(recorded_bag, path, None, PRISM)
    (remark,) = run.remarks
    assert "0.30 s earlier" in remark
    assert remark.endswith("try --measured-offset -0.3")
    assert platform.error is not None
    assert platform.error.rms_mm > 30.0
    _, run = judged(recorded_bag, path, -0.3, PRISM)
    assert run.remarks == ()


def test_another_time_is_refused(recorded_bag: Path, station: TotalStation) -> None:
    path = station(zero=START * 1e-9 + 3600.0)
    with pytest.raises(
        ControlError, match=r"no pose of the time of .*: its poses are of 20.* to 20.*UTC; what --meas"
    ):
        judged(recorded_bag, path, None, PRISM)


def test_what_is_not_covered_is_said(recorded_bag: Path, station: TotalStation) -> None:
    _, run = judged(recorded_bag, station(zero=START * 1e-9, until=2.55), None, PRISM)
    (remark,) = run.remarks
    assert "covers 0.0 to 2.5 s of the trajectory from 0.0 to 4.0 s" in remark


def test_another_frame_is_aligned_on_request_alone(recorded_bag: Path, station: TotalStation) -> None:
    path = station(zero=START * 1e-9, elsewhere=True, turned=True)
    with pytest.raises(ControlError, match=r"are 39\.\d+ m away from the reference.*--align"):
        judged(recorded_bag, path, None, PRISM)
    platform, run = judged(recorded_bag, path, None, PRISM, True)
    (remark,) = run.remarks
    assert "was aligned with the reference, which hides what is wrong in the same way everywhere" in remark
    found = platform.alignment
    assert found is not None
    # the platform neither turns nor errs differently on its way: all of it becomes part of the alignment
    assert found.residual_rms_mm < 0.05
    apart = found.rotation * SETUP.inv()
    assert np.degrees(apart.magnitude()) < 0.5
    assert platform.error is not None
    assert (
        platform.error.rms_mm < 2.0
    )  # what is left: the prism's lever with the turn that the path does not show
    stored = json.loads(json.dumps(run.metrics.as_mapping(), allow_nan=False))["platform"]["alignment"]
    assert stored["translation"] == pytest.approx(found.translation.tolist())


def test_an_alignment_that_does_not_fit_is_named(recorded_bag: Path, station: TotalStation) -> None:
    path = station(zero=START * 1e-9, late=2.0)
    _, run = judged(recorded_bag, path, None, PRISM, True)
    (remark,) = [each for each in run.remarks if "no platform's error" in each]
    assert "--measured-offset" in remark


@pytest.mark.parametrize("aligned", [False, True])
def test_millimetres_are_refused_by_name(recorded_bag: Path, station: TotalStation, aligned: bool) -> None:
    path = station(zero=START * 1e-9, factor=1000.0)
    with pytest.raises(ControlError, match=r"look like millimetres; divide them by 1000"):
        judged(recorded_bag, path, None, PRISM, aligned)
    with pytest.raises(ControlError, match="millimetres or in another frame"):
        judged(recorded_bag, station(zero=START * 1e-9, factor=1000.0, rest=True), None, PRISM)


def test_a_topic_of_the_bag(record: Callable[..., Path]) -> None:
    bag = record(tracker="base", duration=2.0)
    platform, run = judged(bag, "/tracker/pose")
    assert run.remarks == ()
    assert platform.error is not None
    assert platform.error.mean_mm == pytest.approx([5.0, 0.0, 0.0], abs=1e-6)
    with pytest.raises(
        ControlError, match=r"has no topic /prism; of type .*PoseStamped it has /platform_pose, /tr"
    ):
        judged(bag, "/prism")
    with pytest.raises(ControlError, match=r"has sensor_msgs/msg/JointState on /setpoint"):
        judged(bag, "/setpoint")


def test_the_frame_of_a_topic_is_told(record: Callable[..., Path]) -> None:
    bag = record(tracker="hall", duration=2.0)
    _, run = judged(bag, "/tracker/pose")
    assert "/tracker/pose is in the frame 'hall'" in run.remarks[0]
    _, run = judged(bag, "/tracker/pose", aligned=True)
    assert len(run.remarks) == 1
    assert "aligned" in run.remarks[0]


def test_it_takes_the_place_of_a_true_pose_that_is_missing(record: Callable[..., Path]) -> None:
    bag = record(tracker="base", omitted=("/true_pose",))
    _, run = judged(bag, "/tracker/pose")
    assert run.remarks == ()


def test_from_the_command_line(
    recorded_bag: Path, station: TotalStation, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quiet = ["--no-figures", "--config", str(CONFIG), "--output", str(tmp_path / "out")]
    path = station(late=1.0)
    chosen = ["--measured-pose", path, "--measured-offset=-1", "--measured-point", "0.2,0.1,-0.15"]
    assert main([str(recorded_bag), *chosen, *quiet]) == 0
    assert path in capsys.readouterr().out
    (run,) = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))["runs"]
    assert run["platform"]["point"] == [0.2, 0.1, -0.15]
    assert run["platform"]["error"]["rotation_rms_deg"] is None
    for wrong, words in (
        (["--measured-point", "1,2"], "not a point X,Y,Z in m"),
        (["--align"], "--align says something about --measured-pose, which is missing"),
        ([str(recorded_bag), *chosen], "is of one run: analyse 2 bags one by one"),
    ):
        with pytest.raises(SystemExit):
            main([str(recorded_bag), *wrong, *quiet])
        assert words in capsys.readouterr().err
