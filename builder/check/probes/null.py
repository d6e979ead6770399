"""Probe of NULL arguments in place of arrays."""

from __future__ import annotations

from collections.abc import Iterator
from ctypes import c_double, c_uint
from typing import Any

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Results
from builder.check.probes.instance import refused
from builder.check.probes.library import FREEING_NOTHING
from builder.check.rules import listed


def probe(bench: Bench) -> Results:
    """Call fmi2FreeInstance(NULL), which the standard allows; then pass NULL for each array in turn."""
    bench.library.begin(FREEING_NOTHING)
    bench.library._function("FreeInstance")(None)
    accepted = []
    for name, arguments in _calls(bench):
        with bench.running() as instance:
            status = instance.call(name, *arguments, note=" with NULL")
            accepted += [] if refused(status) else [f"fmi2{name}"]
    if accepted:
        yield rules.NULL_ARGUMENT.finding(f"accepted by {listed(list(dict.fromkeys(accepted)))}")


def _calls(bench: Bench) -> Iterator[tuple[str, tuple[Any, ...]]]:
    real = (bench.inputs or bench.outputs)[:1]
    if real:
        reference, value = (c_uint * 1)(int(real[0].reference)), (c_double * 1)()
        for name in ("GetReal", "SetReal"):
            yield name, (None, 1, value)
            yield name, (reference, 1, None)
    if bench.description.can("canGetAndSetFMUstate"):
        yield "GetFMUstate", (None,)
        yield "SetFMUstate", (None,)
    if bench.description.can("canSerializeFMUstate"):
        yield "DeSerializeFMUstate", (None, 8, None)
    if bench.description.can("providesDirectionalDerivative"):
        yield "GetDirectionalDerivative", (None, 1, None, 1, None, None)
    if bench.description.can("canInterpolateInputs") and bench.inputs:
        yield "SetRealInputDerivatives", (None, 1, None, None)
