"""The supervisor as a component: what makes it check at once."""

import numpy as np
import pytest

from cspr_control.components.component import Call, Publication, Remark
from cspr_control.components.supervision import SERVICES, SupervisionComponent, watched_topics
from cspr_control.parameters.settings import supervision_limits
from cspr_control.supervision.supervisor import Action
from cspr_kinematics import Payload, Robot, holding_tensions
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    DIAGNOSTICS,
    DRIVE_STATES,
    MOTOR_STATES,
    PAYLOAD,
    PLATFORM_POSE,
    REFERENCE,
    ROBOT_STATE,
    SETPOINT,
    SUPERVISOR_ALIVE,
    motor_command,
)
from cspr_msgs_py.vocabulary import DriverState, HealthKey, Level, RobotState
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import InertiaSample, PoseSample, SignOfLife, Status, StatusArray

CYCLE = 0.004  # s
NONE = np.empty(0)


def component(robot, doubled=lambda: ()):
    values = defaults("supervisor") | {"allowed_drop": 1.0, "tension_difference": 100.0}  # for any robot
    return SupervisionComponent(robot, supervision_limits(robot, values), doubled)


class Home:
    """A supervisor of a robot at its home pose, all of whose inputs arrive each cycle."""

    def __init__(self, robot):
        self.doubled = []
        self.supervision = component(robot, lambda: self.doubled)
        self.tensions = holding_tensions(robot, robot.home, Payload.none()).tensions
        self.sound = robot.motor_angles(robot.winch.home_lengths, self.tensions)
        self.torques = robot.winch.motor_torque(self.tensions)
        self.position = robot.home.position
        self.encoder_errors = np.zeros(8)
        self.drives = DriverState.DISABLED
        self.time = 5.0
        self.noise = np.random.default_rng(1)

    def cycle(self):
        """Let a cycle pass; return what comes of it, by its inputs."""
        self.time += CYCLE
        stamp, still = round(self.time * 1e9), np.zeros(8)
        angles = self.sound + self.encoder_errors
        states = StatusArray(stamp, (Status("can_drives", Level.OK, self.drives.value, {}),))
        said = {}
        for topic, sample in (
            (DRIVE_STATES, states),
            (REFERENCE, SignOfLife(stamp)),  # that it came, and when, is all that counts
            (SETPOINT, JointStateSample(stamp, self.sound, still, still)),
            (PLATFORM_POSE, PoseSample(stamp, self.position, np.array([0.0, 0.0, 0.0, 1.0]))),
            (MOTOR_STATES, JointStateSample(stamp, angles, still, self.torques)),
            (CABLE_TENSIONS, JointStateSample(stamp, NONE, NONE, self.tensions + self.noise.normal(size=8))),
        ):
            said[topic] = self.supervision.handler(topic)(self.time, sample)
        return said

    def enabled(self):
        for _ in range(30):
            self.cycle()
        decision, _ = self.supervision.services()["/supervisor/enable"](self.time)
        assert decision.accepted, decision.message
        self.drives = DriverState.ENABLED
        self.cycle()
        assert self.supervision.supervisor.state is RobotState.ENABLED
        return self


def test_lengths_that_no_longer_fit_stop_the_drives_within_their_own_cycle(robot):
    home = Home(robot).enabled()
    home.drives = DriverState.ENABLED
    home.encoder_errors[2] = 1.5
    quick_stop = Call("supervisor", SERVICES[Action.QUICK_STOP])
    for _ in range(2):
        assert quick_stop not in [each for outputs in home.cycle().values() for each in outputs]
    assert quick_stop in home.cycle()[CABLE_TENSIONS]
    assert "cable lengths fit no pose: misfit" in str(home.supervision.supervisor.fault)
    assert "motor_3" in str(home.supervision.supervisor.fault)


def test_a_misfit_at_rest_is_on_diagnostics_and_refuses_to_enable(robot):
    home = Home(robot)
    home.encoder_errors[2] = 1.5
    for _ in range(30):
        home.cycle()
    assert 3e-4 < float(home.supervision.status(home.time).values["length_misfit"]) < 1e-3
    decision, _ = home.supervision.services()["/supervisor/enable"](home.time)
    assert not decision.accepted
    assert "cable lengths fit no pose" in decision.message


@pytest.mark.parametrize("cables", ["six_cables.yaml", "ten_cables.yaml"])
def test_the_start_names_the_check_that_is_absent(cables, robot_file):
    robot = Robot.from_yaml(robot_file.parents[1] / "tests" / "kinematics" / "robot" / cables)
    remarks = [output for output in component(robot).begin() if isinstance(output, Remark)]
    assert [remark.level for remark in remarks] == [Level.WARN] * (cables == "six_cables.yaml")
    assert all("absent check" in remark.text for remark in remarks)
    assert ("absent_check" in component(robot).status(0.0).values) is bool(remarks)


def test_a_failure_is_dealt_with_at_once_whatever_else_the_same_message_says(robot):
    home = Home(robot)
    home.enabled()
    failed = Status("feedforward", Level.ERROR, "failed", {HealthKey.FAILURE: "ValueError: no"})
    sound = Status("pose_estimator", Level.OK, "ready", {})
    outputs = home.supervision.handler(DIAGNOSTICS)(home.time, StatusArray(0, (failed, sound)))
    assert SERVICES[Action.QUICK_STOP] in [each.service for each in outputs if isinstance(each, Call)]


