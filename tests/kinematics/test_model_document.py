"""The numbers of docs/model.md, computed again. `python test_model_document.py` prints its tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from cspr_kinematics import (
    Acceleration,
    CableProperties,
    Payload,
    Pose,
    Pulleys,
    Robot,
    Task,
    Twist,
    assess_task,
    available_wrenches,
    distribute_tensions,
    forward_kinematics,
    holding_tensions,
    inverse_kinematics,
    pose_covariance,
    required_wrench,
    rope_wrench,
    solve_forward_kinematics,
    static_wrench,
)

ROOT = Path(__file__).parents[2]
DOCUMENT = ROOT / "docs" / "model.md"
PAYLOAD = Payload(200.0, np.zeros(3))
TILT = np.deg2rad(5.0)

Table = list[str]


def row(*cells: object) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def numbers(values: Iterable[float], digits: int) -> list[str]:
    # adding zero makes -0.00 one with 0.00
    return [f"{round(float(v), digits) + 0.0:.{digits}f}" for v in values]


def trajectory(robot: Robot, speed: float, tilt: float) -> tuple[Pose, Twist, Acceleration]:
    """The paper's eq. 18 (speed 1) or 19 (speed 2), sampled every 0.1 s, about the trajectories' centre."""
    t = np.arange(0.0, 20.0 / speed + 0.05, 0.1) * speed  # eq. 19 is eq. 18 run through at twice the speed
    first = t <= 10.0 + 1e-9
    late = t - 10.0
    position = np.stack(
        (
            np.where(first, 20.0 * (5.0 - t) ** 2, 500.0 - 10.0 * late),
            np.where(first, 60.0 * (5.0 - t), -300.0 + 20.0 * late),
            np.where(first, 20.0 * t, 200.0 - 10.0 * late),
        ),
        axis=-1,
    )
    velocity = np.where(
        first[:, None],
        np.stack((-40.0 * (5.0 - t), np.full_like(t, -60.0), np.full_like(t, 20.0)), axis=-1),
        [-10.0, 20.0, -10.0],
    )
    acceleration = np.where(first[:, None], [40.0, 0.0, 0.0], 0.0)
    zero = np.zeros_like(position)
    return (
        Pose.from_euler(robot.trajectory_center + 1e-3 * position, 0.0, tilt, tilt),
        Twist(1e-3 * speed * velocity, zero),
        Acceleration(1e-3 * speed**2 * acceleration, zero),
    )


def deviations(robot: Robot, speed: float, tilt: float, payload: Payload) -> tuple[np.ndarray, np.ndarray]:
    """Least-norm tensions (n, m) of the dynamic model on a trajectory, and what they exceed the static by."""
    pose, twist, acceleration = trajectory(robot, speed, tilt)
    A = inverse_kinematics(robot, pose).wrench_matrix
    dynamic, static = (
        distribute_tensions(A, w, robot.tension_min, robot.tension_max).tensions
        for w in (
            required_wrench(robot, pose, twist, acceleration, payload),
            static_wrench(robot, pose, payload),
        )
    )
    return dynamic, dynamic - static


def home_table(robot: Robot, _: Robot) -> Table:
    cables = inverse_kinematics(robot, robot.home)
    tensions = distribute_tensions(
        cables.wrench_matrix, static_wrench(robot, robot.home, PAYLOAD), robot.tension_min, robot.tension_max
    ).tensions
    torques = robot.winch.motor_torque(tensions)
    moments = cables.wrench_matrix[3:].T
    rows = [
        row(
            "cable",
            "length, m",
            "u_x",
            "u_y",
            "u_z",
            "(r x u)_x",
            "(r x u)_y",
            "(r x u)_z",
            "t, N",
            "tau, N m",
        )
    ]
    for k in range(robot.number_of_cables):
        rows.append(
            row(
                k + 1,
                *numbers([cables.lengths[k]], 4),
                *numbers(cables.directions[k], 4),
                *numbers(moments[k], 4),
                *numbers([tensions[k]], 2),
                *numbers([torques[k]], 4),
            )
        )
    return rows


def home_facts(robot: Robot, _: Robot) -> Table:
    A = inverse_kinematics(robot, robot.home).wrench_matrix
    w = static_wrench(robot, robot.home, PAYLOAD)
    return [
        row("weight of 353 kg", f"{w[2]:.2f} N"),
        row("condition number of A", f"{np.linalg.cond(A):.4f}"),
        row("largest singular value of A", f"{np.linalg.svd(A)[1][0]:.4f}"),
        row("smallest singular value of A", f"{np.linalg.svd(A)[1][-1]:.4f}"),
    ]


def trajectory_facts(robot: Robot, _: Robot) -> Table:
    rows = [row("trajectory", "least tension, N", "largest tension, N", "largest condition number of A")]
    for name, speed, tilt in (("(18)", 1.0, 0.0), ("(19), 5 degrees about x and y", 2.0, TILT)):
        dynamic, _deviation = deviations(robot, speed, tilt, PAYLOAD)
        A = inverse_kinematics(robot, trajectory(robot, speed, tilt)[0]).wrench_matrix
        rows.append(
            row(name, *numbers([dynamic.min(), dynamic.max()], 1), *numbers([np.linalg.cond(A).max()], 2))
        )
    return rows


def deviation_table(robot: Robot, _: Robot) -> Table:
    rows = [row("cable", "(18) max", "(18) median", "(18) RMS", "(19) max", "(19) median", "(19) RMS")]
    columns = []
    for speed, tilt in ((1.0, 0.0), (2.0, TILT)):
        _pose, _twist, acceleration = trajectory(robot, speed, tilt)
        size = np.abs(deviations(robot, speed, tilt, PAYLOAD)[1])[acceleration.linear.any(axis=-1)]
        columns += [size.max(axis=0), np.median(size, axis=0), np.sqrt((size**2).mean(axis=0))]
    for k in range(robot.number_of_cables):
        rows.append(row(k + 1, *numbers((column[k] for column in columns), 2)))
    return rows


def payload_change_table(robot: Robot, _: Robot) -> Table:
    rows = [row("cable 1 along (19)", "max, N", "median, N", "RMS, N")]
    t = np.arange(0.0, 10.05, 0.1)
    moving = t <= 5.0 + 1e-9
    for name, chosen, payload in (
        ("0 to 3 s, 353 kg", t < 3.0 - 1e-9, PAYLOAD),
        ("3 to 5 s, 453 kg", moving & (t >= 3.0 - 1e-9), Payload(300.0, np.zeros(3))),
    ):
        size = np.abs(deviations(robot, 2.0, TILT, payload)[1])[chosen, 0]
        rows.append(row(name, *numbers([size.max(), np.median(size), np.sqrt((size**2).mean())], 2)))
    return rows


def pulley_table(robot: Robot, with_pulleys: Robot) -> Table:
    fixed = inverse_kinematics(robot, robot.home)
    over = inverse_kinematics(with_pulleys, robot.home)
    wraps = (over.lengths - over.free_lengths) / with_pulleys.pulleys.radius
    rows = [row("cable", "fixed, m", "R = 50 mm, m", "free part, m", "wrap, degrees")]
    for k in range(robot.number_of_cables):
        lengths = numbers([fixed.lengths[k], over.lengths[k], over.free_lengths[k]], 4)
        rows.append(row(k + 1, *lengths, *numbers([np.rad2deg(wraps[k])], 2)))
    return rows


def pulley_error_table(robot: Robot, with_pulleys: Robot) -> Table:
    """What a controller gets wrong that knows nothing of the pulleys: zeroed at home, it asks for a pose."""
    rows = [row("desired (x, y, z), m", "error of the platform's place, mm", "of its rotation, degrees")]
    for place in ([0.5, 0.0, 1.0], [0.0, 0.4, 1.0], [0.0, 0.0, 1.6], [1.0, 0.5, 1.5]):
        asked = Pose(place, np.eye(3))
        paid_out = inverse_kinematics(robot, asked).lengths - robot.winch.home_lengths
        reached = forward_kinematics(
            with_pulleys, with_pulleys.winch.home_lengths + paid_out, asked, length_deviation=0.01
        )
        off = 1e3 * np.linalg.norm(reached.position - asked.position)
        turned = np.rad2deg(np.arccos(np.clip(0.5 * (np.trace(reached.rotation) - 1.0), -1.0, 1.0)))
        rows.append(row(", ".join(f"{x:g}" for x in place), *numbers([off], 2), *numbers([turned], 3)))
    return rows


def accuracy_table(robot: Robot, _: Robot) -> Table:
    deviation = np.sqrt(np.diag(pose_covariance(robot, robot.home, 1e-3)))
    return [
        row("x, mm", "y, mm", "z, mm", "about x, degrees", "about y, degrees", "about z, degrees"),
        row(*numbers(1e3 * deviation[:3], 3), *numbers(np.rad2deg(deviation[3:]), 3)),
    ]


def slack_table(robot: Robot, _: Robot) -> Table:
    rows = [
        row(
            "slack of cable 1 at home, m",
            "largest length error left, mm",
            "error of the platform's place, mm",
        )
    ]
    for slack in (0.02, 0.05, 0.1):
        lengths = robot.winch.home_lengths + slack * np.eye(8)[0]
        solution = solve_forward_kinematics(robot, lengths, robot.home, length_deviation=0.05)
        assert solution.converged
        off = np.linalg.norm(solution.pose.position - robot.home.position)
        rows.append(row(slack, *numbers([1e3 * np.abs(solution.residual).max(), 1e3 * off], 1)))
    return rows


def rope_table(robot: Robot, _: Robot) -> Table:
    rows = [row("cable", "t_home, N", "l_home - f_home, mm", "t with 200 kg, N", "its stretch, mm")]
    loaded = holding_tensions(robot, robot.home, PAYLOAD).tensions
    lengths = robot.winch.home_lengths
    for i in range(8):
        pulled = 1e3 * (lengths - robot.cables.free_length(lengths, loaded))[i]
        stretched = 1e3 * (lengths - robot.home_free_lengths)[i]
        values = (robot.home_tensions[i], stretched, loaded[i], pulled)
        rows.append(row(i + 1, *(numbers([v], d)[0] for v, d in zip(values, (1, 3, 1, 3), strict=True))))
    return rows


def bounded_table(robot: Robot, _: Robot) -> Table:
    rows = [row("payload, kg", "least, N", "largest, N", "feasible", "residual, N")]
    A = inverse_kinematics(robot, robot.home).wrench_matrix
    for mass in (0.0, 200.0, 1200.0, 1400.0):
        w = static_wrench(robot, robot.home, Payload(mass, np.zeros(3)))
        result = distribute_tensions(A, w, robot.tension_min, robot.tension_max, "closest")
        spread = numbers([result.tensions.min(), result.tensions.max()], 1)
        rows.append(
            row(f"{mass:g}", *spread, "yes" if result.feasible else "no", f"{float(result.residual):.1f}")
        )
    return rows


def method_table(robot: Robot, _: Robot) -> Table:
    A, w = inverse_kinematics(robot, robot.home).wrench_matrix, static_wrench(robot, robot.home, PAYLOAD)
    rows = [row("method", "least, N", "largest, N", "distance to the limits, N")]
    for method in ("minimum_norm", "closest", "centroid", "analytic_center"):
        result = distribute_tensions(A, w, robot.tension_min, robot.tension_max, method)
        values = [result.tensions.min(), result.tensions.max(), float(result.margin)]
        rows.append(row(f"`{method}`", *numbers(values, 1)))
    return rows


def largest_acceleration(robot: Robot, direction: np.ndarray) -> float:
    """From rest at home with the payload, as far as the faces of the wrenches within reach are."""
    home = robot.home
    A = inverse_kinematics(robot, home).wrench_matrix
    reach = available_wrenches(A, robot.tension_min, robot.tension_max)
    rest = static_wrench(robot, home, PAYLOAD)
    acceleration = Acceleration(direction[:3], direction[3:])
    slope = reach.normals @ (required_wrench(robot, home, Twist.zero(), acceleration, PAYLOAD) - rest)
    outwards = slope > 0.0
    return float(((reach.offsets - reach.normals @ rest)[outwards] / slope[outwards]).min())


def reach_table(robot: Robot, _: Robot) -> Table:
    robot = dataclasses.replace(robot, cables=CableProperties())  # the paper's, as in all of section 7
    home = robot.home
    empty, loaded = (assess_task(robot, home, Task(mass, mass)) for mass in (0.0, PAYLOAD.mass))
    upwards, turning = (largest_acceleration(robot, np.eye(6)[axis]) for axis in (2, 5))
    return [
        row("quantity at home, at rest", "value"),
        row("margin of the empty platform", f"{float(empty.margin):.1f} N"),
        row("margin with 200 kg", f"{float(loaded.margin):.1f} N"),
        row("largest payload", f"{float(empty.payload_max):.1f} kg"),
        row(
            "largest acceleration upwards with 200 kg",
            f"{upwards:.2f} m/s^2",
        ),
        row(
            "largest angular acceleration about z with 200 kg",
            f"{turning:.2f} rad/s^2",
        ),
    ]


TABLES = (
    home_table,
    home_facts,
    trajectory_facts,
    deviation_table,
    payload_change_table,
    bounded_table,
    method_table,
    reach_table,
    pulley_table,
    pulley_error_table,
    accuracy_table,
    slack_table,
    rope_table,
)


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_the_document_has_these_numbers(table: object, robot: Robot, robot_with_pulleys: Robot) -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    for line in table(robot, robot_with_pulleys):  # type: ignore[operator]
        assert line in text


def test_claims_of_the_text(robot: Robot, robot_with_pulleys: Robot) -> None:
    level, deviation = deviations(robot, 1.0, 0.0, PAYLOAD)
    assert np.abs(deviation[trajectory(robot, 1.0, 0.0)[2].linear[:, 0] == 0.0]).max() < 1e-9
    tilted, faster = deviations(robot, 2.0, TILT, PAYLOAD)
    assert (level > robot.tension_min).all()
    assert (tilted > robot.tension_min).all()
    # four times the acceleration, about four times the deviation
    assert 3.0 < np.abs(faster).max() / np.abs(deviation).max() < 5.0
    cables = inverse_kinematics(robot, robot.home)
    w = static_wrench(robot, robot.home, PAYLOAD)
    tensions = np.linalg.pinv(cables.wrench_matrix) @ w
    assert cables.directions[:, 2] @ tensions == pytest.approx(353.0 * 9.81)
    assert cables.lengths[0] == pytest.approx(np.linalg.norm([-2.5325, -1.3825, 2.11]))
    assert robot.winch.transmission_ratio == pytest.approx(1.667e-3, rel=1e-3)
    assert 8.0 * robot.motor.inertia / robot.winch.transmission_ratio**2 == pytest.approx(4320.0)
    assert robot_with_pulleys.pulleys.radius == Pulleys(0.05).radius


def test_claims_about_ropes(robot: Robot) -> None:
    loaded = holding_tensions(robot, robot.home, PAYLOAD).tensions
    sunk = forward_kinematics(robot, robot.cable_lengths(np.zeros(8), loaded), robot.home)
    assert 1e3 * (robot.home.position - sunk.position)[2] == pytest.approx(3.1, abs=0.05)
    axes = (
        np.linspace(low, high, 9) for low, high in zip(robot.workspace_min, robot.workspace_max, strict=True)
    )
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    cables = inverse_kinematics(robot, Pose.from_euler(places, 0.0, 0.0, 0.0))
    too_heavy = rope_wrench(robot, cables)[:, 2] / 9.81
    assert [round(float(x), 1) for x in (too_heavy.min(), too_heavy.max())] == [2.1, 3.8]
    weight = 0.16 * 9.81 * cables.free_lengths
    sag = weight * (cables.directions[..., :2] ** 2).sum(axis=-1) / (8.0 * 300.0) * cables.free_lengths
    assert (8.0 / 3.0 * sag**2 / cables.free_lengths).max() < 1e-4  # of a flat parabola


def test_straight_anchors_go_slack(robot: Robot) -> None:
    """The document's reason for crossed anchors: without the crossing least-norm tensions go negative."""
    corners = np.sign(robot.exit_points[:, :2]) * robot.platform_size[:2] / 2.0
    anchors = np.column_stack((corners, robot.anchor_points[:, 2]))
    straight = robot.with_geometry(anchor_points=anchors)
    assert (
        min(
            deviations(straight, 1.0, 0.0, PAYLOAD)[0].min(),
            deviations(straight, 2.0, TILT, PAYLOAD)[0].min(),
        )
        < 0.0
    )


if __name__ == "__main__":
    robots = [Robot.from_yaml(ROOT / "config" / name) for name in ("robot.yaml", "robot_pulleys.yaml")]
    for table in TABLES:
        print(f"\n{table.__name__}")
        lines = table(*robots)
        print("\n".join(lines))
