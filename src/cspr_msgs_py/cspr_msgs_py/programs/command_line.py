"""What the command lines of all programs have in common: how they teach, show progress and end."""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from cspr_msgs_py.errors import BagWarning, shortened

EXIT_STATUS = "exit status: 0 done, 1 not done, for the reason on stderr, 2 wrong arguments, 130 interrupted"
_CLOSED_PIPE = 141  # as a shell has it of a program that SIGPIPE has ended
_BAR = 30  # characters of the progress bar


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        super().error(shortened(message))


def program_parser(
    name: str, description: str, epilog: str, exit_status: str = EXIT_STATUS, *, json: str | None = None
) -> argparse.ArgumentParser:
    """Return the parser of a program of the command ``cspr``.

    Parameters
    ----------
    name
        Of the program.
    description, epilog, exit_status
        What it does, examples, and how it ends: ``--help`` shows them as they are written.
    json
        What ``--json FILE`` writes, for a program that measures; `options.json` is then the file or None, see
        :func:`cspr_msgs_py.json_file.write_json`.
    """
    parser = _Parser(
        prog=f"cspr {name}",
        description=description,
        epilog=f"{epilog}\n\n{exit_status}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    if json is not None:
        parser.add_argument(
            "--json", type=output_file, metavar="FILE", help=f"also write {json} to this file"
        )
    return parser


def number(what: str, least: float, most: float = math.inf) -> Callable[[str], float]:
    """Return a reader of finite numbers within limits; what it refuses is not ``what``."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and least <= value <= most):
            raise argparse.ArgumentTypeError(f"{text!r} is not {what}")
        return value

    return read


def output_path(text: str) -> Path:
    """Read a path that is to be written; what cannot be is refused before the work is done, not after it.

    Directories on the way need not be there yet.
    """
    path = Path(text)
    there = next(place for place in (path, *path.absolute().parents) if os.path.exists(place))
    try:
        if there == path and not there.is_dir():
            there.open("ab").close()
        else:
            tempfile.TemporaryFile(dir=there).close()
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{text} cannot be written: {there}: {error.strerror}") from error
    return path


def output_file(text: str) -> Path:
    """Read the path of a file that is to be written, as `output_path` does."""
    if os.path.isdir(text):
        raise argparse.ArgumentTypeError(f"{text} is a directory: name a file in it")
    return output_path(text)


def run_program(
    name: str,
    body: Callable[[], int | None],
    errors: tuple[type[Exception], ...],
    interrupted: str = "",
) -> int:
    """Run the body of a program and return its exit status, with one line on stderr about what ended it.

    What is missing from a bag (`BagWarning`) is said in such a line too.

    Parameters
    ----------
    name
        Of the program.
    body
        Returns the exit status; None for 0.
    errors
        Those whose text is all that the user needs; the status is then 1, as for OSError.
    interrupted
        What Ctrl-C leaves behind, in words; the status is then 130.
    """

    def show_warning(message: Warning | str, *_: object, **__: object) -> None:
        print(f"{name}: {message}", file=sys.stderr)

    try:
        try:
            with warnings.catch_warnings(action="always", category=BagWarning):
                warnings.showwarning = show_warning
                return body() or 0
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # `| head` has read enough; what is left in the buffer must not be an error
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _CLOSED_PIPE
    except KeyboardInterrupt:
        status, text = 130, f"interrupted; {interrupted}" if interrupted else "interrupted"
    except errors as error:
        status, text = 1, str(error)
    except OSError as error:
        status, text = (
            1,
            f"cannot read or write {error.filename}: {error.strerror}" if error.filename else str(error),
        )
    show_progress("")
    print(f"{name}: {shortened(text)}", file=sys.stderr)
    return status


def show_progress(text: str, share: float | None = None) -> None:
    """Show one live line on a terminal, nothing elsewhere; an empty text removes it.

    Parameters
    ----------
    text
        To be shown.
    share
        What is done of the whole, from 0 to 1, for a bar in front of the text; None for no bar.
    """
    if sys.stderr.isatty():
        full = 0 if share is None else round(_BAR * min(max(share, 0.0), 1.0))
        bar = "" if share is None else f"[{'#' * full}{'.' * (_BAR - full)}] "
        print(f"\r\x1b[K{bar}{text}", end="", file=sys.stderr, flush=True)
