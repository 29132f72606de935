import pytest

from cspr_drivers.bus.bus_load import bus_loads, require_fitting_cycle, worst_case_bits
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.errors import ConfigurationError


def stuffed_bits(data_bytes):
    """Count the bits field by field (ISO 11898-1, data frame in base format)."""
    stuffed = 1 + 11 + 1 + 1 + 1 + 4 + 8 * data_bytes + 15  # SOF, identifier, RTR, IDE, r0, DLC, data, CRC
    unstuffed = 1 + 1 + 1 + 7 + 3  # CRC delimiter, ACK, ACK delimiter, end of frame, intermission
    return stuffed + (stuffed - 1) // 4 + unstuffed


def fitting(mapping):
    """Return the loads of a configuration whose rate is that of the controllers."""
    config = CanConfig.from_mapping(mapping, "can.yaml")
    return require_fitting_cycle(config, config.rate)


@pytest.mark.parametrize("data_bytes", range(9))
def test_worst_case_bits(data_bytes):
    assert worst_case_bits(data_bytes) == stuffed_bits(data_bytes)


def test_the_shipped_table_takes_2735_us(mapping):
    (load,) = fitting(mapping)
    assert load.busy == pytest.approx(2735e-6)
    assert load.share == pytest.approx(0.68, abs=0.005)


def test_what_does_not_fit_is_refused_with_the_sum(mapping):
    mapping["rate"] = 500.0
    with pytest.raises(ConfigurationError) as error:
        fitting(mapping)
    assert str(error.value) == (
        "can.yaml: rate = 500: bus main: SYNC 55 + 8 x drive RPDO 95 + 8 x drive TPDO 135 "
        "+ 8 x load cell TPDO 105 = 2735 bits, 2735 us of a cycle of 2000 us (137 %), "
        "more than the limit of 90 %: lower the rate or use another bus"
    )


def test_two_buses_carry_500_hz(mapping):
    mapping["rate"] = 500.0
    mapping["buses"]["second"] = {**mapping["buses"]["main"], "channel": "another"}
    for device in mapping["drives"][4:] + mapping["load_cells"][4:]:
        device["bus"] = "second"
    loads = bus_loads(CanConfig.from_mapping(mapping, "can.yaml"))
    assert [load.bits for load in loads] == [1395, 1395]
    fitting(mapping)


def test_a_slower_bus_carries_less(mapping):
    mapping["buses"]["main"]["bitrate"] = 500_000
    with pytest.raises(ConfigurationError, match="5470 us of a cycle of 4000 us"):
        fitting(mapping)
