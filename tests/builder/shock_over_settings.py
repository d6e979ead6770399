"""Shocks of every law with two adjusters, the temperature, and a combination of the adjusters."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from eightpost.shock import LAWS, Axis, Port, Settings, Shock, Term, fit_parameters

_SPEC = importlib.util.spec_from_file_location(
    "example_curve", Path(__file__).parents[1] / "shock" / "example_curve.py"
)
example_curve = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(example_curve)

#: All laws; `hysteresis` also with settings that change its lagged curve and its stop on their own.
SHOCKS = (*LAWS, "hysteresis_lagged")


def shock_of(name):
    """A shock of a law with random effects of two adjusters, the temperature and one combination."""
    law, has_lagged = LAWS[name.removesuffix("_lagged")], name.endswith("_lagged")
    own = {p.name: p.start for p in fit_parameters(law)}
    varied = tuple(p.name for p in fit_parameters(law) if p.scale == "logarithmic")
    curve = example_curve.knot_curve()
    if law.__name__ == "Hysteresis":
        half = tuple(0.5 * slope for slope in curve.knot_slope)
        stop = {"stop_stiffness": 2e5, "stop_yield": 4e-4, "stop_time": 0.02}
        own, varied = {"lagged_slope": half, "time_constant": (4e-3, 2e-3, 5e-3), **stop}, ("time_constant",)
        varied = ("lagged_slope", "stop_stiffness", *varied) if has_lagged else varied
    random = np.random.default_rng(1)
    axes = (
        Axis("rebound", (0.0, 5.0, 12.0, 20.0), 5.0, counted="from full hard", lowest=0.0, highest=25.0),
        Axis("compression", (0.0, 3.0), 0.0),
        Axis("temperature", (300.0, 320.0, 345.0), 320.0, unit="K"),
    )

    def rows(count, kept):
        lagged = [(500.0, 25)] * has_lagged
        parts = [(400.0, 25), *lagged, (0.1, len(varied) - has_lagged), (20.0, 1)]
        found = np.hstack([random.normal(0.0, size, (count, width)) for size, width in parts])
        found[[k for k in range(count) if k not in kept]] = 0.0
        return tuple(map(tuple, found.tolist()))

    terms = (
        Term(("rebound",), rows(4, (0, 2, 3))),
        Term(("compression",), rows(2, (1,))),
        Term(("temperature",), rows(3, (0, 2))),
        Term(("rebound", "compression"), rows(8, (5, 7))),
    )
    single = [(r, 0.0, 320.0) for r in axes[0].nodes] + [(5.0, 3.0, 320.0), (5.0, 0.0, 300.0), (5.0, 0.0, 345.0)]
    tested = (*single, (12.0, 3.0, 320.0), (20.0, 3.0, 320.0))
    settings = Settings(axes, varied, terms, tested, ((1.0,) * 25,) * len(tested))
    port = Port(gas_preload=50.0, gas_stiffness=700.0, seal_friction=15.0)
    return Shock(name, law(curve, port=port, **own), settings=settings)
