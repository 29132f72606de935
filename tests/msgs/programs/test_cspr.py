"""The command ``cspr``: what it lists without importing it, and how it starts a program."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from argparse import ArgumentTypeError
from importlib.metadata import EntryPoint, distribution
from pathlib import Path

import pytest

from cspr_msgs_py.json_file import plain, write_json
from cspr_msgs_py.programs import cspr
from cspr_msgs_py.programs.command_line import (
    number,
    output_file,
    output_path,
    program_parser,
    run_program,
    show_progress,
)


def test_lists_every_program_and_imports_none() -> None:
    code = (
        "import sys\nfrom cspr_msgs_py.programs.cspr import main\nassert main(['--help']) == 0\n"
        "loaded = {name for name in sys.modules if name.startswith(('cspr_', 'numpy', 'rclpy'))}\n"
        "own = {'', '.errors', '.programs', '.programs.cspr', '.programs.command_line', '.programs.linear_algebra'}\n"
        "assert loaded == {f'cspr_msgs_py{name}' for name in own}, loaded\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for line in (
        "  demo         Run the whole robot on this computer",
        "  commission   Commission a new robot",
    ):
        assert line in done.stdout


def test_without_a_program_it_teaches(capsys: pytest.CaptureFixture[str]) -> None:
    assert cspr.main([]) == 2
    text = capsys.readouterr().out
    assert "usage: cspr PROGRAM" in text
    assert "by name: .venv/bin/control" in text


@pytest.mark.parametrize(
    ("name", "words"), [("analyse", "did you mean analyze?"), ("zzz", "there are analyze, ")]
)
def test_unknown_program(name: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cspr.main([name, "--help"]) == 2
    assert words in capsys.readouterr().err


def started() -> int:
    """Stand in for a program."""
    assert sys.argv == ["cspr stand-in", "--rate", "2"]
    return 7


def test_a_program_is_started_with_its_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["cspr"])
    entry = EntryPoint("stand-in", "stand.in:main", cspr.GROUP)
    monkeypatch.setattr(EntryPoint, "load", lambda self: started)
    monkeypatch.setattr(cspr, "entry_points", lambda group: [entry])
    assert cspr.main(["stand-in", "--rate", "2"]) == 7


def test_an_executable_runs_the_program_of_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("cspr_control", "cspr_drivers", "cspr_msgs_py"):
        points = distribution(package).entry_points
        programs = {entry.name for entry in points if entry.group == cspr.GROUP}
        executables = {entry.name: entry for entry in points if entry.group == "console_scripts"}
        assert {executables[name].load() for name in programs} == {cspr.main_of_executable}
    monkeypatch.setattr(sys, "argv", ["/somewhere/lib/stand-in", "--rate", "2"])
    entry = EntryPoint("stand-in", "stand.in:main", cspr.GROUP)
    monkeypatch.setattr(EntryPoint, "load", lambda self: started)
    monkeypatch.setattr(cspr, "entry_points", lambda group: [entry])
    assert cspr.main_of_executable() == 7


def needs_a_package() -> int:
    """Stand in for a program that imports something optional while it runs."""
    return int(importlib.import_module("no_such_package_at_all").main())


@pytest.mark.parametrize("when", ["loaded", "running"])
def test_a_package_that_is_missing_is_named(
    when: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = "no_such_package_at_all" if when == "loaded" else __name__
    entry = EntryPoint("stand-in", f"{module}:needs_a_package", cspr.GROUP)
    monkeypatch.setattr(cspr, "entry_points", lambda group: [entry])
    assert cspr.main(["stand-in"]) == 1
    assert (
        capsys.readouterr().err
        == "cspr: stand-in needs the Python package no_such_package_at_all, which is not installed\n"
    )


def test_a_path_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path) -> None:
    parser = program_parser("measure", "", "", json="the numbers")
    (tmp_path / "file").touch()
    for path, problem in (
        (tmp_path / "file" / "out.json", f"{tmp_path / 'file'}: Not a directory"),
        (tmp_path, "is a directory: name a file in it"),
        (Path("/proc/out.json"), "/proc: No such file or directory"),
    ):
        with pytest.raises(ArgumentTypeError, match=problem):
            output_file(str(path))
        with pytest.raises(SystemExit) as ended:
            parser.parse_args(["--json", str(path)])
        assert ended.value.code == 2
    new = tmp_path / "not" / "there" / "out.json"
    write_json(parser.parse_args(["--json", str(new)]).json, {"rate": 250})
    assert new.is_file()
    assert output_path(str(tmp_path)) == tmp_path  # a directory that is there already


def test_parser_teaches_and_takes_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    parser = program_parser(
        "measure", "Measure\n  something.", "examples:\n  cspr measure", json="the numbers"
    )
    assert parser.parse_args(["--json", "out.json"]).json == Path("out.json")
    with pytest.raises(SystemExit):
        parser.parse_args(["--help"])
    text = capsys.readouterr().out
    assert "usage: cspr measure" in text
    assert "Measure\n  something." in text
    assert "examples:\n  cspr measure\n\nexit status: 0 done, " in text
    assert not hasattr(program_parser("replay", "", "").parse_args([]), "json")
    with pytest.raises(SystemExit):
        parser.parse_args(["x" * 3000])
    assert capsys.readouterr().err.endswith(f"unrecognized arguments: {'x' * 100}...\n")


@pytest.mark.parametrize(
    ("raised", "status", "said"),
    [
        (KeyboardInterrupt(), 130, "measure: interrupted; nothing was written"),
        (KeyError("speed"), 1, "measure: 'speed'"),
        (KeyError(f"no {'x' * 3000} here"), 1, f"measure: 'no {'x' * 100}... here'"),
        (OSError(28, "No space left on device", "out.json"), 1, "out.json: No space left on device"),
    ],
)
def test_how_programs_end(
    raised: BaseException, status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def body() -> None:
        raise raised

    assert run_program("measure", body, (KeyError,), "nothing was written") == status
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert run_program("measure", lambda: 3, ()) == 3
    with pytest.raises(ValueError, match="invalid literal"):
        run_program("measure", lambda: int("a defect"), (KeyError,))


def test_a_reader_that_has_read_enough_is_no_error() -> None:
    code = (
        "import sys\nfrom cspr_msgs_py.programs.command_line import run_program\n"
        "sys.exit(run_program('measure', lambda: print('line\\n' * 100_000), ()))"
    )
    done = subprocess.run(
        ["bash", "-c", '"$0" -c "$1" | head -1; exit ${PIPESTATUS[0]}', sys.executable, code],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.stdout, done.stderr, done.returncode) == ("line\n", "", 141)


def test_a_reader_that_is_gone_is_no_error() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    for arguments in (["--help"], ["recover", "--help"]):
        done = subprocess.run(
            [sys.executable, "-m", "cspr_msgs_py.programs.cspr", *arguments],
            stdout=writing, stderr=subprocess.PIPE, text=True, check=False,
            env=os.environ | {"PYTHONUNBUFFERED": ""},  # then it is told at the end only
        )  # fmt: skip
        assert (done.stderr, done.returncode) == ("", 141)
    os.close(writing)


def test_json_without_nan(tmp_path: Path) -> None:
    import numpy as np

    write_json(
        tmp_path / "a.json", {"error": np.array([1.0, np.nan]), 3: (np.float64(2.0), np.int64(1), None)}
    )
    content = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert content == {"error": [1.0, None], "3": [2.0, 1, None]}
    assert plain(float("inf")) is None


def test_progress_appears_on_a_terminal_alone(capsys, monkeypatch) -> None:
    show_progress("half", 0.5)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    show_progress("half", 0.5)
    assert capsys.readouterr().err.endswith(f"[{'#' * 15}{'.' * 15}] half")


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "fast"])
def test_a_number_out_of_its_limits_is_refused_in_words(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match=f"'{text}' is not a rate of 0.001 or more"):
        number("a rate of 0.001 or more", 0.001)(text)
