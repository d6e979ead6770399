"""What is said of an identified vehicle: a table for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from eightpost.ident.vehicle.experiment import channel

if TYPE_CHECKING:
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit

_CORNERS = ("lf", "rf", "lr", "rr")


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


def damping_sentence(fit: VehicleFit) -> str:
    """Return the baseline damping in words."""
    rates = ", ".join(f"{port} {rate:.0f}".strip() for port, rate in fit.vehicle.baseline_damping.items())
    return f"around a baseline damping of {rates} N.s/m; {fit.states} states"


def _of(fit: VehicleFit, port: str, quantities: tuple[str, ...]) -> bool:
    return any(channel(port, quantity) in fit.residual for quantity in quantities)


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100.0 * value:.2g}"
