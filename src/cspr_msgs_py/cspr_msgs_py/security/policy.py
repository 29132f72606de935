"""SROS 2 policies, one file a process, from the table of who may do what."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from xml.etree import ElementTree as ET

from cspr_msgs_py.security.access import ENCLAVES, Access, Process, processes

VERSION = "0.2.0"
"""Of the form of the policies, as `ros2 security` of Jazzy reads it."""

_NOTICE = (
    " made by `cspr security`: change cspr_msgs_py/topics.py or cspr_msgs_py/security/access.py instead "
)


def policies(number_of_motors: int) -> dict[str, str]:
    """Return the policy of each process as XML, by the name of its file.

    The controllers that run alone, one a motor, share a file; each has its own enclave in it.
    """
    files: dict[str, dict[str, Process]] = {}
    for name, nodes in processes(number_of_motors).items():
        file = re.sub(r"_\d+$", "", name)
        files.setdefault(f"{file}.xml", {})[f"{ENCLAVES}/{name}"] = nodes
    return {file: _policy(enclaves) for file, enclaves in sorted(files.items())}


def _policy(enclaves: Mapping[str, Process]) -> str:
    root = ET.Element("policy", version=VERSION)
    root.append(ET.Comment(_NOTICE))
    all_enclaves = ET.SubElement(root, "enclaves")
    for path, nodes in enclaves.items():
        profiles = ET.SubElement(ET.SubElement(all_enclaves, "enclave", path=path), "profiles")
        for name, access in nodes.items():
            _add_access(ET.SubElement(profiles, "profile", ns="/", node=name), access)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _add_access(profile: ET.Element, access: Access) -> None:
    _add(profile, "topic", "publish", access.publishes)
    _add(profile, "topic", "subscribe", access.hears)
    _add(profile, "service", "reply", access.offers)
    _add(profile, "service", "request", access.calls)


def _add(profile: ET.Element, kind: str, right: str, names: Iterable[str]) -> None:
    if ordered := sorted(names):
        group = ET.SubElement(profile, f"{kind}s", {right: "ALLOW"})
        for name in ordered:
            ET.SubElement(group, kind).text = name
