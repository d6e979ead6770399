"""Tables of a fit's self-assessment, for the command line and the report."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.ident.validation.tables import NONE, Amount, Cell, ResultTable

if TYPE_CHECKING:
    from eightpost.ident.vehicle import VehicleFit


def certainty_table(fit: VehicleFit) -> ResultTable:
    """Return the uncertainty of each output as the fit estimates it; no rows if the fit does not contain it."""
    heads = (
        ("output", ""), ("response, one sigma, %", ""), ("RMS of setups, one sigma, %", ""),
        ("misfit, standard deviations of the estimate", ""), ("unexplained, % of that without friction", ""),
    )  # fmt: skip
    outputs = {} if fit.trust is None else fit.trust.outputs
    rows: list[tuple[Cell, ...]] = []
    for name, one in outputs.items():
        left = NONE if one.with_friction is None else _percent(one.with_friction)
        rows.append((name, _percent(one.response), _percent(one.measure), Amount(one.misfit, "1", 2), left))
    return ResultTable("Uncertainty of the outputs, from the fit", heads, tuple(rows))


def port_table(fit: VehicleFit) -> ResultTable:
    """Return the friction and the spring nonlinearity that were estimated at the ports."""
    heads = (
        ("port", ""), ("friction, estimate", "N"), ("one sigma", "N"), ("friction, in the model", "N"),
        ("transition velocity", "m/s"), ("spring, square of travel", "N"), ("one sigma", "N"),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    friction, springs = ({}, {}) if fit.trust is None else (fit.trust.friction, fit.trust.springs)
    for port, force in friction.items():
        law, spring = fit.vehicle.friction.get(port), springs.get(port)
        taken = ("none", NONE) if law is None else (Amount(law.force, "N"), Amount(law.velocity, "m/s", 2))
        bent = (NONE, NONE) if spring is None else (Amount(spring.value, "N", 2), Amount(spring.deviation, "N", 2))
        rows.append((port or "port", Amount(force.value, "N"), Amount(force.deviation, "N", 2), *taken, *bent))
    return ResultTable("Estimates at the ports", heads, tuple(rows))


def _percent(value: float) -> Amount:
    return Amount(100.0 * value, "%", 2)
