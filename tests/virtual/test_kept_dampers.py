"""The numbers of the virtual dampers: parts, static forces, responses and the search for a valving."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from eightpost.virtual import cavitation, configuration, random_multisine, shim_build
from eightpost.virtual.damper import PSI, PhysicalDamper, Valving, nearest_valving
from eightpost.virtual.shocks import demo_damper
from eightpost.virtual.valves import SHIM_SETS, ShimStack
from tests.drawn import rounded

SPEEDS = (-1.0, -0.4, -0.15, -0.05, -0.01, 0.0, 0.01, 0.05, 0.15, 0.4, 1.0)
DAMPERS = {
    "configuration 1": configuration(1),
    "configuration 6": configuration(6),
    "configuration 9": configuration(9),
    "C over AA, 14 clicks, 0 psi": shim_build("C/AA", clicks=14, gas_pressure=0.0),
    "F over B, 400 psi": shim_build("F/B", clicks=28, gas_pressure=400.0 * PSI),
    "valving": Valving("C", "E", head="A", clicks=12, jet=0.5e-6, dish=0.1e-3).damper(),
}


@pytest.mark.parametrize("name", DAMPERS)
def test_a_damper(name: str, unchanged: Callable[..., None]) -> None:
    damper: PhysicalDamper = DAMPERS[name]
    run = damper.respond(random_multisine(1, duration=0.5).series, rate=1000.0)
    unchanged({
        "damper": rounded(repr(damper)),
        "numbers": np.array(damper.row.numbers),
        "start": damper.row.start,
        "static": np.array([damper.static_force(v) for v in SPEEDS]),
        "pressures": np.array([damper.steady_pressures(v) for v in SPEEDS]),
        "damping": damper.nominal_damping(),
        "travel": damper.cylinder.travel,
        "run": dict(zip(run.names, run.values, strict=True)),
        "cavitation": cavitation(run),
    })  # fmt: skip


def test_the_stacks_of_shims(unchanged: Callable[..., None]) -> None:
    stacks = {code: ShimStack(code) for code in SHIM_SETS}
    unchanged({code: np.array([stack.stiffness, stack.lift]) for code, stack in stacks.items()})


@pytest.mark.parametrize("build", "ABC")
def test_a_demonstration_damper(build: str, unchanged: Callable[..., None]) -> None:
    damper = demo_damper(build)
    run = damper.respond(random_multisine(1, duration=0.5).series, rate=1000.0)
    static = np.array([damper.static_force(v) for v in SPEEDS])
    unchanged({"damper": rounded(repr(damper)), "static": static, "run": dict(zip(run.names, run.values, strict=True))})


def test_the_valvings_that_come_closest(monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]) -> None:
    monkeypatch.setattr("eightpost.virtual.damper._CODES", ("B", "C", "E"))
    monkeypatch.setattr("eightpost.virtual.damper.JETS", (0.3e-6, 0.8e-6))
    monkeypatch.setattr("eightpost.virtual.damper.DISHES", (0.0, 0.2e-3))
    digressive = nearest_valving(lambda v: float(1500.0 * np.tanh(v / 0.2) + 800.0 * v + 30.0))
    straight = nearest_valving(lambda v: 4000.0 * v if v > 0.0 else 9000.0 * v)
    unchanged({"digressive": digressive, "straight": straight})
