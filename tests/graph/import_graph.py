"""What imports what in the repository, and what comes along with it."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

IMPORTING = {"import_module", "__import__", "run_module", "exec", "eval"}
"""Functions that import what a text names, or what the code in it imports."""


def within(name: str, places: Iterable[str]) -> bool:
    """Return whether a name is one of the places, or inside of one."""
    return any(f"{name}.".startswith(f"{place}.") for place in places)


def module_name(path: Path, root: Path) -> str:
    """Return the name under which a file below a directory is imported."""
    return ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")


def imported(text: str, package: str) -> Iterator[str]:
    """Yield the full name of everything that a module imports, wherever in it; `package` is the one that it is in."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{origin}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call):
            function = getattr(node.func, "attr", getattr(node.func, "id", ""))
            for argument in [*node.args, *(keyword.value for keyword in node.keywords)]:
                if function in IMPORTING and isinstance(argument, ast.Constant):
                    code = str(argument.value)
                    yield from imported(code, package) if function in ("exec", "eval") else [code]


class ImportGraph:
    """Modules, and what they import.

    Parameters
    ----------
    imports
        What each module imports, as `imported` yields it.
    """

    def __init__(self, imports: Mapping[str, Iterable[str]]) -> None:
        self.imports = {module: set(names) for module, names in imports.items()}
        self._known_steps: dict[str, set[str]] = {}

    @classmethod
    def of(cls, directories: Iterable[Path]) -> ImportGraph:
        """Read all modules in directories that can be imported from."""
        imports = {}
        for directory in directories:
            for path in directory.rglob("*.py"):
                name, package = (module_name(each, directory.parent) for each in (path, path.parent))
                imports[name] = imported(path.read_text(encoding="utf-8"), package)
        return cls(imports)

    def with_statement(self, module: str, statement: str) -> ImportGraph:
        """Return the graph in which a module has one more statement."""
        names = {*self.imports.get(module, ()), *imported(statement, module.rpartition(".")[0])}
        return ImportGraph({**self.imports, module: names})

    def way(self, module: str, wanted: Callable[[str], bool]) -> str:
        """Return how a module comes to import what is wanted, such as "a -> b -> c"; empty if it does not."""
        ways = [(module, module)]
        seen = {module}
        for name, way in ways:  # the nearest first; it grows meanwhile
            for step in sorted(self._steps(name) - seen):
                if wanted(step):
                    return f"{way} -> {step}"
                seen.add(step)
                ways.append((step, f"{way} -> {step}"))
        return ""

    def _steps(self, module: str) -> set[str]:
        """Return what runs when a module is imported: what it imports, and the packages that hold this."""
        if module not in self._known_steps:
            names = self.imports.get(module, ())
            self._known_steps[module] = {run for name in names for run in self._run(name)}
        return self._known_steps[module]

    def _run(self, name: str) -> list[str]:
        parts = name.split(".")
        above = [".".join(parts[:end]) for end in range(1, len(parts) + 1)]
        return [module for module in above if module in self.imports] or [name]
