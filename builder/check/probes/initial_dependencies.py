"""Probe of dependencies at initialization: observed dependencies compared with those that InitialUnknowns declares."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence

from builder.check.catalogue import behaviour as rules
from builder.check.description import Variable
from builder.check.probes.bench import Bench, Results, Skip, Values, amplitude, inside
from builder.check.probes.instance import Instance, Value, refused
from builder.check.probes.pairs import Pairs, change_of, declared_pairs, other_value

#: Distance of inputs from their start values, in amplitudes, for each point.
_SCALES = (1.0, 1.0, 3.0, 3.0, 10.0, 10.0, 10.0, 10.0)
_SWEEP, _MOST, _DECADES = 400, 20_000, 4


def probe(bench: Bench) -> Results:
    """Perturb each known at several points; if no effect is observed, also over a sweep of each input."""
    declared = declared_pairs(bench.description, "InitialUnknowns")
    unknowns = [v for v in _unknowns(bench) if v.name in declared]
    knowns = [v for v in bench.description.variables if v.type in ("Real", "Boolean") and _is_known(v)]
    if not unknowns or not knowns:
        yield Skip("no dependencies are declared" if not declared else "there is nothing to perturb")
        return
    pairs = Pairs(declared, {v.name for v in knowns})
    draw = random.Random(2)
    for scale in _SCALES:
        with bench.initializing() as instance:
            point = _Point(instance, unknowns)
            _set_all(bench, instance, draw, scale)
            for known in knowns:
                point.perturb(known, pairs)
    _sweep(bench, unknowns, pairs)
    yield from pairs.findings("in initialization mode", rules.FALSE)


def _unknowns(bench: Bench) -> list[Variable]:
    found = (bench.description.variable(u.index) for u in bench.description.in_section("InitialUnknowns"))
    return [v for v in found if v is not None and v.type == "Real" and v.is_callable]


def _is_known(variable: Variable) -> bool:
    return variable.is_settable_at_start


def _set_all(bench: Bench, instance: Instance, draw: random.Random, scale: float) -> None:
    """Set values other than the start values; variables whose value is rejected keep their value."""
    for variable in bench.description.of("parameter", "Boolean"):
        instance.set(variable, draw.random() < 0.5)
    for variable in bench.description.of("parameter"):
        instance.set(variable, other_value(variable, draw))
        if refused(instance.get_reals(bench.outputs)[0]):
            instance.set(variable, variable.number("start") or 0.0)
    for variable in bench.inputs:
        start = variable.number("start") or 0.0
        value = start + scale * (other_value(variable, draw) - start)
        instance.set(variable, inside(variable, value))


class _Point:
    """An instance in initialization mode, at one set of knowns."""

    def __init__(self, instance: Instance, unknowns: Sequence[Variable]) -> None:
        self._instance, self._unknowns = instance, unknowns

    def perturb(self, known: Variable, pairs: Pairs) -> None:
        """Change one known and restore it; record the unknowns that changed, if they were restored too."""
        status, value = self._instance.get(known)
        before = self._values()
        if refused(status) or before is None or refused(self._instance.set(known, _changed(known, value))):
            return
        during = self._values()
        if refused(self._instance.set(known, value)) or during is None or self._values() != before:
            return
        for unknown, old, new in zip(self._unknowns, before, during, strict=True):
            pairs.record(unknown, known, (old, new))

    def _values(self) -> Values | None:
        status, values = self._instance.get_reals(self._unknowns)
        return None if refused(status) else values


def _changed(known: Variable, value: Value) -> Value:
    if known.type == "Boolean":
        return not value
    change = change_of(known)
    moved = inside(known, float(value) + change)
    return moved if moved != value else inside(known, float(value) - change)


def _sweep(bench: Bench, unknowns: Sequence[Variable], pairs: Pairs) -> None:
    """Sweep each input: some parameters only have an effect in a narrow range of an input, often near its start."""
    for variable in bench.inputs:
        names = pairs.unseen_knowns()
        knowns = [v for v in bench.description.variables if v.name in names]
        if not knowns:
            return
        with bench.initializing() as instance:
            _set_all(bench, instance, random.Random(3), 1.0)
            point, count = _Point(instance, unknowns), min(_SWEEP, _MOST // (len(knowns) * len(bench.inputs)))
            for value in _spread(variable, count):
                if not refused(instance.set(variable, inside(variable, value))):
                    for known in knowns:
                        point.perturb(known, pairs)


def _spread(variable: Variable, count: int) -> Iterator[float]:
    """Yield values on both sides of the start value, up to ten amplitudes, with geometric spacing."""
    start, farthest, half = variable.number("start") or 0.0, 10.0 * amplitude(variable), max(count // 2, 2)
    yield start
    for k in range(half):
        distance = farthest * 10.0 ** (-_DECADES * k / (half - 1))
        yield from (start - distance, start + distance)
