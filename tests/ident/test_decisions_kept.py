"""The sizes at which a fit decides otherwise: segment, cutoff, rate, motions, bounds, the verdict and the notes."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from eightpost.errors import EightpostError
from eightpost.ident import fit_peak_velocity
from eightpost.ident.shock.curve import CurveBasis, KnotBasis, curve_through, fitted_curve
from eightpost.ident.shock.force import LawLimits, limits_for
from eightpost.ident.shock.hysteresis import LaggedVelocity
from eightpost.ident.shock.law_fit import HeldOut
from eightpost.ident.shock.runs import StrokeRange, prepare, prepare_runs, single_frequency
from eightpost.ident.shock.verdict import Parameter, error_reason
from eightpost.rig import PeakVelocityTable
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Hysteresis, StaticCurve
from eightpost.signals import TimeSeries
from tests.drawn import rounded, timed
from tests.limits import first_of, limit_of


@cache
def sine(speed: float = 0.3, hertz: float = 1.6, seconds: float = 6.0, rate: float = 400.0) -> DynoTest:
    time = np.arange(round(seconds * rate)) / rate
    phase = 2.0 * np.pi * hertz * time
    velocity, path = speed * np.cos(phase), speed / (2.0 * np.pi * hertz) * np.sin(phase)
    force = 900.0 * np.tanh(velocity / 0.1) + 1500.0 * velocity + 600.0 * path + 150.0
    channels = {"velocity": ("m/s", velocity), "displacement": ("m", path + 0.01), "force": ("N", force)}
    return DynoTest(TimeSeries.from_channels(time, channels))


def uneven() -> DynoTest:
    series = sine().series
    time = series.time + 2e-4 * np.sin(np.arange(len(series)))
    return DynoTest(TimeSeries(time, series.values, series.names, series.units))


def late_motion(share: float) -> DynoTest:
    """Return a record of 14 s of which the first 10.5 s have a share of the speed."""
    series = sine(seconds=14.0).series
    factor = np.where(series.time < 10.5, share, 1.0)
    return DynoTest(series.with_channel("velocity", "m/s", factor * series["velocity"]))


def heated() -> DynoTest:
    series = sine().series
    return DynoTest(series.with_channel("temperature", "K", 300.0 + 2.0 * series.time**2))


RECORDS: dict[str, tuple[Callable[[], DynoTest], dict[str, Any]]] = {
    "a sine": (sine, {}),
    "without displacement": (lambda: DynoTest(sine().series.select(["velocity", "force"])), {}),
    "uneven": (uneven, {}),
    "long": (lambda: sine(seconds=14.0), {}),
    "long and still at first": (lambda: late_motion(0.2), {}),
    "fast": (lambda: sine(rate=9000.0), {}),
    "slow": (lambda: sine(rate=100.0), {}),
    "a cutoff": (sine, {"cutoff": 30.0}),
    "a segment": (sine, {"segment": (0.05, 4.0)}),
    "heated": (heated, {}),
}


@pytest.mark.parametrize("name", RECORDS)
def test_a_prepared_record(name: str, unchanged: Callable[..., None]) -> None:
    test, options = RECORDS[name]
    found = prepare(test(), **options)
    runs = prepare_runs([test()], **options)
    unchanged({
        "record": dict(zip(found.record.names, found.record.values, strict=True)), "inside": int(found.inside.sum()),
        "rate": found.rate, "cutoff": found.cutoff, "reference": found.reference, "frequency": found.single_frequency,
        "changes": [timed(text) for text in found.changes], "temperature": found.temperature, "step": found.step,
        "stop": found.stop, "deviation": found.deviation, "strokes": str(StrokeRange.of([found])),
        "motions": np.array(runs.motions), "target": runs.target, "row velocity": runs.row_velocity,
        "covariate": runs.covariate, "blocks": len(runs.blocks(0.5)),
    }, relative=1e-4)  # fmt: skip


def refused(**options: Any) -> bool:
    try:
        prepare(sine(), **options)
    except EightpostError:
        return True
    return False


def noisy(size: float) -> np.ndarray:
    velocity = sine().series["velocity"]
    return np.asarray(velocity + size * np.random.default_rng(2).standard_normal(velocity.size))


def two(factor: float, hertz: float = 1.0) -> Any:
    return prepare_runs([sine(), sine(0.3 * factor, 1.6 * hertz)])


def two_frequencies(ratio: float) -> StrokeRange:
    first, second = sine(0.2, 1.0, 8.0), sine(0.2, ratio, 8.0)
    return StrokeRange.of(prepare_runs([first, second]).prepared)


def builds(factor: float) -> bool:
    tests = [replace(sine(0.3 * f), conditions=DynoConditions(build=b)) for f, b in ((1.0, "a"), (factor, "b"))]
    return bool(prepare_runs(tests).has_repeated_builds)


DECISIONS: dict[str, tuple[Callable[[float], bool], float, float]] = {
    "the whole of a record that is still at first": (lambda k: bool(prepare(late_motion(k)).changes), 0.2, 0.9),
    "the whole of a short record": (lambda k: bool(prepare(sine(seconds=k)).changes), 8.0, 12.0),
    "a thinned record": (lambda k: bool(prepare(sine(rate=k)).changes[1:]), 2500.0, 9000.0),
    "a lowered cutoff": (lambda k: prepare(sine(rate=k)).cutoff < 50.0, 90.0, 200.0),
    "a cutoff that is too high": (lambda k: refused(cutoff=k), 100.0, 300.0),
    "a record that is too short": (lambda k: refused(segment=(1.0, 1.0 + k)), 0.05, 2.0),
    "a noisy sine": (lambda k: single_frequency(noisy(k), 400.0) is None, 0.01, 3.0),
    "another peak speed": (lambda k: two(k).has_repeated_motions, 1.0, 2.0),
    "another frequency": (lambda k: two(1.0, k).has_repeated_motions, 1.0, 2.0),
    "another build": (builds, 1.0, 2.0),
    "one frequency": (lambda k: two_frequencies(k).has_one_frequency, 1.05, 2.5),
    "a small error": (lambda k: "well" in str(error_reason(k, "fits", figure="e", origin="a")), 1.0, 9.0),
    "a large error": (lambda k: "poorly" in str(error_reason(k, "fits", figure="e", origin="a")), 5.0, 40.0),
    "a value at its bound": (lambda k: bool(Parameter("x", 1.0 + k, "N", 1.0, (1.0, 9.0)).at_bound), 1e-3, 0.5),
    "a value near 0": (lambda k: bool(Parameter("x", k, "N", 1.0, (0.0, 9.0)).at_bound), 1e-3, 0.5),
    "a better fit": (lambda k: HeldOut((1.0, 1.0)).is_beaten_by(HeldOut((k, k))), 0.8, 1.0),
    "a better fit of scattered parts": (
        lambda k: HeldOut((1.0, 1.0, 1.0, 1.0)).is_beaten_by(HeldOut((0.8 - k, 0.8 + k, 0.8, 0.8))), 0.01, 0.75),
}  # fmt: skip


@pytest.mark.parametrize("name", DECISIONS)
def test_the_size_at_which_a_fit_decides_otherwise(name: str, unchanged: Callable[..., None]) -> None:
    unchanged(limit_of(*DECISIONS[name]), relative=1e-3)


def test_the_fewest_samples_of_a_fit() -> None:
    assert first_of(lambda count: not refused(segment=(1.0, 1.0 + (count - 0.5) / 400.0)), 60, 140) == 100


def test_the_bounds_of_the_parameters(unchanged: Callable[..., None]) -> None:
    force = np.array([-1.0, 0.2, 1.0])
    found: dict[str, LawLimits | str] = {}
    for peak in (5.0, 40.0, 300.0, 3000.0):
        for rate in (30.0, 400.0, 999.0, 1000.0, 5000.0):
            found[f"{peak} N, {rate} Hz"] = timed(rounded(str(limits_for(peak * force, rate))))
    for rate in (400.0, 2000.0):
        dynamics = LaggedVelocity.of(Hysteresis, limits_for(1000.0 * force, rate), rate).with_stop()
        states = [bound.tolist() for bound in dynamics.state_bounds()]
        found[f"hysteresis, {rate} Hz"] = rounded(
            f"{dynamics.names} {dynamics.units} {dynamics.value_bounds()} {states}"
        )
    unchanged(found)


def test_curves_of_both_bases(curve: StaticCurve, unchanged: Callable[..., None]) -> None:
    velocity = np.linspace(-0.7, 0.9, 41)
    basis = CurveBasis(0.381, 0.0127)
    coefficients = np.concatenate([curve.inner, curve.compression, curve.rebound])
    bent = coefficients + np.where(np.arange(coefficients.size) == 16, -900.0, 0.0)
    made = {}
    for name, values in (("smooth", coefficients), ("bent", bent)):
        found, notes = fitted_curve(basis, values, velocity)
        made[name] = [found.compression_slope, found.rebound_slope, found.compression_speed, notes]
    knots = KnotBasis.of(velocity)
    slopes = 2000.0 + 900.0 * np.cos(9.0 * np.array(knots.knots))
    through = knots.static_curve(slopes)
    unchanged({
        **made, "design": basis.design(velocity), "share": basis.outer_share(np.abs(velocity)),
        "ties": [basis.ties(sides) for sides in ((), ("compression",), ("compression", "rebound"))],
        "knots": np.array(knots.knots), "knot design": knots.design(velocity), "penalty": knots.penalty(),
        "subdivided": list(knots.subdivided(slopes)),
        "through": np.array([through.force(v) for v in velocity.tolist()]),
        "from": [np.array(one) for one in (through.knot_velocity, through.knot_force)],
    })  # fmt: skip


@pytest.mark.parametrize("count", [4, 12, 13, 30])
def test_a_curve_through_points(count: int, unchanged: Callable[..., None]) -> None:
    speed = np.linspace(0.0, 0.8, count + 1)[1:] ** 1.3
    wave = 30.0 * np.sin(np.arange(count))
    table = PeakVelocityTable(speed, 900.0 * np.tanh(speed / 0.1) + wave, -1500.0 * speed**0.7 - wave)
    shock = fit_peak_velocity(table)
    velocity = np.concatenate([-speed[::-1], [0.0], speed])
    points = np.concatenate([table.rebound[::-1], [0.0], table.compression])
    found, _ = curve_through(velocity, points)
    unchanged({
        "forces": np.array(found.knot_force), "slopes": np.array(found.knot_slope), "changes": shock.fit["changes"],
        "warnings": shock.fit["warnings"], "errors": [v for k, v in shock.fit.items() if k.endswith("[N]")],
        "verdict": [str(reason) for reason in shock.validity.verdict.reasons],
    }, relative=1e-4)  # fmt: skip
