"""Exceptions of this package, and how long the text of one may be."""

import re


def shortened(text: str) -> str:
    """Return the text of an error without the rest of a word that is longer than paths are: it hides what is said."""
    return re.sub(r"\S{201,}", lambda word: f"{word[0][:100]}...", text)


class MessagesError(Exception):
    """Root of the errors that this package raises."""


class MessageError(MessagesError):
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
