"""Parameter files of ROS 2 nodes, and parameters on the command line, without ROS.

A file maps the names of nodes to ``ros__parameters``; the node ``/**`` stands for all of them. Nested mappings
become names with dots. Source: the ROS 2 design article "ROS 2 Parameters", YAML syntax of ``--params-file``.
The dialect is that of ROS: YAML 1.1, where ``on`` is a truth value and ``010`` is eight, without aliases.
`cspr_kinematics.configuration.yaml_file` reads all other files the same way; a test feeds both the same spellings.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.events import AliasEvent, ScalarEvent
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode
from ruamel.yaml.resolver import VersionedResolver

from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.parameters.table import (
    ALL_NODES,
    NODES,
    OF_PROCESS,
    TABLE,
    known_parameter,
    node_parameters,
    parameter_values,
)

Heard = Mapping[str, Collection[str]]
"""The parameters that the nodes of a process, or of a simulation, take: their names by node."""

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


class ParameterFile:
    """The parameters that a file gives to nodes.

    Parameters
    ----------
    text : str or bytes
        The file's content.
    name : str
        Name of the file in errors.

    Raises
    ------
    ParameterError
        If the content is not that of a parameter file, something stands in it twice, or a node of ours has no such
        parameter; nodes that are not ours are ignored.
    """

    def __init__(self, text: str | bytes, name: str) -> None:
        self.name = name
        # all nodes come first: for ROS the last one counts
        self._nodes: dict[str, dict[str, Any]] = {ALL_NODES: {}}
        self._lines: dict[tuple[str, str], int] = {}  # of what the file itself says
        self._yaml = _yaml("safe")
        try:
            root = self._yaml.compose(text)
            if not isinstance(root, MappingNode):
                raise ParameterError(f"{name} is not a parameter file: it maps no names of nodes")
            self._read_nodes(root, "")
        except ParameterError:
            raise
        except MarkedYAMLError as error:
            line = error.problem_mark.line + 1
            raise ParameterError(f"{name} is not YAML: {error.problem} (line {line})") from error
        except Exception as error:  # no text, no number, no end of brackets, a tag that does not fit
            raise ParameterError(f"{name} is not YAML: {' '.join(str(error).split())}") from error

    @staticmethod
    def from_yaml(path: str | Path) -> "ParameterFile":
        """Read a file; raises ParameterError as the constructor does, also if it cannot be read."""
        try:
            return ParameterFile(Path(path).read_bytes(), str(path))
        except (OSError, ValueError) as error:  # there is no path with a NUL byte
            raise ParameterError(f"cannot read {str(path)!r}: {getattr(error, 'strerror', error)}") from error

    def of(self, node: str) -> dict[str, Any]:
        """Return the given parameters of a node by name; its own take precedence over those of all."""
        return self._nodes.get(ALL_NODES, {}) | self._nodes.get(node, {})

    def values(self, node: str) -> dict[str, Any]:
        """Return all parameters of a node of ours by name, given ones and defaults; raises ParameterError."""
        try:
            return parameter_values(node, self.of(node))
        except ParameterError as error:
            raise ParameterError(f"{self.name}: {node}: {error}") from error

    def change(self, node: str, values: Mapping[str, Any]) -> None:
        """Give parameters of a node, or of all nodes, other values; raises ParameterError for what does not fit."""
        for name, value in values.items():
            row = known_parameter(node, name)
            self._nodes.setdefault(node, {})[name] = row.checked(value) if row else value
            self._lines.pop((node, name), None)

    def require_heard(self, heard: Heard) -> None:
        """Refuse what is given to one of these nodes and not taken by it; raises ParameterError.

        The file may speak to other nodes, and to processes, what was changed may not.
        """
        for node, values in self._nodes.items():
            # gains that are shared by all motor controllers come with all of them
            ours = node in heard or ("motor_control_gains" in heard and node.startswith("motor_controller_"))
            for name in values:
                line = self._lines.get((node, name))
                if line is None or (ours and name not in OF_PROCESS):
                    where = f"other than in {self.name}" if line is None else f"{self.name}, line {line}"
                    require_heard(where, node, name, heard)

    def slow_down(self, speed: float) -> None:
        """Let the simulated machine run at `speed` of real time, and stretch what depends on the computer's clock."""
        for node, values in self._nodes.items():
            for name, value in values.items():
                row = known_parameter(node, name)
                values[name] = row.in_slow_motion(value, speed) if row and row.stretch else value
        for node in TABLE:
            block = ALL_NODES if node.endswith("_K") else node  # one row of the table, many nodes
            for name, row in node_parameters(node).items():
                if row.stretch and name not in self.of(node):
                    self._nodes.setdefault(block, {})[name] = row.in_slow_motion(row.default, speed)
        self.change("simulated_robot", {"speed": speed})

    def text(self) -> str:
        """Return the content of a file with these parameters."""
        content = {node: {"ros__parameters": values} for node, values in self._nodes.items() if values}
        stream = StringIO()
        _yaml("rt").dump(content, stream)
        return stream.getvalue()

    def _read_nodes(self, section: MappingNode, path: str) -> None:
        for key, value in _entries(section):
            inner = f"{path}/{key.lstrip('/')}" if path else key
            if not isinstance(value, MappingNode) or inner == "ros__parameters":
                raise ParameterError(
                    f"{self._place(value)}: {inner} is {_shown(value)}; parameters stand under their node, as in "
                    "feedforward: {ros__parameters: {model: static}}"
                )
            if key == "ros__parameters":
                self._read_values(_node(path), value, "")
            else:
                self._read_nodes(value, inner)

    def _place(self, value: Node) -> str:
        return f"{self.name}, line {value.start_mark.line + 1}"

    def _read_values(self, node: str, section: MappingNode, prefix: str) -> None:
        values = self._nodes.setdefault(node, {})
        for key, value in _entries(section):
            if isinstance(value, MappingNode) and value.value:
                self._read_values(node, value, f"{prefix}{key}.")
                continue
            name, where = prefix + key, ""
            try:
                row = known_parameter(node, name)
                where = f"{node}: "
                if not value.value and not getattr(value, "style", None):  # no value for ROS; '' is one
                    raise ParameterError(f"{name} is {_shown(value)}; give it a value, or leave it out")
                values[name] = self._yaml.constructor.construct_document(value)
                if row and node != ALL_NODES:  # of many nodes, each has its own type and range
                    row.checked(values[name])
            except ParameterError as error:
                raise ParameterError(f"{self._place(value)}: {where}{error}") from error
            if node == ALL_NODES:
                self._require_first(name, value)
            self._lines[node, name] = value.start_mark.line + 1

    def _require_first(self, name: str, value: Node) -> None:
        """Refuse a parameter of all nodes after that of a node of ours, which it would replace for ROS."""
        for node, other in self._lines:
            if other == name and node != ALL_NODES and known_parameter(node, name):
                raise ParameterError(
                    f"{self._place(value)}: {name} is given to all nodes, which for ROS replaces the {name} of {node} "
                    f"in line {self._lines[node, name]}: put {ALL_NODES} first"
                )


