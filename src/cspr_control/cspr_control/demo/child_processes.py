"""Processes that belong together: started with a log each, watched, and ended together."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from types import TracebackType

from cspr_control.errors import ControlError

_LAST_LINES = 12  # of its log that an error shows


class ChildProcesses:
    """Python modules run as child processes, ended in the reverse order of their start.

    Each child is the leader of a session of its own, so that a Ctrl-C in the terminal reaches the parent alone and
    the parent decides in which order the children end. Used as a context manager, no child outlives it.

    Parameters
    ----------
    log_directory
        Where `<name>.log` takes what each child prints.
    grace
        Time that a child has to end after SIGINT before it is killed, s.
    """

    def __init__(self, log_directory: Path, grace: float = 8.0) -> None:
        self._log_directory = log_directory
        self._grace = grace
        self._children: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> ChildProcesses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    def start(self, name: str, module: str, arguments: Sequence[str] = ()) -> None:
        """Start `python -m module arguments...` under a name."""
        self._log_directory.mkdir(parents=True, exist_ok=True)
        with open(self.log(name), "wb") as log:
            self._children[name] = subprocess.Popen(
                [sys.executable, "-u", "-m", module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def log(self, name: str) -> Path:
        """Path of a child's log."""
        return self._log_directory / f"{name}.log"

    def check(self, names: Collection[str] | None = None) -> None:
        """Raise ControlError, with its last output, if a child has ended; one of those named, where some are."""
        for name, child in self._children.items():
            if (names is None or name in names) and (status := child.poll()) is not None:
                raise ControlError(
                    f"{name} ended with {_status_text(status)}; its last output (all of it: {self.log(name)}):\n"
                    f"{self._last_words(name) or '(it said nothing)'}"
                )

    def pids(self) -> dict[str, int]:
        """Process ids by name."""
        return {name: child.pid for name, child in self._children.items()}

    @contextlib.contextmanager
    def frozen(self, name: str) -> Iterator[None]:
        """Let a child stand still, as a debugger or a computer that swaps would, for as long as the context lasts."""
        child = self._children[name]
        child.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            child.send_signal(signal.SIGCONT)

    def end(self) -> None:
        """End every child: SIGINT in the reverse order of the start, SIGKILL after the grace period."""
        for name in reversed(list(self._children)):
            child = self._children.pop(name)
            if child.poll() is not None:
                continue
            with contextlib.suppress(ProcessLookupError):
                child.send_signal(signal.SIGINT)
            deadline = time.monotonic() + self._grace
            # a second Ctrl-C must not leave children behind, so it only shortens the grace
            while child.poll() is None and time.monotonic() < deadline:
                try:
                    child.wait(timeout=max(0.05, deadline - time.monotonic()))
                except subprocess.TimeoutExpired:
                    break
                except KeyboardInterrupt:
                    deadline = min(deadline, time.monotonic() + 2.0)
            if child.poll() is None:
                child.kill()
                child.wait()

    def _last_words(self, name: str) -> str:
        text = self.log(name).read_text(encoding="utf-8", errors="replace")
        return "\n".join(f"  {line}" for line in text.strip().splitlines()[-_LAST_LINES:])


def _status_text(status: int) -> str:
    if status < 0:
        return f"signal {signal.Signals(-status).name}"
    return f"exit status {status}"
