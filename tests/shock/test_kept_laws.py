"""The numbers of every law, of a shock over its settings, of shapes and of what a shock file states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eightpost.shock import (
    LAWS,
    Port,
    Shock,
    fit_parameters,
    law_title,
    own_parameters,
    own_values,
    parameter_units,
    read_shock,
    state_names,
    write_shock,
)
from eightpost.shock.file import fitted_parameters, setting_text, shock_uncertainty
from eightpost.shock.settings import is_tested, node_weights
from eightpost.shock.shape import difference, fit_force, fit_law, range_of, unit_of, with_slope
from tests.drawn import rounded

from .test_settings import law as adjusted_law
from .test_settings import settings

BANK = sorted((Path(__file__).resolve().parents[2] / "examples" / "bank").glob("*.json"))
PORT = Port(motion_ratio=0.8, compression_scale=1.1, rebound_scale=0.9, gas_preload=50.0, gas_stiffness=700.0,
            seal_friction=15.0)  # fmt: skip
SPEEDS = np.concatenate([-np.geomspace(1.5, 1e-3, 12), [0.0], np.geomspace(1e-3, 1.5, 12)])


@pytest.mark.parametrize("name", LAWS)
def test_a_law(name: str, shocks: dict[str, Shock], unchanged: Callable[..., None]) -> None:
    law = replace(shocks[name].law, port=PORT)
    time = np.arange(401) * 1e-3
    velocity = 0.5 * np.sin(12.0 * time) + 0.2 * np.sin(70.0 * time)
    travel = 0.04 * (1.0 - np.cos(12.0 * time))
    state, forces = law.start(float(velocity[0])), []
    for before, after, place in zip(velocity[:-1], velocity[1:], travel[1:], strict=True):
        state = law.follow(state, float(before), float(after), 1e-3)
        forces.append(tuple(law.response(state, float(after), float(place))))
    kind = type(law)
    unchanged({
        "title": law_title(name), "states": state_names(kind), "parameters": own_parameters(kind),
        "units": parameter_units(kind), "fit": [rounded(str(one)) for one in fit_parameters(kind)],
        "own": np.array(own_values(law)),
        "static": np.array([law.static_force(v) for v in SPEEDS.tolist()]),
        "curve": np.array([law.curve.force(v) for v in SPEEDS.tolist()]),
        "beyond": [law.curve.is_beyond_fit(v) for v in (-1.2, -1.0, 1.0, 1.3)],
        "seal": np.array([law.port.seal_force(v) for v in (-0.1, -1e-3, 1e-4, 2e-3)]),
        "weight": np.array([law.lag_weight(f) for f in (-3000.0, -900.0, 0.0, 400.0, 1200.0, 5000.0)]),
        "responses": list(np.array(forces, dtype=float).T),
        "last state": np.array(state if isinstance(state, tuple) else [state]),
        "summary": str(Shock(name, law)),
    })  # fmt: skip


SETTINGS: list[dict[str, float]] = [
    {"rebound": 5}, {"rebound": 14}, {"rebound": 24}, {"rebound": 12, "compression": 3},
    {"rebound": 2, "compression": 2}, {"compression": 7},
]  # fmt: skip


@pytest.mark.parametrize("temperature", [None, 333.0, 360.0])
def test_a_shock_at_its_settings(temperature: float | None, unchanged: Callable[..., None]) -> None:
    shock = Shock("two adjusters", adjusted_law(), settings=settings(size=60.0))
    found = {str(setting): shock.at(clicks=setting, temperature=temperature) for setting in SETTINGS}
    unchanged({name: {
        "force": np.array(one.law.curve.knot_force), "slope": np.array(one.law.curve.knot_slope),
        "lag": one.law.time_constant, "band": np.array(one.fit["curve_band"]["half_width [N]"]),
        "preload": one.law.port.gas_preload, "conditions": one.conditions,
        "verdict": [str(reason) for reason in one.validity.verdict.reasons],
    } for name, one in found.items()})  # fmt: skip


def test_the_axes_of_settings(unchanged: Callable[..., None]) -> None:
    found, values = settings(), (-1.0, 0.0, 2.0, 5.0, 11.0, 20.0, 24.0, 300.0, 333.0)
    nodes = ((0.0, 5.0), (0.0, 5.0, 12.0), (0.0, 5.0, 12.0, 20.0))
    unchanged({
        "axes": {axis.name: {
            "whole": axis.is_whole, "variable": axis.variable, "choices": np.array(axis.choices()),
            "values": [f"{v:g}: beyond {axis.beyond(v):g}, interval {axis.interval(v)}, intervals beyond "
                       f"{axis.intervals_beyond(v):.6g}, neighbours {axis.neighbours(v)}" for v in values],
        } for axis in found.axes},
        "weights": [np.array(node_weights(each, v)) for each in nodes for v in values[:7]],
        "factors": found.factors, "count": found.deviation_count,
        "tested": " ".join(str(is_tested(found, (r, c, t))) for r in (0.0, 5.0, 9.0, 16.0)
                   for c in (0.0, 3.0) for t in (320.0, 330.0)),
        "text": [setting_text(found, s) for s in ((5.0, 0.0, 320.0), (9.0, 3.0, 333.3))],
        "summary": str(Shock("two adjusters", adjusted_law(), settings=found)),
    })  # fmt: skip


def test_shapes_of_the_shipped_bank(unchanged: Callable[..., None]) -> None:
    fits = [fit_law(read_shock(path).law) for path in BANK[:3]]
    shapes = [fit.shape for fit in fits]
    numbers = shapes[0].numbers()
    unchanged({
        "fits": [{**fit.shape.numbers(), "relative": fit.relative} for fit in fits],
        "law": np.array(shapes[0].law().curve.knot_force), "parameters": len(shapes[0].parameters()),
        "difference": difference(shapes[0], shapes[1].curve().force),
        "units": {name: unit_of(name) for name in numbers},
        "ranges": {name: range_of(shapes, name) for name in numbers if name.startswith("rebound")},
        "asymmetric": fit_force(lambda v: 2e3 * np.tanh(v / 0.1) + (500.0 * v if v > 0.0 else 900.0 * v), 0.8, 0.6),
    }, relative=1e-3)  # fmt: skip


@pytest.mark.parametrize("speeds", ["low", "high", "all"])
def test_a_steeper_side(speeds: str, unchanged: Callable[..., None]) -> None:
    curve = read_shock(BANK[0]).law.curve
    unchanged([np.array([one.force(v) for v in SPEEDS.tolist()]) for side in ("compression", "rebound")
               for one in with_slope(curve, side, 0.2, speeds)])  # fmt: skip


def test_what_a_shipped_shock_states(tmp_path: Path, unchanged: Callable[..., None]) -> None:
    shock = read_shock(BANK[1])
    uncertain, fitted = shock_uncertainty(shock), fitted_parameters(shock)
    assert uncertain is not None and fitted is not None
    write_shock(shock, tmp_path / "shock.json")
    unchanged({"summary": str(shock), "numbers": " ".join(shock.numbers), "values": fitted.values,
               "covariance": fitted.covariance, "lowest": fitted.lowest, "highest": fitted.highest,
               "held": fitted.held, "uncertainty": uncertain.parameters})  # fmt: skip
    assert (tmp_path / "shock.json").read_text() == BANK[1].read_text()
