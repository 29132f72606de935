"""One winch that is wound alone: how it turns, when it ends, and when it is refused."""

from dataclasses import replace

import pytest
from tests.drivers.drives.test_cycle import AT_REST, ENABLED, READY, SWITCHED_ON, Robot

from cspr_drivers.config.can_file import WindingLimits
from cspr_drivers.drives.winding import DURATION, Direction, Winding, winding_refusal
from cspr_msgs_py.vocabulary import DriverState

LIMITS = WindingLimits(speed=20.0, torque=0.5, tension=200.0)
INERTIA, FRICTION = 1.5e-3, 0.05  # kg m^2, N m
RATIO = 0.05 / 30.0  # m/rad
PERIOD = 0.004


class Winch:
    """A shaft of its own differential equation, on a cable that pulls with a tension as a function of the angle."""

    def __init__(self, direction, tension):
        self.tension = tension
        self.angle = self.speed = self.time = 0.0
        self.winding = Winding("motor_3", "cable_3", direction, LIMITS, 10.0, tension(0.0))
        self.torques = []

    def run(self, cycles=200, known=True):
        for _ in range(cycles):
            tension = self.tension(self.angle)
            torque = self.winding.torque(
                self.time, self.angle, self.speed, tension if known is True or self.time < known else None
            )
            if self.winding.end:
                return self
            self.torques.append(torque)
            for _ in range(40):
                step = PERIOD / 40
                drag = -FRICTION if self.speed > 0 else FRICTION
                self.speed += step * (torque + RATIO * self.tension(self.angle) + drag) / INERTIA
                self.angle += step * self.speed
            self.time += PERIOD
        raise AssertionError("it does not end")


def slack_by(radians):
    return lambda angle: max(0.0, -(angle + radians)) * RATIO * 3e5


def test_a_slack_cable_is_wound_in_slowly_for_its_time():
    winch = Winch(Direction.IN, slack_by(30.0)).run()
    assert winch.winding.end == "0.3 s are over"
    assert winch.time == pytest.approx(DURATION, abs=PERIOD)
    assert -LIMITS.speed * DURATION <= winch.winding.moved == winch.angle < -0.6 * LIMITS.speed * DURATION
    assert max(map(abs, winch.torques)) <= LIMITS.torque


def test_it_ends_as_soon_as_the_cable_is_taut():
    winch = Winch(Direction.IN, slack_by(2.0)).run()
    assert winch.time < DURATION
    assert winch.winding.end.startswith("cable_3 is taut and carries ")
    assert min(winch.torques) >= -LIMITS.torque


def test_a_cable_that_does_not_give_is_pulled_with_little_torque():
    winch = Winch(Direction.IN, lambda angle: 199.0).run()
    assert min(winch.torques) >= -LIMITS.torque
    assert winch.winding.end == "0.3 s are over"


def test_a_tight_cable_is_paid_out_down_to_the_limit_and_held_meanwhile():
    winch = Winch(Direction.OUT, slack_by(-5.0)).run()  # 2500 N
    assert winch.winding.end.endswith("N and is no longer tight")
    assert 0.0 < winch.angle < 6.0
    assert max(winch.torques) <= LIMITS.torque


def test_a_heavy_cable_is_let_down_at_the_speed_and_does_not_run_away():
    winch = Winch(Direction.OUT, lambda angle: 800.0).run()
    assert winch.winding.end == "0.3 s are over"
    assert winch.speed == pytest.approx(LIMITS.speed, abs=6.0)
    assert winch.angle < 3.0 * LIMITS.speed * DURATION


def test_a_motor_that_turns_too_fast_is_stopped():
    winding = Winding("motor_3", "cable_3", Direction.IN, LIMITS, 10.0, 0.0)
    winding.torque(0.0, 0.0, 0.0, 0.0)
    winding.torque(0.004, 0.4, 101.0, 0.0)
    assert winding.end == "it turned at 101 rad/s"


def test_without_the_tension_it_ends():
    winch = Winch(Direction.IN, slack_by(30.0)).run(known=0.1)
    assert winch.winding.end == "the tension of cable_3 is no longer known"
    assert winch.time < 0.11


SLACK_3 = [300.0, 300.0, 3.0, 300.0, 300.0, 300.0, 300.0, 300.0]


