"""Keeps gains with which the loop could become unstable from a running graph, without costing it a control cycle."""

from __future__ import annotations

import subprocess
import time
from typing import Any

from cspr_control.errors import StabilityError
from cspr_control.motors.motor_control import MotorGains
from cspr_control.stability.background import start_computing
from cspr_control.stability.kept_results import KeptResult, kept_result
from cspr_control.stability.loop_configuration import LoopConfiguration
from cspr_control.stability.scan import Margin
from cspr_control.stability.verdict import Verdict, verdict
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.samples import Status

_POLL = 0.05  # s


class StabilityGuard:
    """What is known of the stability of a loop, from a file or from a process that computes it.

    Nothing is computed here: the answers cost a look into a file until all is known, and none from then on.

    Parameters
    ----------
    loop
        With the settings with which the graph starts.
    """

    def __init__(self, loop: LoopConfiguration) -> None:
        self._loop = loop
        self._known = kept_result(loop)
        self._process: subprocess.Popen[bytes] | None = None
        self._failure = ""
        self._asked = False  # for the map of safe gains
        if self._known is None:
            self._process = start_computing(loop)

    def wait(self) -> Verdict:
        """Wait until the margins are known, some seconds for a new configuration; for before anything moves."""
        while self._newest() is None and not self._failure:
            time.sleep(_POLL)
        return self.verdict

    def require(self, gains: MotorGains) -> None:
        """Refuse gains that have not been computed safe.

        Gains that nobody can judge, because the cables' stiffness is not known, are not refused.

        Raises
        ------
        StabilityError
            If they are not safe, or it is not known yet.
        """
        known = self._newest()
        if known is not None and known.safe_gains is not None:
            known.safe_gains.require(gains)
        elif not self._failure:
            if known is not None and self._process is None:
                # Not before: on a computer of two CPUs it costs the control cycle more than it should.
                self._asked, self._process = True, start_computing(self._loop, safe_gains=True)
            raise StabilityError(
                "which gains are stable is being computed now, once for a configuration: try again in a minute, or "
                "run cspr stability before"
            )

    @property
    def verdict(self) -> Verdict:
        """On the settings with which the graph started."""
        known = self._newest()
        if known is not None:
            return verdict(known.report, self._loop)
        if self._failure:
            return Verdict(Level.WARN, f"the stability is not known: {self._failure}")
        return Verdict(Level.STALE, "the stability is being computed")

    def status(self) -> Status:
        """Return margins and verdict, for ``/diagnostics``."""
        known, judged = self._newest(), self.verdict
        values: dict[str, Any] = {}
        if known is not None:
            for name, words in known.report.words().items():
                margin: Margin = getattr(known.report, name)
                values[name] = words
                values[f"{name}_at"] = "" if margin.place is None else str(margin.place)
            missing = "computing" if self._asked else "not asked for yet"
            values["safe_gains"] = missing if known.safe_gains is None else "known"
        return Status.of("stability", judged.level, str(judged), values)

    def close(self) -> None:
        """End the process that computes, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def _newest(self) -> KeptResult | None:
        """Return what is known by now."""
        if self._process is None:
            return self._known
        ended = self._process.poll() is not None
        self._known = kept_result(self._loop) or self._known
        if ended:
            done = self._known is not None and not (self._asked and self._known.safe_gains is None)
            words = self._last_words()
            self._failure = "" if done else words
        return self._known

    def _last_words(self) -> str:
        process, self._process = self._process, None
        words = process.communicate()[1].decode(errors="replace").strip() if process is not None else ""
        return words.rpartition("\n")[2] or "the process that computes it has ended"
