"""The one way in which configuration files are read: YAML whose keys are unique.

The dialect is the one in which ROS reads parameter files: YAML 1.1, where ``on`` is a truth value and ``010`` is eight,
without aliases. `cspr_msgs_py.parameters.file` reads those the same way; a test feeds both the same spellings.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.events import AliasEvent, ScalarEvent
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.resolver import VersionedResolver

from cspr_kinematics.errors import ConfigurationFileError

_PLAIN = {  # what a text without quotes may be besides a text, as ROS has it
    "null": r"~|null|Null|NULL|",
    "bool": r"[yYnN]|yes|Yes|YES|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF",
    "int": r"[-+]?(0[0-7]*|0x[0-9a-fA-F]+|[1-9][0-9]*)",
    "float": r"[-+]?((\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|\.(inf|Inf|INF))|\.(nan|NaN|NAN)",
}


class _Resolver(VersionedResolver):
    processing_version = (1, 1)  # whatever a file says of itself
    versioned_resolver = {  # noqa: RUF012
        None: [
            (f"tag:yaml.org,2002:{tag}", re.compile(f"({text})$", re.ASCII)) for tag, text in _PLAIN.items()
        ]
    }


class _Composer(Composer):
    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.parser.peek_event()
        if isinstance(event, AliasEvent):  # a few of them can stand for more than a computer holds
            problem = "found an alias; write out what it stands for"
        elif isinstance(event, ScalarEvent) and "\0" in event.value:  # ends a text for ROS, and is in no path
            problem = "found a NUL byte in a text"
        else:
            return super().compose_node(parent, index)
        raise ComposerError(None, None, problem, event.start_mark)


class _Constructor(SafeConstructor):
    """Without the warning that 1e-3 has no dot: it is a number for ROS as well."""

    def construct_yaml_float(self, node: ScalarNode) -> float:
        return float(self.construct_scalar(node).lower().replace(".inf", "inf").replace(".nan", "nan"))


_Constructor.add_constructor("tag:yaml.org,2002:float", _Constructor.construct_yaml_float)


def _yaml(kind: str) -> YAML:
    yaml = YAML(typ=kind, pure=True)
    yaml.Resolver, yaml.Composer, yaml.Constructor = _Resolver, _Composer, _Constructor
    return yaml


def read_yaml(path: str | Path, remedy: str = "") -> dict[Any, Any]:
    """Return the mapping that a configuration file holds.

    Parameters
    ----------
    path
        The file.
    remedy
        What to do about a file that is missing or is not the right one, for the error.

    Raises
    ------
    ConfigurationFileError
        If the file cannot be read, is not YAML, is no mapping, or repeats a key.
    """
    try:
        text = Path(path).read_bytes()
    except (OSError, ValueError) as error:  # there is no path with a NUL byte
        problem = f"cannot be read: {getattr(error, 'strerror', error)}"
        raise ConfigurationFileError(str(path), None, None, _with(problem, remedy)) from error
    return parse_yaml(text, str(path), remedy)


def parse_yaml(text: str | bytes, source: str, remedy: str = "") -> dict[Any, Any]:
    """Return the mapping that the text of a configuration file holds; `source` names it in errors.

    Raises
    ------
    ConfigurationFileError
        As `read_yaml` does.
    """
    try:
        decoded = text.decode("utf-8") if isinstance(text, bytes) else text
        content = _yaml("safe").load(decoded)
    except Exception as error:  # no text, no number, no end of brackets or aliases, a tag that does not fit
        raise ConfigurationFileError(source, None, None, f"is not valid YAML: {_described(error)}") from error
    if not isinstance(content, dict):
        problem = "is empty; it must be" if content is None else "must be"
        problem += " a mapping of keys to values"
        raise ConfigurationFileError(source, None, content, _with(problem, remedy))
    return content


def write_yaml(path: Path, content: dict[Any, Any]) -> None:
    """Write a configuration file that is read as it was meant."""
    _yaml("rt").dump(content, path)


def _described(error: Exception) -> str:
    mark = getattr(error, "problem_mark", None)
    if mark is None:
        return " ".join(str(error).split())
    context = getattr(error, "context", None)
    problem = f"{context}, {error.problem}" if context else error.problem  # type: ignore[attr-defined]
    return f"{problem} (line {mark.line + 1}, column {mark.column + 1})"


def _with(problem: str, remedy: str) -> str:
    return f"{problem}; {remedy}" if remedy else problem
