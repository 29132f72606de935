"""Exceptions of this package, and how long the text of one may be."""

import re
import traceback
from pathlib import PurePath


def shortened(text: str) -> str:
    """Return the text of an error without the rest of a word that is longer than paths are: it hides what is said."""
    return re.sub(r"\S{201,}", lambda word: f"{word[0][:100]}...", text)


def failure_text(error: Exception) -> str:
    """Return in one line what went wrong, and where."""
    text = shortened(" ".join(str(error).split()))
    places = traceback.extract_tb(error.__traceback__)
    where = f" ({PurePath(places[-1].filename).name}, line {places[-1].lineno})" if places else ""
    return f"{type(error).__name__}: {text}{where}"


class MessagesError(Exception):
    """Root of the errors that this package raises."""


class MessageError(MessagesError, ValueError):
    """A message does not hold what its topic promises."""


class BagError(MessagesError):
    """A bag cannot be written or read."""


class ParameterError(MessagesError):
    """A parameter is unknown, or has a value that it may not have."""


class StartError(MessagesError):
    """A node cannot start; the text says what to change."""


class NodeError(MessagesError):
    """A node of a process that has several could not go on; the text is its name, the cause what went wrong."""


class BagWarning(UserWarning):
    """A bag can be read, but not all of it is there."""
