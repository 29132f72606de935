"""Single keys from the terminal."""

import os
import select
import sys
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

RIGHT_ARROW: Final = "\x1b[C"


class Keyboard:
    """Keys as they are pressed; without a terminal there are none."""

    def __init__(self, descriptor: int | None) -> None:
        self._descriptor = descriptor

    def wait(self, timeout: float) -> str:
        """Return what was pressed, after waiting for `timeout` seconds at most; empty for nothing."""
        if self._descriptor is None:
            time.sleep(timeout)
            return ""
        if not select.select([self._descriptor], [], [], timeout)[0]:
            return ""
        pressed = os.read(self._descriptor, 16)
        if not pressed:  # the terminal is gone
            self._descriptor = None
        return pressed.decode(errors="replace")


@contextmanager
def keyboard() -> Iterator[Keyboard]:
    """Give the keys of the terminal, not only whole lines, while the block runs; none if there is no terminal."""
    if not sys.stdin.isatty():
        yield Keyboard(None)
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield Keyboard(descriptor)
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
