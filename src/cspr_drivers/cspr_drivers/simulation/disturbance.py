"""What can happen to a signal on its way, whatever it carries: seven kinds, as PX4's failure injection has them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from enum import Enum
from typing import Generic, TypeVar

import numpy as np

Item = TypeVar("Item")

_EVERY = 10  # one of so many gets through, when it is slow
_BEHIND = 10  # so many come in between, when it is delayed
_LOST = 0.5  # share of what is lost, when it is intermittent


class DisturbanceKind(Enum):
    """The kinds by name, which is the value, and with their meaning in words."""

    OFF = "off", "nothing comes any more"
    STUCK = "stuck", "what came last comes again and again, in time"
    GARBAGE = "garbage", "random bytes come"
    WRONG = "wrong", "a value in it is wrong"
    SLOW = "slow", f"one in {_EVERY} comes"
    DELAYED = "delayed", f"each comes {_BEHIND} later"
    INTERMITTENT = "intermittent", f"{100 * _LOST:.0f} % get lost, at random"

    meaning: str

    def __new__(cls, name: str, meaning: str) -> DisturbanceKind:
        """Make the name the value of a kind."""
        kind = object.__new__(cls)
        kind._value_ = name
        kind.meaning = meaning
        return kind


class Disturbance(Generic[Item]):
    """One kind, from the first item that it is given on.

    Parameters
    ----------
    kind
        What happens.
    garbled, falsified
        Make of an item one of random bytes, and one with a wrong value.
    renewed
        Makes of an old item one that looks as new as another: with its stamp, where items have one.
    generator
        Of what is random.
    """

    def __init__(
        self,
        kind: DisturbanceKind,
        garbled: Callable[[Item, np.random.Generator], Item | None],
        falsified: Callable[[Item], Item],
        renewed: Callable[[Item, Item], Item],
        generator: np.random.Generator,
    ) -> None:
        self._kind = kind
        self._garbled = garbled
        self._falsified = falsified
        self._renewed = renewed
        self._generator = generator
        self._count = 0
        self._kept: deque[Item] = deque()

    def __call__(self, item: Item) -> Item | None:
        """Return what comes in place of an item, None for nothing."""
        self._count += 1
        match self._kind:
            case DisturbanceKind.OFF:
                return None
            case DisturbanceKind.STUCK:
                if not self._kept:
                    self._kept.append(item)
                return self._renewed(self._kept[0], item)
            case DisturbanceKind.GARBAGE:
                return self._garbled(item, self._generator)
            case DisturbanceKind.WRONG:
                return self._falsified(item)
            case DisturbanceKind.SLOW:
                return item if self._count % _EVERY == 0 else None
            case DisturbanceKind.DELAYED:
                self._kept.append(item)
                return self._kept.popleft() if len(self._kept) > _BEHIND else None
            case DisturbanceKind.INTERMITTENT:
                return item if self._generator.random() >= _LOST else None
