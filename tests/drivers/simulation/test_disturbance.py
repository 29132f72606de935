import numpy as np
import pytest

from cspr_drivers.simulation.disturbance import Disturbance, DisturbanceKind


def through(kind, items):
    disturbance = Disturbance(
        kind,
        garbled=lambda item, generator: -1,
        falsified=lambda item: item + 0.5,
        renewed=lambda old, new: (old, new),
        generator=np.random.default_rng(1),
    )
    return [disturbance(item) for item in items]


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("off", [None] * 25),
        ("stuck", [(0, item) for item in range(25)]),
        ("garbage", [-1] * 25),
        ("wrong", [item + 0.5 for item in range(25)]),
        ("slow", [item if item in (9, 19) else None for item in range(25)]),
        ("delayed", [None] * 10 + [*range(15)]),
    ],
)
def test_what_comes_in_place_of_a_signal(kind, expected):
    assert through(DisturbanceKind(kind), range(25)) == expected


def test_an_intermittent_signal_loses_some_and_changes_none():
    items = through(DisturbanceKind.INTERMITTENT, range(1000))
    assert 400 < items.count(None) < 600
    assert all(came in (None, item) for item, came in enumerate(items))
