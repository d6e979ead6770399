"""Kinds of virtual dampers of the set `final`: no rule or threshold of the verdict was chosen with them."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.verdicts.damper import Damper
from benchmarks.verdicts.kinds import Kind, Random, between, common, digressive, pair


def bypassed(random: Random) -> Damper:
    """Softer in the middle of the stroke."""
    base = digressive(random)
    return Damper(laminar=base.laminar, blow_off=base.blow_off, opened=base.opened, bleed=base.bleed,
                  bypass=between(random, 0.05, 1.0), **common(random))  # fmt: skip


def cushioned(random: Random) -> Damper:
    """A hydraulic stop near the ends of the stroke."""
    base = digressive(random)
    known = common(random) | {"reach": between(random, 0.015, 0.04)}
    return Damper(laminar=base.laminar, blow_off=base.blow_off, opened=base.opened, bleed=base.bleed,
                  cushion=between(random, 500.0, 10000.0), **known)  # fmt: skip


def selective(random: Random) -> Damper:
    """Frequency-selective damping."""
    base = digressive(random)
    return Damper(laminar=base.laminar, blow_off=base.blow_off, opened=base.opened, bleed=base.bleed,
                  selective=between(random, 5e3, 2e5), **common(random))  # fmt: skip


def loose(random: Random) -> Damper:
    """Play of a mount."""
    base = digressive(random)
    return Damper(laminar=base.laminar, blow_off=base.blow_off, opened=base.opened, bleed=base.bleed,
                  play=between(random, 2e-5, 5e-4), **common(random))  # fmt: skip


def aerated(random: Random) -> Damper:
    """Oil with bubbles, soft at low pressure."""
    base = digressive(random)
    known = common(random) | {"stiffness": between(random, 3e5, 2e6)}
    return Damper(laminar=base.laminar, blow_off=base.blow_off, opened=base.opened, bleed=base.bleed,
                  gas_in_oil=between(random, 30.0, 500.0), **known)  # fmt: skip


def magnetic(random: Random) -> Damper:
    """A magneto-rheological valve."""
    return Damper(laminar=pair(random, 600.0, 3000.0), blow_off=(1e5, 1e5), yield_force=between(random, 50.0, 1500.0),
                  **common(random))  # fmt: skip


FINAL: Mapping[str, Kind] = {
    "bypassed": bypassed, "cushioned": cushioned, "selective": selective, "loose": loose, "aerated": aerated,
    "magnetic": magnetic,
}  # fmt: skip
