"""The places in a Python source that can be changed (operators, signs, bounds, constants), found by cosmic-ray."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from functools import cache, partial
from itertools import permutations
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

from benchmarks.mutants.site import Change, Site

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
