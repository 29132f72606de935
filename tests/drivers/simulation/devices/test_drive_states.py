import pytest

from cspr_drivers.canopen.cia402 import State
from cspr_drivers.simulation.devices.drive_states import QUICK_STOP_RAMP, DriveStateMachine, Phase
from cspr_drivers.simulation.simulation_config import BrakeProperties, DriveProperties

BRAKE = BrakeProperties(open_delay=0.03, close_delay=0.02, holding_torque=1.0)
DRIVE = DriveProperties(quick_stop_damping=1.0, quick_stop_time=0.2)

S = State


def machine_in(state: State) -> DriveStateMachine:
    """Return an automaton that was led into a state at time 0."""
    machine = DriveStateMachine(BRAKE, DRIVE, lambda _index: QUICK_STOP_RAMP)
    if state is S.NOT_READY_TO_SWITCH_ON:
        return machine
    machine.advance(-1.0, 0.0)
    if state is S.FAULT:
        machine.fault(-1.0)
        return machine
    words = {
        S.SWITCH_ON_DISABLED: (),
        S.READY_TO_SWITCH_ON: (0x06,),
        S.SWITCHED_ON: (0x06, 0x07),
    }.get(state, (0x06, 0x07, 0x0F))
    for word in words:
        machine.command(word, -1.0, may_operate=True)
    machine.advance(-0.5, 0.0)
    if state is S.QUICK_STOP_ACTIVE:
        machine.command(0x02, 0.0, may_operate=True)
    elif state is S.FAULT_REACTION_ACTIVE:
        machine.fault(0.0)
    assert machine.state is state
    return machine


def settle(machine: DriveStateMachine) -> None:
    for step in range(1000):
        machine.advance(step * 1e-3, 0.0)


# Every transition by control word (CiA 402-2), and where each other word leaves the state.
TRANSITIONS = [
    (S.NOT_READY_TO_SWITCH_ON, 0x06, S.NOT_READY_TO_SWITCH_ON),
    (S.SWITCH_ON_DISABLED, 0x06, S.READY_TO_SWITCH_ON),  # 2
    (S.SWITCH_ON_DISABLED, 0x07, S.SWITCH_ON_DISABLED),
    (S.SWITCH_ON_DISABLED, 0x0F, S.SWITCH_ON_DISABLED),
    (S.SWITCH_ON_DISABLED, 0x00, S.SWITCH_ON_DISABLED),
    (S.SWITCH_ON_DISABLED, 0x80, S.SWITCH_ON_DISABLED),
    (S.READY_TO_SWITCH_ON, 0x07, S.SWITCHED_ON),  # 3
    (S.READY_TO_SWITCH_ON, 0x0F, S.SWITCHED_ON),  # 3
    (S.READY_TO_SWITCH_ON, 0x06, S.READY_TO_SWITCH_ON),
    (S.READY_TO_SWITCH_ON, 0x02, S.SWITCH_ON_DISABLED),  # 7
    (S.READY_TO_SWITCH_ON, 0x00, S.SWITCH_ON_DISABLED),  # 7
    (S.SWITCHED_ON, 0x0F, S.OPERATION_ENABLED),  # 4
    (S.SWITCHED_ON, 0x07, S.SWITCHED_ON),
    (S.SWITCHED_ON, 0x06, S.READY_TO_SWITCH_ON),  # 6
    (S.SWITCHED_ON, 0x02, S.SWITCH_ON_DISABLED),  # 10
    (S.SWITCHED_ON, 0x00, S.SWITCH_ON_DISABLED),  # 10
    (S.OPERATION_ENABLED, 0x0F, S.OPERATION_ENABLED),
    (S.OPERATION_ENABLED, 0x02, S.QUICK_STOP_ACTIVE),  # 11
    (S.OPERATION_ENABLED, 0x80, S.SWITCH_ON_DISABLED),  # 9
    (S.OPERATION_ENABLED, 0x00, S.SWITCH_ON_DISABLED),  # 9
    (S.QUICK_STOP_ACTIVE, 0x0F, S.QUICK_STOP_ACTIVE),
    (S.QUICK_STOP_ACTIVE, 0x00, S.SWITCH_ON_DISABLED),  # 12
    (S.FAULT_REACTION_ACTIVE, 0x00, S.FAULT_REACTION_ACTIVE),
    (S.FAULT_REACTION_ACTIVE, 0x80, S.FAULT_REACTION_ACTIVE),
    (S.FAULT, 0x80, S.SWITCH_ON_DISABLED),  # 15
    (S.FAULT, 0x06, S.FAULT),
    (S.FAULT, 0x0F, S.FAULT),
]


@pytest.mark.parametrize(("before", "word", "after"), TRANSITIONS)
def test_transition(before, word, after):
    machine = machine_in(before)
    machine.command(word, 0.0, may_operate=True)
    assert machine.state is after


