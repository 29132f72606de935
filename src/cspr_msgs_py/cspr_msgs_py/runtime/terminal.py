"""Single keys from the terminal, and a progress bar on one of its lines."""

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

_WIDTH: Final = 30  # characters of the bar


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


def progress_line(share: float | None, text: str = "") -> None:
    """Show how much is done on the line of the cursor; nothing when stderr is no terminal.

    Parameters
    ----------
    share
        From 0 to 1; None to end the line.
    text
        What stands behind the bar.
    """
    if not sys.stderr.isatty():
        return
    if share is None:
        print(file=sys.stderr)
        return
    full = round(_WIDTH * min(max(share, 0.0), 1.0))
    print(f"\r\033[K[{'#' * full}{'.' * (_WIDTH - full)}] {text}", end="", file=sys.stderr, flush=True)
