import math
import re

import numpy as np
import pytest

from cspr_control.supervision.balance_check import BalanceSettings
from cspr_control.supervision.checks import FaultKind, MonitoredInput, SupervisionLimits
from cspr_control.supervision.debounce import Debounce
from cspr_control.supervision.supervisor import Action, Supervisor
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.vocabulary import DriverState, RobotState, TrajectoryPhase
from cspr_msgs_py.wire.joint_state import JointStateSample

COUNT = 8
PAY_OUT = 0.002  # m/rad
INERTIA = 1.5e-3  # kg m^2
STEP = 0.02
LIMITS = SupervisionLimits(
    max_ages={source: defaults("supervisor")[f"max_age.{source.name.lower()}"] for source in MonitoredInput},
    following_error=1.0,
    following_error_time=0.1,
    tension_min=(50.0,) * 7 + (30.0,),
    tension_min_time=0.3,
    tension_max=(3000.0,) * 7 + (2000.0,),
    tension_max_time=0.1,
    starting_error=1.0,
    node_timeout=3.5,
    enable_timeout=1.0,
    motor_speed=450.0,
    motor_speed_time=0.05,
    workspace_min=(-1.0, -0.5, 0.3),
    workspace_max=(1.0, 0.5, 2.0),
    workspace_margin=0.05,
    transmission_ratio=PAY_OUT,
    motor_inertia=INERTIA,
    motor_torque=10.0,
    tension_difference=200.0,
    tension_difference_time=0.3,
    stuck_time=1.0,
    length_misfit=3e-4,
    slack_misfit=3e-3,
    misfit_cycles=3,
    slack_tension=25.0,
    slack_hold=0.1,
    stop_timeout=0.8,
    drive_timeout=1.0,
    balance=BalanceSettings(-1.0, 300.0, 0.003, 0.02, 0.05),
    verification_required=True,
    allowed_drop=0.02,
)


class Rig:
    """A supervisor whose inputs arrive every step unless they are silenced."""

    def __init__(self):
        self.supervisor = Supervisor(COUNT, LIMITS)
        self.time = 50.0
        self.drives = DriverState.DISABLED
        self.cause = ""
        self.phase = TrajectoryPhase.HOLD
        self.angles = np.zeros(COUNT)
        self.tensions = np.full(COUNT, 400.0)
        self.silent = set()
        self.speeds = np.zeros(COUNT)
        self.desired_speeds = np.full(COUNT, 2.0)
        self.desired_accelerations = np.zeros(COUNT)
        self.torques = np.full(COUNT, -400.0 * PAY_OUT)
        self.position = np.array([0.0, 0.0, 1.0])
        self.orientation = np.array([0.0, 0.0, 0.0, 1.0])
        self.stuck = np.zeros(COUNT, dtype=bool)
        self.noise = np.random.default_rng(1)

    def step(self, duration=STEP):
        actions = []
        for _ in range(max(1, round(duration / STEP))):
            self.time += STEP
            self._observe()
            actions += self.supervisor.update(self.time)
        return actions

    def _observe(self):
        stamp = round(self.time * 1e9)
        checks = self.supervisor.checks
        if MonitoredInput.MOTOR_STATES not in self.silent:
            checks.observe_motors(self.time, JointStateSample(stamp, self.angles, self.speeds, self.torques))
        if MonitoredInput.REFERENCE not in self.silent:
            checks.observe_arrival(MonitoredInput.REFERENCE, self.time)
        if MonitoredInput.SETPOINT not in self.silent:
            # For the next cycle: at the time of the state the desired angle is zero.
            self.desired_speeds = self.desired_speeds + self.desired_accelerations * STEP
            ahead = 0.004 * self.desired_speeds, self.desired_speeds, np.zeros(COUNT)
            checks.observe_setpoint(self.time, JointStateSample(stamp + 4_000_000, *ahead))
        if MonitoredInput.CABLE_TENSIONS not in self.silent:
            noise = self.noise.uniform(-2.0, 2.0, COUNT)
            checks.observe_tensions(self.time, np.where(self.stuck, self.tensions, self.tensions + noise))
        if MonitoredInput.PLATFORM_POSE not in self.silent:
            checks.observe_pose(self.time, self.position, self.orientation)
        if MonitoredInput.DRIVE_STATES not in self.silent:
            self.supervisor.observe_drives(self.time, self.drives, self.cause)
        self.supervisor.phase = self.phase

    def enabled(self):
        self.step()
        assert self.supervisor.enable(self.time).accepted
        assert self.step() == [Action.ENABLE_DRIVES]
        self.drives = DriverState.ENABLING
        assert self.step(0.2) == []
        assert self.state is RobotState.ENABLING
        self.drives = DriverState.ENABLED
        assert self.step() == []
        assert self.state is RobotState.ENABLED
        return self

    @property
    def state(self):
        return self.supervisor.state

    def load(self, cable, tension):
        """Let a cable carry a tension, with the torque of its motor."""
        self.tensions[cable] = tension
        self.torques[cable] = -tension * PAY_OUT

    def assert_fault(self, actions, kind, text=""):
        assert self.state is RobotState.FAULT
        assert self.supervisor.fault.kind is kind
        assert text in str(self.supervisor.fault)
        assert actions[:2] == [Action.QUICK_STOP, Action.STOP_TRAJECTORY]

    def assert_controlled_stop(self, actions, kind, text=""):
        """The robot comes to rest along its path, closes the brakes, and only then is in fault."""
        assert self.state is RobotState.STOPPING
        assert self.supervisor.fault.kind is kind
        assert text in str(self.supervisor.fault)
        assert actions == [Action.STOP_TRAJECTORY]
        self.phase = TrajectoryPhase.STOPPING
        self.supervisor.answered(self.time, Action.STOP_TRAJECTORY, True, "")
        assert self.step(0.3) == []
        self.phase = TrajectoryPhase.HOLD
        self.desired_speeds, self.desired_accelerations = np.zeros((2, COUNT))
        assert self.step() == [Action.DISABLE_DRIVES]
        self.drives = DriverState.STOPPING
        assert self.step(0.1) == []
        self.drives = DriverState.DISABLED
        assert self.step() == []
        assert self.state is RobotState.FAULT
        assert self.supervisor.fault.kind is kind
        assert self.step(1.0) == []
        assert not self.supervisor.enable(self.time).accepted


