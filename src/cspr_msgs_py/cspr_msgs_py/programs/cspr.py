"""Executable ``cspr``: the programs of the robot that are no nodes, under one name.

Programs are entry points of the group ``cspr.programs``, of any package that is installed. None is imported to list
them: the line about each is the first of its module's docstring, read from the file.
"""

from __future__ import annotations

import ast
import difflib
import os
import sys
from collections.abc import Iterable, Sequence
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path

from cspr_msgs_py.errors import shortened
from cspr_msgs_py.programs.command_line import run_program
from cspr_msgs_py.programs.linear_algebra import ONE_THREAD

GROUP = "cspr.programs"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program that the first argument names; return its exit status, or 2 if there is none of that name."""
    return run_program("cspr", lambda: _run(arguments), ())


def _run(arguments: Sequence[str] | None) -> int:
    words = list(sys.argv[1:] if arguments is None else arguments)
    programs = {entry.name: entry for entry in entry_points(group=GROUP)}
    if not words or words[0] in ("-h", "--help", "help"):
        print(_help(programs.values()))
        return 0 if words else 2
    name = words[0]
    if name not in programs:
        near = difflib.get_close_matches(name, programs, 1, 0.5)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(sorted(programs))}"
        print(f"cspr: there is no program {shortened(repr(name))}; {hint}", file=sys.stderr)
        return 2
    os.environ.update(ONE_THREAD | os.environ)
    sys.argv = [f"cspr {name}", *words[1:]]  # the program reads its arguments as if it were started alone
    try:
        return int(programs[name].load()() or 0)
    except ModuleNotFoundError as error:
        print(f"cspr: {name} needs the Python package {error.name}, which is not installed", file=sys.stderr)
        return 1


def main_of_executable() -> int:
    """Run the program that bears the name of the executable, as ``ros2 run PACKAGE PROGRAM`` starts it."""
    return main([Path(sys.argv[0]).name, *sys.argv[1:]])


def _help(programs: Iterable[EntryPoint]) -> str:
    lines = ["usage: cspr PROGRAM [options]", "", "programs:"]
    lines += sorted(f"  {entry.name:<13}{_summary(entry)}" for entry in programs)
    lines += ["", "`cspr PROGRAM --help` explains one. Nodes are started with `ros2 run PACKAGE NODE`,"]
    lines += ["or, where there is no ros2, by name: .venv/bin/control"]
    return "\n".join(lines)


def _summary(entry: EntryPoint) -> str:
    """Return the first line of a module's docstring; nothing is executed, nor its packages imported."""
    package, *inside = entry.module.split(".")
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        return "(its package is not installed)"
    try:
        source = Path(spec.origin).parent.joinpath(*inside).with_suffix(".py").read_text(encoding="utf-8")
    except OSError:
        return ""
    text = (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]
    return text.replace("``", "").rstrip(".")


if __name__ == "__main__":
    sys.exit(main())
