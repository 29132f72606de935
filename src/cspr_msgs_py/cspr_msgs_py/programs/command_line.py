"""What the command lines of all programs have in common: how they teach, and how they write their numbers."""

from __future__ import annotations

import argparse
from pathlib import Path


def program_parser(
    name: str, description: str, epilog: str, *, json: str | None = None
) -> argparse.ArgumentParser:
    """Return the parser of a program of the command ``cspr``.

    Parameters
    ----------
    name
        Of the program.
    description, epilog
        What it does, and examples: ``--help`` shows both as they are written.
    json
        What ``--json FILE`` writes, for a program that measures; `options.json` is then the file or None, see
        :func:`cspr_msgs_py.json_file.write_json`.
    """
    parser = argparse.ArgumentParser(
        prog=f"cspr {name}",
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    if json is not None:
        parser.add_argument("--json", type=Path, metavar="FILE", help=f"also write {json} to this file")
    return parser
