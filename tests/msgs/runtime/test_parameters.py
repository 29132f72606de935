from collections.abc import Callable, Iterator

import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from cspr_msgs_py.errors import StartError
from cspr_msgs_py.parameters.row import NodeParameter
from cspr_msgs_py.runtime.parameters import declare, declare_all


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
    assert declare(created, NodeParameter("gain", 1.0, "a gain", minimum=0.0)) == 2.5
    assert declare(created, NodeParameter("motor", 1, "its number", "", 1, 8)) == 1
    assert list(declare(created, NodeParameter("limits", [1.0, 2.0], "some numbers"))) == [1.0, 2.0]
    assert declare(created, NodeParameter("name", "nominal", "a choice")) == "nominal"


def test_the_descriptor_tells_unit_and_range(node) -> None:
    created = node()
    declare(created, NodeParameter("gain", 1.0, "a gain", "N m s", 0.0))
    descriptor = created.describe_parameter("gain")
    assert descriptor.description == "a gain [N m s]"
    assert descriptor.read_only
    (allowed,) = descriptor.floating_point_range
    assert (allowed.from_value, allowed.to_value) == (0.0, float("inf"))


def test_the_range_holds_while_the_node_runs(node) -> None:
    created = node()
    declare(created, NodeParameter("gain", 1.0, "a gain", "", 0.0, 2.0, changeable=True))
    assert not created.set_parameters([Parameter("gain", value=3.0)])[0].successful
    assert created.set_parameters([Parameter("gain", value=2.0)])[0].successful


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        (5, "parameter gain: .*expecting type 'DOUBLE'.*with a decimal point: write 2.0 for 2"),
        ("high", "parameter gain: .*'STRING', expecting type 'DOUBLE'"),
        (-1.0, "parameter gain: .*out of range Min: 0.0, Max: 10.0"),
        (float("nan"), "parameter gain: .*out of range"),
    ],
)
def test_a_wrong_override_is_a_start_error(node, value: object, complaint: str) -> None:
    with pytest.raises(StartError, match=complaint):
        declare(node(gain=value), NodeParameter("gain", 1.0, "a gain", "", 0.0, 10.0))


def test_numbers_are_finite(node) -> None:
    with pytest.raises(StartError, match=r"parameter limits is .*list of finite numbers"):
        declare(node(limits=[1.0, float("inf")]), NodeParameter("limits", [1.0], "some numbers"))
    with pytest.raises(StartError, match="parameter speed is nan; it must be a finite number"):
        declare(node(speed=float("nan")), NodeParameter("speed", 1.0, "without a range"))


def test_a_word_that_is_none_of_the_choices_is_a_start_error(node) -> None:
    row = NodeParameter("model", "dynamic", "what is anticipated", choices=("none", "dynamic"))
    assert row.description == "what is anticipated: none, dynamic"
    with pytest.raises(StartError, match="parameter model is 'all'; it must be one of none, dynamic"):
        declare(node(model="all"), row)


def test_a_node_declares_all_that_the_table_has_for_it(node) -> None:
    created = node(nice=7)
    created.declare_parameter("output", "bag")
    values = declare_all(created, "recorder")
    assert values["nice"] == 7
    assert values["output"] == "bag"  # declared before
    assert created.get_parameter("split_size").value == 0.0
    assert declare_all(node(), "can_drives", control_rate=500.0)["control_rate"] == 500.0