@pytest.fixture
def rig():
    return Rig()


def test_nothing_happens_before_enable(rig):
    assert rig.step(2.0) == []
    assert rig.state is RobotState.DISABLED


def test_enable_run_stop(rig):
    rig.enabled()
    assert rig.step(1.0) == []
    rig.phase = TrajectoryPhase.RUNNING
    assert rig.supervisor.stop(rig.time).accepted
    assert rig.step() == [Action.STOP_TRAJECTORY]
    rig.supervisor.answered(rig.time, Action.STOP_TRAJECTORY, True, "")
    rig.phase = TrajectoryPhase.STOPPING
    assert rig.step(0.4) == []
    rig.phase = TrajectoryPhase.HOLD
    assert rig.step() == [Action.DISABLE_DRIVES]
    rig.drives = DriverState.STOPPING
    assert rig.step(0.2) == []
    assert rig.state is RobotState.STOPPING
    rig.drives = DriverState.DISABLED
    assert rig.step() == []
    assert rig.state is RobotState.DISABLED
    rig.enabled()


def test_a_trajectory_that_does_not_come_to_rest_is_cut_off_by_the_brakes(rig):
    rig.enabled()
    rig.phase = TrajectoryPhase.RUNNING
    rig.supervisor.stop(rig.time)
    actions = rig.step(1.0)
    assert actions == [Action.STOP_TRAJECTORY, Action.DISABLE_DRIVES]


def test_a_stop_that_nobody_hears_closes_the_brakes_at_once(rig):
    rig.enabled()
    rig.phase = TrajectoryPhase.RUNNING
    rig.supervisor.stop(rig.time)
    rig.step()
    rig.supervisor.answered(rig.time, Action.STOP_TRAJECTORY, False, "not available")
    assert rig.step() == [Action.DISABLE_DRIVES]


def test_stop_while_enabling(rig):
    rig.step()
    rig.supervisor.enable(rig.time)
    rig.step()
    assert rig.supervisor.stop(rig.time).accepted
    rig.drives = DriverState.STOPPING
    assert rig.step() == [Action.DISABLE_DRIVES]
    rig.drives = DriverState.DISABLED
    rig.step()
    assert rig.state is RobotState.DISABLED


def test_stop_without_motion_says_so(rig):
    decision = rig.supervisor.stop(rig.time)
    assert decision.accepted
    assert "nothing to stop" in decision.message


