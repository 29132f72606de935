"""What a bag says about its recording: the software, the computer, the time."""

import platform
import subprocess
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

_MARK = ":/*cspr_msgs_py/package.xml"  # a file of this repository, wherever it stands in the work tree


def recording_information(started: datetime, control_rate: float) -> dict[str, str]:
    """Return software version, host, kernel, rate (Hz), start and, where there is one, the git revision."""
    information = {
        "software": f"cspr_msgs_py {version('cspr_msgs_py')}",
        "python": platform.python_version(),
        "host": platform.node(),
        "kernel": f"{platform.system()} {platform.release()}",
        "control_rate": str(control_rate),
        "start_time": started.isoformat(),
    }
    revision = git_revision(Path(__file__).parent) or git_revision(Path.cwd())
    return information | ({"git_revision": revision} if revision else {})


def git_revision(directory: Path) -> str | None:
    """Return the commit of the work tree around `directory`, with ``-dirty`` behind it when files differ from it.

    None where there is no git, no work tree, or one of another project.
    """
    if not _git(directory, "ls-files", "--", _MARK):
        return None
    return _git(directory, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")


def _git(directory: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(directory), *arguments], capture_output=True, text=True, timeout=10, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None