def _node(path: str) -> str:
    """Return the node's name, without name space; `ALL_NODES` for a pattern, and for none."""
    name = path.rpartition("/")[2]
    return ALL_NODES if "*" in name or not name else name


def _shown(value: Node) -> str:
    text = f"{value.value:.60}" if isinstance(value, ScalarNode) else "a list or mapping"
    return text if value.value else "empty"


def _entries(section: MappingNode) -> list[tuple[str, Node]]:
    """Return keys, as they are written, and values; refuse a key that stands there twice."""
    entries: dict[str, Node] = {}
    for name, value in section.value:
        if not isinstance(name, ScalarNode):
            raise ComposerError(None, None, "found a key that is no text", name.start_mark)
        key = str(name.value)
        if key in entries:
            scalars = isinstance(value, ScalarNode) and isinstance(entries[key], ScalarNode)
            both = f' with value "{value.value}" (original value: "{entries[key].value}")' if scalars else ""
            raise ComposerError(None, None, f'found duplicate key "{key}"{both}', name.start_mark)
        entries[key] = value
    return list(entries.items())


def value_from_text(node: str, name: str, text: str) -> Any:
    """Return the value that a text, read as ROS reads it, gives to a parameter of a node of ours.

    Raises
    ------
    ParameterError
        If there is no such node or parameter, or it may not have that value.
    """
    row = known_parameter(node, name)
    if row is None:
        raise ParameterError(f"there is no node {node}; there are {', '.join(NODES)}")
    try:
        value = _yaml("safe").load(text)
    except Exception:  # no YAML, such as "[": the check says what is needed
        value = text
    return row.checked(row.as_double(value))


def require_heard(where: str, node: str, name: str, heard: Heard | None) -> None:
    """Refuse a parameter that is given to a node that does not take it, or is not there.

    Parameters
    ----------
    where
        It is given, for the error.
    node
        Name of the node, or `ALL_NODES`: then it is enough that one takes it.
    name
        Name of the parameter; what is not ours is ignored.
    heard
        What the nodes that are there take; before they are, it is enough that a node of ours has the parameter.

    Raises
    ------
    ParameterError
        Says who takes it, or what is taken.
    """
    try:
        row = known_parameter(node, name)
    except ParameterError as error:
        raise ParameterError(f"{where}: {error}") from error
    takers = [each for each, names in (heard or {}).items() if name in names]
    if row is None or heard is None or node in takers or (node == ALL_NODES and takers):
        return
    if node != ALL_NODES and node not in heard:
        raise ParameterError(f"{where}: {node} is not here; the nodes here are {', '.join(heard)}")
    who = "no node takes" if node == ALL_NODES else f"{node} takes no"
    if takers:
        hint = f"{takers[0]} does"
    elif node == ALL_NODES:
        hint = f"it belongs to {', '.join(each for each in NODES if name in node_parameters(each))}"
    else:
        hint = f"it takes {', '.join(each for each in node_parameters(node) if each in heard[node])}"
    raise ParameterError(f"{where}: {who} {name} here; {hint}")


def check_arguments(arguments: Sequence[str], heard: Heard | None = None) -> None:
    """Refuse a command line with parameters, or files with such, that nobody takes.

    Parameters
    ----------
    arguments
        The command line.
    heard
        What the nodes of the process take, as for `require_heard`.

    Raises
    ------
    ParameterError
    """
    for option, value in pairwise(arguments):
        if option == "--params-file":
            file = ParameterFile.from_yaml(value)
            if heard is not None:
                file.require_heard(heard)
        elif option in ("-p", "--param"):
            path, _, name = value.partition(":=")[0].rpartition(":")
            require_heard(f"{option} {value}", _node(path), name, heard)
        elif option in ("-r", "--remap") and re.match(r"([^:]+:)?__(node|name):=", value):
            raise ParameterError(
                f"{option} {value}: other nodes find this one by its name; leave that as it is"
            )