@pytest.mark.parametrize("source", list(MonitoredInput))
def test_enable_is_refused_without_fresh_inputs(rig, source):
    rig.silent.add(source)
    rig.step(0.1)
    decision = rig.supervisor.enable(rig.time)
    assert not decision.accepted
    assert source.value in decision.message
    assert rig.step() == []
    assert rig.state is RobotState.DISABLED


@pytest.mark.parametrize(
    "drives", [d for d in DriverState if d not in (DriverState.DISABLED, DriverState.FAULT)]
)
def test_enable_is_refused_unless_the_drives_are_disabled(rig, drives):
    rig.step()
    rig.supervisor.observe_drives(rig.time, drives)
    assert drives.value in rig.supervisor.enable(rig.time).message
    assert rig.state is not RobotState.ENABLING


def test_enable_is_refused_away_from_the_setpoint(rig):
    rig.angles = np.array([0.0, 0.0, -1.5] + [0.0] * 5)
    rig.step()
    assert "motor_3" in rig.supervisor.enable(rig.time).message


def test_enable_is_refused_with_an_overloaded_cable_or_a_moving_reference(rig):
    rig.tensions = np.array([2900.0] + [400.0] * 6 + [2001.0])
    rig.step(0.3)
    assert "cable_8 carries 2001 N, limit 2000 N" in rig.supervisor.enable(rig.time).message
    rig.tensions = np.full(COUNT, 400.0)
    rig.phase = TrajectoryPhase.RUNNING
    rig.step()
    assert "running" in rig.supervisor.enable(rig.time).message


def test_enable_that_the_drives_refuse_leaves_the_robot_disabled(rig):
    rig.step()
    rig.supervisor.enable(rig.time)
    rig.step()
    rig.supervisor.answered(rig.time, Action.ENABLE_DRIVES, False, "motor_4 does not answer")
    assert rig.step() == []
    assert rig.state is RobotState.DISABLED
    assert "motor_4" in rig.supervisor.remark


def test_drives_that_do_not_become_enabled(rig):
    rig.step()
    rig.supervisor.enable(rig.time)
    rig.drives = DriverState.ENABLING
    actions = rig.step(1.2)
    assert actions.pop(0) is Action.ENABLE_DRIVES
    rig.assert_fault(actions, FaultKind.TIMEOUT, "enabling")


def test_drives_that_do_not_become_disabled(rig):
    rig.enabled()
    rig.supervisor.stop(rig.time)
    rig.supervisor.answered(rig.time, Action.STOP_TRAJECTORY, True, "")
    assert rig.step() == [Action.STOP_TRAJECTORY, Action.DISABLE_DRIVES]
    rig.assert_fault(rig.step(1.2), FaultKind.TIMEOUT, "enabled")


def test_drives_that_refuse_to_be_disabled(rig):
    rig.enabled()
    rig.supervisor.stop(rig.time)
    rig.supervisor.answered(rig.time, Action.STOP_TRAJECTORY, True, "")
    rig.step()
    rig.supervisor.answered(rig.time, Action.DISABLE_DRIVES, False, "no")
    rig.assert_fault(rig.step(), FaultKind.DRIVE_STATE)


@pytest.mark.parametrize("source", list(MonitoredInput))
def test_stale_topic_is_a_fault(rig, source):
    rig.enabled()
    rig.silent.add(source)
    limit = LIMITS.max_ages[source]
    assert rig.step(limit - 3 * STEP) == []
    actions = rig.step(5 * STEP)
    if source in (MonitoredInput.CABLE_TENSIONS, MonitoredInput.PLATFORM_POSE):
        rig.assert_controlled_stop(actions, FaultKind.STALE_TOPIC, source.value)
    else:
        rig.assert_fault(actions, FaultKind.STALE_TOPIC, source.value)


def test_a_stale_topic_is_named_with_its_node(rig):
    rig.enabled()
    rig.silent |= {MonitoredInput.REFERENCE, MonitoredInput.SETPOINT}  # the one answers the other
    rig.assert_fault(rig.step(0.3), FaultKind.STALE_TOPIC, "/reference of trajectory_publisher")


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize(
    "quantity", ["angles", "speeds", "torques", "tensions", "desired_speeds", "position", "orientation"]
)
def test_what_is_no_number_or_beyond_all_bounds_is_a_fault(rig, quantity, number):
    if quantity in ("orientation", "desired_speeds") and math.isfinite(number):
        return  # a rotation is a direction, however long; a motor that follows a set-point follows it
    rig.enabled()
    rig.phase = TrajectoryPhase.RUNNING
    with np.errstate(all="ignore"):
        getattr(rig, quantity)[0] = number
        rig.step(1.0)
        assert rig.supervisor.fault is not None
        assert rig.state in (RobotState.STOPPING, RobotState.FAULT)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("quantity", ["angles", "tensions", "desired_speeds", "position", "orientation"])
