import pytest

from cspr_drivers.canopen.frame_table import (
    CONTROL_WORD,
    DRIVE_RPDO1,
    DRIVE_TPDO1,
    LOAD_CELL_TPDO1,
    POSITION_ACTUAL,
    STATUS_WORD,
    SYNC_COB_ID,
    TARGET_TORQUE,
    TORQUE_ACTUAL,
    FunctionCode,
    PdoLayout,
    cob_id,
)
from cspr_drivers.errors import FrameError


def test_cob_ids_of_the_predefined_connection_set():
    # CiA 301, section 7.3.5: tables of the broadcast and of the peer-to-peer objects.
    assert SYNC_COB_ID == 0x80
    assert cob_id(FunctionCode.EMERGENCY, 1) == 0x081
    assert cob_id(FunctionCode.TPDO1, 1) == 0x181
    assert cob_id(FunctionCode.RPDO1, 127) == 0x27F
    assert cob_id(FunctionCode.SDO_RESPONSE, 1) == 0x581
    assert cob_id(FunctionCode.SDO_REQUEST, 1) == 0x601
    assert cob_id(FunctionCode.HEARTBEAT, 127) == 0x77F


@pytest.mark.parametrize("node_id", [0, 128, -1])
def test_node_ids_out_of_range_are_refused(node_id):
    with pytest.raises(ValueError, match=r"not in 1\.\.127"):
        cob_id(FunctionCode.TPDO1, node_id)


def test_golden_bytes_of_the_drive_rpdo():
    # 6040h = 000Fh (enable operation), 6071h = -200 thousandths = FF38h.
    # Little-endian: CiA 301, section 7.1.4.
    assert DRIVE_RPDO1.encode(0x000F, -200) == bytes.fromhex("0F 00 38 FF")
    assert DRIVE_RPDO1.decode(bytes.fromhex("0F 00 38 FF")) == (0x000F, -200)
    assert DRIVE_RPDO1.length == 4


def test_golden_bytes_of_the_drive_tpdo():
    # 6041h = 4027h (operation enabled, brake open), 6064h = -2, 6077h = 1000.
    frame = bytes.fromhex("27 40 FE FF FF FF E8 03")
    assert DRIVE_TPDO1.decode(frame) == (0x4027, -2, 1000)
    assert DRIVE_TPDO1.encode(0x4027, -2, 1000) == frame
    assert DRIVE_TPDO1.length == 8


def test_golden_bytes_of_the_load_cell_tpdo():
    # 9130h:01 = 12345 (1234.5 N with one decimal digit), 6150h:01 = 02h (positive overload).
    frame = bytes.fromhex("39 30 00 00 02")
    assert LOAD_CELL_TPDO1.decode(frame) == (12345, 2)
    assert LOAD_CELL_TPDO1.encode(12345, 2) == frame
    assert LOAD_CELL_TPDO1.length == 5


def test_mapping_entries():
    # CiA 301, PDO mapping parameter: index, subindex, length in bits.
    assert DRIVE_RPDO1.mapping == (0x60400010, 0x60710010)
    assert DRIVE_TPDO1.mapping == (0x60410010, 0x60640020, 0x60770010)
    assert LOAD_CELL_TPDO1.mapping == (0x91300120, 0x61500108)


def test_another_order_is_another_frame():
    layout = PdoLayout((TARGET_TORQUE, CONTROL_WORD))
    assert layout.encode(-200, 0x000F) == bytes.fromhex("38 FF 0F 00")
    assert layout.decode(bytes.fromhex("38 FF 0F 00")) == (-200, 0x000F)


def test_values_in_another_order_than_the_frame():
    layout = PdoLayout((TORQUE_ACTUAL, STATUS_WORD, POSITION_ACTUAL), values=DRIVE_TPDO1.objects)
    frame = bytes.fromhex("E8 03 27 40 FE FF FF FF")
    assert layout.encode(0x4027, -2, 1000) == frame
    assert layout.decode(frame) == (0x4027, -2, 1000)
    assert layout.mapping == (0x60770010, 0x60410010, 0x60640020)


@pytest.mark.parametrize("values", [(), (1,), (1, 2, 3)])
def test_another_number_of_values_is_refused(values):
    with pytest.raises(FrameError, match="do not fit the frame"):
        DRIVE_RPDO1.encode(*values)


@pytest.mark.parametrize("length", [0, 1, 7, 9])
def test_a_frame_of_another_length_is_not_decoded(length):
    with pytest.raises(FrameError, match=f"frame of {length} bytes where 8 were expected"):
        DRIVE_TPDO1.decode(bytes(length))


def test_values_that_do_not_fit_are_refused():
    with pytest.raises(FrameError, match="do not fit the frame of control_word, target_torque"):
        DRIVE_RPDO1.encode(0, 40_000)


def test_more_than_eight_bytes_are_refused():
    with pytest.raises(ValueError, match="take 10 bytes, a PDO holds 8"):
        PdoLayout((STATUS_WORD, POSITION_ACTUAL, POSITION_ACTUAL))
    assert PdoLayout((STATUS_WORD, POSITION_ACTUAL, TORQUE_ACTUAL)) == DRIVE_TPDO1
