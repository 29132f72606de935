"""The parameters of the nodes `feedforward` and `mass_estimator`, and the settings that they make.

The nodes declare them from here, and a re-run over a recording reads and checks the same ones without ROS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from cspr_control.errors import SettingError
from cspr_control.estimation.payload import EstimatorSettings
from cspr_control.motors.feedforward import LARGEST_OFFSET, FeedforwardSettings, checked_payload
from cspr_kinematics import bounded_methods
from cspr_msgs_py.vocabulary import FeedforwardModel, PayloadSource


@dataclass(frozen=True)
class NodeParameter:
    """A parameter of a node.

    Attributes
    ----------
    name
        Its name.
    default
        A float, a string or a list of floats; it also sets the type.
    description
        What it does.
    minimum, maximum
        Inclusive range of a float; None for what has none.
    unit
        Of its value.
    """

    name: str
    default: Any
    description: str
    minimum: float | None = None
    maximum: float | None = None
    unit: str = ""

    def checked(self, value: Any) -> Any:
        """Return ``value`` if the parameter may have it.

        Raises
        ------
        SettingError
            If it has another type, is not finite, or lies outside the range.
        """
        if isinstance(self.default, float):
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise SettingError(f"{self.name} is {value!r}; it must be a finite number")
            low = -math.inf if self.minimum is None else self.minimum
            high = math.inf if self.maximum is None else self.maximum
            if not low <= value <= high:
                raise SettingError(
                    f"{self.name} is {value:g}; it must lie in [{low:g}, {high:g}] {self.unit}".rstrip()
                )
            return float(value)
        if isinstance(self.default, str):
            if not isinstance(value, str):
                raise SettingError(f"{self.name} is {value!r}; it must be a word")
            return value
        numbers = list(value) if isinstance(value, list | tuple) else [value]
        if not all(isinstance(n, int | float) and math.isfinite(n) for n in numbers):
            raise SettingError(f"{self.name} is {value!r}; it must be a list of finite numbers")
        return [float(n) for n in numbers]


def _estimator(name: str, description: str, minimum: float, maximum: float, unit: str = "") -> NodeParameter:
    return NodeParameter(name, getattr(EstimatorSettings(), name), description, minimum, maximum, unit)


MASS_ESTIMATOR = (
    _estimator("time_constant", "Time constant of the low-pass filter", 1e-3, 60.0, "s"),
    _estimator("mass_rate_limit", "Fastest change of the published mass", 0.1, 1e4, "kg/s"),
    _estimator("center_rate_limit", "Fastest change of the published centre of mass", 1e-3, 10.0, "m/s"),
    _estimator("max_payload", "Largest payload", 0.1, 1e5, "kg"),
    _estimator("max_offset", "Largest coordinate of the centre of mass", 1e-3, LARGEST_OFFSET, "m"),
    _estimator("minimum_mass", "Payload below which no centre of mass is published", 0.1, 1e3, "kg"),
    _estimator(
        "payload_height",
        "Assumed z of the payload's centre of mass in platform",
        -LARGEST_OFFSET,
        LARGEST_OFFSET,
        "m",
    ),
    _estimator("slack_tension", "Tension below which a cable counts as slack", 0.1, 1e4, "N"),
    _estimator("max_speed", "Speed above which the estimate is held", 1e-3, 100.0, "m/s"),
    _estimator("max_angular_speed", "Angular speed above which the estimate is held", 1e-3, 100.0, "rad/s"),
    _estimator(
        "max_sideways_ratio", "Horizontal force over vertical above which the estimate is held", 1e-3, 10.0
    ),
    _estimator("tensions_timeout", "Age from which cable tensions count as stale", 1e-3, 10.0, "s"),
    _estimator("pose_timeout", "Age from which the platform pose counts as stale", 1e-3, 10.0, "s"),
)

_DEFAULT = FeedforwardSettings()
_MODELS = ", ".join(model.value for model in FeedforwardModel)
_SOURCES = ", ".join(source.value for source in PayloadSource)

FEEDFORWARD = (
    NodeParameter("model", _DEFAULT.model.value, f"What the torque anticipates: {_MODELS}"),
    NodeParameter("payload_source", _DEFAULT.payload_source.value, f"Payload counted on: {_SOURCES}"),
    NodeParameter(
        "nominal_payload_mass",
        _DEFAULT.nominal_payload.mass,
        "Payload assumed without an estimate",
        0.0,
        1e5,
        "kg",
    ),
    NodeParameter("nominal_payload_center", [0.0, 0.0, 0.0], "Its centre of mass in platform", unit="m"),
    NodeParameter("max_payload", _DEFAULT.max_payload, "Largest payload", 0.1, 1e5, "kg"),
    NodeParameter(
        "payload_timeout",
        _DEFAULT.payload_timeout,
        "Age from which an estimate counts as stale",
        1e-3,
        60.0,
        "s",
    ),
    NodeParameter(
        "switch_slew",
        _DEFAULT.switch_slew,
        "Fastest change of a motor's torque by a switch of model, payload or tension method",
        1e-3,
        1e4,
        "N m/s",
    ),
    NodeParameter(
        "tension_method",
        _DEFAULT.tension_method,
        f"How the wrench is distributed over the cables: {', '.join(bounded_methods(8))}",
    ),
)


def estimator_settings(values: Mapping[str, Any]) -> EstimatorSettings:
    """Return the settings of the estimator from the values of `MASS_ESTIMATOR`; raises SettingError."""
    return EstimatorSettings(**values)


def feedforward_settings(number_of_cables: int, values: Mapping[str, Any]) -> FeedforwardSettings:
    """Return the settings of the feed-forward of a robot from the values of `FEEDFORWARD`.

    Raises SettingError or PayloadError.
    """
    try:
        model = FeedforwardModel(values["model"])
        source = PayloadSource(values["payload_source"])
    except ValueError as error:
        raise SettingError(f"{error}; models are {_MODELS}, payload sources {_SOURCES}") from error
    methods = bounded_methods(number_of_cables)
    if values["tension_method"] not in methods:
        raise SettingError(
            f"tension_method is {values['tension_method']!r}; for this robot there are {', '.join(methods)}"
        )
    return FeedforwardSettings(
        model=model,
        payload_source=source,
        nominal_payload=checked_payload(
            "nominal payload",
            values["nominal_payload_mass"],
            values["nominal_payload_center"],
            values["max_payload"],
        ),
        max_payload=values["max_payload"],
        payload_timeout=values["payload_timeout"],
        switch_slew=values["switch_slew"],
        tension_method=values["tension_method"],
    )


def parameter_values(parameters: Sequence[NodeParameter], *given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the value of each parameter: the default, or the last one given.

    Names that are not in the table are passed over: a parameter file serves many nodes. Use `known_parameter`
    for names that somebody typed.

    Raises
    ------
    SettingError
        If a value does not fit its parameter.
    """
    values = {parameter.name: parameter.default for parameter in parameters}
    for mapping in given:
        for parameter in parameters:
            if parameter.name in mapping:
                values[parameter.name] = parameter.checked(mapping[parameter.name])
    return values


def known_parameter(node: str, parameters: Sequence[NodeParameter], name: str) -> NodeParameter:
    """Return the parameter of that name; raises SettingError, with what was probably meant, if there is none."""
    names = [parameter.name for parameter in parameters]
    if name not in names:
        close = get_close_matches(name, names, n=1)
        hint = f"; did you mean {close[0]}?" if close else f"; it has {', '.join(names)}"
        raise SettingError(f"{node} has no parameter {name!r}{hint}")
    return parameters[names.index(name)]
