from collections.abc import Callable, Iterator

import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from cspr_msgs_py.errors import StartError
from cspr_msgs_py.runtime.parameters import declare


@pytest.fixture
def node(context: Context) -> Iterator[Callable[..., Node]]:
    nodes: list[Node] = []

    def create(**overrides: object) -> Node:
        parameters = [Parameter(name, value=value) for name, value in overrides.items()]
        nodes.append(Node("parameters", context=context, parameter_overrides=parameters))
        return nodes[-1]

    yield create
    for created in nodes:
        created.destroy_node()


def test_the_value_is_the_default_or_the_override(node) -> None:
    created = node(gain=2.5)
    assert declare(created, "gain", 1.0, "a gain", minimum=0.0) == 2.5
    assert declare(created, "motor", 1, "its number", minimum=1, maximum=8) == 1
    assert list(declare(created, "limits", [1.0, 2.0], "some numbers")) == [1.0, 2.0]
    assert declare(created, "name", "nominal", "a choice") == "nominal"


def test_the_descriptor_tells_unit_and_range(node) -> None:
    created = node()
    declare(created, "gain", 1.0, "a gain", minimum=0.0, unit="N m s", read_only=True)
    descriptor = created.describe_parameter("gain")
    assert descriptor.description == "a gain [N m s]"
    assert descriptor.read_only
    (allowed,) = descriptor.floating_point_range
    assert (allowed.from_value, allowed.to_value) == (0.0, float("inf"))


def test_the_range_holds_while_the_node_runs(node) -> None:
    created = node()
    declare(created, "gain", 1.0, "a gain", minimum=0.0, maximum=2.0)
    assert not created.set_parameters([Parameter("gain", value=3.0)])[0].successful
    assert created.set_parameters([Parameter("gain", value=2.0)])[0].successful


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        (5, "parameter gain: .*expecting type 'DOUBLE'.*with a decimal point: 5.0"),
        ("high", "parameter gain: .*'STRING', expecting type 'DOUBLE'"),
        (-1.0, "parameter gain: .*out of range Min: 0.0, Max: 10.0"),
        (float("nan"), "parameter gain: .*out of range"),
    ],
)
def test_a_wrong_override_is_a_start_error(node, value: object, complaint: str) -> None:
    with pytest.raises(StartError, match=complaint):
        declare(node(gain=value), "gain", 1.0, "a gain", minimum=0.0, maximum=10.0)


def test_numbers_are_finite(node) -> None:
    with pytest.raises(StartError, match=r"parameter limits: .*not a finite number"):
        declare(node(limits=[1.0, float("inf")]), "limits", [1.0], "some numbers")
    with pytest.raises(StartError, match="parameter speed: nan is not a finite number"):
        declare(node(speed=float("nan")), "speed", 1.0, "without a range")
