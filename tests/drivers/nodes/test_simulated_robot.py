"""The simulated robot as a node: drivers, devices and plant in one process, seen from the topics."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from tests.messages import from_diagnostic_array, from_inertia_stamped, inertia_stamped

from cspr_drivers.errors import ConfigurationError, DriverError
from cspr_drivers.nodes.simulated_robot import SimulatedRobot, create_nodes
from cspr_kinematics import Robot
from cspr_msgs_py.runtime.process import advertise, subscribe, subscribe_raw, subscribe_samples
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    DIAGNOSTICS,
    DRIVE_STATES,
    MOTOR_STATES,
    SET_SIMULATED_PAYLOAD,
    SIMULATED_PAYLOAD,
    TRUE_POSE,
    cable_names,
    motor_names,
)
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.samples import PoseSample

pytest.importorskip("mujoco")

ROOT = Path(__file__).parents[3]
PATIENCE = 120.0


def parameters(**files: Path) -> list[Parameter]:
    files = {
        "can_config": ROOT / "config" / "can.yaml",
        "simulation_config": ROOT / "config" / "simulation.yaml",
    } | files
    return [Parameter(name, value=str(path)) for name, path in files.items()]


@pytest.fixture
def context():
    context = Context()
    rclpy.init(args=[], context=context)
    yield context
    context.try_shutdown()


class Observer:
    """All nodes of the process and a listener, spun by the test."""

    def __init__(self, context: Context) -> None:
        self.nodes = create_nodes(context=context, parameter_overrides=parameters())
        self.probe = rclpy.create_node("probe", context=context)
        self.executor = SingleThreadedExecutor(context=context)
        for node in (*self.nodes, self.probe):
            self.executor.add_node(node)
        self.payloads: list[tuple[int, float, np.ndarray]] = []
        self.tensions = None
        self.states = None
        self.drive_state = ""
        self.health: dict = {}
        motors = JointStateCodec(motor_names(8))
        cables = JointStateCodec(cable_names(8), position=False, velocity=False)
        subscribe(self.probe, SIMULATED_PAYLOAD, lambda m: self.payloads.append(from_inertia_stamped(m)))
        subscribe(self.probe, DRIVE_STATES, self._drives)
        subscribe(self.probe, DIAGNOSTICS, lambda m: self.health.update(from_diagnostic_array(m)))
        self.stamps: set[int] = set()
        self.poses: dict[int, PoseSample] = {}
        subscribe_raw(self.probe, MOTOR_STATES, lambda b: self._motors(motors.decode(b)))
        subscribe_samples(self.probe, TRUE_POSE, lambda sample: self.poses.update({sample.stamp_ns: sample}))
        subscribe_raw(self.probe, CABLE_TENSIONS, lambda b: setattr(self, "tensions", cables.decode(b)))
        self.commands = advertise(self.probe, SET_SIMULATED_PAYLOAD)

    def _motors(self, states) -> None:
        self.states = states
        self.stamps.add(states.stamp_ns)

    def _drives(self, message) -> None:
        self.drive_state = from_diagnostic_array(message)["can_drives"][1]

    def until(self, condition) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f"nothing came of it; {self.drive_state}; {self.health}"
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, client) -> Trigger.Response:
        assert client.wait_for_service(PATIENCE)
        future = client.call_async(Trigger.Request())
        self.until(future.done)
        return future.result()

    def close(self) -> None:
        for node in self.nodes:
            self.executor.remove_node(node)
            if hasattr(node, "make_safe"):
                node.make_safe()
        for node in self.nodes:
            node.destroy_node()
        self.executor.remove_node(self.probe)
        self.probe.destroy_node()
        self.executor.shutdown()


@pytest.fixture
def observer(context):
    observer = Observer(context)
    yield observer
    observer.close()


def test_simulated_robot(observer):
    """The drivers find their devices, the payload is published and changes on request, and nonsense is refused."""
    observer.until(lambda: observer.drive_state == "disabled" and observer.tensions and observer.states)
    assert np.abs(observer.states.position).max() < 0.01
    assert observer.tensions.effort.min() > 50.0
    observer.until(lambda: len(observer.stamps & observer.poses.keys()) > 10)
    pose = observer.poses[max(observer.stamps & observer.poses.keys())]
    home = Robot.from_yaml(ROOT / "config" / "robot.yaml").home
    assert pose.position == pytest.approx(home.position, abs=2e-3)
    assert pose.quaternion_xyzw == pytest.approx(home.quaternion, abs=2e-3)

    before = observer.tensions.effort.sum()
    observer.until(lambda: observer.payloads)
    assert observer.payloads[-1][1] == 0.0

    at = time.time_ns() + 300_000_000
    observer.commands.publish(inertia_stamped(at, 60.0, (0.0, 0.01, -0.02)))
    observer.until(lambda: observer.payloads[-1][1] == 60.0)
    changed = next(stamp for stamp, mass, _ in observer.payloads if mass == 60.0)
    assert -0.005 < (changed - at) * 1e-9 < 1.0
    assert observer.payloads[-1][2] == pytest.approx([0.0, 0.01, -0.02])
    observer.until(lambda: observer.tensions.effort.sum() > before + 100.0)

    observer.commands.publish(inertia_stamped(0, -1.0, (0.0, 0.0, 0.0)))
    observer.commands.publish(inertia_stamped(0, float("nan"), (0.0, 0.0, 0.0)))
    observer.commands.publish(inertia_stamped(0, 1.0, (0.0, 0.0, 0.0), frame_id="base"))
    observer.until(
        lambda: observer.health.get("simulated_robot", (0, "", {}))[2].get("refused_payloads") == "3"
    )
    assert observer.payloads[-1][1] == 60.0

    simulated = observer.nodes[-1]
    inject = observer.probe.create_client(Trigger, "/simulated_robot/inject_fault")
    clear = observer.probe.create_client(Trigger, "/simulated_robot/clear_faults")
    answer = observer.call(inject)
    assert not answer.success
    assert "drive_silent" in answer.message
    (result,) = simulated.set_parameters([Parameter("fault", value="drive_silent motor_9")])
    assert not result.successful
    assert "motor_8" in result.reason
    (result,) = simulated.set_parameters([Parameter("fault", value="drive_silent motor_3")])
    assert result.successful
    assert observer.call(inject).success
    observer.until(lambda: observer.drive_state == "not_ready")
    assert observer.call(clear).success
    observer.until(lambda: observer.drive_state == "disabled")

    with simulated._emulator.machine.lock:
        simulated._emulator.machine.failure = DriverError("the simulated machine diverged")
    with pytest.raises(DriverError, match="diverged"):
        observer.until(lambda: False)


def test_missing_simulation_file(context, tmp_path):
    missing = tmp_path / "simulation.yaml"
    with pytest.raises(ConfigurationError, match=str(missing)):
        SimulatedRobot(context=context, parameter_overrides=parameters(simulation_config=missing))


def test_without_mujoco_the_process_ends_with_one_line():
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from cspr_drivers.nodes.simulated_robot import main\n"
        "sys.exit(main())"
    )
    process = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert process.returncode == 1
    assert process.stderr.strip().startswith("simulated_robot: the simulation needs MuJoCo")
    assert len(process.stderr.strip().splitlines()) == 1
