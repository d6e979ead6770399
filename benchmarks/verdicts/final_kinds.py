"""Kinds of virtual dampers of the set `final`: no rule or threshold of the verdict was chosen with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from benchmarks.verdicts.damper import Damper
from benchmarks.verdicts.kinds import Kind, Random, between, common, digressive, pair


def bypassed(random: Random) -> Damper:
    """Softer in the middle of the stroke."""
    return replace(digressive(random), bypass=between(random, 0.05, 1.0))


def cushioned(random: Random) -> Damper:
    """A hydraulic stop near the ends of the stroke."""
    cushion = between(random, 500.0, 10000.0)
    return replace(digressive(random), cushion=cushion, reach=between(random, 0.015, 0.04))


def selective(random: Random) -> Damper:
    """Frequency-selective damping."""
    return replace(digressive(random), selective=between(random, 5e3, 2e5))


def loose(random: Random) -> Damper:
    """Play of a mount."""
    return replace(digressive(random), play=between(random, 2e-5, 5e-4))


def aerated(random: Random) -> Damper:
    """Oil with bubbles, soft at low pressure."""
    bubbles = between(random, 30.0, 500.0)
    return replace(digressive(random), gas_in_oil=bubbles, stiffness=between(random, 3e5, 2e6))


def magnetic(random: Random) -> Damper:
    """A magneto-rheological valve."""
    return Damper(laminar=pair(random, 600.0, 3000.0), blow_off=(1e5, 1e5), yield_force=between(random, 50.0, 1500.0),
                  **common(random))  # fmt: skip


FINAL: Mapping[str, Kind] = {
    "bypassed": bypassed, "cushioned": cushioned, "selective": selective, "loose": loose, "aerated": aerated,
    "magnetic": magnetic,
}  # fmt: skip
