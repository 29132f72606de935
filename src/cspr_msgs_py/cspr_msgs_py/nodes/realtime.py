"""Real-time priority of a node's process."""

import os
from pathlib import Path


def set_realtime_priority(priority: int) -> str | None:
    """Put every thread of this process under SCHED_FIFO with `priority` (1 to 99).

    Threads started later inherit it from the thread that starts them. The middleware's receiving threads are
    part of the control cycle, so they are not left out.

    Returns
    -------
    str or None
        None when it is done, else why it was refused and which privilege is missing.
    """
    try:
        for task in Path("/proc/self/task").iterdir():
            try:
                os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(priority))
            except ProcessLookupError:  # a thread that has ended meanwhile
                continue
    except PermissionError:
        return (
            f"real-time priority {priority} was refused, the process keeps its normal priority: it needs the "
            f"capability CAP_SYS_NICE, or an rtprio limit of at least {priority} for the user (a line "
            f"'<user> - rtprio {priority}' in /etc/security/limits.d/, then log in again)"
        )
    except (OSError, ValueError) as error:
        return f"real-time priority {priority} was refused, the process keeps its normal priority: {error}"
    return None
