import pytest

from cspr_drivers.canopen.cia402 import State
from cspr_drivers.canopen.nmt import NmtCommand
from cspr_drivers.simulation.devices.canopen_codes import SdoAbort

RPDO = 0x205


@pytest.fixture
def fresh(drive_desk):
    """Return a drive with its first RPDO invalid and unmapped."""
    desk = drive_desk()
    assert desk.write(0x1400, 1, 0x8000_0000 | RPDO, 4) == 0
    assert desk.write(0x1600, 0, 0, 1) == 0
    return desk


def test_mapping_of_a_valid_pdo_cannot_change(desk):
    assert desk.write(0x1600, 0, 0, 1) == SdoAbort.DEVICE_STATE
    assert desk.write(0x1600, 1, 0x60400010, 4) == SdoAbort.DEVICE_STATE


def test_mapping_entries_cannot_change_while_counted(fresh):
    assert fresh.write(0x1600, 1, 0x60400010, 4) == 0
    assert fresh.write(0x1600, 0, 1, 1) == 0
    assert fresh.write(0x1600, 2, 0x60710010, 4) == SdoAbort.DEVICE_STATE


def test_no_mapping_changes_under_power(desk):
    desk.enable()
    assert desk.write(0x1401, 1, 0x8000_0301, 4) == 0
    assert desk.write(0x1601, 0, 0, 1) == SdoAbort.DEVICE_STATE


REFUSED_OBJECTS = [
    (0x20000010, SdoAbort.NO_OBJECT),
    (0x60400110, SdoAbort.NO_SUBINDEX),
    (0x60FE0920, SdoAbort.NO_SUBINDEX),
    (0x60410010, SdoAbort.NOT_MAPPABLE),  # read only: not for an RPDO
    (0x60760020, SdoAbort.NOT_MAPPABLE),  # never in a PDO
    (0x60400008, SdoAbort.NOT_MAPPABLE),  # of another length
]


@pytest.mark.parametrize(("mapping", "code"), REFUSED_OBJECTS)
def test_objects_that_cannot_be_mapped(fresh, mapping, code):
    assert fresh.write(0x1600, 1, mapping, 4) == code


def test_more_than_64_bits(fresh):
    for subindex in range(1, 6):
        assert fresh.write(0x1600, subindex, 0x60710010, 4) == 0
    assert fresh.write(0x1600, 0, 5, 1) == SdoAbort.PDO_LENGTH_EXCEEDED
    assert fresh.write(0x1600, 0, 4, 1) == 0


def test_more_objects_than_entries(fresh):
    assert fresh.write(0x1600, 0, 9, 1) == SdoAbort.VALUE_TOO_HIGH


def test_counted_entry_without_object(fresh):
    assert fresh.write(0x1600, 1, 0, 4) == 0
    assert fresh.write(0x1600, 0, 1, 1) == SdoAbort.NO_OBJECT


COB_IDS = [
    (0x0000, SdoAbort.INVALID_VALUE),
    (0x0080, SdoAbort.INVALID_VALUE),
    (0x0585, SdoAbort.INVALID_VALUE),
    (0x0705, SdoAbort.INVALID_VALUE),
    (0x2000_0205, SdoAbort.INVALID_VALUE),  # 29-bit identifier
    (0x0206, 0),
    (0x4000_0205, 0),
]


@pytest.mark.parametrize(("value", "code"), COB_IDS)
def test_cob_ids(fresh, value, code):
    assert fresh.write(0x1400, 1, value, 4) == code


def test_cob_id_of_a_valid_pdo_cannot_change(desk):
    assert desk.write(0x1400, 1, RPDO + 1, 4) == SdoAbort.DEVICE_STATE
    assert desk.write(0x1400, 1, RPDO, 4) == 0


@pytest.mark.parametrize(
    ("index", "kind", "code"),
    [(0x1400, 255, 0), (0x1400, 1, 1), (0x1800, 0, 1), (0x1800, 1, 0), (0x1800, 3, 1), (0x1800, 255, 0)],
)
def test_transmission_types(fresh, index, kind, code):
    assert fresh.write(index, 2, kind, 1) == (SdoAbort.INVALID_VALUE if code else 0)


def test_frames_follow_the_mapping_that_was_configured(fresh):
    assert fresh.write(0x6060, 0, 10, 1) == 0
    fresh.map(0x1400, 0x2A0, 255, (0x60710010, 0x60400010))
    fresh.nmt(NmtCommand.START)
    fresh.send(RPDO, b"\x06\x00\x00\x00")
    assert fresh.drive.automaton.state is State.SWITCH_ON_DISABLED
    fresh.send(0x2A0, b"\x11\x00\x06\x00")
    assert fresh.drive.automaton.state is State.READY_TO_SWITCH_ON
    assert fresh.read(0x6071, 0) == 0x11


def test_control_word_counts_wherever_it_stands_in_the_frame(fresh):
    """The torque stands behind the control word here, and is nevertheless there when operation begins."""
    assert fresh.write(0x6060, 0, 10, 1) == 0
    fresh.map(0x1400, RPDO, 255, (0x60400010, 0x60710010))
    fresh.nmt(NmtCommand.START)
    fresh.command(0x06)
    fresh.command(0x07)
    fresh.command(0x0F, 200)
    assert [torque for _, torque in fresh.plant.torque_log] == [pytest.approx(1.0)]