@pytest.mark.parametrize(
    ("index", "direction", "tensions", "words"),
    [
        (2, Direction.IN, SLACK_3, None),
        (0, Direction.IN, SLACK_3, "cable_1 is taut: it carries 300 N, and cables are wound in up to 200 N"),
        (0, Direction.OUT, SLACK_3, None),
        (2, Direction.OUT, SLACK_3, None),
        (0, Direction.OUT, [150.0, *SLACK_3[1:]], "call /can_drives/motor_3/wind_in first"),
        (2, Direction.IN, [], "the tension of cable_3 is not known"),
        (2, Direction.IN, [float("nan")] * 8, "the tension of cable_3 is not known"),
    ],
)
def test_refusals_say_why_and_what_to_do(index, direction, tensions, words):
    refusal = winding_refusal(index, direction, tensions, LIMITS)
    assert refusal is None if words is None else words in refusal


# in the cycle of the drives


@pytest.fixture
def robot(config):
    robot = Robot(replace(config, winding=LIMITS))
    robot.turn(1.0)
    robot.turn(1.0)
    robot.cycle.tensions(robot.now, SLACK_3)
    return robot


def turn(robot, torque=1.0):
    """Run one cycle in which the cells answer; return the frames of motor_3."""
    robot.cycle.tensions(robot.now, SLACK_3)
    return [data for cob_id, data in robot.turn(torque)[1] if cob_id == 0x203]


def open_brake(robot):
    """Let motor_3 follow its control words until its brake is open; return what it was sent."""
    sent = []
    for status in (READY, SWITCHED_ON, ENABLED):
        sent += turn(robot)
        robot.status[2] = status
    return sent + turn(robot)


def test_one_drive_is_released_with_a_torque_of_the_driver(robot):
    assert robot.cycle.wind(robot.now, 2, Direction.IN) is None
    assert robot.cycle.group.state is DriverState.WINDING
    assert robot.cycle.group.cause == "motor_3 is wound in"
    assert list(dict.fromkeys(open_brake(robot))) == ["06 00 00 00", "07 00 00 00", "0f 00 00 00"]
    frames = turn(robot)
    assert frames == ["0f 00 9c ff"]  # -0.5 N m of 5 N m; the controller's 1 N m goes nowhere
    assert robot.cycle.group.members == ("motor_3",)


def test_when_it_is_over_the_brake_closes_and_the_drives_are_disabled(robot):
    robot.cycle.wind(robot.now, 2, Direction.IN)
    open_brake(robot)
    while not any(frame.startswith("07 00") for frame in turn(robot)):
        assert robot.cycle.group.state is DriverState.WINDING
    robot.status[2] = SWITCHED_ON
    turn(robot)
    assert robot.cycle.group.state is DriverState.WINDING
    robot.status[2] = AT_REST
    turn(robot)
    turn(robot)
    assert robot.cycle.group.state is DriverState.DISABLED
    assert robot.cycle.group.cause == ""
    assert robot.cycle.last_winding == "motor_3 is wound in: by +0.00 rad, 0.3 s are over"


def test_one_winch_at_a_time_and_nothing_else_meanwhile(robot):
    robot.cycle.wind(robot.now, 2, Direction.IN)
    again = robot.cycle.wind(robot.now, 3, Direction.IN)
    assert again == "motor_3 is wound in: one winch at a time, call again when that is over"
    assert robot.cycle.enable(robot.now) == "the drives are winding"
    assert robot.cycle.home_refusal(robot.now) == "the drives are winding: disable them first"


def test_it_is_refused_unless_the_drives_are_disabled(robot):
    robot.enable()
    assert robot.cycle.wind(robot.now, 2, Direction.IN) == "the drives are enabled: disable them first"
    robot.cycle.quick_stop(robot.now, "a test")
    refusal = robot.cycle.wind(robot.now, 2, Direction.IN)
    assert refusal == "a fault is latched: a test; reset it first"


def test_it_needs_no_supervisor_and_is_ended_by_disable(robot):
    robot.cycle.wind(robot.now, 2, Direction.IN)
    open_brake(robot)
    robot.cycle.disable(robot.now)
    robot.status[2] = AT_REST
    turn(robot)
    turn(robot)
    assert robot.cycle.group.state is DriverState.DISABLED
    assert robot.cycle.last_winding.endswith("it was stopped")


def test_a_fault_of_any_drive_ends_it(robot):
    robot.cycle.wind(robot.now, 2, Direction.IN)
    open_brake(robot)
    robot.status[5] = 0x18
    turn(robot)
    turn(robot)
    assert robot.cycle.group.state is DriverState.FAULT
    assert robot.cycle.group.cause.startswith("motor_6 is in fault")