def test_enable_is_refused_with_what_is_no_number(rig, quantity, number):
    getattr(rig, quantity)[0] = number
    with np.errstate(all="ignore"):
        rig.step(0.2)
        assert not rig.supervisor.enable(rig.time).accepted


@pytest.mark.parametrize("name", ["feedforward", "mass_estimator"])
def test_a_node_that_ends_is_named(rig, name):
    checks = rig.supervisor.checks
    rig.enabled()
    checks.observe_node(rig.time, name)
    assert rig.step(3.4) == []
    actions, words = rig.step(0.2), f"{name} was last heard"
    if name == "mass_estimator":  # the motors follow without it
        rig.assert_controlled_stop(actions, FaultKind.NODE, words)
    else:
        rig.assert_fault(actions, FaultKind.NODE, words)
    assert words in str(checks.obstacle(rig.time))
    checks.observe_node(rig.time, name)
    assert checks.obstacle(rig.time) is None


def test_a_node_that_fails_is_named_until_it_no_longer_does(rig):
    checks = rig.supervisor.checks
    rig.enabled()
    checks.observe_node(rig.time, "feedforward", "KeyError: 'x'")
    rig.assert_fault(rig.step(), FaultKind.NODE, "feedforward: KeyError: 'x'")
    assert "KeyError" in str(checks.obstacle(rig.time))
    rig.step(1.6)
    assert checks.obstacle(rig.time) is None


def test_a_number_that_rounds_to_zero_has_no_sign(rig):
    rig.enabled()
    rig.stuck[4] = True  # no noise
    rig.load(4, -0.3)
    rig.step(0.5)
    assert rig.supervisor.fault.detail == "cable_5 at 0 N, limit 50 N"


def test_following_error_is_a_fault_when_it_lasts(rig):
    rig.enabled()
    rig.angles = np.array([0.0] * 6 + [1.2, 0.0])
    assert rig.step(0.08) == []
    rig.angles = np.zeros(COUNT)
    assert rig.step(0.08) == []
    rig.angles = np.array([0.0] * 6 + [1.2, 0.0])
    rig.assert_fault(rig.step(0.2), FaultKind.FOLLOWING_ERROR, "motor_7")


def test_motor_angle_that_is_not_finite_is_a_fault(rig):
    rig.enabled()
    rig.angles = np.array([math.nan] + [0.0] * 7)
    rig.assert_fault(rig.step(0.2), FaultKind.FOLLOWING_ERROR, "motor_1")


@pytest.mark.parametrize(
    ("tension", "allowed", "kind"),
    [(10.0, 0.3, FaultKind.TENSION_LOW), (3100.0, 0.1, FaultKind.TENSION_HIGH)],
)
def test_tension_beyond_its_limit_is_a_fault_when_it_lasts(rig, tension, allowed, kind):
    rig.enabled()
    rig.load(4, tension)
    assert rig.step(allowed - STEP) == []
    rig.load(4, 400.0)
    assert rig.step(0.5) == []
    rig.load(4, tension)
    actions = rig.step(allowed + 2 * STEP)
    if kind is FaultKind.TENSION_LOW:
        rig.assert_controlled_stop(actions, kind, "cable_5")
    else:
        rig.assert_fault(actions, kind, "cable_5")


@pytest.mark.parametrize(("cable", "tension", "limit"), [(0, 40.0, 50), (7, 2500.0, 2000)])
def test_each_cable_has_its_own_limits(rig, cable, tension, limit):
    rig.enabled()
    rig.load(7 - cable, tension)
    rig.step(0.5)
    assert rig.supervisor.fault is None
    rig.load(7 - cable, 400.0)
    rig.load(cable, tension)
    rig.step(0.5)
    assert re.fullmatch(rf"cable_{cable + 1} at \d+ N, limit {limit} N", rig.supervisor.fault.detail)


