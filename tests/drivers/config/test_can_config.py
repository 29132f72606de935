from pathlib import Path

import pytest

from cspr_drivers.canopen.frame_table import CONTROL_WORD, TARGET_TORQUE
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.errors import ConfigurationError, DriverError

SHIPPED = Path(__file__).parents[3] / "config" / "can.yaml"


def test_the_shipped_configuration():
    config = CanConfig.from_yaml(SHIPPED)
    assert config.rate == 250.0
    assert config.period == 0.004
    assert config.master_node_id == 127
    assert [drive.name for drive in config.drives] == [f"motor_{k}" for k in range(1, 9)]
    assert [cell.name for cell in config.load_cells] == [f"cable_{k}" for k in range(1, 9)]
    assert str(config.drives[2]) == "motor_3 (node 3 on main)"
    assert config.drives[1].units.polarity == -1
    assert config.load_cells[0].units.decimal_digits == 1
    assert config.pdo.drive_rpdo.objects == (CONTROL_WORD, TARGET_TORQUE)


def change(mapping, path, value):
    *places, last = path
    for place in places:
        mapping = mapping[place]
    mapping[last] = value


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (["rate"], 0.0, "can.yaml: rate = 0.0: must lie in [1, 2000]"),
        (["rate"], 1.0e9, "can.yaml: rate = 1e+09: must lie in [1, 2000]"),
        (["rate"], float("nan"), "can.yaml: rate = nan: must be a finite number"),
        pytest.param(["rate"], 10**400, "0...: must be a finite number", id="rate-10^400"),
        (["rate"], True, "can.yaml: rate = True: must be a finite number"),
        (["speed"], 1.0, "can.yaml: speed = 1.0: unknown key; known here: "),
        (["bus_load_limit"], 1.5, "can.yaml: bus_load_limit = 1.5: must be at most 1"),
        (["master_node_id"], 128, "can.yaml: master_node_id = 128: must be a whole number from 1 to 127"),
        (
            ["velocity_source"],
            "606C",
            "can.yaml: velocity_source = '606C': must be one of position_difference",
        ),
        (["brake_open_bit"], 3, "can.yaml: brake_open_bit = 3: must be one of 8, 14, 15"),
        (["buses"], {}, "can.yaml: buses: must name at least one bus"),
        (["buses"], 5, "can.yaml: buses = 5: must be a mapping of keys to values"),
        (
            ["buses", "main", "bitrate"],
            1,
            "can.yaml: buses.main.bitrate = 1: must be a whole number from 10000",
        ),
        (
            ["drives", 2, "node_id"],
            0,
            "can.yaml: drives[2].node_id = 0: must be a whole number from 1 to 127",
        ),
        (["drives", 2, "node_id"], 1, "can.yaml: drives[2].node_id = 1: is already the node id of motor_1"),
        (
            ["load_cells", 0, "node_id"],
            127,
            "can.yaml: load_cells[0].node_id = 127: is already the node id of the driver",
        ),
        (["drives", 0, "bus"], "other", "can.yaml: drives[0].bus = 'other': must be one of main"),
        (["drives", 0, "polarity"], 2, "can.yaml: drives[0].polarity = 2: must be one of 1, -1"),
        (["drives", 0, "polarity"], True, "can.yaml: drives[0].polarity = True: must be one of 1, -1"),
        (
            ["drives", 0, "encoder_increments"],
            4096.5,
            "drives[0].encoder_increments = 4096.5: must be a whole number",
        ),
        (
            ["drives", 0, "rated_torque"],
            -1.0,
            "can.yaml: drives[0].rated_torque = -1.0: must be at least 0.001",
        ),
        (
            ["drives", 0, "torque_limit"],
            200.0,
            "drives[0].rated_torque = 5.0: torque_limit, 200 N m, must be from 0.02 to 32.767 times",
        ),
        (  # 6076h in uN m, taken for mN m
            ["drives", 0, "rated_torque"],
            5000.0,
            "rated_torque, 5000 N m: does the drive count 6076h in mN m?",
        ),
        (
            ["drives", 3, "rated_torque"],
            60.0,
            "drives[3].rated_torque = 60.0: rated_torque, 60 N m, is more than 10 times off that of another drive",
        ),
        (["drives", 0, "gear"], 3, "can.yaml: drives[0].gear = 3: unknown key"),
        (["load_cells", 3, "scale"], 0.0, "can.yaml: load_cells[3].scale = 0.0: must not be zero"),
        (
            ["load_cells", 3, "decimal_digits"],
            9,
            "load_cells[3].decimal_digits = 9: must be a whole number from 0 to 6",
        ),
        (
            ["pdo", "drive_rpdo"],
            ["control_word"],
            "pdo.drive_rpdo = ['control_word']: must hold, in any order, control_word",
        ),
        (["pdo", "drive_tpdo"], "all", "can.yaml: pdo.drive_tpdo = 'all': must be a list of texts"),
        (["timeouts", "command"], 0, "can.yaml: timeouts.command = 0: must be at least 0.001"),
        (["timeouts", "rpdo"], 70.0, "can.yaml: timeouts.rpdo = 70.0: must lie in [0.001, 65.535]"),
        (
            ["timeouts", "heartbeat_consumer"],
            0.05,
            "heartbeat_consumer = 0.05: must be greater than heartbeat_producer",
        ),
        # 20 mm at 0.1 m/s^2 take 0.632 s, and falling freely 63.9 ms
        (
            ["timeouts", "command"],
            1e9,
            "can.yaml: timeouts.command = 1e+09: must be at most 0.632 s: the drives keep their torque for so "
            "long, and what that leaves unbalanced, 0.1 m/s^2, then costs allowed_drop = 0.02 m",
        ),
        (["timeouts", "feedback"], 0.64, "can.yaml: timeouts.feedback = 0.64: must be at most 0.632 s"),
        (["timeouts", "rpdo"], 0.64, "can.yaml: timeouts.rpdo = 0.64: must be at most 0.632 s"),
        (["timeouts", "heartbeat_consumer"], 60.0, "heartbeat_consumer = 60.0: must be at most 0.632 s"),
        (["timeouts", "stop"], 1e9, "can.yaml: timeouts.stop = 1e+09: must lie in [0.001, 60]"),
        (
            ["load_cell_checks", "stuck_time"],
            1.1,
            "can.yaml: load_cell_checks.stuck_time = 1.1: must be at most 1, or a load cell that is stuck is not found "
            "within a second",
        ),
        (
            ["load_cell_checks", "stuck_span"],
            1e9,
            "can.yaml: load_cell_checks.stuck_span = 1e+09: must be at most 60, or a load cell that is stuck may be "
            "wrong by more than 60 N unnoticed",
        ),
        (["load_cell_checks", "stuck_span"], 0.0, "load_cell_checks.stuck_span = 0.0: must be positive"),
        (
            ["torque_check", "time"],
            0.065,
            "can.yaml: torque_check.time = 0.065: must be at most 0.0639 s: a drive may have let go for so long, and a "
            "free fall then costs allowed_drop = 0.02 m",
        ),
        (
            ["torque_check", "difference"],
            1e9,
            "can.yaml: torque_check.difference = 1e+09: must be at most 2.5 N m, a quarter of the smallest "
            "torque_limit: a drive that lets go of more must be noticed",
        ),
        (["allowed_drop"], 1.5, "can.yaml: allowed_drop = 1.5: must"),
        (["drives"], [], "can.yaml: drives = []: must be a list of at least one element"),
        (["drives", 1], "x", "can.yaml: drives[1] = 'x': must be a mapping of keys to values"),
    ],
)
def test_errors_name_file_key_and_value(mapping, path, value, words):
    change(mapping, path, value)
    with pytest.raises(ConfigurationError) as error:
        CanConfig.from_mapping(mapping, "can.yaml")
    assert words in str(error.value)
    assert isinstance(error.value, DriverError)


