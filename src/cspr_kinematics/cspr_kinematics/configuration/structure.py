"""From the mapping of a configuration file to dataclasses whose annotations give type and range.

msgspec says whether a value fits its annotation; what is added here are the keys and the words: an unknown key is
refused together with the nearest known one, and every error names the value by its path and says what is needed.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta
from msgspec.inspect import EnumType, FloatType, IntType, LiteralType, Metadata, type_info

from cspr_kinematics.errors import ConfigurationFileError, InvalidInputError

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Text = Annotated[str, Meta(pattern=r"\S")]
Vector = tuple[float, float, float]

T = TypeVar("T")


def structured(kind: type[T], content: object, source: str, key: str = "") -> T:
    """Return a configuration as the dataclass that it must fit.

    Parameters
    ----------
    kind
        The dataclass. Its fields may be numbers, texts, enums, literals, dataclasses, and lists, tuples and mappings
        of them, with the constraints of `msgspec.Meta`; of a union, a list goes to the alternative that is one. A
        field without default must be there, and there must be no key besides the fields. A `Meta` that is given
        a `description` ends the error of a value out of its range with it.
    content
        The mapping that was read.
    source, key
        Name of the file, and path of the mapping in it, for errors.

    Raises
    ------
    ConfigurationFileError
        For the first key or value that does not fit.
    """
    _check(kind, content, source, key)
    return msgspec.convert(content, kind)


def unknown_key(name: object, known: Iterable[str]) -> str:
    """Return what is wrong with a key that is none of those known, and which of them may have been meant."""
    known = sorted(known)
    hint = did_you_mean(name, known)
    return f"unknown key{hint} {'known' if hint == ';' else 'Known'} here: {', '.join(known)}"


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return ``; did you mean X?`` for the known name that is most like another; ``;`` if none is."""
    lower = {each.lower(): each for each in known}
    nearest = difflib.get_close_matches(str(name).lower(), lower, 1)
    return f"; did you mean {lower[nearest[0]]}?" if nearest else ";"


@contextmanager
def located(source: str, key: str = "") -> Iterator[None]:
    """Turn an InvalidInputError of a constructor into one that names the file, and the value below `key` in it."""
    try:
        yield
    except InvalidInputError as error:
        raise ConfigurationFileError(source, _path(key, error.name), error.value, error.reason) from error


def _check(kind: Any, value: object, source: str, key: str) -> None:
    kind = _alternative(kind, value)
    bare = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    origin, inner = get_origin(bare), get_args(bare)
    reason = ""
    parts: list[tuple[Any, object, str]] = []
    if dataclasses.is_dataclass(bare):
        parts = _fields(bare, value, source, key)
    elif origin is dict:
        if not isinstance(value, Mapping):
            reason = "must be a mapping of keys to values"
        elif not all(isinstance(name, str) and name for name in value):
            reason = "its keys must be texts"
        else:
            parts = [(inner[1], entry, _path(key, name)) for name, entry in value.items()]
    elif origin in (list, tuple):
        if not isinstance(value, list | tuple):
            reason = "must be a list of texts" if inner[0] is str else "must be a list"
        elif origin is tuple and Ellipsis not in inner and len(value) != len(inner):
            reason = f"has {len(value)} elements where {len(inner)} are needed"
        elif not value and getattr(type_info(kind), "min_length", None):
            reason = "must be a list of at least one element"
        else:
            kinds = inner if origin is tuple and Ellipsis not in inner else (inner[0],) * len(value)
            places = [f"{key}[{place}]" for place in range(len(value))]
            parts = list(zip(kinds, value, places, strict=True))
    else:
        reason = _fault(kind, value)
    if reason:
        raise ConfigurationFileError(source, key or None, value, reason)
    for part in parts:
        _check(part[0], part[1], source, part[2])


def _fields(kind: Any, value: object, source: str, key: str) -> list[tuple[Any, object, str]]:
    """Return annotation, value and path of what a dataclass is made of."""
    hints = get_type_hints(kind, include_extras=True)
    fields = {field.name: field for field in dataclasses.fields(kind)}
    if not isinstance(value, Mapping):
        raise ConfigurationFileError(
            source, key or None, value, f"must be a mapping of keys to values: {', '.join(fields)}"
        )
    for name, entry in value.items():
        if name not in fields:
            raise ConfigurationFileError(source, _path(key, name), entry, unknown_key(name, fields))
    for name, field in fields.items():
        required = field.default is field.default_factory is dataclasses.MISSING
        if required and name not in value:
            raise ConfigurationFileError(source, _path(key, name), None, "is missing")
    return [(hints[name], entry, _path(key, name)) for name, entry in value.items()]


def _alternative(kind: Any, value: object) -> Any:
    """Return the one of a union's alternatives that a value must fit."""
    if get_origin(kind) not in (Union, UnionType):
        return kind
    alternatives = get_args(kind)
    if value is None and NoneType in alternatives:
        return NoneType
    lists = [one for one in alternatives if get_origin(one) in (list, tuple)]
    others = [one for one in alternatives if one is not NoneType and one not in lists]
    return (lists if lists and (isinstance(value, list | tuple) or not others) else others)[0]


def _fault(kind: Any, value: object) -> str:
    """Return what is needed where a single value does not fit; empty if it does."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    try:
        msgspec.convert(value, kind)
        fits = not number or _is_finite(value)  # type: ignore[arg-type]
    except msgspec.ValidationError:
        fits = False
    if fits:
        return ""
    info, why = type_info(kind), ""
    if isinstance(info, Metadata):
        why = f", {(info.extra_json_schema or {}).get('description', '')}"
        info = info.type
    if isinstance(info, FloatType):
        if not number or not _is_finite(value):  # type: ignore[arg-type]
            return f"must be a finite number{_hint(value)}"
        return f"must {_bound(info, value)}{why}"  # type: ignore[arg-type]
    if isinstance(info, IntType):
        return f"must be a whole number from {info.ge} to {info.le}{why}"
    if isinstance(info, LiteralType | EnumType):
        bare = get_args(kind)[0] if get_origin(kind) is Annotated else kind
        choices = get_args(bare) if get_origin(bare) is Literal else [entry.value for entry in bare]
        return f"must be one of {', '.join(map(str, choices))}{why}"
    return "must be a non-empty text"


def _is_finite(value: float) -> bool:
    """Return whether a number is finite as a double; there is no end to Python's whole numbers."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _bound(info: FloatType, value: float) -> str:
    if info.ge is not None and info.le is not None:
        return f"lie in [{info.ge:g}, {info.le:g}]"
    if info.gt is not None and value <= info.gt:
        return f"be greater than {info.gt:g}" if info.gt else "be positive"
    if info.ge is not None and value < info.ge:
        return f"be at least {info.ge:g}" if info.ge else "not be negative"
    return f"be at most {info.le:g}" if info.le is not None else f"be less than {info.lt:g}"


def _hint(value: object) -> str:
    """Return how a text that was meant as a number is written as one."""
    try:
        float(value if isinstance(value, str) else "")
    except ValueError:
        return ""
    return "; without quotes"


def _path(key: str, name: object) -> str:
    return f"{key}.{name}" if key else str(name)
