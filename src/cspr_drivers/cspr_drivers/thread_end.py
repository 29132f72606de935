"""A thread of a driver that ends by an error: nobody may find out by what does not happen any more."""

from __future__ import annotations

import traceback
from collections.abc import Callable

EndHandler = Callable[[str], None]
"""Told, in the thread that ends, which one it is and why, in words."""


def telling(target: Callable[[], None], name: str, told: EndHandler) -> Callable[[], None]:
    """Return what a thread of some name is to run instead of `target`, so that its end by an error is told.

    The traceback goes to stderr. What asks Python to end a thread, `SystemExit`, is no error.
    """

    def run() -> None:
        try:
            target()
        except SystemExit:
            raise
        except BaseException as error:
            traceback.print_exception(error)
            told(end_text(name, error))

    return run


def end_text(name: str, error: BaseException) -> str:
    """Return in words which thread has ended, and by which error."""
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return f"the driver's thread '{name}' has ended ({reason}): start the driver again"
