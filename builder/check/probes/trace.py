"""Probe that computes a digest of the outputs of a short run, to compare it with the same run elsewhere."""

from __future__ import annotations

import hashlib
import struct

from builder.check.probes.bench import Bench, Measured, Results


def probe(bench: Bench) -> Results:
    """Run and yield the digest of the outputs."""
    with bench.running() as instance:
        rows = [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, bench.all_points())]
    flat = [value for row in rows for value in row]
    yield Measured("outputs", hashlib.sha256(struct.pack(f"<{len(flat)}d", *flat)).hexdigest())
