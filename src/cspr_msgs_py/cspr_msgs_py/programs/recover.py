"""Rebuild a damaged bag, and say what was lost."""

import argparse
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from cspr_msgs_py.bag.reader import find_bag
from cspr_msgs_py.bag.recovery import Recovery, recover
from cspr_msgs_py.errors import BagError
from cspr_msgs_py.programs.command_line import output_path, program_parser, run_program, show_progress

DESCRIPTION = """Write what can be read of a damaged bag into a new, whole one, and say what was lost.

For the bag of a recorder that was killed, of a power failure, or of a bad disk. The damaged bag is not touched.
Attachments, metadata and quality of service are copied too."""

EPILOG = """examples:
  cspr recover runs/latest/bag                     writes runs/latest/bag_recovered
  cspr recover bag/bag_3.mcap --output whole       one file of a bag only"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Recover a bag; returns the exit status."""
    parser = program_parser("recover", DESCRIPTION, EPILOG)
    parser.add_argument(
        "bag", metavar="BAG", type=find_bag, help="a bag, one of its files, or a run's directory"
    )
    parser.add_argument(
        "--output",
        metavar="DIR",
        type=output_path,
        help="the whole bag, which must not exist yet; default: BAG_recovered",
    )
    options = parser.parse_args(arguments)
    return run_program("recover", lambda: _run(options), (BagError,), "the damaged bag is as it was")


def _run(options: argparse.Namespace) -> None:
    source: Path = options.bag
    output = options.output or source.resolve().with_name(
        f"{source.resolve().name.partition('.')[0]}_recovered"
    )
    result = recover(source, output, lambda share: show_progress("recovering", share))
    show_progress("")
    print(_report(result))


def _report(result: Recovery) -> str:
    total = sum(result.counts.values())
    lines = [f"{result.directory}: {total} messages of {len(result.counts)} topics"]
    if total:
        first, last = (
            datetime.fromtimestamp(stamp * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3]
            for stamp in (result.start_ns, result.end_ns)
        )
        lines[0] += f" in {(result.end_ns - result.start_ns) * 1e-9:.2f} s, from {first} to {last} UTC"
    if not result.losses:
        return "\n".join([*lines, "nothing was lost: the bag was whole"])
    lines += [f"lost: {text}" for text in result.losses]
    for topic, number in sorted(result.missing.items()):
        lines.append(f"lost: {number} message{'s' if number > 1 else ''} of {topic}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