@pytest.mark.parametrize("speed", [460.0, -460.0, math.nan])
def test_overspeed_is_a_fault_when_it_lasts(rig, speed):
    rig.enabled()
    rig.speeds[2] = speed
    assert rig.step(0.04) == []
    rig.speeds[2] = 440.0
    assert rig.step(0.5) == []
    rig.speeds[2] = speed
    rig.assert_fault(rig.step(0.1), FaultKind.OVERSPEED, "motor_3")


@pytest.mark.parametrize(
    ("axis", "inside", "outside"), [(0, 1.04, 1.06), (0, -1.04, -1.06), (1, 0.54, 0.56), (2, 0.26, 0.24)]
)
def test_a_platform_that_leaves_its_workspace_comes_to_rest(rig, axis, inside, outside):
    rig.enabled()
    rig.position[axis] = inside
    assert rig.step(0.5) == []
    rig.position[axis] = outside
    rig.assert_controlled_stop(rig.step(), FaultKind.WORKSPACE, f"{'xyz'[axis]} = ")


def test_a_platform_outside_its_workspace_may_come_back_but_not_go_further(rig):
    rig.position[1] = 0.8
    rig.enabled()
    rig.position[1] = 0.84
    assert rig.step(0.5) == []
    rig.position[1] = 0.86
    rig.assert_controlled_stop(rig.step(), FaultKind.WORKSPACE, "y = 0.86")


@pytest.mark.parametrize("error", [210.0, -210.0])
def test_a_load_cell_that_its_motor_contradicts(rig, error):
    rig.enabled()
    rig.tensions[5] = 400.0 + 190.0
    assert rig.step(1.0) == []
    rig.tensions[5] = 400.0 + error
    assert rig.step(0.2) == []
    rig.assert_controlled_stop(
        rig.step(0.2), FaultKind.TORQUE, "load cell of cable_6, or polarity, rated torque, gear"
    )


@pytest.mark.parametrize(
    ("unexplained", "kind", "text"),
    [
        (3.0, FaultKind.LOAD_CELL, "the balance of the platform contradicts the load cell of cable_6"),
        (
            0.2,
            FaultKind.TORQUE,
            "fits the load cell, so polarity, rated torque, gear, brake or friction of motor_6",
        ),
    ],
)
def test_the_balance_tells_which_of_the_two_it_is(rig, unexplained, kind, text):
    rig.enabled()
    rig.supervisor.checks.observe_balance(rig.time, unexplained)
    rig.tensions[5] = 400.0 + 210.0
    assert rig.step(0.2) == []
    rig.assert_controlled_stop(rig.step(0.2), kind, text)


@pytest.mark.parametrize(
    ("torque", "tension", "text"),
    [
        (
            -10.0,
            300.0,
            "its torque at the limit of 10 N m, and its cable carries 300 N: its winch or brake is blocked",
        ),
        (-10.0, 2900.0, "an obstacle, or a load too heavy for it"),
        (-0.1, 400.0, "its torque -0.1 of 10 N m: its gains, its controller or its drive let go"),
    ],
)
def test_a_motor_that_is_behind_is_named_with_what_keeps_it(rig, torque, tension, text):
    rig.enabled()
    rig.angles[2] = 1.5
    rig.torques[2], rig.tensions[2], rig.stuck[2] = torque, tension, True  # without noise
    rig.step(0.15)
    assert str(rig.supervisor.fault).startswith("following error: motor_3 is -1.50 rad behind, limit 1 rad, ")
    assert str(rig.supervisor.fault).endswith(text)


@pytest.mark.parametrize(
    ("motors", "moving", "found"), [([2, 5], False, True), ([2], False, False), ([2, 5], True, False)]
)
def test_angles_that_stand_still_while_set_points_go_on(rig, motors, moving, found):
    rig.enabled()
    rig.desired_speeds[:] = 0.0
    rig.silent.add(MonitoredInput.SETPOINT)
    for cycle in range(5):
        wanted = np.zeros(COUNT)
        wanted[motors] = 0.18 * cycle  # less than following_error
        stamp = round(rig.time * 1e9) + 20_000_000
        rig.supervisor.checks.observe_setpoint(
            rig.time, JointStateSample(stamp, 2.0 * wanted, *np.zeros((2, COUNT)))
        )
        rig.angles = 2.0 * wanted if moving else np.zeros(COUNT)
        rig.step()
    text = "/motor_states of can_drives shows the same angles of motor_3, motor_6 again and again"
    assert (text in str(rig.supervisor.fault)) == found


