"""Parameter files without ROS."""

import pytest

from cspr_control.errors import SettingError
from cspr_control.estimation.payload import EstimatorSettings
from cspr_control.parameters.file import ParameterFile
from cspr_control.parameters.tables import (
    FEEDFORWARD,
    MASS_ESTIMATOR,
    estimator_settings,
    feedforward_settings,
    known_parameter,
    parameter_values,
)

TEXT = """
/**:
  ros__parameters: {kp: 2.0, max_payload: 300.0}
/mass_estimator:
  ros__parameters: {max_payload: 250.0, time_constant: 0.3}
supervisor:
  ros__parameters:
    max_age: {setpoint: 0.2}
"""


def test_what_is_said_of_a_node_beats_what_is_said_of_all():
    file = ParameterFile.parse(TEXT, "control.yaml")
    assert file.of("mass_estimator") == {"kp": 2.0, "max_payload": 250.0, "time_constant": 0.3}
    assert file.of("feedforward") == {"kp": 2.0, "max_payload": 300.0}
    assert file.of("supervisor")["max_age.setpoint"] == 0.2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [", "not YAML"),
        ("5", "maps no names"),
        ("node: {kp: 1.0}", "node has no ros__parameters"),
    ],
)
def test_what_is_no_parameter_file_is_refused_by_name(text, words):
    with pytest.raises(SettingError, match=words) as error:
        ParameterFile.parse(text, "odd.yaml")
    assert "odd.yaml" in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(SettingError, match=r"none\.yaml"):
        ParameterFile.from_yaml(tmp_path / "none.yaml")


def test_the_shipped_file_makes_settings(robot_file):
    file = ParameterFile.from_yaml(robot_file.parent / "control.yaml")
    estimator = estimator_settings(parameter_values(MASS_ESTIMATOR, file.of("mass_estimator")))
    assert estimator.time_constant == 0.4
    assert feedforward_settings(8, parameter_values(FEEDFORWARD, file.of("feedforward"))).switch_slew == 2.0


def test_defaults_are_those_of_the_settings():
    assert estimator_settings(parameter_values(MASS_ESTIMATOR)) == EstimatorSettings()


def test_later_values_win_and_must_fit():
    values = parameter_values(MASS_ESTIMATOR, {"time_constant": 0.3, "kp": 1.0}, {"time_constant": 1})
    assert values["time_constant"] == 1.0
    assert "kp" not in values
    with pytest.raises(SettingError, match="time_constant is True"):
        parameter_values(MASS_ESTIMATOR, {"time_constant": True})
    with pytest.raises(SettingError, match="nominal_payload_center"):
        parameter_values(FEEDFORWARD, {"nominal_payload_center": ["a"]})
    with pytest.raises(SettingError, match="model is 3"):
        parameter_values(FEEDFORWARD, {"model": 3})
    with pytest.raises(SettingError, match="it has model, payload_source"):
        known_parameter("feedforward", FEEDFORWARD, "zzz")
