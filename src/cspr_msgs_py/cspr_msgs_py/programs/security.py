"""Write the SROS 2 policies: who may do what in the graph, one file a process."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from cspr_msgs_py.errors import MessagesError
from cspr_msgs_py.programs.command_line import output_path, program_parser, run_program
from cspr_msgs_py.security.policy import policies

DESCRIPTION = """Write the SROS 2 policy of each process: the topics that it publishes and hears, the services that it
offers and calls, and nothing else. docs/security.md tells how keys are made of them and what they leave open."""

EPILOG = """examples:
  cspr security                                  into config/security/, for eight motors
  cspr security --motors 6 --output policies"""

_MOST_MOTORS = 127  # node ids of a bus


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the policies; returns the exit status."""
    parser = program_parser("security", DESCRIPTION, EPILOG)
    parser.add_argument(
        "--motors", type=_count, default=8, metavar="M", help="motors of the robot; default: %(default)s"
    )
    parser.add_argument(
        "--output", type=output_path, default=Path("config/security"), metavar="DIR",
        help="where the files are written; default: %(default)s",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    return run_program("security", lambda: _run(options), (MessagesError,))


def _count(text: str) -> int:
    if not (text.isdecimal() and 1 <= int(text) <= _MOST_MOTORS):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of motors")
    return int(text)


def _run(options: argparse.Namespace) -> None:
    directory: Path = options.output
    directory.mkdir(parents=True, exist_ok=True)
    files = policies(options.motors)
    for name, text in files.items():
        (directory / name).write_text(text, encoding="utf-8")
    print(f"{len(files)} policies in {directory}")


if __name__ == "__main__":
    sys.exit(main())
