"""The numbers of the preparation: laws of mechanics, findings about faults and their sizes, and prepared records."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from eightpost.corners import CORNERS
from eightpost.ident.preparation import (
    Decimation,
    Preparation,
    advance_channels,
    check_lost_channels,
    drifts,
    prepare,
    record_lags,
)
from eightpost.ident.preparation.channel_faults import clipped, dropouts, spikes, unit_remedy
from eightpost.ident.preparation.mechanics import comparisons, spectra_of
from eightpost.ident.preparation.plausibility import record_findings
from eightpost.rig import RigTest
from eightpost.rig.faults import Fault
from eightpost.signals import TimeSeries
from eightpost.virtual.program import stand_in_truth
from tests.drawn import flat, timed
from tests.limits import limit_of

from ..linear_rig import record
from .test_plausibility import eight_post as eight_post  # noqa: PLC0414 -- a fixture
from .test_plausibility import exchanged, with_row
from .test_plausibility import sound as sound  # noqa: PLC0414 -- a fixture


@cache
def short(name: str = "seven_dof") -> TimeSeries:
    return record(name, seconds=16.0, seed=3).series


def said(found: tuple[Fault, ...] | list[Fault]) -> list[str]:
    return [timed(f"{one.rule.name}: {', '.join(one.channels)}: {one.figure}: {one.remedy}") for one in found]


def laws(series: TimeSeries, corners: tuple[str, ...], mass: float | None = None) -> list[str]:
    spectra = spectra_of(series)
    assert spectra is not None
    return [
        f"{one.law} {one.kind} {one.value:.5g} of {one.tolerance:.5g} +- {one.deviation:.3g} score {one.score:.4g}: "
        + " ".join(f"{name} {effect:.3g}" for name, effect in one.effect.items())
        for one in comparisons(spectra, corners, mass)
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["seven_dof", "quarter_car", "eight_post"])
def test_the_laws_of_a_sound_record(name: str, eight_post: TimeSeries, unchanged: Callable[..., None]) -> None:
    series = eight_post if name == "eight_post" else short(name)
    unchanged(laws(series, ("",) if name == "quarter_car" else CORNERS, 900.0), relative=1e-3)


def scaled(name: str, factor: float) -> Callable[[TimeSeries], TimeSeries]:
    return lambda series: with_row(series, name, factor * series[name])


def late(seconds: float, *names: str) -> Callable[[TimeSeries], TimeSeries]:
    return lambda series: advance_channels(series, dict.fromkeys(names, -seconds))


def noise(name: str, size: float = 1.0) -> Callable[[TimeSeries], TimeSeries]:
    def change(series: TimeSeries) -> TimeSeries:
        drawn = np.random.default_rng(0).standard_normal(len(series))
        return with_row(series, name, series[name] * (1.0 - min(size, 1.0)) + size * series[name].std() * drawn)

    return change


def of_all(quantity: str, factor: float) -> Callable[[TimeSeries], TimeSeries]:
    def change(series: TimeSeries) -> TimeSeries:
        for corner in CORNERS:
            series = with_row(series, f"{corner}.{quantity}", factor * series[f"{corner}.{quantity}"])
        return series

    return change


FAULTS: dict[str, Callable[[TimeSeries], TimeSeries]] = {
    "a tire in pounds": scaled("lf.tire_force", 1.0 / 4.4482),
    "an accelerometer that reads 1.3 times": scaled("rr.hub_acceleration", 1.3),
    "a chassis that reads 0.7 times": scaled("lr.chassis_acceleration", 0.7),
    "a ride height that reads 1.5 times": scaled("front.ride_height", 1.5),
    "a pot in millimetres": scaled("rf.displacement", 25.4),
    "a damper force that reads 1.6 times": scaled("lf.force", 1.6),
    "a reversed hub": scaled("rr.hub_acceleration", -1.0),
    "a reversed force": scaled("rf.force", -1.0),
    "a late pot": late(0.02, "lf.displacement"),
    "a late pot with its velocity": late(0.03, "rr.displacement", "rr.velocity"),
    "an early tire": late(-5e-3, "lr.tire_force"),
    "a late force": late(4e-3, "rf.force"),
    "noise for a force": noise("rf.force"),
    "noise for a road": noise("lf.road"),
    "swapped hubs": lambda series: exchanged(series, "lf.hub_acceleration", "rr.hub_acceleration"),
    "swapped heights": lambda series: exchanged(series, "front.ride_height", "rear.ride_height"),
    "all tires wrong": of_all("tire_force", 1.4),
    "all pots wrong": of_all("displacement", 1.2),
    "two faults": lambda series: scaled("rf.tire_force", 1.3)(scaled("lr.displacement", 25.4)(series)),
}


@pytest.mark.parametrize("name", FAULTS)
def test_the_findings_about_a_fault(name: str, unchanged: Callable[..., None]) -> None:
    found = record_findings(FAULTS[name](short()), CORNERS, mass=1100.0 if "all" in name else None)
    unchanged(said(found), relative=1e-2)


def spike(size: float) -> TimeSeries:
    values = short()["lf.displacement"].copy()
    values[9000] += size * values.std()
    return with_row(short(), "lf.displacement", values)


def two_spikes(size: float) -> TimeSeries:
    """Another channel sees the spike."""
    values = short()["lf.force"].copy()
    values[9010] += size * values.std()
    return with_row(spike(8.0), "lf.force", values)


def spike_of_acceleration(size: float) -> TimeSeries:
    values = short()["lf.hub_acceleration"].copy()
    values[9000] += size * values.std()
    return with_row(short(), "lf.hub_acceleration", values)


def held(samples: float) -> TimeSeries:
    values = short()["lf.force"].copy()
    values[9000 : 9000 + round(samples)] = values[9000]
    return with_row(short(), "lf.force", values)


def coarse(share: float) -> TimeSeries:
    values = short()["lf.force"]
    rounded = np.round(values / (share * values.std())) * share * values.std()
    rounded[9000:9100] = rounded[9000]
    return with_row(short(), "lf.force", rounded)


def clipped_by(share: float) -> TimeSeries:
    values = short()["lf.force"]
    return with_row(short(), "lf.force", np.minimum(values, np.quantile(values, 1.0 - share)))


SAMPLES: dict[str, tuple[Callable[[float], list[Fault]], float, float]] = {
    "a spike": (lambda k: list(spikes(spike(k))), 0.01, 8.0),
    "a spike of an acceleration": (lambda k: list(spikes(spike_of_acceleration(k))), 0.3, 20.0),
    "a spike that another channel sees": (lambda k: list(spikes(two_spikes(k))), 1e-3, 0.4),
    "a held value": (lambda k: list(dropouts(held(k))), 3.0, 100.0),
    "a held value of a coarse channel": (lambda k: list(dropouts(coarse(k))), 1e-4, 0.5),
    "clipped peaks": (lambda k: list(clipped(clipped_by(k))), 1e-4, 0.1),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_the_size_from_which_a_fault_of_samples_is_found(name: str, unchanged: Callable[..., None]) -> None:
    found, low, high = SAMPLES[name]
    size = limit_of(lambda k: bool(found(k)), low, high, steps=5)
    unchanged({"from": size, "at either end": [said(found(end)) for end in (low, high)]}, relative=1e-3)


def lost(share: float) -> str:
    series, at = short(), slice(2000, 2000 + round(share * len(short())))
    values = series["lf.force"].copy()
    values[at] = values[2000]
    try:
        check_lost_channels(with_row(series, "lf.force", values), CORNERS)
    except ValueError as error:
        return str(error)
    return ""


def test_the_length_from_which_a_channel_is_lost(unchanged: Callable[..., None]) -> None:
    unchanged({"from": limit_of(lambda k: bool(lost(k)), 1e-3, 0.4), "said": lost(0.4)}, relative=1e-3)


@pytest.mark.parametrize("name", ["seven_dof", "quarter_car"])
def test_the_lags_of_a_record(name: str, unchanged: Callable[..., None]) -> None:
    series, corners = (short(name), CORNERS) if name == "seven_dof" else (short(name), ("",))
    own = [
        f"{corner}.{what}".lstrip(".") for corner in corners for what in ("hub_acceleration", "chassis_acceleration")
    ]
    out = advance_channels(series, dict.fromkeys(own, -0.004))
    found = [*record_lags(out, corners), *drifts(out, corners)]
    unchanged(
        [timed(f"{lag}, {lag.drift_text}, notable {lag.is_notable} {lag.correlation:.4f}") for lag in found],
        relative=1e-3,
    )


@pytest.mark.parametrize("corner", ["lf.displacement", "lf.force"])
def test_the_lag_from_which_a_channel_is_notable(corner: str, unchanged: Callable[..., None]) -> None:
    series = short().window(0.0, 8.0)

    def is_notable(seconds: float) -> bool:
        names = [corner, "lf.velocity"] if corner.endswith("displacement") else [corner]
        lags = record_lags(advance_channels(series, dict.fromkeys(names, -seconds)), CORNERS)
        return any(lag.is_notable for lag in lags)

    unchanged(limit_of(is_notable, 5e-4, 0.05, steps=4), relative=1e-3)


def test_the_unit_that_a_gain_betrays(unchanged: Callable[..., None]) -> None:
    names = ("lf.tire_force", "lf.hub_acceleration", "lf.displacement", "lf.velocity", "aero_command", "ride_height")
    gains = (0.04, 0.0545, 0.1, 0.2248, 0.24, 0.25, 4.4, 9.81, 10.5, 25.4, 27.0, 28.0, 1000.0)
    unchanged([f"{gain} {name}: {unit_remedy(name, gain)}" for gain in gains for name in names])


def by_name(series: TimeSeries, values: np.ndarray) -> str:
    return flat(dict(zip(series.names, values.tolist(), strict=True)))


WAYS = {
    "default": Preparation(),
    "own velocity, shorter settling": Preparation(Decimation(250.0, ripple=0.1), pot_cutoff=None, settling=0.5),
    "geometry and delays": Preparation(geometry=stand_in_truth().geometry, delays={"lf.force": 2e-3}, settling=1.0),
}


@pytest.mark.parametrize("name", WAYS)
def test_prepared_records(name: str, unchanged: Callable[..., None]) -> None:
    tests = [RigTest(short().window(0.0, 6.0), source=Path("a.csv")), RigTest(short().window(7.0, 12.0))]
    loads = {f"{corner}.aero": ("N", 100.0 + short()[f"{corner}.force"]) for corner in CORNERS}
    places = {f"{corner}.aero_position": ("m", short()[f"{corner}.displacement"]) for corner in CORNERS}
    if name == "geometry and delays":
        series = short()
        for channel, (unit, values) in (loads | places).items():
            series = series.with_channel(channel, unit, values)
        tests = [
            replace(test, series=series.window(*ends)) for test, ends in zip(tests, ((0, 6), (7, 12)), strict=True)
        ]
    made = prepare(tests, WAYS[name])
    unchanged({
        "deviations": [by_name(one, one.values.std(axis=1)) for one in made.records],
        "samples": [by_name(one, one.values[:, 200]) for one in made.records],
        "rate": made.rate, "means": [flat(means) for means in made.means],
        "notes": [timed(note) for note in made.notes],
        "steps": [timed(step) for step in made.steps],
        "summary": len(made.summary()), "reasons": [str(reason) for reason in made.reasons],
    }, relative=1e-3)  # fmt: skip