@pytest.mark.parametrize(
    "path", [["rate"], ["timeouts", "sdo"], ["drives", 0, "node_id"], ["buses", "main", "channel"]]
)
def test_a_missing_key_is_named(mapping, path):
    *places, last = path
    section = mapping
    for place in places:
        section = section[place]
    del section[last]
    with pytest.raises(ConfigurationError, match=rf"{last}: is missing"):
        CanConfig.from_mapping(mapping, "can.yaml")


def test_a_key_with_a_default_may_be_left_out(mapping):
    mapping["velocity_filter"] = 0.01
    assert CanConfig.from_mapping(mapping, "can.yaml").velocity_filter == 0.01
    del mapping["velocity_filter"]
    assert CanConfig.from_mapping(mapping, "can.yaml").velocity_filter == 0.0


def test_each_cable_has_motor_and_load_cell(mapping):
    mapping["load_cells"].pop()
    with pytest.raises(ConfigurationError, match="7 entries for 8 drives"):
        CanConfig.from_mapping(mapping, "can.yaml")


def test_two_buses_on_one_channel_are_refused(mapping):
    mapping["buses"]["second"] = dict(mapping["buses"]["main"])
    with pytest.raises(
        ConfigurationError, match=r"buses.second.channel = .*: is already the channel of bus main"
    ):
        CanConfig.from_mapping(mapping, "can.yaml")


