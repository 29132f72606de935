"""The table of parameters, and the files and documents that repeat it."""

import re
from pathlib import Path

import pytest
import yaml

from cspr_msgs_py.bag.mcap_writer import Compression
from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.parameters.row import NodeParameter
from cspr_msgs_py.parameters.table import TABLE, defaults, known_parameter, node_parameters, parameter_values

CONTROL_FILE = Path(__file__).parents[3] / "config" / "control.yaml"
ROWS = [pytest.param(node, row, id=f"{node}.{row.name}") for node, rows in TABLE.items() for row in rows]


@pytest.mark.parametrize(("node", "row"), ROWS)
def test_a_default_is_a_value_that_the_parameter_may_have(node: str, row: NodeParameter) -> None:
    assert known_parameter(node.replace("_K", "_3"), row.name) is row
    if not isinstance(row.default, type):
        assert row.checked(row.default) == row.default
        assert type(row.checked(row.default)) is type(row.default)
    by_time = row.unit == "s" or row.unit.endswith("/s")
    assert row.stretch == 0 or by_time or (row.stretch, row.unit) == (2, "m"), "only times, rates and falls"


def test_what_the_shipped_file_shows_has_the_default_and_the_unit_of_the_table() -> None:
    text = CONTROL_FILE.read_text(encoding="utf-8")
    section, seen, prefix = "", 0, ""
    for line in text.splitlines():
        if top := re.fullmatch(r"(\S+):", line):
            section = top[1]
        elif group := re.fullmatch(r"    (\w+):", line):
            prefix = f"{group[1]}."
        elif entry := re.fullmatch(r"    ( *)(\w+): (.*?)(?: +# (.*))?", line):
            name = (prefix if entry[1] else "") + entry[2]
            row = known_parameter(section, name)
            assert row is not None
            assert yaml.safe_load(entry[3]) == row.default, f"{section}.{name}"
            if row.unit and entry[4]:
                assert re.match(rf"{re.escape(row.unit)}\b", entry[4]), f"{section}.{name} is in {row.unit}"
            seen += 1
    assert seen == len(re.findall(r"^    +\w+: \S", text, re.MULTILINE)) > 40


def test_later_values_win_and_must_fit() -> None:
    values = parameter_values("mass_estimator", {"time_constant": 0.3, "kp": 1.0}, {"time_constant": 1.0})
    assert values["time_constant"] == 1.0
    assert "kp" not in values
    with pytest.raises(ParameterError, match=r"time_constant is 1; it must be a finite number; write 1\.0"):
        parameter_values("mass_estimator", {"time_constant": 1})
    with pytest.raises(ParameterError, match="time_constant is True"):
        parameter_values("mass_estimator", {"time_constant": True})
    with pytest.raises(ParameterError, match="nominal_payload_center"):
        parameter_values("feedforward", {"nominal_payload_center": ["a"]})
    with pytest.raises(
        ParameterError, match=r"nominal_payload_center is 11\.0; it must lie in \[-10, 10\] m"
    ):
        parameter_values("feedforward", {"nominal_payload_center": [0.0, 11.0, 0.0]})
    with pytest.raises(ParameterError, match="model is 3"):
        parameter_values("feedforward", {"model": 3})
    with pytest.raises(ParameterError, match=r"kp is -1.0; it must lie in \[0, 1000\] N m/rad"):
        parameter_values("motor_controller_3", {"kp": -1.0})


def test_a_default_without_its_row_is_missed_in_words() -> None:
    assert defaults("supervisor")["stuck_time"] == 1.0
    with pytest.raises(
        ParameterError, match=r"no parameter 'no_such_limit': .* cspr_msgs_py.parameters.table"
    ):
        defaults("supervisor")["no_such_limit"]


def test_the_table_names_what_a_bag_can_be_compressed_with() -> None:
    (row,) = (row for row in TABLE["recorder"] if row.name == "compression")
    assert set(row.choices) == {member.value for member in Compression}


def test_nodes_that_are_not_ours_have_no_parameters() -> None:
    assert node_parameters("rviz") == {}
    assert defaults("motor_controller_3") == defaults("motor_controller_K")
    assert "realtime_priority" not in node_parameters("recorder")
