"""Pairs of instances that differ in one input or parameter."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping

from builder.check.catalogue import behaviour as rules
from builder.check.description import Description, Variable
from builder.check.probes.bench import amplitude, inside
from builder.check.rules import Finding, Rule, listed

# ---- Perturbed values of variables ----------------------------------------------------------------------------------


def other_value(variable: Variable, draw: random.Random) -> float:
    """Return a random value in the range, within one amplitude (inputs) or 10 % (parameters) of the start value."""
    start = variable.number("start") or 0.0
    size = amplitude(variable) if variable.causality == "input" else (0.1 * abs(start) or 0.1)
    change = size * draw.uniform(-1.0, 1.0)
    if inside(variable, start + change) != start + change:
        change = -change  # at the end of the range, change in the other direction
    return inside(variable, start + change)


def change_of(variable: Variable) -> float:
    """Return a change that is small compared with the variable and large compared with rounding errors."""
    start = abs(variable.number("start") or 0.0)
    return 1e-3 * (amplitude(variable) if variable.causality == "input" else start or 0.1)


# ---- Comparison of declared and observed dependencies ---------------------------------------------------------------

#: Changes relative to the unknown's size (at least its nominal value): possible by rounding, and never by rounding.
_ROUNDING, _CERTAIN = 1e-13, 1e-9


def declared_pairs(description: Description, section: str) -> dict[str, set[str]]:
    """Return the names of the declared dependencies of each unknown that declares any."""
    found: dict[str, set[str]] = {}
    for unknown in description.in_section(section):
        variable = description.variable(unknown.index)
        if variable is not None and unknown.dependencies is not None:
            known = (description.variable(index) for index in unknown.dependencies)
            found[variable.name] = {v.name for v in known if v is not None}
    return found


class Pairs:
    """Pairs of unknown and known: declared pairs, and pairs observed when the known was changed.

    `tried` are the names of the knowns that are changed.
    """

    def __init__(self, declared: Mapping[str, set[str]], tried: set[str]) -> None:
        self._declared, self._tried = declared, tried
        self._seen: set[tuple[str, str]] = set()
        self._certain: set[tuple[str, str]] = set()

    def record(self, unknown: Variable, known: Variable, values: tuple[float, float]) -> None:
        """Record the two values of an unknown for two values of a known."""
        first, second = values
        change, size = abs(second - first), max(abs(first), abs(second), unknown.number("nominal") or 1.0)
        if change > _ROUNDING * size:
            self._seen.add((unknown.name, known.name))
        if change > _CERTAIN * size:
            self._certain.add((unknown.name, known.name))

    def _unseen(self) -> list[tuple[str, str]]:
        return [
            (unknown, known)
            for unknown, names in self._declared.items()
            for known in sorted(names & self._tried)
            if (unknown, known) not in self._seen
        ]

    def unseen_knowns(self) -> set[str]:
        """Return the knowns of all declared pairs that were not observed."""
        return {known for _, known in self._unseen()}

    def findings(self, where: str, false: Rule) -> Iterator[Finding]:
        """Compare both; `false` is the rule for declared dependencies that were never observed."""
        hidden: dict[str, list[str]] = {}
        for unknown, known in sorted(self._certain):
            if known not in self._declared.get(unknown, {known}):
                hidden.setdefault(unknown, []).append(known)
        for unknown, knowns in hidden.items():
            yield rules.HIDDEN.finding(f"{where} {unknown} depends on {listed(knowns)}, which it does not declare")
        never: dict[str, list[str]] = {}
        for unknown, known in self._unseen():
            never.setdefault(unknown, []).append(known)
        for unknown, knowns in never.items():
            rule = rules.FALSE_VELOCITY if false is rules.FALSE_VELOCITY and _is_velocity(unknown) else rules.FALSE
            yield rule.finding(f"{where} {unknown} never depended on {listed(knowns)}, which it declares")


def _is_velocity(name: str) -> bool:
    return name.rpartition(".")[2] == "velocity"