@pytest.mark.parametrize(
    ("desired", "speed", "torque", "text"),
    [
        (50.0, 0.0, -0.4, "motor_3 falls behind, by 0.35 rad so far, its torque -0.4 of 10 N m"),
        (-50.0, 0.0, 0.4, "motor_3 falls behind, by -0.35 rad so far, its torque 0.4 of 10 N m"),
        (50.0, 1.0, 10.0, "motor_3 stands still, 0.35 rad behind so far, its torque at the limit of 10 N m"),
        (50.0, 10.0, 10.0, ""),  # it moves
        (15.0, 1.0, 10.0, ""),  # its set-point hardly does
        (50.0, 10.0, 1.2, ""),  # it pushes
        (50.0, 60.0, -0.4, ""),  # it catches up
    ],
)
def test_a_motor_that_gives_up_is_not_waited_for(rig, desired, speed, torque, text):
    rig.enabled()
    rig.desired_speeds[2], rig.speeds[2], rig.torques[2] = desired, speed, torque
    rig.angles[2] = -0.35 * np.sign(desired)
    rig.step(0.08)
    assert text in str(rig.supervisor.fault)
    assert bool(text) == (rig.state is RobotState.FAULT)


def test_what_accelerates_a_winch_contradicts_no_load_cell(rig):
    rig.enabled()
    rig.desired_accelerations[:] = 500.0 * np.array([1, -1] * 4)
    rig.step()
    rig.torques += INERTIA * rig.desired_accelerations  # 375 N at the cable
    assert rig.step(1.0) == []
    rig.tensions[5] = 400.0 + 210.0
    rig.assert_controlled_stop(rig.step(0.4), FaultKind.TORQUE, "its motor corresponds to 400 N")


def test_a_jump_of_the_desired_speed_contradicts_no_load_cell_for_long(rig):
    rig.enabled()
    for _ in range(20):
        rig.desired_speeds = rig.desired_speeds + 100.0
        rig.step()
        rig.step()
    assert rig.state is RobotState.ENABLED


def test_a_stuck_load_cell(rig):
    rig.enabled()
    rig.stuck[3] = True
    assert rig.step(0.9) == []
    rig.assert_controlled_stop(rig.step(0.2), FaultKind.LOAD_CELL, "cable_4 has shown exactly 400 N")


def test_brakes_that_hold_contradict_no_load_cell(rig):
    """While brakes open or close the cables hang on them, and not on the motors."""
    rig.enabled()
    rig.supervisor.stop(rig.time)
    rig.step()
    rig.supervisor.answered(rig.time, Action.STOP_TRAJECTORY, True, "")
    assert rig.step() == [Action.DISABLE_DRIVES]
    rig.torques[:] = 0.0
    assert rig.step(0.8) == []


def test_brakes_wait_for_set_points_that_still_move(rig):
    """The reference is at rest, but not yet the offset to it that damps a swing; not longer than for a trajectory."""
    for patient in (True, False):
        rig.enabled()
        rig.desired_speeds = np.full(COUNT, 20.0)
        rig.supervisor.stop(rig.time)
        rig.step()
        rig.supervisor.answered(rig.time, Action.STOP_TRAJECTORY, True, "")
        assert rig.step(0.2) == []
        if patient:
            rig.desired_speeds = np.full(COUNT, 1.0)
            assert rig.step() == [Action.DISABLE_DRIVES]
            rig.drives = DriverState.DISABLED
            rig.step()
        else:
            assert rig.step(LIMITS.stop_timeout) == [Action.DISABLE_DRIVES]


def test_a_recording_that_fails_stops_the_robot_once(rig):
    rig.enabled()
    rig.supervisor.recording_problem = "no space left on device"
    rig.assert_controlled_stop(rig.step(), FaultKind.RECORDING, "no space left")
    assert rig.supervisor.reset(rig.time).accepted
    rig.step(0.1)
    rig.enabled()
    assert rig.step(1.0) == []


def test_lengths_that_fit_no_pose_stop_the_drives_at_once(rig):
    rig.enabled()
    rig.supervisor.length_problem = "misfit of 0.31 mm, limit 0.3 mm: encoder or cable of motor_3"
    rig.assert_fault(rig.step(), FaultKind.LENGTHS, "of motor_3")


