"""The operator of the demo on a slow machine: it waits by the machine's time."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from cspr_control.nodes.demo_operator import Operator
from cspr_msgs_py.vocabulary import RobotState


class Client:
    """A graph that stops `duration` s after it was asked, and whose services never answer."""

    def __init__(self, duration: float) -> None:
        self.now, self._end = 0.0, duration
        self.asked: list[str] = []

    @property
    def robot_state(self) -> RobotState:
        return RobotState.DISABLED if self.now >= self._end else RobotState.ENABLED

    def trigger(self, service: str) -> Any:
        self.asked.append(service)
        return SimpleNamespace(done=lambda: False)


@pytest.fixture
def operator() -> Any:
    def create(client: Client, speed: float) -> Operator:
        def sleep(duration: float) -> None:
            client.now += duration

        silent = SimpleNamespace(check=lambda *_: None, show=lambda *_: None)
        return Operator(client, silent, silent, speed, lambda: client.now, sleep)  # type: ignore[arg-type]

    return create


@pytest.mark.parametrize(("speed", "limit"), [(1.0, 4.0), (0.1, 40.0)])
def test_the_robot_comes_to_rest_at_its_own_pace_before_its_processes_end(
    operator: Any, speed: float, limit: float
) -> None:
    client = Client(0.9 * limit)
    operator(client, speed).make_safe()
    assert client.asked == ["/supervisor/stop"]
    assert client.robot_state is RobotState.DISABLED
    late = Client(2.0 * limit)
    operator(late, speed).make_safe()
    assert late.now == pytest.approx(limit, abs=0.1)


def test_an_answer_may_take_as_long_as_the_machine_is_slow(operator: Any) -> None:
    client = Client(0.0)
    assert not operator(client, 0.1)._ask("/supervisor/enable")
    assert client.now == pytest.approx(50.0, abs=0.1)
