import numpy as np
import pytest

from cspr_drivers.canopen.cia404 import AUTOZERO_SIGNATURE, NEWTON, InputStatus
from cspr_drivers.canopen.nmt import NmtCommand
from cspr_drivers.simulation.devices.canopen_codes import SdoAbort


@pytest.fixture
def operational(load_cell_desk):
    """Return a function that makes an amplifier in NMT operational."""

    def make(**errors):
        desk = load_cell_desk(**errors)
        desk.map(0x1800, desk.TPDO, 1, (0x91300120, 0x61500108))
        desk.nmt(NmtCommand.START)
        return desk

    return make


def test_identity(load_cell_desk):
    desk = load_cell_desk()
    assert desk.frames(0x700 + 5) == [b"\x00"]
    assert desk.read(0x1000, 0) == 0x00020194
    assert desk.read(0x6131, 1) == NEWTON
    assert desk.read(0x6132, 1) == 1


def test_process_value_with_gain_error_and_offset(operational):
    desk = operational(gain_error=0.001, offset=-2.0)
    desk.plant.cable_tensions[0] = 700.0
    assert desk.measure() == (6987, InputStatus.VALID)


def test_noise_has_its_standard_deviation_and_no_mean(operational):
    desk = operational(noise_std=2.0)
    values = np.array([desk.measure()[0] for _ in range(2000)]) / 10.0
    assert values.std() == pytest.approx(2.0, rel=0.1)
    assert values.mean() == pytest.approx(600.0, abs=0.2)


def test_decimal_digits_scale_the_value(operational):
    desk = operational()
    assert desk.write(0x6132, 1, 2, 1) == 0
    assert desk.measure() == (60000, InputStatus.VALID)


def test_tare(operational):
    desk = operational(noise_std=2.0, offset=15.0)
    assert desk.write(0x6125, 1, AUTOZERO_SIGNATURE, 4) == 0
    assert np.mean([desk.measure()[0] for _ in range(500)]) == pytest.approx(0.0, abs=3.0)
    desk.plant.cable_tensions[0] += 100.0
    assert desk.measure()[0] == pytest.approx(1000, abs=100)
    assert desk.read(0x9124, 1, signed=True) == -6150


def test_zero_survives_a_restart(operational):
    desk = operational()
    assert desk.write(0x6125, 1, AUTOZERO_SIGNATURE, 4) == 0
    desk.nmt(NmtCommand.RESET_NODE)
    assert desk.read(0x9130, 1, signed=True) == 0


@pytest.mark.parametrize(
    ("tension", "status"),
    [
        (5001.0, InputStatus.POSITIVE_OVERLOAD),
        (-101.0, InputStatus.NEGATIVE_OVERLOAD),
        (4999.0, InputStatus.VALID),
    ],
)
def test_overload(operational, tension, status):
    desk = operational()
    desk.plant.cable_tensions[0] = tension
    value, measured = desk.measure()
    assert measured == status
    assert -1000 <= value <= 50000


def test_refusals(load_cell_desk):
    desk = load_cell_desk()
    assert desk.write(0x6125, 1, 1, 4) == SdoAbort.CANNOT_BE_STORED
    assert desk.write(0x6131, 1, 0x00220000, 4) == SdoAbort.INVALID_VALUE
    assert desk.write(0x6132, 1, 6, 1) == SdoAbort.VALUE_TOO_HIGH
    assert desk.read(0x6125, 1) == SdoAbort.WRITE_ONLY
    assert desk.write(0x9130, 1, 0, 4) == SdoAbort.READ_ONLY


# Injected faults


def test_stuck_and_saturated_cells(operational):
    desk = operational()
    assert desk.measure() == (6000, 0)
    desk.cell.stuck = True
    desk.plant.cable_tensions[0] = 700.0
    assert desk.measure() == (6000, 0)
    desk.cell.stuck = False
    assert desk.measure() == (7000, 0)
    desk.cell.saturated = True
    value, status = desk.measure()
    assert value == 50000
    assert status == InputStatus.POSITIVE_OVERLOAD


def test_drift_runs_with_time_and_ends(operational):
    desk = operational()
    desk.measure()
    desk.cell.drift(100.0)
    for _ in range(5):
        value, status = desk.measure()
    assert value == 6000 + 5 * 4
    assert status == 0
    desk.cell.drift(0.0)
    assert desk.measure() == (6000, 0)
