"""Scheduling of a node's process: its CPU, real-time priority for control, niceness for recording.

On Linux these belong to a thread, and the middleware has started its threads before a node can ask. For control
every thread of the process is set; threads started later inherit from the thread that starts them.

Each function returns None when it is done, else why it was refused.
"""

import os
from collections.abc import Callable
from pathlib import Path


def set_realtime_priority(priority: int) -> str | None:
    """Put this process under SCHED_FIFO with `priority` (1 to 99); a refusal names the privilege that is missing."""
    parameters = os.sched_param(priority)
    try:
        _each_thread(lambda thread: os.sched_setscheduler(thread, os.SCHED_FIFO, parameters))
    except PermissionError:
        return (
            f"real-time priority {priority} was refused, the process keeps its normal priority: it needs the "
            f"capability CAP_SYS_NICE, or an rtprio limit of at least {priority} for the user (a line "
            f"'<user> - rtprio {priority}' in /etc/security/limits.d/, then log in again)"
        )
    except OSError as error:
        return f"real-time priority {priority} was refused, the process keeps its normal priority: {error}"
    return None


def set_cpu(cpu: int) -> str | None:
    """Let this process run on one CPU only.

    The threads of an interpreter take turns in any case. Spread over several CPUs they wake one another across
    them, with cold caches: at 250 cycles a second of eight small messages this costs more than the work itself.
    """
    try:
        _each_thread(lambda thread: os.sched_setaffinity(thread, {cpu}))
    except OSError as error:
        allowed = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
        return f"CPU {cpu} was refused, the process stays on {allowed}: {error.strerror}"
    return None


def set_background(niceness: int) -> str | None:
    """Keep this process out of the way of others: its threads interrupt nobody when they wake up (SCHED_BATCH).

    This thread and those that it will start also get the nice level `niceness` (0 to 19: the higher, the later).
    The threads of the middleware do not: with transports of the user's own they may share locks and queues in shared
    memory with every publisher, and one that waits long for its turn makes the control loop wait with it.
    """
    try:
        _each_thread(lambda thread: os.sched_setscheduler(thread, os.SCHED_BATCH, os.sched_param(0)))
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    except OSError as error:
        return f"background scheduling at nice level {niceness} was refused: {error}"
    return None


def _each_thread(change: Callable[[int], object]) -> None:
    for task in Path("/proc/self/task").iterdir():
        try:
            change(int(task.name))
        except ProcessLookupError:  # a thread that has ended meanwhile
            continue
