"""Passes, limits and start responses of drive file iterations are those in tests/results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from eightpost.drivefile import ActuatorBands, Limits, Settings, Target, start_response
from eightpost.drivefile.iteration import Outcome, correction, gains, regularised_inverse
from eightpost.drivefile.page import _reasons, error_table
from eightpost.drivefile.target import Lines, PassErrors, at_rate, pass_errors, within_limits
from eightpost.ident.vehicle.frequency_response import response_of
from eightpost.shock import read_shock
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction, IdentifiedVehicle, add_port_damping, read_vehicle, shipped
from tests.unchanged import refusals

Unchanged = Callable[..., None]
BANK = Path(__file__).parents[2] / "examples" / "bank"


def errors_of(one: PassErrors) -> dict[str, object]:
    """Return the errors of a pass, an array for each kind."""
    kinds = {name: np.array(list(getattr(one, name).values())) for name in ("channels", "peaks", "beyond", "means")}
    return {**kinds, **{f"bands of {name}": np.array(bands) for name, bands in one.bands.items()}}


def described(outcome: Outcome) -> dict[str, object]:
    """Return the numbers of an outcome, with the errors of its last pass."""
    simple = {name: getattr(outcome, name) for name in ("status", "best", "rejections", "drive", "unreachable")}
    totals, hits = np.array([one.total for one in outcome.errors]), [str(hit) for hit in outcome.hits]
    last = errors_of(outcome.errors[-1]) if outcome.errors else {}
    return {**simple, "totals": totals, "hits": hits, "last": last}


def test_the_passes_of_an_iteration_with_means_and_limits(seven_dof, problem_of, unchanged: Unchanged) -> None:
    """The target has means, and noise that the rig cannot reproduce; the stroke is half of what it needs."""
    rig, drive = seven_dof
    series = rig.target.series
    noise = (
        0.1 * series.values.std(axis=1, keepdims=True) * np.random.default_rng(3).standard_normal(series.values.shape)
    )
    values = series.values + noise + (rig.start.static @ np.array([0.0] * 4 + [-3000.0, 200.0, 400.0]))[:, None]
    loaded = replace(rig, target=Target(TimeSeries(series.time, values, series.names, series.units), rig.target.high))
    stroke = 0.8 * float(np.abs(drive[0]).max())
    problem = problem_of(loaded, Settings(limits=Limits(stroke=stroke, velocity=0.2, force=2500.0)))
    outcomes = loaded.passes(problem, 3)
    texts = [f"{one.statement}; {one.figure}; {one.rule}" for one in _reasons(problem, outcomes[-1], ("a hit",))]
    table = error_table(problem, outcomes[-1])
    cells = [" ".join(str(getattr(cell, "value", cell)) for cell in row) for row in table.rows]
    passes = {f"after {k}": described(one) for k, one in enumerate(outcomes) if k in (0, 1, 3)}
    unchanged({**passes, "reasons": texts, "table": cells}, relative=1e-3)


@pytest.mark.parametrize("shock", ["C_B", ""])
def test_the_start_response_of_an_identified_car_about_its_track(quarter, shock: str, unchanged: Unchanged) -> None:
    target = quarter[0].target
    model = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": 3000.0})
    law = Friction(60.0, 0.004, Bristle(80.0, 1e-4, 1.2, 0.01))
    car = IdentifiedVehicle("car", model, {"": 3000.0}, friction={"": law})
    shocks = {"": read_shock(BANK / f"{shock}.json").law} if shock else {}
    frequency = np.linspace(2.0, 15.0, 30)
    measured = replace(response_of(model, frequency), coherence=np.tile(np.linspace(1.0, 0.7, 30), (9, 1)))
    found = start_response(car, target, shocks=shocks, actuators=ActuatorBands(80.0, 6.0), measured=measured)
    coherence = found.response.coherence
    unchanged({"H": dict(zip(target.names, found.response.H, strict=True)), "static": found.static,
               "coherence": coherence, "notes": found.notes})  # fmt: skip


def test_a_corner_that_is_no_target_keeps_its_damping(quarter) -> None:
    target = quarter[0].target
    car = IdentifiedVehicle("car", read_vehicle(shipped("quarter_car")).with_damper(), {"": 1500.0})
    without = Target(target.series.select(["hub_acceleration"]), target.high)
    assert "displacement is not a target" in start_response(car, without).notes[0]


def test_what_cannot_be_iterated_is_refused(quarter, unchanged: Unchanged) -> None:
    target, law = quarter[0].target, read_shock(BANK / "C_B.json").law
    series, car = target.series, read_vehicle(shipped("quarter_car"))
    undamped = IdentifiedVehicle("car", car.with_damper(), {"": 1500.0})
    flat = series.with_channel("displacement", "m", np.full(len(series), 0.01))
    settings = ({"gain": 0.0}, {"gain": 1.5}, {"regularisation": 1.0}, {"acceleration": 0.0})
    bands = ({"wheelloader": 0.0}, {"aeroloader": 0.0})
    limits = ({"stroke": 0.0}, {"velocity": 0.0}, {"force": 0.0})
    given = ((Settings, settings), (ActuatorBands, bands), (Limits, limits))
    unchanged(refusals({f"{kind.__name__} {one}": partial(kind, **one) for kind, all_ in given for one in all_} | {
        "5 s": lambda: Target(series.window(0.0, 5.0), 20.0), "90 Hz": lambda: Target(series, 90.0),
        "a constant channel": lambda: Target(flat, 20.0),
        "an unknown corner": lambda: start_response(undamped, target, shocks={"lf": law}),
        "a second damper": lambda: start_response(car, target, shocks={"": law}),
        "an input in Pa": lambda: regularised_inverse(np.ones((1, 2, 1)), np.ones((1, 2)), ("Pa",), 0.1),
    }))  # fmt: skip


@pytest.mark.parametrize("rate", [400.0, 200.0, 80.0])
def test_a_record_at_another_rate(rate: float, unchanged: Unchanged) -> None:
    time = 2.0 + np.arange(801) / 200.0
    series = TimeSeries.from_channels(time, {"a": ("m", np.sin(20.0 * time) + 0.2 * np.sin(400.0 * time))})
    found = at_rate(series, rate)
    unchanged({"time": found.time, "a": found["a"]})


def test_commands_within_their_limits(unchanged: Unchanged) -> None:
    lines = Lines(1500, 100.0, 20.0)
    window = np.concatenate([np.linspace(0, 1, 100), np.ones(1300), np.linspace(1, 0, 100)])
    noise = lines.rows(lines.spectrum(np.random.default_rng(2).standard_normal((3, 1500))))
    rows = window * noise * np.array([[0.1], [0.1], [4000.0]]) + np.array([[0.0], [0.02], [1500.0]])
    limits = Limits(0.08, 1.5, 4000.0)
    found, hits = within_limits(rows, ("lf.road", "rf.road", "lf.aero"), ("m", "m", "N"), lines, limits, window)
    unchanged({"rows": list(found), "hits": [str(hit) for hit in hits]})


def test_a_correction_its_gains_and_an_inverse(unchanged: Unchanged) -> None:
    lines = Lines(1000, 100.0, 20.0)
    generator, count = np.random.default_rng(5), lines.frequency.size
    H, *drives = generator.standard_normal((4, count, 3, 2)) + 1j * generator.standard_normal((4, count, 3, 2))
    passes = [(one[:, 0], np.einsum("kij,kj->ki", 0.8 * H, one[:, 0]) + 0.3 * one[:, :, 0]) for one in drives]
    factor, coherence = correction(H, passes, lines, 2.0)
    inverse = regularised_inverse(H, 1.0 + np.abs(H[:, :, 0]), ("m", "N"), 0.05)
    unchanged({"factor": factor, "coherence": coherence, "gains": gains(coherence, 0.8), "inverse": inverse.G,
               "condition": inverse.condition, "rank": inverse.rank})  # fmt: skip


def test_the_errors_of_a_pass(quarter, unchanged: Unchanged) -> None:
    target = quarter[0].target
    record = (
        1.2 * target.rows + target.means[:, None] + 1e-3 * np.random.default_rng(1).standard_normal(target.rows.shape)
    )
    found = pass_errors(target, record)
    quantities = {name: found.of_quantity(name) for name in ("displacement", "hub_acceleration", "tire_force")}
    unchanged({"found": errors_of(found), "total": found.total, "worst": found.worst, **quantities}, relative=1e-4)
