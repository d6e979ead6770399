"""Estimates, fits and simulations of identified cars are those in tests/results."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eightpost.corners import CORNERS
from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit
from eightpost.ident.vehicle.common_poles import CommonPoles, Excitation
from eightpost.ident.vehicle.experiment import (
    Blocks,
    CoherentBand,
    Experiment,
    experiment_of,
    find_baseline,
    gather,
    ranges_of,
)
from eightpost.ident.vehicle.frequency_response import Preconditioning, response_of
from eightpost.ident.vehicle.plan import LIMITS, recipe
from eightpost.ident.vehicle.port_search import FrictionSearch, SpringSearch
from eightpost.ident.vehicle.simulation import (
    ManySetups,
    bristle_force,
    closed_at_ports,
    direction,
    free_running,
    law_force,
    open_at_ports,
    simulate_with_shocks,
    with_dampers,
)
from eightpost.ident.vehicle.siso_models import (
    AEROLOADERS,
    SEVEN_DOF,
    WHEELLOADERS,
    RationalFit,
    balance,
    parallel_model,
)
from eightpost.ident.vehicle.stability import closed_loop_stability, discretise_by_parts, safe_slopes
from eightpost.ident.vehicle.trust import MeasuredLevels, level_errors
from eightpost.ident.vehicle.vehicle_fit import VehicleFit, fit_verdict, with_validity, write_fit
from eightpost.progress import reported_to
from eightpost.shock import read_shock
from eightpost.signals import TimeSeries
from eightpost.uncertainty import MeasureUncertainty
from eightpost.vehicle import Bristle, Friction, IdentifiedVehicle, add_port_damping, read_vehicle, shipped

from .rig_tests import BASELINE, RATE, Rig, noise

Unchanged = Callable[..., None]
BANK = Path(__file__).parents[2] / "examples" / "bank"
AT = np.array([0.5, 1.5, 3.0, 6.0, 12.0, 20.0])


def experiment_with(rig: Rig) -> Experiment:
    return Experiment("car", rig.rig, rig.forces, rig.outputs, rig.damping, sources={"base.parquet": "0" * 64})


def rows(series: TimeSeries) -> dict[str, np.ndarray]:
    return dict(zip(series.names, series.values, strict=True))


@pytest.fixture(scope="module")
def car() -> IdentifiedVehicle:
    """Return the quarter car with friction that creeps and sticks, and a progressive spring at its port."""
    model = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": BASELINE})
    law = Friction(30.0, 0.01, Bristle(100.0, 1e-4, 1.1, 0.01), 1e5, 0.002)
    return IdentifiedVehicle("car", model, {"": BASELINE}, friction={"": law})


@pytest.fixture(scope="module")
def drive() -> TimeSeries:
    road = 0.006 * noise(np.random.default_rng(8), 500, RATE, 20.0)
    time = np.arange(road.size) / RATE
    force = 300.0 * np.sin(25.0 * time)
    return TimeSeries.from_channels(time, {"road": ("m", road), "aero_force": ("N", force)})


@pytest.mark.parametrize("name", ["AA_AA", "C_B"])
def test_the_motion_with_a_shock_and_friction(car, drive, name: str, unchanged: Unchanged) -> None:
    law = read_shock(BANK / f"{name}.json").law
    found = simulate_with_shocks(car, {"": law}, drive)
    record = TimeSeries.from_channels(
        drive.time, {n: (u, r) for s in (drive, found) for n, u, r in zip(s.names, s.units, s.values, strict=True)}
    )
    record = record.with_channel("force", "N", law_force(record, "", law))
    kept = {
        "law": {"force": record["force"]},
        "open": rows(open_at_ports(car, record)),
        "closed": rows(closed_at_ports(car, record, {"": law})),
        "free": rows(free_running(car, record, ("",))),
    }
    unchanged({"with shock": rows(found), **kept})


def test_the_motion_of_many_setups_and_of_linear_dampers(car, drive, unchanged: Unchanged) -> None:
    bank = [read_shock(BANK / f"{name}.json").law for name in ("AA_AA", "C_B")]
    found = ManySetups(car, bank, drive, 2).run([[0], [1]])
    names = car.state_space.output_names
    dampers = with_dampers(car, drive, {"": 0.7 * BASELINE})
    unchanged({"setups": dict(zip(names, found.swapaxes(0, 1), strict=True)),
               "dampers": dict(zip(names, dampers, strict=True))})  # fmt: skip


def test_the_forces_of_the_laws_of_friction(drive, unchanged: Unchanged) -> None:
    velocity = 10.0 * drive["road"]
    unchanged({"direction": direction(velocity, RATE, 0.02), "wide": direction(velocity, RATE, 0.5),
               "bristle": bristle_force(velocity, RATE, Bristle(100.0, 1e-4, 1.2, 0.02))})  # fmt: skip


def test_the_baseline_the_experiment_and_its_ranges(seven_dof, unchanged: Unchanged) -> None:
    records = seven_dof.records
    baseline = find_baseline(records, CORNERS)
    experiment = experiment_of(records[0].names, baseline.damping)
    ranges = ranges_of(records, experiment, (0.2, 20.0))
    louder = replace(records[0], values=1.3 * records[0].values)
    softer = replace(records[0], values=0.01 * records[0].values)
    outputs = ("lf.velocity", "rear.ride_height")
    gathered = gather(records, seven_dof.inputs, outputs, baseline.damping)
    spectra = Blocks(5.0).spectra(gathered)
    blocks = {name: part for name, part in spectra._asdict().items() if isinstance(part, np.ndarray | float | int)}
    drives = Excitation.of(records[0], experiment.rig, (0.5, 15.0))
    kept = {"baseline": baseline, "notes": baseline.notes(), "experiment": experiment, "ranges": ranges.as_mapping()}
    unchanged(
        {**kept, "beyond": ranges.beyond(louder), "gentle": ranges.is_gentle(softer),
         "blocks": blocks, "levels of dampers": drives.rms(seven_dof.truth, baseline.damping)}
    )  # fmt: skip


def test_the_stability_of_a_car(seven_dof, unchanged: Unchanged) -> None:
    model = seven_dof.truth
    vehicle = IdentifiedVehicle("car", model, seven_dof.damping)
    stability, slopes = closed_loop_stability(vehicle), safe_slopes(model, seven_dof.damping)
    steps = discretise_by_parts(model.A, model.B, 2e-3)
    sentences = {"stability": stability.summary(), "slopes": slopes.summary()}
    unchanged({**sentences, "found": stability, "softest": slopes.softest, "steps": steps}, relative=1e-3)


def test_a_rational_fit_and_its_reduction(quarter_car, unchanged: Unchanged) -> None:
    frequency = np.linspace(0.2, 25.0, 250)
    response = response_of(quarter_car.truth, frequency)
    outputs = [one for one in quarter_car.truth.outputs if one.name in ("velocity", "tire_force")]
    road = response.inputs[response.input_names.index("road")]
    weights = {
        name: one.at(frequency) for name, one in (("car", SEVEN_DOF), ("road", WHEELLOADERS), ("load", AEROLOADERS))
    }
    fits = {
        one.name: RationalFit(4, degree).fit(frequency, response.between(one.name, "road"), weights["car"])
        for one, degree in zip(outputs, (3, 4), strict=True)
    }
    parallel = parallel_model({(name, "road"): fit for name, fit in fits.items()}, [road], outputs)
    reduced = balance(parallel, np.array([0.01]), np.array([0.1, 500.0]))
    models = {"parallel": parallel.frequency_response(AT), "reduced": reduced.truncated(4).frequency_response(AT)}
    of_paths = {
        name: {"modes": np.array(fit.modes()), "response": fit.frequency_response(AT)} for name, fit in fits.items()
    }
    unchanged({"weights": weights, **of_paths, "hankel": reduced.hankel[:5], **models}, relative=1e-3)


def test_a_preconditioned_response(quarter_car, unchanged: Unchanged) -> None:
    frequency = np.linspace(0.2, 25.0, 250)
    exact = response_of(quarter_car.truth, frequency)
    generator = np.random.default_rng(1)
    lost = frequency > 14.0
    wild = exact.H * np.where(lost, 3.0 * np.exp(2j * np.pi * generator.random(frequency.size)), 1.0)
    partial = np.broadcast_to(np.where(lost, 0.03, 0.99), exact.H.shape)
    found, notes = Preconditioning().apply(replace(exact, H=wild, partial_coherence=partial))
    unchanged({"H": dict(zip(exact.output_names, found.H, strict=True)), "notes": notes})


@pytest.mark.parametrize("share", [0.2, 0.05])
def test_the_band_that_noisy_records_support(share: float, unchanged: Unchanged) -> None:
    frequency = np.arange(0.1, 40.0, 0.1)
    model = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": BASELINE})
    response = response_of(model.select(outputs=["velocity", "tire_force", "ride_height"]), frequency)
    noise_share = share * (frequency / np.array([[20.0], [15.0], [25.0]])) ** 4
    coherence, variance = 1.0 / (1.0 + noise_share), np.ones(response.H.shape)
    found = CoherentBand().of(replace(response, coherence=coherence, variance=variance))
    unchanged({"band": found, "says": found.summary()})


def measures_of(found: Mapping[str, MeasureUncertainty]) -> dict[str, object]:
    """Return the numbers of each measure, one array for each level."""
    kept: dict[str, object] = {}
    for name, one in found.items():
        kept[name] = np.array([one.common, one.own, one.bias])
        for k, level in enumerate(one.levels):
            kept[f"{name}, level {k}"] = np.array([level.error, level.deviation, level.spread])
            kept[f"{name}, shares {k}"] = np.array(level.shares)
    return kept


def test_the_levels_of_the_tests_of_a_car(quarter_car, unchanged: Unchanged) -> None:
    """The car is 5 % too soft, and its tests have noise."""
    generator = np.random.default_rng(4)
    records = [replace(one.window(0.0, 24.0)) for one in quarter_car.records]
    noisy = [replace(one, values=one.values + 0.01 * one.values.std(axis=1, keepdims=True)
                     * generator.standard_normal(one.values.shape)) for one in records]  # fmt: skip
    model = replace(quarter_car.truth, B=0.95 * quarter_car.truth.B)
    vehicle = IdentifiedVehicle("car", model, quarter_car.damping)
    levels, experiment = MeasuredLevels(seconds=20.0), experiment_with(quarter_car)
    found = levels.uncertainty(vehicle, noisy, experiment)
    more = levels.with_records(found, vehicle, [records[1].window(2.0, 20.0)])
    powers = levels.powers(vehicle, noisy[0])
    parts = {"error": powers.error, "shares": powers.shares, "spread": powers.spread}
    measures = {"found": measures_of(found), "with a record": measures_of(more), "errors": level_errors(found)}
    unchanged({**measures, "powers": parts, "note": levels.note(noisy, experiment, found)}, relative=1e-3)


def test_the_limits_for_tests_of_one_car(unchanged: Unchanged) -> None:
    unchanged(LIMITS)


def described(fit: VehicleFit) -> dict[str, object]:
    """Return a fit without its matrices, which have no unique coordinates, and without its duration."""
    parts = {name: getattr(fit, name) for name in ("recipe", "residual", "notes", "stable", "ranges")}
    assert fit.trust is not None
    parts |= {"measures": measures_of(fit.trust.measures), "trust": replace(fit.trust, measures={}, orders=None)}
    verdict = [str(one) for one in fit_verdict(fit).reasons]
    model = fit.vehicle.state_space
    return {**parts, "states": len(model.A), "modes": np.array(model.modes()), "model": model.frequency_response(AT),
            "coherence": fit.response.coherence, "estimate": np.abs(fit.response.H), "friction": fit.vehicle.friction,
            "damping": fit.vehicle.baseline_damping, "verdict": verdict}  # fmt: skip


@pytest.mark.slow
def test_the_fit_with_common_poles_and_its_progress(quarter_car, monkeypatch, unchanged: Unchanged) -> None:
    """The progress does not depend on time here."""
    monkeypatch.setattr("eightpost.progress._INTERVAL", np.inf)
    tests, shares = [one.window(0.0, 25.0) for one in quarter_car.records], list[float]()
    search = FrictionSearch((0.005, 0.02), (1e-4,), (10.0, 20.0), iterations=2)
    fit = CommonPoleFit(order=4, max_states=8)
    recipe = CommonPoles(fit=fit, friction=search, springs=SpringSearch(seconds=10.0, iterations=2), samples=3)
    with reported_to(lambda done, _total: shares.append(done)):
        fit = recipe.identify(tests, experiment_with(quarter_car))
    unchanged({**described(fit), "progress": np.round(shares, 3)}, relative=1e-3)


@pytest.mark.slow
def test_the_fit_of_a_plan_of_the_dissertation(quarter_car, tmp_path: Path, unchanged: Unchanged) -> None:
    tests = [one.window(0.0, 40.0) for one in quarter_car.records]
    fit = recipe("boggs").identify(tests, experiment_with(quarter_car))
    paths = write_fit(tmp_path / "car.json", with_validity(fit))
    unchanged({**described(fit), "files": [path.name for path in paths], "says": str(fit)}, relative=1e-3)
