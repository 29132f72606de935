"""Watch over the transitions of the drives: each must happen within its time limit."""

from __future__ import annotations

from collections.abc import Sequence

from cspr_drivers.canopen.cia402 import State, Transition, transition
from cspr_drivers.config.timeouts import Timeouts


class TransitionWatch:
    """Since when each drive has had a transition to make. Times are arguments, s.

    Parameters
    ----------
    count
        Number of drives.
    timeouts
        `transition`, `enable` and `stop` are the limits.
    """

    def __init__(self, count: int, timeouts: Timeouts) -> None:
        self._timeouts = timeouts
        self._asked: list[tuple[Transition, float] | None] = [None] * count

    def clear(self) -> None:
        """Forget all transitions under way."""
        self._asked = [None] * len(self._asked)

    def overdue(self, states: Sequence[State | None], words: Sequence[int], time: float) -> dict[int, str]:
        """Return, by index and in words, which drives have not made the transition that was commanded.

        Parameters
        ----------
        states
            Of the drives, `None` for one that reports none.
        words
            Control words that they have.
        """
        late = {}
        for index, (state, word) in enumerate(zip(states, words, strict=True)):
            wanted = None if state is None else transition(state, word)
            asked = self._asked[index]
            if wanted is None:
                self._asked[index] = None
            elif asked is None or asked[0] is not wanted:
                self._asked[index] = (wanted, time)
            elif time - asked[1] > (limit := getattr(self._timeouts, wanted.wait.value)):
                late[index] = (
                    f"still in {wanted.source.value} after {limit:g} s: "
                    f"no transition {wanted.number} to {wanted.target.value}"
                )
        return late
