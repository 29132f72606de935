"""Message classes by name, and the definition text (``ros2msg``) that a bag carries for its readers.

The text is that of the ``.msg`` files, with their comments and constants: viewers show the name of a constant in
place of its number. These files are not part of every installation; without them the text is rebuilt from the Python
class, which has everything that determines the bytes of a message.
"""

import importlib
import json
import re
from pathlib import Path
from typing import Any

from cspr_msgs_py.errors import MessageError

_SEPARATOR = "=" * 80

# Names of the Python classes' field types that the definition language spells otherwise.
_SPELLING = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
_PRIMITIVES = {"bool", "byte", "char", "float32", "float64", "wchar"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}


def message_class(type_name: str) -> Any:
    """Return the class of a message type written as ``package/msg/Name``.

    Raises
    ------
    MessageError
        If the name has another form, or its package is not installed.
    """
    match = re.fullmatch(r"(\w+)/msg/(\w+)", type_name)
    if match is None:
        raise MessageError(
            f"{type_name!r} is not the name of a message type such as sensor_msgs/msg/JointState"
        )
    package, name = match.groups()
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise MessageError(
            f"message type {type_name} is not installed ({error}); install the ROS package {package}"
        ) from error


def message_definition(type_name: str) -> str:
    """Return the definition of a message with those of all the messages inside it.

    The form is that of rosbag2: the definition itself, then for each nested type a line of 80 equal signs,
    a line ``MSG: package/Name`` and its definition.
    """
    pending = [type_name]
    seen = {type_name}
    sections: list[str] = []
    while pending:
        current = pending.pop(0)
        fields = {
            name: _field_type(kind)
            for name, kind in message_class(current).get_fields_and_field_types().items()
        }
        for _, nested in fields.values():
            if nested is not None and nested not in seen:
                seen.add(nested)
                pending.append(nested)
        package, _, name = current.split("/")
        file = shared_file(package, f"{name}.msg")
        if file is not None:
            text = file.read_text(encoding="utf-8").rstrip() + "\n"
        else:
            text = "".join(f"{kind} {field}\n" for field, (kind, _) in fields.items())
        header = f"{_SEPARATOR}\nMSG: {package}/{name}\n" if sections else ""
        sections.append(header + text)
    return "".join(sections)


def message_type_hash(type_name: str) -> str:
    """Return the hash of a message type, ``RIHS01_...``, as publishers tell it; empty where it is not installed."""
    package, _, name = type_name.split("/")
    try:
        file = shared_file(package, f"{name}.json")
    except ImportError:
        return ""
    hashes = [] if file is None else json.loads(file.read_text(encoding="utf-8"))["type_hashes"]
    return next((str(each["hash_string"]) for each in hashes if each["type_name"] == type_name), "")


def shared_file(package: str, name: str) -> Path | None:
    """Return a file about a message, in the share directory of the prefix that its package is installed in."""
    module = importlib.import_module(package)
    places = (parent / "share" / package / "msg" / name for parent in Path(str(module.__file__)).parents)
    return next((place for place in places if place.is_file()), None)


def _field_type(kind: str) -> tuple[str, str | None]:
    """Return a field's type in the definition language, and the message type that it refers to."""
    if match := re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>", kind):
        element, bound = match.groups()
        text, nested = _field_type(element)
        return f"{text}[<={bound}]" if bound else f"{text}[]", nested
    if match := re.fullmatch(r"(.+)\[(\d+)\]", kind):
        text, nested = _field_type(match[1])
        return f"{text}[{match[2]}]", nested
    if match := re.fullmatch(r"(w?string)<(\d+)>", kind):
        return f"{match[1]}<={match[2]}", None
    text = _SPELLING.get(kind, kind)
    if text in _PRIMITIVES or text in ("string", "wstring"):
        return text, None
    package, name = kind.split("/")
    return kind, f"{package}/msg/{name}"
