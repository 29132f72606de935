"""Bookkeeping of the control cycle: who answered the SYNC, which commands came in time, how long it took.

A cycle runs from one SYNC to the next. It is *missed* when not all m fresh commands were put on the bus in
it; a command is fresh when it answers the motor states of that very cycle. The latency of a cycle runs from
its last feedback frame to the last of its m commands. Times are arguments, in seconds of one monotonic clock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from cspr_drivers.cycle.latency import NO_LATENCY, LatencyHistogram, LatencySummary


@dataclass(frozen=True)
class AnswerCounts:
    """How one device has answered the SYNC frames since the last `clear`.

    Attributes
    ----------
    answered, missing
        Cycles with its answer in time, and without.
    late
        Answers that came when the next cycle had begun; what they said was not used.
    """

    answered: int
    late: int
    missing: int


@dataclass
class CycleStatistics:
    """Counts since the last `clear`.

    Attributes
    ----------
    cycles
        Cycles that have ended.
    missed_cycles
        Those of them without m fresh commands in time.
    incomplete_cycles
        Those of them in which not all drives answered; these are missed as well.
    late_commands
        Commands that answered an earlier cycle.
    repeated_feedback
        Feedback frames of a drive that had already answered in the cycle.
    late_feedback
        Feedback frames that answered the SYNC of an earlier cycle; their positions were not used.
    latency
        Of the cycles that were not missed.
    answers
        Of each drive.
    """

    cycles: int = 0
    missed_cycles: int = 0
    incomplete_cycles: int = 0
    late_commands: int = 0
    repeated_feedback: int = 0
    late_feedback: int = 0
    latency: LatencySummary = NO_LATENCY
    answers: tuple[AnswerCounts, ...] = ()


class CycleWatch:
    """The present cycle and the statistics of those before it.

    Parameters
    ----------
    motors
        Number m of drives that answer, and of commands that each cycle wants.
    frames
        Frames in which each drive answers. Frame f of drive i has the index i + f m.
    """

    def __init__(self, motors: int, frames: int = 1) -> None:
        self._motors = motors
        self._frames = motors * frames
        self._owed = [0] * self._frames  # answers to earlier SYNC frames that may still come
        self._taken_as_late: set[int] = set()
        self._answered: set[int] = set()
        self._commanded: set[int] = set()
        self._last_feedback = self._last_command = 0.0
        self._begun = False
        self.clear()

    def clear(self) -> None:
        """Restart the statistics; the present cycle goes on and is counted when it ends."""
        self._counts = CycleStatistics()
        self._histogram = LatencyHistogram()
        self._ended = 0
        self._missing = [0] * self._frames
        self._late = [0] * self._frames

    def sync(self, counted: bool) -> None:
        """End the present cycle, which enters the statistics when `counted`, and begin the next."""
        self._ended += self._begun
        if counted:
            self._counts.cycles += 1
            if len(self._answered) < self._frames:
                self._counts.incomplete_cycles += 1
            if len(self._commanded) < self._motors:
                self._counts.missed_cycles += 1
            else:
                self._histogram.add(max(0.0, self._last_command - self._last_feedback))
        for index in range(self._frames):
            if index in self._answered or index in self._taken_as_late:
                # the late answer has come, or nothing followed what was taken for it: then it was lost, not late
                self._owed[index] = 0
            elif self._begun:
                self._owed[index] += 1
                self._missing[index] += 1
        self._begun = True
        self._taken_as_late = set()
        self._answered = set()
        self._commanded = set()
        self._last_feedback = self._last_command = 0.0

    def is_late(self, index: int) -> bool:
        """Whether feedback that has just come answers an earlier SYNC, and so holds an earlier position.

        A drive answers each SYNC once, in order: after a cycle without its answer the next frame is that answer.
        If no other frame follows in the same cycle, the answer was lost, and the next frame counts again.
        """
        if self._owed[index] == 0:
            return False
        self._owed[index] -= 1
        self._taken_as_late.add(index)
        self._counts.late_feedback += 1
        self._late[index] += 1
        return True

    def feedback(self, index: int, time: float) -> bool:
        """Note the feedback of a drive, on the bus at `time`; return whether it was the last one missing."""
        if index in self._answered:
            self._counts.repeated_feedback += 1
            return False
        self._answered.add(index)
        self._last_feedback = max(self._last_feedback, time)
        return len(self._answered) == self._frames

    def has_answered(self, index: int) -> bool:
        """Return whether the feedback of a drive has come in the present cycle."""
        return index in self._answered

    def command(self, index: int, fresh: bool, time: float) -> None:
        """Note that a command was put on the bus at `time`."""
        if not fresh:
            self._counts.late_commands += 1
        elif index not in self._commanded:
            self._commanded.add(index)
            self._last_command = max(self._last_command, time)

    @property
    def missing(self) -> tuple[int, ...]:
        """Frames that have not come in the present cycle."""
        return tuple(index for index in range(self._frames) if index not in self._answered)

    def statistics(self) -> CycleStatistics:
        """Return the counts so far."""
        answers = tuple(map(self._answers, range(self._motors)))
        return replace(self._counts, latency=self._histogram.summary(), answers=answers)

    def _answers(self, motor: int) -> AnswerCounts:
        missing = max(self._missing[motor :: self._motors])
        # A drive that answers in two frames is late in both.
        return AnswerCounts(self._ended - missing, max(self._late[motor :: self._motors]), missing)
