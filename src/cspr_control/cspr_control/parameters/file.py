"""Parameter files of ROS 2 nodes, read without ROS.

A file maps the names of nodes to ``ros__parameters``; the node ``/**`` stands for all of them. Nested mappings
become names with dots. Source: the ROS 2 design article "ROS 2 Parameters", YAML syntax of ``--params-file``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from cspr_control.errors import SettingError

_ALL_NODES = "/**"


class ParameterFile:
    """The parameters that a file gives to nodes.

    Parameters
    ----------
    content
        The file's mapping.
    name
        Name of the file in errors.

    Raises
    ------
    SettingError
        If the content is not that of a parameter file.
    """

    def __init__(self, content: Any, name: str) -> None:
        self.name = name
        self._nodes: dict[str, dict[str, Any]] = {}
        if not isinstance(content, Mapping):
            raise SettingError(f"{name} is not a parameter file: it maps no names of nodes")
        for node, section in content.items():
            if not isinstance(section, Mapping) or not isinstance(section.get("ros__parameters"), Mapping):
                raise SettingError(f"{name} is not a parameter file: {node} has no ros__parameters")
            key = node if node == _ALL_NODES else str(node).strip("/")
            self._nodes.setdefault(key, {}).update(_flat(section["ros__parameters"]))

    @staticmethod
    def parse(text: str | bytes, name: str) -> ParameterFile:
        """Read the text of a file; raises SettingError as the constructor does, also for broken YAML."""
        try:
            return ParameterFile(yaml.safe_load(text), name)
        except (
            yaml.YAMLError,
            ValueError,
            RecursionError,
        ) as error:  # no text, no number, no end of brackets
            raise SettingError(f"{name} is not YAML: {' '.join(str(error).split())}") from error

    @staticmethod
    def from_yaml(path: str | Path) -> ParameterFile:
        """Read a file; raises SettingError as the constructor does, also if it cannot be read."""
        try:
            text = Path(path).read_bytes()
        except OSError as error:
            raise SettingError(f"cannot read {path}: {error.strerror}") from error
        return ParameterFile.parse(text, str(path))

    def of(self, node: str) -> dict[str, Any]:
        """Return the parameters of a node by name; what is said of it alone beats what is said of all."""
        return self._nodes.get(_ALL_NODES, {}) | self._nodes.get(node, {})

    def change(self, node: str, values: Mapping[str, Any]) -> None:
        """Give parameters of a node, or of all nodes, other values."""
        self._nodes.setdefault(node, {}).update(values)


def _flat(section: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, value in section.items():
        if isinstance(value, Mapping):
            values |= _flat(value, f"{prefix}{key}.")
        else:
            values[f"{prefix}{key}"] = value
    return values