LEAVING = [
    (0x07, S.SWITCHED_ON),  # 5
    (0x06, S.READY_TO_SWITCH_ON),  # 8
    (0x02, S.SWITCH_ON_DISABLED),  # 11, 12
]


@pytest.mark.parametrize(("word", "after"), LEAVING)
def test_operation_is_left_with_the_brake_closed_before_power_goes(word, after):
    machine = machine_in(S.OPERATION_ENABLED)
    machine.command(word, 0.0, may_operate=True)
    machine.advance(0.0, 0.0)
    machine.advance(0.019, 0.0)
    assert machine.powered
    assert machine.brake_open
    machine.advance(0.021, 0.0)
    assert not machine.powered
    assert not machine.brake_open
    assert machine.state is after


def test_disable_voltage_leaves_the_motor_to_the_brake():
    machine = machine_in(S.OPERATION_ENABLED)
    machine.command(0x00, 0.0, may_operate=True)
    assert not machine.powered
    machine.advance(0.019, 0.0)
    assert machine.brake_open
    machine.advance(0.021, 0.0)
    assert not machine.brake_open
    assert machine.settled


def test_power_cut_while_the_brake_closes_does_not_delay_it():
    machine = machine_in(S.OPERATION_ENABLED)
    machine.command(0x07, 0.0, may_operate=True)
    machine.advance(0.0, 0.0)
    machine.command(0x00, 0.015, may_operate=True)
    machine.advance(0.021, 0.0)
    assert not machine.brake_open


def test_first_transition_follows_by_itself():
    machine = DriveStateMachine(BRAKE, DRIVE, lambda _index: QUICK_STOP_RAMP)
    machine.advance(0.0, 0.0)
    assert machine.state is S.SWITCH_ON_DISABLED


def test_brake_opens_after_the_torque_is_on():
    machine = machine_in(S.SWITCHED_ON)
    machine.command(0x0F, 0.0, may_operate=True)
    assert machine.follows_target
    machine.advance(0.029, 0.0)
    assert not machine.brake_open
    machine.advance(0.031, 0.0)
    assert machine.brake_open
    assert machine.settled


def test_operation_needs_a_mode():
    machine = machine_in(S.SWITCHED_ON)
    machine.command(0x0F, 0.0, may_operate=False)
    assert machine.state is S.SWITCHED_ON
    assert not machine.powered


@pytest.mark.parametrize(("speed", "duration"), [(0.0, 0.02), (50.0, 0.22)])
def test_quick_stop_waits_for_standstill_but_not_for_ever(speed, duration):
    machine = machine_in(S.OPERATION_ENABLED)
    machine.command(0x02, 0.0, may_operate=True)
    assert machine.damping == 1.0
    assert not machine.follows_target
    time = 0.0
    while machine.powered:
        machine.advance(time, speed)
        time += 1e-3
    assert time == pytest.approx(duration, abs=3e-3)
    assert machine.state is S.SWITCH_ON_DISABLED


def test_enable_cannot_call_a_closing_brake_back():
    machine = machine_in(S.OPERATION_ENABLED)
    machine.command(0x07, 0.0, may_operate=True)
    machine.advance(0.0, 0.0)
    machine.command(0x0F, 0.01, may_operate=True)
    machine.advance(0.021, 0.0)
    assert machine.state is S.SWITCHED_ON
    machine.command(0x0F, 0.022, may_operate=True)
    assert machine.state is S.OPERATION_ENABLED


def test_quick_stop_before_the_brake_is_open_closes_it_again():
    machine = machine_in(S.SWITCHED_ON)
    machine.command(0x0F, 0.0, may_operate=True)
    machine.command(0x02, 0.01, may_operate=True)
    machine.advance(0.031, 0.0)
    assert not machine.brake_open
    assert machine.state is S.SWITCH_ON_DISABLED


@pytest.mark.parametrize("state", [S.SWITCH_ON_DISABLED, S.READY_TO_SWITCH_ON, S.SWITCHED_ON])
def test_fault_without_power_is_immediate(state):
    machine = machine_in(state)
    machine.fault(0.0)
    assert machine.state is S.FAULT


@pytest.mark.parametrize("state", [S.OPERATION_ENABLED, S.QUICK_STOP_ACTIVE])
def test_fault_with_power_stops_first(state):
    machine = machine_in(state)
    machine.fault(0.0)
    assert machine.state is S.FAULT_REACTION_ACTIVE
    settle(machine)
    assert machine.state is S.FAULT
    assert machine.phase is Phase.OFF


def test_fault_reset_needs_a_rising_edge():
    machine = machine_in(S.SWITCHED_ON)
    machine.command(0x80, 0.0, may_operate=True)
    machine.fault(0.0)
    machine.command(0x80, 0.0, may_operate=True)
    assert machine.state is S.FAULT
    machine.command(0x00, 0.0, may_operate=True)
    assert machine.command(0x80, 0.0, may_operate=True)
    assert machine.state is S.SWITCH_ON_DISABLED