def test_lengths_that_fit_no_pose_turn_a_stop_along_the_path_into_a_quick_stop(rig):
    rig.enabled()
    rig.supervisor.load_cell_doubt = "cable_3 reads 400 N, its motor carries 900 N"
    rig.step()
    assert rig.state is RobotState.STOPPING
    rig.supervisor.length_problem = "misfit of 0.31 mm"
    rig.assert_fault(rig.step(), FaultKind.LOAD_CELL, "; then cable lengths fit no pose: misfit of 0.31 mm")


def test_a_robot_whose_lengths_fit_no_pose_is_not_enabled(rig):
    rig.step()
    rig.supervisor.length_problem = "misfit of 0.31 mm"
    decision = rig.supervisor.enable(rig.time)
    assert (decision.accepted, decision.message) == (
        False, "refused: cable lengths fit no pose: misfit of 0.31 mm"
    )  # fmt: skip
    rig.supervisor.length_problem = ""
    rig.enabled()


def test_a_load_cell_that_its_driver_finds_faulty_stops_the_robot_along_its_path(rig):
    rig.enabled()
    rig.supervisor.load_cell_problem = "cable_3: silent"
    rig.assert_controlled_stop(rig.step(), FaultKind.LOAD_CELL, "cable_3: silent")


def test_a_fault_that_ends_a_stop_along_the_path_is_named_after_the_first(rig):
    """On a dead bus the load cells may be missed a moment before the drives are."""
    rig.enabled()
    rig.supervisor.load_cell_problem = "cable_1, cable_2: silent"
    rig.step()
    assert rig.supervisor.state is RobotState.STOPPING
    rig.drives, rig.cause = DriverState.FAULT, "all drives: silent for 104 ms"
    assert Action.QUICK_STOP in rig.step()
    assert rig.supervisor.state is RobotState.FAULT
    assert str(rig.supervisor.fault) == (
        "load cell not plausible: cable_1, cable_2: silent; then drive fault: all drives: silent for 104 ms"
    )


def test_a_faulty_load_cell_keeps_the_robot_from_being_enabled(rig):
    rig.step()
    rig.supervisor.load_cell_problem = "cable_3: not valid"
    decision = rig.supervisor.enable(rig.time)
    assert not decision.accepted
    assert "load cells: cable_3: not valid" in decision.message
    rig.supervisor.load_cell_problem = ""
    rig.enabled()
    assert rig.step(1.0) == []


def test_a_recording_that_failed_before_enabling_stops_nothing(rig):
    rig.supervisor.recording_problem = "no space left on device"
    rig.enabled()
    assert rig.step(1.0) == []


def test_a_worse_fault_ends_a_controlled_stop_at_once_and_the_first_cause_stays(rig):
    rig.enabled()
    rig.position[0] = 1.2
    assert rig.step() == [Action.STOP_TRAJECTORY]
    rig.angles = np.full(COUNT, 2.0)
    rig.assert_fault(rig.step(0.2), FaultKind.WORKSPACE)


def test_a_fault_during_the_operators_stop_is_latched(rig):
    rig.enabled()
    rig.phase = TrajectoryPhase.RUNNING
    rig.supervisor.stop(rig.time)
    rig.step()
    rig.position[0] = 1.2
    assert rig.step() == []
    rig.supervisor.answered(rig.time, Action.STOP_TRAJECTORY, True, "")
    rig.phase = TrajectoryPhase.HOLD
    assert rig.step() == [Action.DISABLE_DRIVES]
    rig.drives = DriverState.DISABLED
    rig.step()
    assert rig.state is RobotState.FAULT
    assert rig.supervisor.fault.kind is FaultKind.WORKSPACE


@pytest.mark.parametrize("enabled", [False, True])
def test_drive_fault_is_latched_whenever_it_comes(rig, enabled):
    if enabled:
        rig.enabled()
    rig.drives, rig.cause = DriverState.FAULT, "motor_2: EMCY 0x2310"
    rig.assert_fault(rig.step(), FaultKind.DRIVE_FAULT, "motor_2")


def test_drives_that_leave_operation_are_a_fault(rig):
    rig.enabled()
    rig.drives = DriverState.DISABLED
    rig.assert_fault(rig.step(), FaultKind.DRIVE_STATE, "by themselves")


def test_drives_enabled_by_somebody_else_are_stopped(rig):
    rig.drives = DriverState.ENABLED
    rig.assert_fault(rig.step(), FaultKind.DRIVE_STATE, "nobody enabled")


