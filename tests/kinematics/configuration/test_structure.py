"""Mappings that do not fit the dataclass they are meant for, and what is said of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta

from cspr_kinematics.configuration.structure import NotNegative, Positive, Text, Vector, located, structured
from cspr_kinematics.errors import ConfigurationFileError, InvalidInputError


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Wheel:
    radius: Positive
    spokes: Annotated[int, Meta(ge=3, le=36)]
    axis: Vector = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Cart:
    name: Text
    wheels: Annotated[list[Wheel], Meta(min_length=1)]
    spare: dict[str, Wheel]
    colour: Colour
    gear: Literal[1, -1]
    load: NotNegative | list[NotNegative]
    driver: Wheel | None
    seats: list[NotNegative] | None
    step: Annotated[float, Meta(gt=0.0, le=0.5, description="or it tips over")]
    tags: list[str]


def cart(**changes: Any) -> dict[str, Any]:
    wheel = {"radius": 1, "spokes": 12}
    content = {
        "name": "one", "wheels": [wheel, dict(wheel)], "spare": {"left": dict(wheel)}, "colour": "blue", "gear": -1,
        "load": 5.0, "driver": None, "seats": None, "step": 0.1, "tags": [],
    }  # fmt: skip
    return content | changes


def test_a_mapping_that_fits() -> None:
    built = structured(Cart, cart(load=[1, 2.5]), "cart.yaml")
    assert built.wheels[1] == Wheel(1.0, 12)
    assert built.spare["left"].axis == (0.0, 1.0, 0.0)
    assert (built.colour, built.gear, built.load, built.driver) == (Colour.BLUE, -1, [1.0, 2.5], None)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"Gear": 1},
            "cart.yaml: Gear = 1: unknown key; did you mean gear? Known here: colour, driver, gear",
        ),
        ({"zebra": 1}, "cart.yaml: zebra = 1: unknown key; known here: colour, driver"),
        ({5: 1}, "cart.yaml: 5 = 1: unknown key"),
        ({"wheels": [{"radius": 1.0, "spoke": 3}]}, "wheels[0].spoke = 3: unknown key; did you mean spokes?"),
        ({"wheels": [{"radius": 1.0}]}, "cart.yaml: wheels[0].spokes: is missing"),
        ({"wheels": []}, "wheels = []: must be a list of at least one element"),
        ({"wheels": {}}, "wheels = {}: must be a list"),
        ({"seats": 2.0}, "seats = 2.0: must be a list"),
        ({"seats": {"left": 2.0}}, "seats = {'left': 2.0}: must be a list"),
        ({"seats": [-1.0]}, "seats[0] = -1.0: must not be negative"),
        ({"spare": {"left": 3}}, "spare.left = 3: must be a mapping of keys to values: radius, spokes, axis"),
        ({"spare": {1: {}}}, "spare = {1: {}}: its keys must be texts"),
        ({"spare": []}, "spare = []: must be a mapping of keys to values"),
        ({"driver": {"radius": 0, "spokes": 3}}, "driver.radius = 0: must be positive"),
        (
            {"driver": {"radius": 1.0, "spokes": 3, "axis": [1.0]}},
            "driver.axis = [1.0]: has 1 elements where 3 are needed",
        ),
        ({"driver": {"radius": 1.0, "spokes": 2.0}}, "spokes = 2.0: must be a whole number from 3 to 36"),
        ({"colour": "green"}, "colour = 'green': must be one of red, blue"),
        ({"gear": True}, "gear = True: must be one of 1, -1"),
        ({"load": [1.0, -1.0]}, "load[1] = -1.0: must not be negative"),
        (
            {"load": "1e-3"},
            "must be a finite number; without quotes",
        ),
        ({"load": float("inf")}, "load = inf: must be a finite number"),
        ({"load": [1.0, float("nan")]}, "load[1] = nan: must be a finite number"),
        ({"load": 10**400}, "...: must be a finite number"),
        ({"step": 0.6}, "step = 0.6: must be at most 0.5, or it tips over"),
        ({"tags": "all"}, "tags = 'all': must be a list of texts"),
        ({"tags": [""], "name": " "}, "name = ' ': must be a non-empty text"),
    ],
    ids=str,
)
def test_what_does_not_fit(changes: dict[Any, Any], words: str) -> None:
    with pytest.raises(ConfigurationFileError) as caught:
        structured(Cart, cart() | changes, "cart.yaml")
    assert words in str(caught.value)


def test_the_path_of_a_part_is_given() -> None:
    with pytest.raises(ConfigurationFileError, match=r"some\.yaml: a\.b\.spokes: is missing"):
        structured(Wheel, {"radius": 1.0}, "some.yaml", "a.b")
    with (
        pytest.raises(ConfigurationFileError, match=r"some\.yaml: a\.mass = 0: too light"),
        located("some.yaml", "a"),
    ):
        raise InvalidInputError("mass", 0, "too light")
