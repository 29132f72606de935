"""The whole closed loop along a trajectory over the kernel's CAN: control, drivers and devices, three processes."""

import time

import numpy as np

from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.parameters.table import ALL_NODES
from cspr_msgs_py.runtime.process import subscribe, subscribe_raw
from cspr_msgs_py.topics import ROBOT_STATE, SETPOINT, motor_names
from cspr_msgs_py.wire.joint_state import JointStateCodec

# No gains would bear a torque that is a cycle of 25 Hz late, with the platform bouncing on its cables, and `control`
# refuses such; these bear one of 100 Hz.
PACE = (100.0, 0.05)  # Hz of the machine; seconds of the machine in a second of the computer
GAINS = {"kp": 0.3, "kd": 0.03}
DURATION = 10.0  # s of the machine, half of the trajectory: then the operator stops it
PATIENCE = 300.0  # s of the computer
PATIENT = (
    "motor_states",
    "reference",
    "setpoint",
    "cable_tensions",
    "platform_pose",
)  # may be 5 s of the computer old


def control_parameters(path, root, pace):
    """Write the shipped parameters with what the slower cycle, and the slow motion, need."""
    file = ParameterFile.from_yaml(root / "config" / "control.yaml")
    robot = str(root / "config" / "robot.yaml")
    timeout = 1.0 * pace.speed  # 1 s of the computer
    file.change(
        ALL_NODES, GAINS | {"control_rate": pace.rate, "setpoint_timeout": timeout, "robot_config": robot}
    )
    file.change("trajectory_publisher", {"trajectory": "smooth-19"})
    file.change("supervisor", {f"max_age.{topic}": 5.0 * pace.speed for topic in PATIENT})
    file.change("supervisor", {"verification_required": False})
    file.change("supervisor", {"allowed_drop": 2.0})  # m, of a machine on which nothing hangs
    file.change("trajectory_publisher", {"supervision_timeout": 5.0 * pace.speed})
    file.slow_down(pace.speed)
    path.write_text(file.text())


def test_the_closed_loop_runs_along_a_trajectory(bench, executable, root, wire_report, capsys):
    control_parameters(bench.directory / "control.yaml", root, bench.pace)
    probe, states, causes, errors = bench.probe, [], [], []
    setpoints = JointStateCodec(motor_names(8))

    def compare(buffer):
        if probe.state is not None and states and states[-1] == "enabled":
            errors.append(probe.state.position - setpoints.decode(buffer).position)

    def note(message):
        causes.append({value.key: value.value for value in message.values})
        states.append(message.message)

    watching = [
        subscribe(probe.node, ROBOT_STATE, note),
        subscribe_raw(probe.node, SETPOINT, compare),
    ]
    probe.leave()
    control = executable(
        "control", "cspr_control.nodes.control", "--params-file", bench.directory / "control.yaml"
    )
    try:
        bench.until(lambda: states and states[-1] == "disabled", "the supervisor is not ready")
        deadline, refusal = time.monotonic() + PATIENCE, ""
        while states[-1] != "enabled":  # refused as long as the controllers are not all awake
            assert time.monotonic() < deadline, bench.explain(f"not enabled: {states}, {refusal}")()
            if states[-1] == "disabled":
                refusal = probe.call("/supervisor/enable").message
            time.sleep(0.3)
        bench.until(lambda: probe.call("/trajectory_publisher/start").success, "start is refused")
        errors.clear()
        begin = time.time()
        lowest = highest = probe.state.position
        starts, due = 1, begin + 1.0
        while time.time() < begin + DURATION / bench.pace.speed:
            time.sleep(0.05)
            assert states[-1] == "enabled", f"{causes[-1]}; {bench.explain(states)()}"
            # It gives a trajectory up when no motor states come for a while, and holds its pose: a busy computer. And a
            # trajectory ends. While one is under way, another start is refused.
            if time.time() > due:
                starts += probe.call("/trajectory_publisher/start").success
                due += 1.0
            lowest, highest = (
                np.minimum(lowest, probe.state.position),
                np.maximum(highest, probe.state.position),
            )
        end = time.time()
        assert probe.call("/supervisor/stop").success
        bench.until(lambda: states[-1] == "disabled", lambda: f"not stopped: {states}")
        bench.until(lambda: probe.brakes_open == 0, "brakes are open")
    finally:
        control.end()
        for subscription in watching:
            probe.node.destroy_subscription(subscription)
        probe.lead()
    assert "fault" not in states
    # it went somewhere, every winch turned: a revolution of a motor is 10 mm of cable
    assert ((highest - lowest) > 2.0 * np.pi).all()
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    report = wire_report([frame for frame in bench.wire.frames() if begin <= frame.time < end])
    pace = f"{DURATION:g} s at {bench.pace.rate:g} Hz and {bench.pace.speed:g} of real time"
    with capsys.disabled():
        print(f"\n{pace}, smooth-19, started {starts} times: {report}")
        print("RMS position error, motors 1 to 8, deg: " + " ".join(f"{e:.0f}" for e in np.degrees(rms)))
    assert (rms < 12.0).all()  # rad; the supervisor stops at as much, if it lasts
