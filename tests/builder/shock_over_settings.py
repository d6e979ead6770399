"""Shocks of every law with two adjusters, the temperature, and a combination of the adjusters."""

from eightpost.shock import LAWS, Port, Shock, fit_parameters

from ..shock.example_curve import example_settings, knot_curve

#: All laws; `hysteresis` also with settings that change its lagged curve and its stop on their own.
SHOCKS = (*LAWS, "hysteresis_lagged")


def shock_of(name):
    """A shock of a law with random effects of two adjusters, the temperature and one combination."""
    law, has_lagged = LAWS[name.removesuffix("_lagged")], name.endswith("_lagged")
    own = {p.name: p.start for p in fit_parameters(law)}
    varied = tuple(p.name for p in fit_parameters(law) if p.scale == "logarithmic")
    curve = knot_curve()
    if law.__name__ == "Hysteresis":
        half = tuple(0.5 * slope for slope in curve.knot_slope)
        stop = {"stop_stiffness": 2e5, "stop_yield": 4e-4, "stop_time": 0.02}
        own, varied = {"lagged_slope": half, "time_constant": (4e-3, 2e-3, 5e-3), **stop}, ("time_constant",)
        varied = ("lagged_slope", "stop_stiffness", *varied) if has_lagged else varied
    lagged = [(500.0, 25)] * has_lagged
    parts = [(400.0, 25), *lagged, (0.1, len(varied) - has_lagged), (20.0, 1)]
    settings = example_settings(varied, parts, seed=1, deviation=1.0)
    port = Port(gas_preload=50.0, gas_stiffness=700.0, seal_friction=15.0)
    return Shock(name, law(curve, port=port, **own), settings=settings)
