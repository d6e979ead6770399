"""What a fit says of itself as tables, for the command line and the report alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.ident.validation.tables import NONE, Amount, Cell, ResultTable

if TYPE_CHECKING:
    from eightpost.ident.vehicle import VehicleFit


def certainty_table(fit: VehicleFit) -> ResultTable:
    """Return how sure each output is by the fit's own word; no row where the fit does not say it."""
    heads = (
        ("output", ""), ("response, one sigma, %", ""), ("RMS of setups, one sigma, %", ""),
        ("misfit, deviations of the estimate", ""), ("unexplained, % of that without friction", ""),
    )  # fmt: skip
    outputs = {} if fit.trust is None else fit.trust.outputs
    rows: list[tuple[Cell, ...]] = []
    for name, one in outputs.items():
        left = NONE if one.with_friction is None else _percent(one.with_friction)
        rows.append((name, _percent(one.response), _percent(one.measure), Amount(one.misfit, "1", 2), left))
    return ResultTable("How sure the fit is of its outputs", heads, tuple(rows))


def port_table(fit: VehicleFit) -> ResultTable:
    """Return what was found at the ports: friction, and springs that are not straight."""
    heads = (
        ("port", ""), ("friction found", "N"), ("one sigma", "N"), ("taken", "N"), ("over", "m/s"),
        ("spring, square of travel", "N"), ("one sigma", "N"),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    friction, springs = ({}, {}) if fit.trust is None else (fit.trust.friction, fit.trust.springs)
    for port, force in friction.items():
        law, spring = fit.vehicle.friction.get(port), springs.get(port)
        taken = ("none", NONE) if law is None else (Amount(law.force, "N"), Amount(law.velocity, "m/s", 2))
        bent = (NONE, NONE) if spring is None else (Amount(spring.value, "N", 2), Amount(spring.deviation, "N", 2))
        rows.append((port or "port", Amount(force.value, "N"), Amount(force.deviation, "N", 2), *taken, *bent))
    return ResultTable("What the fit found at the ports", heads, tuple(rows))


def _percent(value: float) -> Amount:
    return Amount(100.0 * value, "%", 2)