def test_the_order_in_a_frame_can_be_changed(mapping):
    mapping["pdo"]["drive_rpdo"] = ["target_torque", "control_word"]
    assert CanConfig.from_mapping(mapping, "can.yaml").pdo.drive_rpdo.objects == (TARGET_TORQUE, CONTROL_WORD)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match=r"nothing\.yaml: cannot be read: No such file or directory"):
        CanConfig.from_yaml(tmp_path / "nothing.yaml")


@pytest.mark.parametrize(
    "text",
    ["rate: [1, 2\n", "rate: !!timestamp 2001-99-99", "rate: 250.0\nrate: 500.0", "[" * 1000],
    ids=lambda text: text[:12],
)
def test_a_file_that_is_no_yaml_is_named(tmp_path, text):
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=r"broken\.yaml: is not valid YAML: "):
        CanConfig.from_yaml(path)


def test_a_list_at_the_top_is_refused(tmp_path):
    path = tmp_path / "list.yaml"
    path.write_text("- 1\n")
    with pytest.raises(ConfigurationError, match="must be a mapping"):
        CanConfig.from_yaml(path)


def test_a_device_may_be_without_identity(mapping):
    mapping["drives"][3]["identity"] = None
    assert CanConfig.from_mapping(mapping, "can.yaml").drives[3].identity is None


def test_a_part_of_an_identity_is_not_enough(mapping):
    del mapping["load_cells"][2]["identity"]["serial_number"]
    with pytest.raises(ConfigurationError, match=r"load_cells\[2\].identity.serial_number: is missing"):
        CanConfig.from_mapping(mapping, "can.yaml")


@pytest.mark.parametrize("code", [0, 5])
def test_an_option_code_that_drops_the_load_is_refused(mapping, code):
    mapping["option_codes"]["quick_stop"] = code
    with pytest.raises(
        ConfigurationError, match=f"option_codes.quick_stop = {code}: must be one of 1, 2, 3, 4"
    ):
        CanConfig.from_mapping(mapping, "can.yaml")


def test_limits_in_time_may_be_as_long_as_the_height_that_they_cost_allows(mapping):
    mapping["timeouts"].update(command=0.63, feedback=0.63, rpdo=0.63, heartbeat_consumer=0.63)
    mapping["torque_check"] = {"difference": 2.5, "time": 0.0638}
    assert CanConfig.from_mapping(mapping, "can.yaml").allowed_drop == 0.02
    mapping["allowed_drop"] = 0.2  # ten times the height takes 3.16 times as long
    mapping["timeouts"].update(command=1.9, feedback=1.9, rpdo=1.9, heartbeat_consumer=1.9)
    mapping["torque_check"]["time"] = 0.2
    CanConfig.from_mapping(mapping, "can.yaml")
    mapping["timeouts"]["rpdo"] = 2.1
    with pytest.raises(ConfigurationError, match=r"timeouts\.rpdo = 2\.1: must be at most 2 s"):
        CanConfig.from_mapping(mapping, "can.yaml")