@pytest.mark.parametrize("topic", [MOTOR_STATES, REFERENCE, SETPOINT, CABLE_TENSIONS, PLATFORM_POSE])
@pytest.mark.parametrize("back", [0, 5_000_000_000])
def test_a_second_publisher_is_named_and_stops_the_robot_at_once(robot, topic, back):
    bench = Home(robot).enabled()
    stamp, still = round(bench.time * 1e9) - back, np.zeros(8)
    sample = {
        REFERENCE: SignOfLife(stamp),
        PLATFORM_POSE: PoseSample(stamp, bench.position, np.array([0.0, 0.0, 0.0, 1.0])),
        CABLE_TENSIONS: JointStateSample(stamp, NONE, NONE, bench.tensions),
    }.get(topic, JointStateSample(stamp, bench.sound, still, bench.torques))
    bench.supervision.handler(topic)(bench.time, sample)
    supervisor = bench.supervision.supervisor
    assert supervisor.state is RobotState.FAULT
    assert str(supervisor.fault).startswith(
        f"two publishers: stamps of {topic.name} repeat or go back: somebody publishes it beside {topic.writer}"
    )


def test_stamps_that_began_anew_let_a_robot_at_rest_be_enabled_later(robot):
    bench = Home(robot)
    for _ in range(30):
        bench.cycle()
    enable = bench.supervision.services()["/supervisor/enable"]
    bench.supervision.on_setpoint(bench.time, JointStateSample(7, bench.sound, *np.zeros((2, 8))))
    refused, _ = enable(bench.time)
    assert "two publishers: stamps of /setpoint" in refused.message
    for _ in range(300):
        bench.cycle()
    assert enable(bench.time)[0].accepted


def payload(stamp, mass):
    return InertiaSample(stamp, mass, np.zeros(3))


def test_a_payload_that_is_held_may_come_again_and_another_one_not(robot):
    bench = Home(robot).enabled()
    on_payload, state = bench.supervision.handler(PAYLOAD), bench.supervision.supervisor
    for stamp, mass in ((7_000, 80.0), (7_000, 80.0), (8_000, 80.5)):
        on_payload(bench.time, payload(stamp, mass))
    assert state.state is RobotState.ENABLED
    on_payload(bench.time, payload(8_000, 81.0))
    assert "two publishers: stamps of /payload repeat or go back" in str(state.fault)


def test_a_payload_of_before_is_anothers(robot):
    bench = Home(robot).enabled()
    for stamp in (8_000, 7_000):
        bench.supervision.handler(PAYLOAD)(bench.time, payload(stamp, 80.0))
    assert "/payload" in str(bench.supervision.supervisor.fault)


def said_by(bench, topic):
    """Return what the supervisor publishes on a topic in its next round of checks, with a robot that is enabled."""
    outputs = [*bench.supervision.watch(bench.time)]
    return [each.sample for each in outputs if isinstance(each, Publication) and each.topic is topic]


def test_the_supervisor_hears_itself_without_alarm_and_another_one_with(robot):
    bench = Home(robot).enabled()
    hear, supervisor = bench.supervision.handler(SUPERVISOR_ALIVE), bench.supervision.supervisor
    sent = said_by(bench, SUPERVISOR_ALIVE) + said_by(bench, SUPERVISOR_ALIVE)
    for sample in sent:
        hear(bench.time, sample)
    assert supervisor.state is RobotState.ENABLED
    hear(bench.time, sent[-1])
    assert str(supervisor.fault) == (
        "two publishers: /supervisor_alive brings what supervisor has not sent: somebody publishes it beside supervisor"
    )


def test_somebody_else_who_says_how_the_robot_is_stops_it(robot):
    bench = Home(robot).enabled()
    values = {"cause": "", "remark": ""}
    other = Status("supervisor", Level.OK, RobotState.STOPPING.value, values)
    bench.supervision.handler(ROBOT_STATE)(bench.time, other)
    assert "two publishers: /robot_state brings what" in str(bench.supervision.supervisor.fault)


def test_a_doubled_topic_refuses_to_enable_with_its_end_points(robot):
    bench = Home(robot)
    for _ in range(30):
        bench.cycle()
    enable = bench.supervision.services()["/supervisor/enable"]
    bench.doubled = ["/setpoint has 2 publishers, /feedforward and /lab/feedforward: end all but one"]
    refused, _ = enable(bench.time)
    assert refused.message == f"refused: two publishers: {bench.doubled[0]}"
    bench.doubled = []
    assert enable(bench.time)[0].accepted


def test_a_doubled_topic_found_later_brings_the_robot_to_rest(robot):
    bench = Home(robot).enabled()
    look = bench.supervision.look_for_publishers
    look(bench.time)
    assert bench.supervision.supervisor.state is RobotState.ENABLED
    bench.doubled = ["/reference has 2 publishers, /a and /b"]
    outputs = look(bench.time)
    assert Call("supervisor", SERVICES[Action.STOP_TRAJECTORY]) in outputs
    assert bench.supervision.supervisor.state is RobotState.STOPPING
    assert "/reference has 2 publishers, /a and /b" in str(bench.supervision.supervisor.fault)


def test_topics_that_must_have_one_publisher_are_those_the_robot_moves_by():
    watched = watched_topics(8)
    assert {MOTOR_STATES, SETPOINT, ROBOT_STATE, PAYLOAD, motor_command(8)} < set(watched)
    assert DIAGNOSTICS not in watched
