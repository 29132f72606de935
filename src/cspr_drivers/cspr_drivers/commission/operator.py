"""The questions to the person at the robot, and how the answers are understood."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from cspr_drivers.errors import ConfigurationError, DriverError

_T = TypeVar("_T")


class WalkStoppedError(DriverError):
    """The operator has ended the commissioning; what was found out until then is kept."""


class Operator:
    """A person at a terminal; subclasses answer in place of one.

    Each kind of question has a method; what cannot be understood is asked again.
    """

    def tell(self, text: str) -> None:
        """Show a text."""
        print(text, flush=True)

    def ask(self, key: str, question: str, default: str) -> str:
        """Return the answer to a question.

        Parameters
        ----------
        key
            Name of the question, the same in every walk.
        question
            The question.
        default
            Answer that an empty line stands for; empty when there is none.

        Raises
        ------
        WalkStoppedError
            If nobody answers any more.
        """
        try:
            return input(f"{question} ")
        except EOFError:
            raise WalkStoppedError(f"no answer to: {question.strip()}") from None

    def refuse(self, key: str, problem: str) -> None:
        """Say why an answer cannot be used; the question is then asked again.

        Raises
        ------
        ConfigurationError
            If nobody could give another answer.
        """
        self.tell(f"   {problem}")

    def yes(self, key: str, question: str) -> bool:
        """Return whether the answer is yes, which an empty line stands for."""

        def read(answer: str) -> bool:
            word = answer.lower()
            if word and "yes".startswith(word):
                return True
            if word and "no".startswith(word):
                return False
            raise ValueError("answer yes or no")

        return self._until_understood(key, f"{question} [yes]", "yes", read)

    def done(self, key: str, request: str) -> None:
        """Ask for something to be done, and wait until it is.

        Raises
        ------
        WalkStoppedError
            If it is not to be done.
        """
        if not self.yes(key, f"{request} Done?"):
            raise WalkStoppedError(f"stopped at: {request}")

    def choice(self, key: str, question: str, choices: Sequence[str], default: str = "") -> str:
        """Return one of several words."""

        def read(answer: str) -> str:
            if answer not in choices:
                raise ValueError("answer one of " + ", ".join(choices))
            return answer

        shown = f"{question} ({'/'.join(choices)})" + (f" [{default}]" if default else "")
        return self._until_understood(key, shown, default, read)

    def number(self, key: str, question: str, minimum: float, maximum: float) -> float:
        """Return a number in a closed interval."""

        def read(answer: str) -> float:
            value = float(answer)
            if not math.isfinite(value) or not minimum <= value <= maximum:
                raise ValueError(f"answer a number from {minimum:g} to {maximum:g}")
            return value

        return self._until_understood(key, question, "", read)

    def numbers(
        self, key: str, question: str, minimum: float, maximum: float, default: str
    ) -> tuple[float, ...]:
        """Return one or more numbers in a closed interval, with spaces between them."""

        def read(answer: str) -> tuple[float, ...]:
            values = tuple(float(word) for word in answer.split())
            if not values or not all(math.isfinite(v) and minimum <= v <= maximum for v in values):
                raise ValueError(f"answer numbers from {minimum:g} to {maximum:g}, with spaces between them")
            return values

        shown = f"{question} [{default}]" if default else question
        return self._until_understood(key, shown, default, read)

    def _until_understood(self, key: str, question: str, default: str, read: Callable[[str], _T]) -> _T:
        while True:
            answer = self.ask(key, question, default).strip() or default
            try:
                return read(answer)
            except ValueError as error:
                self.refuse(key, f"'{answer}': {error}")


QUESTIONS = (
    *("resume", "keep", "write"),  # the walk as a whole
    *("supported", "turn", "winch", "way", "mark", "measured"),  # winches and their scales
    *("pull", "again", "cell", "slack", "weights", "hang", "taken-off"),  # load cells and brakes
    "home",
)
"""What a walk asks: the first words of the keys, which a device or a number of a cable may follow after a point."""


class FileOperator(Operator):
    """Answers from a mapping of keys to answers, in place of a person.

    Parameters
    ----------
    answers
        An answer for each key, or a list of answers for a key that comes up more than once.
    source
        Where they come from, for messages.
    """

    def __init__(self, answers: Mapping[str, object], source: str) -> None:
        self._answers = {
            key: list(value) if isinstance(value, list) else value for key, value in answers.items()
        }
        self._source = source

    def ask(self, key: str, question: str, default: str) -> str:
        """Return the answer of the file, or the default where the file has none.

        Raises
        ------
        ConfigurationError
            If there is neither.
        """
        answer = self._answers.get(key, default)
        if isinstance(answer, list):
            answer = answer.pop(0) if answer else default
        if answer == "":
            raise ConfigurationError(f"{self._source}: {key} is missing: {question}")
        text = {True: "yes", False: "no"}[answer] if isinstance(answer, bool) else str(answer)
        self.tell(f"{question} {text}")
        return text

    def refuse(self, key: str, problem: str) -> None:
        """End the walk: the file would give the same answer again."""
        raise ConfigurationError(f"{self._source}: {key}: {problem}")
