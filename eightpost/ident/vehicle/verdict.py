"""Summary of an identified vehicle, and its verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

from eightpost.corners import CORNERS, channel
from eightpost.ident.vehicle.trust import UNUSABLE, OutputTrust, Trust
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.measure_uncertainty import MeasureUncertainty, separation
from eightpost.model_uncertainty import ModelUncertainty
from eightpost.report.console import Table, console_table, right
from eightpost.validity import Range, Validity
from eightpost.vehicle import Friction
from eightpost.vehicle.statespace import StateSpace
from eightpost.verdict import Grade, Reason, Rules, Verdict

# ---- Console tables on an identified vehicle ------------------------------------------------------------------------


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


# ---- Verdict on an identified vehicle -------------------------------------------------------------------------------

ABOUT = "fit of the vehicle"

#: Limits of the misfit of an output, weighted by frequency as in the fit [1].
GOOD_FIT, POOR_FIT = 0.1, 0.3

RULES = Rules()

UNSTABLE = RULES.add("vehicle not stable", ABOUT, Grade.NOT_USABLE,
    condition="the car is unstable with at least one of the linear dampers that were tried",
    why="a simulation with such shocks may diverge",
    remedy="identify with more tests of other shocks, or without the channels that fit worst",
)  # fmt: skip
MISFIT = RULES.add("large misfit of the vehicle", ABOUT, Grade.NOT_USABLE,
    condition=f"misfit of an output of {100 * POOR_FIT:g} % or more",
    why="the model does not reproduce a third of the output's response",
    remedy="check the plots of the fit; leave the output out (--output-channels), or repeat the tests",
)  # fmt: skip
DOUBTFUL_FIT = RULES.add("notable misfit of the vehicle", ABOUT, Grade.LIMITED,
    condition=f"misfit of an output above {100 * GOOD_FIT:g} %",
    why="differences between setups are of similar size",
    remedy="compare setups by the other outputs, and validate on other records (eightpost validate)",
)  # fmt: skip
GOOD = RULES.add("small misfit of the vehicle", ABOUT, Grade.USABLE,
    condition=f"misfit of every output at most {100 * GOOD_FIT:g} %",
    why="differences between setups are larger",
)  # fmt: skip
FLAG = RULES.add("flag of the identification", ABOUT, Grade.LIMITED,
    condition="the tests show effects that a linear model does not have: nonlinear springs, tires that lift off, a "
    "misfit larger than noise, an output that no input explains",
    why="the model is accurate only near the amplitudes of the tests",
    remedy="test at the amplitudes of the track, and validate on other records (eightpost validate)",
)  # fmt: skip
NOT_SIMULATED = RULES.add("vehicle cannot be simulated", ABOUT, Grade.NOT_USABLE,
    condition="no model of the car can be simulated with other dampers, or one of its own tests cannot be simulated",
    why="a run with other shocks may diverge, and the accuracy of predictions is not known",
    remedy="see the notes on the models that were rejected; identify with more or longer tests, or with fewer outputs",
)  # fmt: skip
CHOSEN = RULES.add("recipe chosen by a left-out test", "choice of the recipe", Grade.USABLE,
    condition="the recipe was chosen by the error of its free-running simulation of a test that it left out",
    why="the error is that of a prediction, not of a fit",
    remedy="nothing; --recipe names another one",
)  # fmt: skip


#: Flags that need no reason, because the model includes the effect.
_MODELLED = ("friction", "port springs")


def with_validity(fit: VehicleFit, further: Iterable[Reason] = ()) -> VehicleFit:
    """Return the fit with its verdict, further reasons, the covered ranges and the uncertainty added to the vehicle."""
    verdict = Verdict((*fit_verdict(fit).reasons, *further))
    stated = fit.trust.measures if fit.trust is not None else {}
    uncertainty = ModelUncertainty(measures=stated) if stated else None
    validity = Validity(verdict, tuple(_ranges(fit.ranges, fit.vehicle.coupled())), uncertainty)
    return replace(fit, vehicle=replace(fit.vehicle, validity=validity))


def fit_verdict(fit: VehicleFit) -> Verdict:
    """Return the verdict on a fit."""
    return Verdict(_reasons(fit))


def _reasons(fit: VehicleFit) -> Iterator[Reason]:
    origin = f"{fit.recipe} fit to {', '.join(fit.sources) or 'records in memory'}"
    if not fit.stable:
        yield UNSTABLE.reason("the car is not stable with every damper", figure="1 damper or more", origin=origin)
    worst = max(fit.residual, key=lambda name: fit.residual[name])
    value = fit.residual[worst]
    rule = GOOD if value <= GOOD_FIT else DOUBTFUL_FIT if value < POOR_FIT else MISFIT
    statement = "the model reproduces its tests" if rule is GOOD else "the model does not reproduce its tests well"
    figure = f"{worst} {100 * value:.1f} %; limits {100 * GOOD_FIT:g} and {100 * POOR_FIT:g} %"
    yield rule.reason(statement, figure=figure, origin=origin)
    if fit.choice is not None and fit.choice.trials:
        yield CHOSEN.reason(fit.choice.reason, figure=fit.choice.figures, origin=origin)
    for name, sentence in ({} if fit.trust is None else fit.trust.flags).items():
        if name == UNUSABLE:
            yield NOT_SIMULATED.reason("the car cannot be simulated", figure=sentence.rstrip("."), origin=origin)
        elif name not in _MODELLED:
            yield FLAG.reason("the car is not fully linear", figure=sentence.rstrip("."), origin=origin)


def _ranges(ranges: Mapping[str, tuple[float, float]], model: StateSpace) -> Iterator[Range]:
    """Yield the amplitude ranges of the model's channels, and the fitted band for every output.

    The band of a velocity has a lower end; other outputs may be static.
    """
    units = {channel.name: channel.unit for channel in (*model.inputs, *model.outputs)}
    for name, (low, high) in ranges.items():
        if name in units:
            yield Range(name, "amplitude", low, high, units[name])
    if "frequency" in ranges:
        low, high = ranges["frequency"]
        for channel in model.outputs:
            moves = channel.name.rpartition(".")[2] == "velocity"
            yield Range(channel.name, "frequency", low if moves else 0.0, high, "Hz")
