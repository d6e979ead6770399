"""Probe of damaged or truncated serialized states, which the FMU must reject."""

from __future__ import annotations

from collections.abc import Iterator

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Results, Skip
from builder.check.probes.instance import refused
from builder.check.probes.state import halves
from builder.check.rules import listed

_PLACES = 12


def probe(bench: Bench) -> Results:
    """Damage bytes at several places of a serialized state."""
    if not (bench.description.can("canGetAndSetFMUstate") and bench.description.can("canSerializeFMUstate")):
        yield Skip("canSerializeFMUstate is not true")
        return
    with bench.running() as instance:
        bench.run(instance, bench.excitation, halves(bench)[0])
        content = instance.serialized(instance.state())
    accepted = []
    for what, damaged in _damaged(content):
        with bench.running() as instance:
            bench.library.begin(f"fmi2DeSerializeFMUstate of bytes {what}")
            status, _ = instance.deserialize(damaged)
            accepted += [] if refused(status) else [what]
    if accepted:
        yield rules.CORRUPT.finding(f"accepted: {listed(accepted)}")


def _damaged(content: bytes) -> Iterator[tuple[str, bytes]]:
    for place in range(0, len(content), max(len(content) // _PLACES, 1)):
        yield f"with byte {place} changed", content[:place] + bytes([content[place] ^ 0x41]) + content[place + 1 :]
    yield "cut in half", content[: len(content) // 2]
    yield "without content", b""
    yield "with bytes appended", content + b"\0" * 8
