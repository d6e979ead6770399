"""Console tables on an identified vehicle: misfit, uncertainty, accuracy of measures, friction."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from eightpost.corners import CORNERS, channel
from eightpost.ident.vehicle.trust import OutputTrust, Trust
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.measure_uncertainty import MeasureUncertainty, separation
from eightpost.report.console import Table, console_table, right
from eightpost.vehicle import Friction

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
    ports = [port for port in ("", *CORNERS, "front", "rear", "driver") if _of(fit, port, tuple(quantities))]
    return console_table(
        ["output", *right(*(port or "misfit" for port in ports))],
        [(q, *(_percent(fit.residual.get(channel(port, q))) for port in ports)) for q in quantities],
        title=f"{fit.vehicle.name}, recipe {fit.recipe}: misfit of the model's response, %",
    )


def trust_table(trust: Trust) -> Table:
    """Return the uncertainty of each quantity: that of its worst output."""
    figures = _FIGURES if any(one.with_friction is not None for one in trust.outputs.values()) else _FIGURES[:-1]
    rows = []
    for quantity in dict.fromkeys(name.rpartition(".")[2] for name in trust.outputs):
        outputs = [one for name, one in trust.outputs.items() if name.rpartition(".")[2] == quantity]
        rows.append((quantity, *(f"{max(map(figure, outputs)):.2g}" for _, figure in figures)))
    title = (
        f"uncertainty of the worst output of each quantity; one standard deviation, from {trust.samples} drawn models"
    )
    return console_table(["quantity", *right(*(head for head, _ in figures))], rows, title=title)


#: Separation of two setups in the table of measures: their predictions differ by 10 %, RMS over all measures and in the
#: measure itself.
TENTH = separation(0.1, 0.1)


def measure_table(trust: Trust) -> Table:
    """Return 95 % intervals of predicted RMS values of untested setups: the worst output of each quantity."""
    rows = []
    for quantity, worst in worst_measures(trust):
        halves = (worst.half_width(0.0), MeasureUncertainty(0.0, worst.own).half_width(TENTH))
        rows.append((quantity, *(f"{100.0 * half:.2g}" for half in halves)))
    title = "accuracy of predicted RMS values of setups that were not tested; 95 % intervals of the worst outputs"
    columns = right("error that all setups share, +- %", "error between two setups 10 % apart, +- %")
    return console_table(["quantity", *columns], rows, title=title)


def worst_measures(trust: Trust) -> Iterator[tuple[str, MeasureUncertainty]]:
    """Yield each quantity with the largest common and the largest own error of its measures."""
    names = {name: name.rpartition(".")[2] for name in trust.measures}
    for quantity in dict.fromkeys(names.values()):
        found = [one for name, one in trust.measures.items() if names[name] == quantity]
        yield quantity, MeasureUncertainty(max(one.common for one in found), max(one.own for one in found))


def friction_table(fit: VehicleFit, trust: Trust) -> Table:
    """Return the estimated friction of every port and the friction that the vehicle has."""
    rows = []
    for port, force in trust.friction.items():
        law = fit.vehicle.friction.get(port)
        used = ("none", "", "") if law is None else (f"{law.sliding_force:.1f}", *_widths(law))
        rows.append((port or "port", f"{force.value:.1f}", f"{force.deviation:.2f}", *used))
    columns = right("estimate, N", "standard deviation, N", "vehicle, N", "velocity, mm/s", "reach, mm")
    return console_table(["port", *columns], rows, title="friction at the ports")


def _widths(law: Friction) -> tuple[str, str]:
    """Return the velocity of the friction that creeps and the reach of the friction that sticks, in mm."""
    velocity = f"{1e3 * law.velocity:.2g}" if law.force or not law.bristle.force else ""
    return velocity, f"{1e3 * law.bristle.reach:.2g}" if law.bristle.force else ""


def damping_sentence(fit: VehicleFit) -> str:
    """Return the baseline damping and the number of states as a sentence."""
    rates = ", ".join(f"{port} {rate:.0f}".strip() for port, rate in fit.vehicle.baseline_damping.items())
    return f"around a baseline damping of {rates} N.s/m; {fit.states} states"


def _of(fit: VehicleFit, port: str, quantities: tuple[str, ...]) -> bool:
    return any(channel(port, quantity) in fit.residual for quantity in quantities)


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100.0 * value:.2g}"
