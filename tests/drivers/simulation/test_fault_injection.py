import pytest

from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.errors import DriverError
from cspr_drivers.simulation.bus.bus_timing import BusDisturbance
from cspr_drivers.simulation.devices.encoder import Encoder
from cspr_drivers.simulation.fault_injection import (
    WITHOUT_DEVICES,
    FaultInjector,
    FaultOrder,
    FaultTarget,
    InjectedFault,
)


class NotedBus:
    def __init__(self):
        self.disturbance = BusDisturbance.NONE

    def disturb(self, disturbance):
        self.disturbance = disturbance


@pytest.fixture
def bus():
    return NotedBus()


@pytest.fixture
def injector(desk, load_cell_desk, bus):
    """Return an injector for one drive, and for the load cell of another desk."""
    buses = {"main": bus.disturb}
    return FaultInjector((desk.drive,), (load_cell_desk().cell,), desk.machine, buses, lambda: lambda: None)


@pytest.mark.parametrize("fault", list(InjectedFault))
def test_every_fault_is_known_by_its_name_and_its_target(injector, fault):
    place, expected = {
        FaultTarget.MOTOR: (" motor_1", 0),
        FaultTarget.CABLE: (" cable_1", 0),
        FaultTarget.BUS: (" main", "main"),
        FaultTarget.ROBOT: ("", 0),
    }[fault.target]
    assert injector.read(fault.value + place) == FaultOrder(fault, expected)
    assert fault.meaning


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no fault is named, such as drive_silent motor_3; `cspr closed_loop --help` lists them"),
        ("drive_silnt motor_1", "there is no fault 'drive_silnt'"),
        ("drive_silent", "'' is not a valid place; use 'drive_silent PLACE' with one of motor_1"),
        ("drive_silent motor_2", "'motor_2' is not a valid place"),
        ("load_cell_stuck motor_1", "one of cable_1"),
        ("bus_cut can0", "one of main"),
    ],
)
def test_orders_that_cannot_be_read(injector, text, says):
    with pytest.raises(DriverError) as caught:
        injector.read(text)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("fault", "attribute"),
    [
        (InjectedFault.DRIVE_SILENT, "disconnected"),
        (InjectedFault.DRIVE_NO_FEEDBACK, "pdos_missing"),
        (InjectedFault.DRIVE_NO_HEARTBEAT, "heartbeat_missing"),
        (InjectedFault.DRIVE_WRONG_MODE, "mode_is_lost"),
        (InjectedFault.DRIVE_EMERGENCY, "warning"),
        (InjectedFault.WINCH_BLOCKED, "blocked"),
        (InjectedFault.EMERGENCY_STOP, "emergency_stop"),
    ],
)
def test_clear_takes_a_fault_back(injector, desk, fault, attribute):
    injector.inject(FaultOrder(fault))
    assert getattr(desk.drive, attribute) is True
    injector.clear()
    assert getattr(desk.drive, attribute) is False


@pytest.mark.parametrize("alone", [True, False])
def test_an_encoder_stands_still_or_drifts_with_and_without_its_drive(desk, alone):
    encoder = Encoder() if alone else desk.drive.encoder
    drives, encoders = ((), (encoder,)) if alone else ((desk.drive,), ())
    injector = FaultInjector(drives, (), desk.machine, {}, encoders=encoders)
    injector.inject(injector.read("encoder_frozen motor_1"))
    assert encoder.frozen
    injector.inject(injector.read("encoder_drift motor_1"))
    assert encoder.drift == 2.0
    injector.clear()
    assert (encoder.frozen, encoder.drift) == (False, 0.0)


def test_missing_feedback_and_heartbeat(injector, desk):
    assert desk.write(0x1017, 0, 10, 2) == 0
    desk.wire.frames.clear()
    injector.inject(FaultOrder(InjectedFault.DRIVE_NO_FEEDBACK))
    desk.sync()
    desk.wait(0.05)
    assert desk.frames(desk.TPDO) == []
    assert desk.frames(0x700 + 5)
    injector.clear()
    injector.inject(FaultOrder(InjectedFault.DRIVE_NO_HEARTBEAT))
    desk.sync()
    desk.wait(0.05)
    assert len(desk.frames(desk.TPDO)) == 1
    assert desk.frames(0x700 + 5) == []


@pytest.mark.parametrize(
    ("fault", "shown"),
    [
        (InjectedFault.LOAD_CELL_OFFSET, 6600),
        (InjectedFault.LOAD_CELL_ZERO, 0),
        (InjectedFault.LOAD_CELL_GAIN, 5400),
        (InjectedFault.LOAD_CELL_STUCK, 6000),
    ],
)
def test_load_cells_show_what_their_faults_make_of_600_newton(load_cell_desk, fault, shown):
    desk = load_cell_desk()
    desk.map(0x1800, desk.TPDO, 1, (0x91300120, 0x61500108))
    desk.nmt(1)
    injector = FaultInjector((), (desk.cell,), desk.machine, {})
    assert desk.measure()[0] == 6000  # tenths of a newton
    injector.inject(injector.read(f"{fault.value} cable_1"))
    assert desk.measure()[0] == shown
    desk.plant.cable_tensions[0] = 700.0
    desk.machine._measured = False
    assert (desk.measure()[0] == 6000) is (fault is InjectedFault.LOAD_CELL_STUCK)
    injector.clear()
    desk.machine._measured = False
    assert desk.measure()[0] == 7000


