"""What is said of an identified vehicle: tables for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from eightpost.ident.vehicle.experiment import channel

if TYPE_CHECKING:
    from collections.abc import Callable

    from eightpost.ident.vehicle.trust import OutputTrust, Trust
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit

_CORNERS = ("lf", "rf", "lr", "rr")

#: Heads of the table of trust, and what stands below; the last one only where friction was looked for.
_FIGURES: tuple[tuple[str, Callable[[OutputTrust], float]], ...] = (
    ("response, %", lambda one: 100.0 * one.response),
    ("RMS of setups, %", lambda one: 100.0 * one.measure),
    ("misfit, deviations", lambda one: one.misfit),
    ("unexplained, % of that without friction", lambda one: 100.0 * (one.with_friction or 0.0)),
)


def residual_table(fit: VehicleFit) -> Table:
    """Return how far the model is from its response: a row per quantity, a column per corner, in percent."""
    quantities = dict.fromkeys(name.rpartition(".")[2] for name in fit.residual)
    ports = [port for port in ("", *_CORNERS, "front", "rear", "driver") if _of(fit, port, tuple(quantities))]
    table = Table("output", title=f"{fit.vehicle.name}, recipe {fit.recipe}: misfit of the model's response, %")
    for port in ports:
        table.add_column(port or "misfit", justify="right")
    for quantity in quantities:
        table.add_row(quantity, *(_percent(fit.residual.get(channel(port, quantity))) for port in ports))
    return table


def trust_table(trust: Trust) -> Table:
    """Return how far each quantity is to be trusted: the worst of its outputs."""
    table = Table(
        "quantity",
        title=f"how sure, worst output of a quantity; one sigma from {trust.samples} models with other noise",
    )
    figures = _FIGURES if any(one.with_friction is not None for one in trust.outputs.values()) else _FIGURES[:-1]
    for head, _ in figures:
        table.add_column(head, justify="right")
    for quantity in dict.fromkeys(name.rpartition(".")[2] for name in trust.outputs):
        outputs = [one for name, one in trust.outputs.items() if name.rpartition(".")[2] == quantity]
        table.add_row(quantity, *(f"{max(map(figure, outputs)):.2g}" for _, figure in figures))
    return table


def friction_table(fit: VehicleFit, trust: Trust) -> Table:
    """Return the friction of every port as it was found, with what the vehicle has of it."""
    table = Table("port", title="friction at the ports")
    for head in ("found, N", "one sigma, N", "taken, N", "over, mm/s"):
        table.add_column(head, justify="right")
    for port, force in trust.friction.items():
        law = fit.vehicle.friction.get(port)
        taken = ("none", "") if law is None else (f"{law.force:.1f}", f"{1e3 * law.velocity:.2g}")
        table.add_row(port or "port", f"{force.value:.1f}", f"{force.deviation:.2f}", *taken)
    return table


def damping_sentence(fit: VehicleFit) -> str:
    """Return the baseline damping in words."""
    rates = ", ".join(f"{port} {rate:.0f}".strip() for port, rate in fit.vehicle.baseline_damping.items())
    return f"around a baseline damping of {rates} N.s/m; {fit.states} states"


def _of(fit: VehicleFit, port: str, quantities: tuple[str, ...]) -> bool:
    return any(channel(port, quantity) in fit.residual for quantity in quantities)


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100.0 * value:.2g}"
