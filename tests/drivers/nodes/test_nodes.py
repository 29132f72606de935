"""The drivers' nodes, each in a context of its own, on a bus with scripted devices."""

import dataclasses
import math
import time

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from tests.messages import from_diagnostic_array

from cspr_drivers.bus.shared_ports import SharedPorts
from cspr_drivers.clock import Clock
from cspr_drivers.errors import BusError, ConfigurationError
from cspr_drivers.nodes.can_drives import CanDrives
from cspr_drivers.nodes.load_cells import LoadCells
from cspr_msgs_py.runtime.process import advertise, sample_publisher, subscribe, subscribe_raw
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    DIAGNOSTICS,
    DRIVE_STATES,
    LOAD_CELL_STATES,
    MOTOR_STATES,
    SUPERVISOR_ALIVE,
    cable_names,
    motor_command,
    motor_names,
)
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.samples import SignOfLife

PATIENCE = 120.0


class Bench:
    """A probe that plays the motor controllers: it answers every state with the torques it is given."""

    def __init__(self, context, motors):
        self.context = context
        self.executor = EventsExecutor(context=context)
        self.probe = Node("probe", context=context)
        self.executor.add_node(self.probe)
        self.nodes = []
        self.torques = [1.0] * motors
        self.states = []
        self.tensions = []
        self.drives = []
        self.health = {}
        self._state_codec = JointStateCodec(motor_names(motors))
        self._tension_codec = JointStateCodec(cable_names(motors), position=False, velocity=False)
        self.codecs = [JointStateCodec((n,), position=False, velocity=False) for n in motor_names(motors)]
        self.alive = sample_publisher(self.probe, SUPERVISOR_ALIVE)  # as a supervisor does
        self.watched = True
        self.commands = [advertise(self.probe, motor_command(k)) for k in range(1, motors + 1)]
        subscribe_raw(self.probe, MOTOR_STATES, self._answer)
        subscribe_raw(
            self.probe, CABLE_TENSIONS, lambda b: self.tensions.append(self._tension_codec.decode(b))
        )
        subscribe(self.probe, DRIVE_STATES, lambda m: self.drives.append(from_diagnostic_array(m)))
        subscribe(self.probe, DIAGNOSTICS, lambda m: self.health.update(from_diagnostic_array(m)))

    def _answer(self, buffer):
        state = self._state_codec.decode(buffer)
        self.states.append(state)
        if self.watched:
            self.alive(SignOfLife(state.stamp_ns))
        for codec, publisher, torque in zip(self.codecs, self.commands, self.torques, strict=True):
            if torque is not None:
                publisher.publish(codec.encode(state.stamp_ns, effort=[torque]))

    def add(self, node):
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def until(self, condition):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f"nothing came of it; drives: {self.drives[-1:]}"
            self.executor.spin_until_future_complete(Future(), timeout_sec=0.01)

    def call(self, service):
        client = self.probe.create_client(Trigger, service)
        self.until(client.service_is_ready)
        return self.ask(client, Trigger.Request())

    def ask(self, client, request):
        """Return the answer of a service; where none has come, the busy computer lost it: ask again."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            future, again = client.call_async(request), time.monotonic() + 20.0
            self.until(lambda: future.done() or time.monotonic() > again)  # noqa: B023
            if future.done():
                return future.result()
        raise AssertionError(f"{client.srv_name} does not answer; drives: {self.drives[-1:]}")

    @property
    def state(self):
        return self.drives[-1]["can_drives"][1] if self.drives else ""

    @property
    def cause(self):
        return self.drives[-1]["can_drives"][2]["cause"]

    def enable(self):
        self.until(lambda: self.state == "disabled")
        self.until(lambda: self.call("/can_drives/enable").success)
        self.until(self._enabled)

    def _enabled(self):
        """Return whether the drives are enabled; after a pause of the computer, which is a fault, ask once more."""
        if self.state == "fault" and "silent for" in self.cause:
            self.call("/can_drives/fault_reset")
        elif self.state == "disabled":
            self.call("/can_drives/enable")
        return self.state == "enabled"

    def close(self):
        for node in self.nodes:
            self.executor.remove_node(node)
            node.make_safe()
            node.destroy_node()
        self.executor.remove_node(self.probe)
        self.probe.destroy_node()
        self.executor.shutdown()


@pytest.fixture
def context():
    context = Context()
    rclpy.init(args=[], context=context)
    yield context
    context.try_shutdown()


@pytest.fixture
def ports(config, far_end):
    """The near ends of the buses, open for as long as the test, whatever the nodes do."""
    ports = SharedPorts(config)
    ports.acquire()
    yield ports
    ports.release()


@pytest.fixture
def bench(context, config, ports):
    bench = Bench(context, len(config.drives))
    yield bench
    bench.close()


@pytest.fixture
def drives(bench, config, ports):
    return bench.add(CanDrives(config, ports, context=bench.context))


def test_enable_move_disable(bench, drives, far_end):
    bench.enable()
    level, state, values = bench.drives[-1]["motor_3"]
    assert (level, state) == (Level.OK, "operation_enabled")
    assert float(values.pop("feedback_age_ms")) < 1000.0
    assert values == {
        "brake": "open",
        "error_code": "0x0000",
        "errors": "",
        "remedy": "",
        "statusword": "0x5037",
        "emergency_stop": "",
        "slipped_rad": "",
        "unavailable": "",
    }
    far_end.drives[0].counts = 131072
    bench.until(lambda: bench.states[-1].position[0] == pytest.approx(2 * math.pi))
    bench.until(lambda: bench.states[-1].effort[1] == pytest.approx(1.0))
    assert abs(time.time_ns() - bench.states[-1].stamp_ns) < 1e9
    assert bench.call("/can_drives/disable").success
    bench.until(lambda: bench.state == "disabled")
    assert bench.drives[-1]["motor_3"][2]["brake"] == "closed"
    bench.until(lambda: "can_drives" in bench.health)
    bench.until(lambda: int(bench.health["can_drives"][2]["cycles"]) > 0)
    assert bench.health["can_drives: bus main"][1] == "ok"


def test_no_drive_lets_go_of_the_platform_alone(bench, drives):
    bench.enable()
    refused = bench.call("/can_drives/motor_3/disable")
    assert not refused.success
    assert refused.message == "motor_3 carries the platform with all others: disable them together"
    assert bench.state == "enabled"


def test_quick_stop_and_reset(bench, drives):
    bench.enable()
    assert bench.call("/can_drives/quick_stop").success
    bench.until(lambda: bench.state == "fault")
    assert bench.cause == "quick stop commanded"
    refused = bench.call("/can_drives/enable")
    assert not refused.success
    assert refused.message == "a fault is latched: quick stop commanded; reset it first"
    bench.until(lambda: bench.call("/can_drives/fault_reset").success)
    bench.until(lambda: bench.state == "disabled")


def test_a_torque_that_is_no_number_stops_the_drives(bench, drives, far_end):
    bench.enable()
    bench.torques[5] = math.nan
    bench.until(lambda: bench.state == "fault")
    assert bench.cause == "motor_6: torque command of nan N m is not finite"
    assert all(torque == -200 or not torque for _, torque in far_end.drives[5].rpdos)


def test_a_command_for_an_unknown_motor_stops_the_drives(bench, drives):
    bench.enable()
    bench.torques[2] = None
    bench.commands[2].publish(serialize_message(JointState(name=["motor_9"], effort=[1.0])))
    bench.until(lambda: bench.state == "fault")
    assert bench.cause == "motor_3: unreadable torque command: JointState lacks motor_3; it names motor_9"


def test_commands_that_cease_stop_the_drives(bench, drives):
    bench.enable()
    bench.torques[:] = [None] * len(bench.torques)
    bench.until(lambda: bench.state == "fault")
    assert bench.cause.startswith("no torque command within 300 ms for motor_")


def test_commands_of_another_layout_are_understood(bench, drives, far_end):
    bench.until(lambda: bench.states)
    bench.torques[0] = None
    message = JointState(name=["motor_1"], position=[0.0], velocity=[0.0], effort=[2.0])
    message.header.frame_id = "somewhere"
    seen = len(bench.states)
    bench.until(lambda: len(bench.states) > seen)  # the next one, which nobody has answered
    stamp = bench.states[-1].stamp_ns
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    bench.commands[0].publish(serialize_message(message))
    bench.until(lambda: far_end.drives[0].torque == 400)


def test_tensions_and_tare(bench, config, ports, drives, far_end):
    bench.add(LoadCells(config, ports, context=bench.context))
    bench.until(lambda: bench.tensions)
    assert bench.tensions[-1].effort == pytest.approx([110.0 + 10.0 * k for k in range(8)])
    bench.until(lambda: bench.states and any(t.stamp_ns == bench.states[-1].stamp_ns for t in bench.tensions))
    refused = bench.call("/load_cells/tare")
    assert not refused.success
    assert "only slack cables" in refused.message
    for cell in far_end.cells:
        cell.value = 5
    bench.until(lambda: bench.call("/load_cells/tare").success)
    bench.until(lambda: (0x6125, 1) in far_end.cells[7].objects)


def test_a_slack_cable_is_wound_in_until_its_time_is_over(bench, config, ports, drives, far_end):
    bench.until(lambda: bench.state == "disabled")
    refused = bench.call("/can_drives/motor_3/wind_in")
    assert not refused.success
    assert "the tension of cable_3 is not known" in refused.message
    bench.add(LoadCells(config, ports, context=bench.context))
    far_end.cells[2].value = 3
    bench.until(lambda: bench.tensions and bench.tensions[-1].effort[2] < 10.0)
    bench.until(lambda: bench.call("/can_drives/motor_3/wind_in").success)
    bench.until(lambda: any(torque < 0 for _, torque in far_end.drives[2].rpdos))
    bench.until(lambda: "winding" in {entry["can_drives"][1] for entry in bench.drives})
    bench.until(lambda: bench.state == "disabled")
    assert not any(word == 0x0F for drive in far_end.drives[:2] for word, _ in drive.rpdos)
    bench.until(lambda: "can_drives" in bench.health)
    bench.until(lambda: "0.3 s are over" in bench.health["can_drives"][2]["last_winding"])


class AnotherClock(Clock):
    """Of a process that began when the time of day was another."""

    def system_ns(self):
        return super().system_ns() - 3_600_000_000_000


def test_load_cells_of_another_process_stamp_as_the_drives_do(bench, config, drives):
    bench.add(LoadCells(config, clock=AnotherClock(), context=bench.context))

    def paired():
        stamps = [state.stamp_ns for state in bench.states[-50:]]
        return any(abs(each.stamp_ns - stamp) < 250_000 for each in bench.tensions[-5:] for stamp in stamps)

    bench.until(paired)


def test_a_missing_cell_is_named_in_diagnostics(bench, config, ports, drives, far_end):
    far_end.cells[3].answers_sync = False
    bench.add(LoadCells(config, ports, context=bench.context))
    bench.until(lambda: bench.health.get("load_cells", ("", ""))[1] == "cable_4 silent")
    assert bench.health["load_cells"][0] is Level.ERROR
    assert bench.tensions == []


def test_a_missing_cell_is_named_on_its_own_topic(bench, config, ports, drives, far_end):
    states = []
    subscribe(bench.probe, LOAD_CELL_STATES, lambda m: states.append(from_diagnostic_array(m)))
    bench.add(LoadCells(config, ports, context=bench.context))
    bench.until(lambda: states and states[-1]["load_cells"] == (Level.OK, "ok", {"cause": ""}))
    far_end.cells[3].answers_sync = False
    bench.until(lambda: states[-1]["load_cells"] == (Level.ERROR, "fault", {"cause": "cable_4: silent"}))
    assert states[-1]["cable_4"][1] == "silent"
    assert states[-1]["cable_5"][1] == "ok"


def test_a_missing_drive_is_named_in_diagnostics(bench, config, ports, far_end):
    far_end.drives[6].answers_sdo = False
    bench.add(CanDrives(config, ports, context=bench.context))
    bench.until(
        lambda: (
            bench.health.get("can_drives", ("", "", {"not_configured": ""}))[2]["not_configured"]
            == "motor_7 (node 7 on main): does not answer"
        )
    )
    # the others are heard one after the other
    bench.until(lambda: bench.call("/can_drives/enable").message == "motor_7: does not answer")
    assert not bench.call("/can_drives/enable").success


def test_the_node_makes_the_robot_safe_when_it_ends(bench, drives, far_end):
    bench.enable()
    drives.make_safe()
    assert all(drive.status == 0x50 for drive in far_end.drives)
    bench.until(lambda: bench.state == "disabled")


def test_another_rate_than_the_controllers_expect_is_refused(context, config, ports):
    with pytest.raises(ConfigurationError, match=r"control_rate is 250 Hz, but can\.yaml: rate = 100"):
        CanDrives(
            config, ports, context=context, parameter_overrides=[Parameter("control_rate", value=250.0)]
        )


@pytest.mark.parametrize("node_class", [CanDrives, LoadCells])
def test_a_missing_configuration_file_is_named(context, node_class):
    with pytest.raises(ConfigurationError, match=r"no_such\.yaml: cannot be read.*-p can_config:=PATH"):
        node_class(context=context, parameter_overrides=[Parameter("can_config", value="no_such.yaml")])


@pytest.mark.parametrize("node_class", [CanDrives, LoadCells])
def test_a_missing_interface_is_named(context, mapping, tmp_path, node_class):
    mapping["buses"]["main"].update(interface="socketcan", channel="can_not_there")
    path = tmp_path / "can.yaml"
    path.write_text(str(mapping))  # a mapping printed by Python is YAML as well
    with pytest.raises(BusError, match="CAN bus main"):
        node_class(context=context, parameter_overrides=[Parameter("can_config", value=str(path))])


def transition(bench, node, name):
    """Ask a managed node for a transition; return whether it succeeded."""
    client = bench.probe.create_client(ChangeState, f"/{node}/change_state")
    bench.until(client.service_is_ready)
    request = ChangeState.Request()
    request.transition.label = name
    return bench.ask(client, request).success


def test_the_life_cycle_of_the_driver(bench, config, ports, far_end):
    by_hand = [Parameter("autostart", value=False)]
    node = bench.add(CanDrives(config, ports, context=bench.context, parameter_overrides=by_hand))
    assert bench.call("/can_drives/enable").message == "can_drives is not configured"
    assert not any(drive.operational for drive in far_end.drives)
    assert transition(bench, "can_drives", "configure")
    bench.until(lambda: bench.state == "disabled")
    assert bench.call("/can_drives/enable").message == "can_drives is inactive: activate it first"
    assert transition(bench, "can_drives", "activate")
    bench.enable()
    assert transition(bench, "can_drives", "deactivate")
    assert all(drive.status == 0x50 for drive in far_end.drives)
    bench.until(lambda: bench.state == "disabled")
    assert transition(bench, "can_drives", "cleanup")
    assert not any(drive.operational for drive in far_end.drives)
    assert transition(bench, "can_drives", "configure")
    assert transition(bench, "can_drives", "activate")
    bench.enable()
    node.make_safe()
    assert all(drive.status == 0x50 for drive in far_end.drives)


def test_drives_are_enabled_together_only_while_a_supervisor_lives(bench, drives):
    bench.watched = False
    bench.until(lambda: bench.state == "disabled")
    bench.until(lambda: "no sign of life" in bench.call("/can_drives/enable").message)
    bench.until(lambda: bench.call("/can_drives/motor_3/enable").success)
    bench.until(lambda: bench.state == "enabled")
    bench.until(lambda: bench.call("/can_drives/motor_3/disable").success)
    bench.watched = True
    bench.enable()
    bench.watched = False
    bench.until(lambda: bench.state == "fault")
    assert "no sign of life of the supervisor for" in bench.cause


def test_a_transition_that_there_is_not_is_refused(bench, drives):
    bench.enable()
    client = bench.probe.create_client(ChangeState, "/can_drives/change_state")
    bench.until(client.service_is_ready)
    request = ChangeState.Request()
    request.transition.id = Transition.TRANSITION_ACTIVATE  # it is active
    assert not bench.ask(client, request).success
    assert bench.state == "enabled"


def test_what_goes_wrong_in_a_callback_stops_the_drives_and_is_named(bench, drives):
    bench.enable()
    drives.failed(KeyError("gone"))  # which the process calls
    bench.until(lambda: bench.state == "fault")
    assert bench.cause == "can_drives failed: KeyError: 'gone'"
    bench.until(lambda: bench.health["can_drives"][2].get("failure") == "KeyError: 'gone'")


def test_a_bus_that_cannot_be_opened_leaves_the_node_unconfigured(bench, config):
    bus = dataclasses.replace(config.buses[0], interface="carrier_pigeon")
    broken = dataclasses.replace(config, buses=(bus,))
    by_hand = [Parameter("autostart", value=False)]
    bench.add(CanDrives(broken, context=bench.context, parameter_overrides=by_hand))
    assert not transition(bench, "can_drives", "configure")
    assert bench.call("/can_drives/quick_stop").message == "can_drives is not configured"
    with pytest.raises(BusError, match="CAN bus main"):
        CanDrives(broken, context=bench.context)


def test_commands_to_one_drive(bench, drives, far_end):
    bench.until(lambda: bench.state == "disabled")
    bench.until(lambda: bench.call("/can_drives/motor_3/enable").success)
    bench.until(lambda: bench.state == "enabled")
    assert bench.drives[-1]["can_drives"][2]["enabled"] == "motor_3"
    assert bench.drives[-1]["motor_4"][2]["brake"] == "closed"
    assert bench.call("/can_drives/motor_3/quick_stop").success
    bench.until(lambda: bench.state == "fault")
    assert bench.cause == "quick stop of motor_3 commanded"
    bench.until(lambda: bench.call("/can_drives/fault_reset").success)
    bench.until(lambda: bench.state == "disabled")
    far_end.drives[4].status = 0x18
    bench.until(lambda: bench.state == "fault")
    bench.until(lambda: bench.call("/can_drives/motor_5/fault_reset").success)
    bench.until(lambda: bench.drives[-1]["motor_5"][1] == "switch_on_disabled")
    assert bench.state == "fault"
    bench.until(lambda: bench.call("/can_drives/fault_reset").success)
    bench.until(lambda: bench.state == "disabled")
    bench.until(lambda: bench.call("/can_drives/motor_5/enable").success)
    assert bench.call("/can_drives/motor_5/disable").success
    bench.until(lambda: bench.state == "disabled")
