"""Console tables on an identified vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from eightpost.ident.vehicle.experiment import channel

if TYPE_CHECKING:
    from collections.abc import Callable

    from eightpost.ident.vehicle.trust import OutputTrust, Trust
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit

_CORNERS = ("lf", "rf", "lr", "rr")

#: Columns of the uncertainty table and their values; the last one is shown only if friction was estimated.
_FIGURES: tuple[tuple[str, Callable[[OutputTrust], float]], ...] = (
    ("response, %", lambda one: 100.0 * one.response),
    ("RMS of setups, %", lambda one: 100.0 * one.measure),
    ("misfit, standard deviations", lambda one: one.misfit),
    ("unexplained, % of the value without friction", lambda one: 100.0 * (one.with_friction or 0.0)),
)


def residual_table(fit: VehicleFit) -> Table:
    """Return the misfit of the model's response [%]: one row per quantity, one column per corner."""
    quantities = dict.fromkeys(name.rpartition(".")[2] for name in fit.residual)
    ports = [port for port in ("", *_CORNERS, "front", "rear", "driver") if _of(fit, port, tuple(quantities))]
    table = Table("output", title=f"{fit.vehicle.name}, recipe {fit.recipe}: misfit of the model's response, %")
    for port in ports:
        table.add_column(port or "misfit", justify="right")
    for quantity in quantities:
        table.add_row(quantity, *(_percent(fit.residual.get(channel(port, quantity))) for port in ports))
    return table


def trust_table(trust: Trust) -> Table:
    """Return the uncertainty of each quantity: that of its worst output."""
    table = Table(
        "quantity",
        title=f"uncertainty of the worst output of each quantity; one standard deviation, from {trust.samples} models "
        "with resampled noise",
    )
    figures = _FIGURES if any(one.with_friction is not None for one in trust.outputs.values()) else _FIGURES[:-1]
    for head, _ in figures:
        table.add_column(head, justify="right")
    for quantity in dict.fromkeys(name.rpartition(".")[2] for name in trust.outputs):
        outputs = [one for name, one in trust.outputs.items() if name.rpartition(".")[2] == quantity]
        table.add_row(quantity, *(f"{max(map(figure, outputs)):.2g}" for _, figure in figures))
    return table


def friction_table(fit: VehicleFit, trust: Trust) -> Table:
    """Return the estimated friction of every port and the friction that the vehicle has."""
    table = Table("port", title="friction at the ports")
    for head in ("estimate, N", "standard deviation, N", "vehicle, N", "velocity, mm/s"):
        table.add_column(head, justify="right")
    for port, force in trust.friction.items():
        law = fit.vehicle.friction.get(port)
        used = ("none", "") if law is None else (f"{law.force:.1f}", f"{1e3 * law.velocity:.2g}")
        table.add_row(port or "port", f"{force.value:.1f}", f"{force.deviation:.2f}", *used)
    return table


def damping_sentence(fit: VehicleFit) -> str:
    """Return the baseline damping and the number of states as a sentence."""
    rates = ", ".join(f"{port} {rate:.0f}".strip() for port, rate in fit.vehicle.baseline_damping.items())
    return f"around a baseline damping of {rates} N.s/m; {fit.states} states"


def _of(fit: VehicleFit, port: str, quantities: tuple[str, ...]) -> bool:
    return any(channel(port, quantity) in fit.residual for quantity in quantities)


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100.0 * value:.2g}"