def test_quick_stop_is_repeated_until_the_drives_obey(rig):
    rig.enabled()
    rig.silent.add(MonitoredInput.SETPOINT)
    rig.step(0.2)
    assert rig.step(0.6).count(Action.QUICK_STOP) >= 2
    rig.drives = DriverState.STOPPING
    assert rig.step(0.6) == []


@pytest.fixture
def faulty(rig):
    rig.enabled()
    rig.tensions = np.full(COUNT, 3100.0)
    rig.step(0.2)
    rig.drives = DriverState.DISABLED
    rig.tensions = np.full(COUNT, 400.0)
    rig.step(0.5)
    assert rig.state is RobotState.FAULT
    return rig


def test_fault_stays_latched_and_enable_is_refused(faulty):
    assert faulty.step(5.0) == []
    assert faulty.supervisor.fault.kind is FaultKind.TENSION_HIGH
    decision = faulty.supervisor.enable(faulty.time)
    assert not decision.accepted
    assert "reset" in decision.message


def test_reset_leads_to_disabled_and_not_further(faulty):
    assert faulty.supervisor.reset(faulty.time).accepted
    assert faulty.step() == [Action.RESET_DRIVES]
    faulty.step()
    assert faulty.state is RobotState.DISABLED
    assert faulty.supervisor.fault is None
    assert faulty.step(2.0) == []
    assert faulty.state is RobotState.DISABLED
    faulty.enabled()


def test_reset_that_the_drives_do_not_follow(faulty):
    faulty.drives, faulty.cause = DriverState.FAULT, "motor_1"
    faulty.step()
    faulty.supervisor.reset(faulty.time)
    assert faulty.step(1.5) == [Action.RESET_DRIVES]
    assert faulty.state is RobotState.FAULT
    assert "after the reset" in str(faulty.supervisor.fault)


def test_reset_that_the_drives_refuse(faulty):
    faulty.drives = DriverState.FAULT
    faulty.step()
    faulty.supervisor.reset(faulty.time)
    faulty.step()
    faulty.supervisor.answered(faulty.time, Action.RESET_DRIVES, False, "still hot")
    faulty.step()
    assert "still hot" in str(faulty.supervisor.fault)


def test_reset_needs_a_fault_and_stopped_drives(rig):
    assert not rig.supervisor.reset(rig.time).accepted
    rig.enabled()
    rig.silent.add(MonitoredInput.SETPOINT)
    rig.step(0.2)
    assert "not yet stopped" in rig.supervisor.reset(rig.time).message


def test_lasting_violation_is_per_member():
    watch = Debounce(2, 0.5)
    assert watch.update(0.0, [True, False]) is None
    assert watch.update(0.4, [False, True]) is None
    assert watch.update(0.6, [True, True]) is None
    assert watch.update(0.9, [True, True]) == 1
    watch.clear()
    assert watch.update(1.0, [True, True]) is None


def test_a_brake_that_slips_at_rest_is_a_fault_at_once_with_how_far_it_has_by_now(rig):
    rig.step()
    rig.supervisor.brake_problem = "motor_3 has turned by +0.6 rad"
    rig.drives = DriverState.FAULT
    rig.assert_fault(rig.step(), FaultKind.BRAKE, "motor_3 has turned by +0.6 rad")
    rig.supervisor.brake_problem = "motor_3 has turned by +9.0 rad"
    rig.step()
    assert str(rig.supervisor.fault) == "brake slips: motor_3 has turned by +9.0 rad"
    assert rig.supervisor.reset(rig.time).accepted
    rig.drives, rig.supervisor.brake_problem = DriverState.DISABLED, ""
    rig.step()
    assert rig.state is RobotState.DISABLED
    assert rig.supervisor.fault is None


def test_a_brake_that_slips_after_a_fault_is_told_besides_it(rig):
    rig.enabled()
    rig.drives, rig.cause = DriverState.FAULT, "emergency stop"
    rig.step()
    for angle in (0.6, 12.0):
        rig.supervisor.brake_problem = f"motor_3 has turned by {angle} rad"
        rig.step()
        assert str(rig.supervisor.fault) == (
            f"drive fault: emergency stop; then brake slips: motor_3 has turned by {angle} rad"
        )
    rig.supervisor.reset(rig.time)
    rig.supervisor.answered(rig.time, Action.RESET_DRIVES, False, "not stopped yet")
    rig.step()
    assert "the drives were not reset: not stopped yet; then brake slips" in str(rig.supervisor.fault)
