"""Geometry, statics and dynamics of cable-suspended parallel robots.

The public names are those of ``__init__.pyi``. Each is imported when somebody first asks for it, so that a program that
only reads configuration files does without numba and scipy: half of its start and 60 MB.
"""

import ast
from importlib import import_module
from pathlib import Path

_MODULES = {
    alias.name: str(statement.module)
    for statement in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(statement, ast.ImportFrom)
    for alias in statement.names
}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value


def __dir__() -> list[str]:
    return __all__
