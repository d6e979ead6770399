"""Probe of values that must be rejected: unknown references, NaN, infinity, values outside min and max."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack
from ctypes import c_char_p, c_double, c_int, c_uint
from typing import Any

from builder.check.catalogue import behaviour as rules
from builder.check.description import Variable
from builder.check.probes.bench import Bench, Results
from builder.check.probes.instance import CallError, Instance, base_type, refused
from builder.check.rules import Finding, Rule, listed

_BUFFERS: dict[str, Any] = {"Real": c_double, "Integer": c_int, "Boolean": c_int, "String": c_char_p}


def probe(bench: Bench) -> Results:
    """Try unknown references, then invalid values."""
    yield from _unknown_references(bench)
    yield from _bad_values(bench)


def _unknown_references(bench: Bench) -> Iterator[Finding]:
    accepted = []
    for kind, buffer_type in _BUFFERS.items():
        used = {int(v.reference) for v in bench.description.variables if v.is_callable and base_type(v) == kind}
        for reference in (max(used, default=0) + 1, 2**32 - 1):
            for way in ("Get", "Set"):
                with bench.running() as instance:
                    content = (buffer_type * 1)(b"x" if kind == "String" else 0)
                    status = instance.call(
                        f"{way}{kind}",
                        (c_uint * 1)(reference),
                        1,
                        content,
                        note=f" of the unknown reference {reference}",
                    )
                    accepted += [] if refused(status) else [f"fmi2{way}{kind} of {reference}"]
    if accepted:
        yield rules.BAD_REFERENCE.finding(f"accepted: {listed(accepted)}")


class _Subject:
    """An instance in initialization mode, which is replaced after it accepts an invalid value or changes a value."""

    def __init__(self, bench: Bench, stack: ExitStack) -> None:
        self._bench, self._stack = bench, stack
        self.fresh()

    def fresh(self) -> None:
        """Create a new instance."""
        self._stack.close()
        self.instance: Instance = self._stack.enter_context(self._bench.initializing())


def _bad_values(bench: Bench) -> Iterator[Finding]:
    accepted: dict[Rule, list[str]] = {}
    changed: list[str] = []
    settable = [v for v in bench.description.variables if v.type == "Real" and v.is_settable_at_start]
    with ExitStack() as stack:
        subject = _Subject(bench, stack)
        for variable in settable:
            for rule, value in _bad(variable):
                if not refused(subject.instance.set(variable, value)):
                    accepted.setdefault(rule, []).append(f"{variable.name} = {value}")
                    subject.fresh()
                elif not _is_unchanged(subject.instance, variable):
                    changed.append(variable.name)
                    subject.fresh()
        if not accepted and not _continues(bench, subject.instance):
            changed.append("the step after rejected values")
    for rule, names in accepted.items():
        yield rule.finding(f"accepted: {listed(names)}")
    if changed:
        yield rules.OLD_VALUE.finding(f"changed: {listed(changed)}")


def _bad(variable: Variable) -> Iterator[tuple[Rule, float]]:
    for value in (math.nan, math.inf, -math.inf):
        yield rules.NOT_FINITE, value
    for end, sign in (("min", -1.0), ("max", 1.0)):
        limit = variable.number(end)
        if limit is not None and abs(limit) < 1e300:
            yield rules.OUT_OF_RANGE, limit + sign * max(1.0, abs(limit))


def _is_unchanged(instance: Instance, variable: Variable) -> bool:
    status, value = instance.get(variable)
    return not refused(status) and value == (variable.number("start") or 0.0)


def _continues(bench: Bench, instance: Instance) -> bool:
    try:
        instance.need("ExitInitializationMode")
        bench.run(instance, bench.held, range(3))
    except CallError:
        return False
    return True
