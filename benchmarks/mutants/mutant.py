"""Mutants: places in Python and C sources that can be changed, and a random sample of them."""

from __future__ import annotations

import hashlib
import random
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from difflib import unified_diff
from functools import cache, partial
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

from benchmarks.mutants.area_tests import ROOT, Area

#: Function of a source that returns the changed source, or None if the change cannot be made.
Change = Callable[[str], str | None]


class Site(NamedTuple):
    """A place and the changes that can be made there, one at a time."""

    line: int  #: Line number, from 1.
    column: int  #: Column number, from 0.
    changes: tuple[Change, ...]  #: Changes, each of which gives a mutant.


@dataclass(frozen=True)
class Mutant:
    """A source with one change."""

    area: str  #: Name of the area.
    file: str  #: Path relative to the root of the checkout.
    line: int  #: Line number of the change, from 1.
    before: str  #: Original source.
    after: str  #: Changed source.

    @property
    def key(self) -> str:
        """Key that is equal for equal changes of equal sources."""
        return hashlib.sha256(f"{self.area}\0{self.file}\0{self.after}".encode()).hexdigest()[:16]

    @property
    def lines(self) -> tuple[str, str]:
        """Original and changed line, without leading and trailing spaces."""
        return tuple(text.splitlines()[self.line - 1].strip() for text in (self.before, self.after))

    @property
    def diff(self) -> str:
        """Change as a patch."""
        texts = (text.splitlines() for text in (self.before, self.after))
        return "\n".join(unified_diff(*texts, f"a/{self.file}", f"b/{self.file}", n=1, lineterm=""))


def mutants(areas: Sequence[Area], seed: int, root: Path = ROOT) -> Iterator[Mutant]:
    """Yield mutants of areas in random order, one for each place of their sources.

    A longer sample with the same seed starts with the shorter one.
    """
    places = [
        (area, path, site)
        for area in areas
        for path in area.sources
        for site in (python_sites if path.suffix == ".py" else c_sites)((root / path).read_text(encoding="utf-8"))
    ]
    chance = random.Random(seed)
    chance.shuffle(places)
    for area, path, site in places:
        before = (root / path).read_text(encoding="utf-8")
        after = chance.choice(site.changes)(before)
        if after is not None and after != before:
            yield Mutant(area.name, path.as_posix(), site.line, before, after)


_NO_CODE = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|^[ \t]*#(?:\\\n|[^\n])*', re.DOTALL | re.MULTILINE)
_NUMBER = re.compile(r"(?<![\w.])(?:0x[0-9a-fA-F.]+(?:p[+-]?\d+)?|\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)(?![\w.])")
_SIGN = re.compile(r"(?<![-\w)\]])-(?=[\w(.])|!(?=[\w(])")
_OPERATOR = re.compile(r"(?<=\s)(?:[-+*/]|[-+*/]=|[<>]=?|[=!]=|&&|\|\|)(?=\s)")
_OTHERS = {
    "+": "-*", "-": "+*", "*": "/+", "/": "*-",
    "+=": ("-=",), "-=": ("+=",), "*=": ("/=",), "/=": ("*=",),
    "<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="), ">=": (">", "<"), "==": ("!=",), "!=": ("==",),
    "&&": ("||",), "||": ("&&",),
}  # fmt: skip


def c_sites(source: str) -> list[Site]:
    """Return the places of a C source, in the order of the text."""
    code = _NO_CODE.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), source)
    sites = [_site(source, found, ("",)) for found in _SIGN.finditer(code)]
    sites += [_site(source, found, _OTHERS[found[0]]) for found in _OPERATOR.finditer(code)]
    sites += [_site(source, found, _neighbours(found[0])) for found in _NUMBER.finditer(code)]
    return sorted(sites, key=lambda site: site[:2])


def _site(source: str, found: re.Match[str], others: str | tuple[str, ...]) -> Site:
    before = source[: found.start()]
    changes = tuple(partial(_c_changed, found.span(), other) for other in others)
    return Site(before.count("\n") + 1, len(before) - before.rfind("\n") - 1, changes)


def _neighbours(number: str) -> tuple[str, ...]:
    """Return the number plus one and minus one, like cosmic-ray does for Python."""
    if number.isdigit():
        return str(int(number) + 1), str(int(number) - 1)
    value = float.fromhex(number) if number.startswith("0x") else float(number)
    return repr(value + 1.0), repr(value - 1.0)


def _c_changed(span: tuple[int, int], other: str, source: str) -> str:
    return source[: span[0]] + other + source[span[1] :]


_ARITHMETIC = [(one, other) for one in ("Add", "Sub", "Mul", "Div") for other in ("Add", "Sub", "Mul", "Div")]
_ARITHMETIC += [("FloorDiv", "Div"), ("Mod", "Mul"), ("Pow", "Mul"), ("BitAnd", "BitOr")]
_COMPARISONS = [*permutations(("Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"), 2), ("Is", "IsNot"), ("IsNot", "Is")]

OPERATORS = (
    *(f"core/ReplaceBinaryOperator_{one}_{other}" for one, other in _ARITHMETIC if one != other),
    *(f"core/ReplaceComparisonOperator_{one}_{other}" for one, other in _COMPARISONS),
    "core/ReplaceAndWithOr",
    "core/ReplaceOrWithAnd",
    "core/ReplaceUnaryOperator_Delete_USub",
    "core/ReplaceUnaryOperator_Delete_Not",
    "core/NumberReplacer",
)


#: Types of parso nodes in which a star is not a multiplication.
_STARRED = ("parameters", "param", "argument", "star_expr", "dictorsetmaker", "lambdef")


def python_sites(source: str) -> list[Site]:
    """Return the places of a Python source, in the order of the text."""
    changes: defaultdict[tuple[int, int], list[Change]] = defaultdict(list)
    nodes = list(ast_nodes(get_ast(source)))
    for name in OPERATORS:
        for occurrence, (line, column) in enumerate(_positions(name, nodes)):
            changes[line, column].append(partial(_changed, name, occurrence))
    changes.pop((-1, -1), None)
    return [Site(line, column, tuple(found)) for (line, column), found in sorted(changes.items())]


def _positions(name: str, nodes: list[Any]) -> Iterator[tuple[int, int]]:
    """Yield the positions of an operator; (-1, -1) if it mistakes a star of arguments for a multiplication."""
    operator = _operator(name)
    for node in nodes:
        for start, _ in operator.mutation_positions(node):
            yield (-1, -1) if node.parent is not None and node.parent.type in _STARRED else start


def _changed(name: str, occurrence: int, source: str) -> str | None:
    changed: str | None = mutate_code(source, _operator(name), occurrence)
    return changed


@cache
def _operator(name: str) -> Any:
    return get_operator(name)()
