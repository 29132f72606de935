import pytest

from cspr_drivers.errors import DriverError
from cspr_drivers.simulation.plant.shared import SharedPlant
from cspr_drivers.simulation.simulation_config import PayloadChange
from cspr_kinematics import Payload


def payload(mass: float) -> Payload:
    return Payload(mass, (0.0, 0.0, 0.1))


def test_frame_stamps_become_plant_time(clock, noted_plant):
    machine = SharedPlant(noted_plant(), (), clock)
    stamp = clock.time_of_day()
    clock.time += 0.25
    assert machine.time_at(stamp) == pytest.approx(0.0)
    assert machine.time_at(clock.time_of_day()) == pytest.approx(0.25)
    assert machine.from_ros_time(stamp) == pytest.approx(0.0)


@pytest.mark.parametrize("stamp", [0.0, 123.4, 1.7e9 + 5000.0])
def test_stamps_of_another_clock_are_replaced(clock, noted_plant, stamp):
    machine = SharedPlant(noted_plant(), (), clock)
    clock.time += 0.25
    assert machine.time_at(stamp) == pytest.approx(0.25)


def test_a_time_of_day_that_was_set_changes_no_age(clock, noted_plant):
    machine = SharedPlant(noted_plant(), (), clock)
    clock.time += 1.0
    clock.day -= 0.4
    assert machine.time_at(clock.time_of_day()) == pytest.approx(1.0, abs=1e-6)


def test_payloads_arrive_in_time(clock, noted_plant):
    plant = noted_plant()
    machine = SharedPlant(plant, (PayloadChange(2.0, payload(20.0)),), clock)
    machine.change_payload(payload(10.0), 1.0)
    machine.advance(0.9)
    assert plant.payload.mass == 0.0
    machine.advance(1.0)
    assert plant.payload.mass == 10.0
    machine.advance(5.0)
    assert plant.payload.mass == 20.0
    machine.change_payload(payload(5.0), 3.0)  # a time that is over
    machine.advance(5.1)
    assert plant.payload.mass == 5.0


def test_a_payload_takes_its_time_to_come_aboard(clock, noted_plant):
    plant = noted_plant()
    machine = SharedPlant(plant, (PayloadChange(1.0, payload(20.0), 0.5),), clock)
    machine.change_payload(payload(10.0), 2.0, 0.25)
    machine.advance(1.0)
    assert plant.growth == 0.5
    machine.advance(2.0)
    assert plant.growth == 0.25


def test_time_never_runs_back(clock, noted_plant):
    plant = noted_plant()
    machine = SharedPlant(plant, (), clock)
    machine.advance(1.0)
    machine.advance(0.5)
    assert machine.time == plant.time == 1.0


def test_failure_is_kept(clock, noted_plant):
    plant = noted_plant()
    machine = SharedPlant(plant, (), clock)

    def diverge(time: float) -> None:
        raise DriverError("diverged")

    plant.advance = diverge
    for time in (1.0, 2.0):
        with pytest.raises(DriverError, match="diverged"):
            machine.advance(time)
    assert str(machine.failure) == "diverged"
