"""Size and structure of the code base, and of other versions of it beside this one.

    python -m benchmarks.structure [ROOT ...]

Prints a Markdown table with a column for each root, a checkout of the project (default: this one). The first rows count
the packages eightpost, builder, cosim and fmus; the last ones the Python of tests and benchmarks, and the words of the
pages in docs. A module with one importer is imported by one other module of these
packages; the modules `__init__` of packages count neither as importers nor as imported. Function lengths are in lines
without docstrings.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import resolve_name
from pathlib import Path
from statistics import median

from benchmarks.table import ROOT, markdown

PACKAGES = ("eightpost", "builder", "cosim", "fmus")
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True)
class Source:
    """A Python file."""

    module: str  #: Dotted name of the module; of a package without `.__init__`.
    path: Path  #: File.
    text: str  #: Content.
    tree: ast.Module  #: Syntax tree.

    @property
    def is_package(self) -> bool:
        """Whether the file is the `__init__` of a package."""
        return self.path.name == "__init__.py"


def sources(root: Path) -> list[Source]:
    """Return the Python files of a checkout."""
    found = []
    for path in sorted(path for package in PACKAGES for path in (root / package).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        parts = path.relative_to(root).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found.append(Source(name, path, text, ast.parse(text)))
    return found


def figures(root: Path) -> dict[str, str]:
    """Return the rows of the table for a checkout, by their titles."""
    files = sources(root)
    lengths = sorted(_function_lengths(files))
    folders = Counter(file.path.parent for file in files)
    lines = sorted(file.text.count("\n") for file in files)
    by_module = importers(files)
    named = [node for file in files for node in file.tree.body if isinstance(node, (*_FUNCTIONS, ast.ClassDef))]
    imports = [node for file in files for node in ast.walk(file.tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    pages = (root / "docs").rglob("*.md")
    return {
        "lines of Python": f"{sum(lines)}",
        "files": f"{len(files)}",
        "folders": f"{len(folders)}",
        "files in the largest folder": f"{max(folders.values())}",
        "module length, median / maximum": f"{median(lines):.0f} / {lines[-1]}",
        "public functions and classes": f"{sum(not node.name.startswith('_') for node in named)}",
        "modules with one importer": f"{sum(len(by) == 1 for by in by_module.values())}",
        "import lines": f"{sum((node.end_lineno or 0) - node.lineno + 1 for node in imports)}",
        "function length, median / 90th percentile / maximum": (
            f"{median(lengths):.0f} / {lengths[int(0.9 * len(lengths))]} / {lengths[-1]}"
        ),
        "functions longer than 60 lines": f"{sum(length > 60 for length in lengths)}",
        "tests, lines / files": _size(root / "tests"),
        "benchmarks, lines / files": _size(root / "benchmarks"),
        "docs, words": f"{sum(len(page.read_text(encoding='utf-8').split()) for page in pages)}",
    }


def _size(folder: Path) -> str:
    """Lines and number of the Python files of a folder."""
    paths = list(folder.rglob("*.py"))
    return f"{sum(path.read_text(encoding='utf-8').count(chr(10)) for path in paths)} / {len(paths)}"


def _function_lengths(files: list[Source]) -> Iterator[int]:
    for file in files:
        for node in ast.walk(file.tree):
            if isinstance(node, _FUNCTIONS):
                documented = ast.get_docstring(node, clean=False) is not None
                first = node.body[0]
                docstring = (first.end_lineno or 0) - first.lineno + 1 if documented else 0
                yield (node.end_lineno or 0) - node.lineno + 1 - docstring


def importers(files: list[Source]) -> dict[str, set[str]]:
    """Return the modules that import each module; a name that a package exports counts for the module it is from."""
    modules = {file.module for file in files if not file.is_package}
    exported = {file.module: _exported(file) for file in files if file.is_package}
    found: dict[str, set[str]] = {module: set() for module in modules}
    for file in files:
        if file.is_package:
            continue
        for target in _imported(file, modules, exported):
            if target != file.module:
                found[target].add(file.module)
    return found


def _exported(file: Source) -> dict[str, str]:
    """Return the module that each name of a package comes from."""
    return {
        alias.asname or alias.name: _absolute(file, node)
        for node in ast.walk(file.tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def _imported(file: Source, modules: set[str], exported: dict[str, dict[str, str]]) -> Iterator[str]:
    for node in ast.walk(file.tree):
        if isinstance(node, ast.ImportFrom):
            base = _absolute(file, node)
            for alias in node.names:
                yield from _resolved(base, alias.name, modules, exported)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)


def _resolved(base: str, name: str, modules: set[str], exported: dict[str, dict[str, str]]) -> Iterator[str]:
    if f"{base}.{name}" in modules:
        yield f"{base}.{name}"
    elif base in modules:
        yield base
    elif name in exported.get(base, {}) and exported[base][name] != base:
        yield from _resolved(exported[base][name], name, modules, exported)


def _absolute(file: Source, node: ast.ImportFrom) -> str:
    package = file.module if file.is_package else file.module.rpartition(".")[0]
    return resolve_name("." * node.level + (node.module or ""), package)


def main() -> None:
    """Print the table."""
    roots = [Path(argument).resolve() for argument in sys.argv[1:]] or [ROOT]
    columns = [figures(root) for root in roots]
    rows = [[title, *(column[title] for column in columns)] for title in columns[0]]
    print(markdown(["", *(root.name for root in roots)], rows))


if __name__ == "__main__":
    main()
