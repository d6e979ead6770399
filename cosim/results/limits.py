"""Reasons of a run's verdict from limits that are watched at every step: velocities, settings, tires off the ground."""

from __future__ import annotations

from collections.abc import Iterator

from cosim.results import rules
from cosim.results.run_data import RunData
from cosim.results.validity import LARGEST_SHARE, NOTABLE_SHARE
from eightpost.verdict import Reason


def limit_reasons(run: RunData) -> Iterator[Reason]:
    """Yield the reasons from the shares of time beyond the limits of shocks and tires."""
    yield from _fitted(run)
    yield from _settings(run)
    yield from _tires(run)


def _fitted(run: RunData) -> Iterator[Reason]:
    for shock, time in run.share_beyond_fit.items():
        energy = _energy_beyond(run, shock)
        share = max(time, energy or 0.0)
        beyond = rules.BEYOND_FIT if share <= LARGEST_SHARE else rules.MOSTLY_BEYOND_FIT
        rule, within = (rules.WITHIN_FIT, "stays within") if share <= NOTABLE_SHARE else (beyond, "leaves")
        dissipated = "" if energy is None else f", {energy:.1%} of its energy"
        yield rule.reason(
            f"the shock {within} the velocities that it was fitted on",
            figure=f"outside {time:.1%} of the time{dissipated}; limits {NOTABLE_SHARE:.0%} and {LARGEST_SHARE:.0%}",
            origin=f"component {shock}",
        )


def _settings(run: RunData) -> Iterator[Reason]:
    """Yield the reasons about the settings of shocks that have them."""
    for shock, beyond in run.share_beyond_settings.items():
        far = run.share_far_beyond_settings.get(shock, 0.0)
        untested = run.share_untested_settings.get(shock, 0.0)
        origin = f"component {shock}"
        if beyond > 0.0:
            yield (rules.FAR_BEYOND_SETTINGS if far > 0.0 else rules.BEYOND_SETTINGS).reason(
                "the shock is set beyond the settings that were measured",
                figure=f"{beyond:.0%} of the time, by more than an interval between measured settings {far:.0%}",
                origin=origin,
            )
        if untested > 0.0:
            figure = f"{untested:.0%} of the time"
            yield rules.UNTESTED_SETTINGS.reason(
                "the shock is at a combination of settings that was not measured", figure=figure, origin=origin
            )
        if not beyond and not untested:
            figure = "0 % of the time beyond or at an untested combination"
            yield rules.WITHIN_SETTINGS.reason("the shock is at measured settings", figure=figure, origin=origin)


def _energy_beyond(run: RunData, shock: str) -> float | None:
    """Return the share of a shock's dissipated energy outside its fitted velocities; None if not recorded."""
    names = (f"{shock}.dissipated_power", f"{shock}.beyond_fit")
    if not set(names) <= set(run.series.names):
        return None
    settled = run.settled()
    power, beyond = (abs(settled[name]) for name in names)
    total = float(power.sum())
    return float(power[beyond > 0.5].sum()) / total if total else 0.0


def _tires(run: RunData) -> Iterator[Reason]:
    for tire, off in run.share_tire_off.items():
        if off is None:
            yield rules.STATIC_LOAD_UNKNOWN.reason(
                "lift-off of tires cannot be detected: no static tire force is given", figure="0 N", origin=tire
            )
        elif off > 0.0:
            rule = rules.TIRE_OFF if off <= LARGEST_SHARE else rules.MOSTLY_TIRE_OFF
            figure = f"{off:.1%} of the time; limit {LARGEST_SHARE:.0%}"
            yield rule.reason("a tire is off the ground", figure=figure, origin=tire)