def test_the_plant_alone_has_no_faults_of_devices(load_cell_desk):
    desk = load_cell_desk()
    injector = FaultInjector((), (desk.cell,), desk.machine, {}, encoders=(Encoder(),))
    places = {FaultTarget.ROBOT: "", FaultTarget.CABLE: "cable_1", FaultTarget.MOTOR: "motor_1"}
    for fault in InjectedFault:
        if fault in WITHOUT_DEVICES:
            injector.inject(injector.read(f"{fault.value} {places[fault.target]}"))
        else:
            with pytest.raises(DriverError, match=f"{fault.value} needs devices"):
                injector.read(f"{fault.value} cable_1")


def test_blocked_winch_holds_though_the_drive_says_otherwise(injector, desk):
    desk.enable(torque=-220)
    injector.inject(FaultOrder(InjectedFault.WINCH_BLOCKED))
    assert desk.plant.brake_closed[0]
    assert desk.status() & 1 << 14
    injector.clear()
    assert not desk.plant.brake_closed[0]


def test_emergency_without_fault(injector, desk):
    desk.enable(torque=-220)
    injector.inject(FaultOrder(InjectedFault.DRIVE_EMERGENCY))
    assert desk.emergencies() == [0x3220]
    assert desk.status() & 0xFF == 0xB7  # operation enabled, voltage, warning
    injector.clear()
    assert desk.emergencies() == [0]


def test_an_encoder_that_steps_and_one_that_goes_round(injector, desk):
    # object 6064h of 32 bits; the motor of the desk stands at its home pose
    before = desk.read(0x6064, 0, signed=True)
    injector.inject(FaultOrder(InjectedFault.ENCODER_WRAP))
    assert desk.read(0x6064, 0, signed=True) == before
    injector.inject(FaultOrder(InjectedFault.ENCODER_JUMP))
    assert desk.read(0x6064, 0, signed=True) == before + 5 * desk.drive.value(0x608F, 1)
    injector.clear()
    assert desk.read(0x6064, 0, signed=True) == before


def test_weak_brake_and_slipping_cable(injector, desk):
    injector.inject(FaultOrder(InjectedFault.BRAKE_WEAK))
    injector.inject(FaultOrder(InjectedFault.CABLE_SLACK))
    assert desk.plant.brake_share[0] < 0.1
    assert desk.plant.slipped[0] == pytest.approx(0.05)
    injector.clear()
    assert desk.plant.brake_share[0] == 1.0
    assert desk.plant.slipped[0] == pytest.approx(0.0)


def test_a_platform_that_hangs_on_an_obstacle(injector, desk):
    injector.inject(FaultOrder(InjectedFault.PLATFORM_CAUGHT))
    assert desk.plant.caught
    injector.clear()
    assert not desk.plant.caught


def test_the_kernels_buses_are_not_disturbed_from_here(desk):
    injector = FaultInjector((desk.drive,), (), desk.machine, {})
    with pytest.raises(DriverError, match="bus_cut: only the simulated buses of one process"):
        injector.read("bus_cut main")


@pytest.mark.parametrize("fault", [f for f in InjectedFault if f.target is FaultTarget.BUS])
def test_faults_of_a_bus(injector, bus, fault):
    injector.inject(FaultOrder(fault, "main"))
    assert bus.disturbance.name == fault.value.removeprefix("bus_").upper()
    injector.clear()
    assert bus.disturbance is BusDisturbance.NONE


def test_drives_accept_what_the_driver_writes(repository, drive_desk):
    """Every object that the driver sets stands in the EDS file, and may have the value."""
    from cspr_drivers.devices.settings import drive_settings

    config = CanConfig.from_yaml(repository / "config" / "can.yaml")
    desk = drive_desk()
    for setting in drive_settings(config, config.drives[4]):
        for parameter in setting.writes:
            size = parameter.bits // 8
            code = desk.write(parameter.index, parameter.subindex, parameter.value, size, parameter.signed)
            assert code == 0, f"{parameter} = {parameter.value}: abort code 0x{code:08X}"


def test_a_supervisor_is_killed_and_started_again(desk):
    said = []
    injector = FaultInjector((desk.drive,), (), desk.machine, {})
    with pytest.raises(DriverError, match="no supervisor within reach"):
        injector.read("supervisor_killed")
    injector.kill_supervisor = lambda: said.append("killed") or (lambda: said.append("started"))
    injector.inject(injector.read("supervisor_killed"))
    assert said == ["killed"]
    injector.clear()
    assert said == ["killed", "started"]
