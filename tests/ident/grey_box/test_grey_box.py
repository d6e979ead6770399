"""The grey-box car: its linear model, its steps, its start values, and the recipe on a known car."""

from dataclasses import astuple, replace
from types import SimpleNamespace

import numpy as np
import pytest

from eightpost.corners import CORNERS
from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident.grey_box.family import GreyBoxCar, declared, linear_model, port_laws, start_values
from eightpost.ident.grey_box.recipe import GreyBox, _misfit, _notes, _record, _springs, _unused, sampled_cars
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.frequency_response import response_of
from eightpost.ident.vehicle.vehicle_fit import read_fit, write_fit
from eightpost.signals import TimeSeries
from eightpost.uncertainty import TOTAL
from eightpost.vehicle import SevenDof, add_port_damping, read_vehicle, shipped

RATE = 125.0
QUANTITIES = ("velocity", "displacement", "tire_force", "hub_acceleration")
OUTPUTS = (*(f"{c}.{q}" for q in QUANTITIES for c in CORNERS), "front.ride_height", "rear.ride_height")
RIG = (*(f"{c}.road" for c in CORNERS), *(f"{c}.aero" for c in CORNERS))
#: A car with a solid rear axle, friction and progressive springs.
TRUE = {
    "front.mass heave": 420.0, "rear.mass heave": 530.0, "mass coupling heave": 90.0, "front.mass roll": 260.0,
    "rear.mass roll": 280.0, "twist_stiffness": 6e5, "rear.mass coupling": 14.0, "rear.shock_share": 0.22,
    "rear.spring_share": 0.18, "front.bar": 3e4, "front.aero_place": 1.1, "rear.aero_place": -0.1,
} | {f"{c}.{name}": value for c in CORNERS for name, value in {
    "hub_mass": 44.0, "spring_rate": 1.9e5, "tire_stiffness": 3.4e5, "tire_damping": 420.0, "motion_ratio": 0.88,
    "friction": 60.0}.items()}  # fmt: skip


@pytest.fixture(scope="module")
def experiment():
    forces = tuple(f"{c}.force" for c in CORNERS)
    return Experiment("car", RIG, forces, OUTPUTS, dict.fromkeys(CORNERS, 3000.0))


def _car(experiment, **changes):
    table = declared(TRUE | changes, experiment.rig)
    return GreyBoxCar(experiment, table.names, np.full(4, np.inf)), table


def simulate(car, values, table, inputs):
    """Return the outputs (N, Y) for values by parameter."""
    return car.run(np.array([[values[name] for name in table.names]]), inputs, RATE)[0]


def _drive(seed, seconds):
    """Return smooth roads, loads and changes of shock forces (N, 12)."""
    generator = np.random.default_rng(seed)
    samples = round(seconds * RATE)
    lines = np.fft.rfftfreq(samples, 1.0 / RATE)
    size = np.where((lines > 0.4) & (lines < 22.0), 1.0 / np.maximum(lines, 1.0), 0.0)
    spectra = size * np.exp(2j * np.pi * generator.uniform(size=(12, lines.size)))
    rows = np.fft.irfft(spectra, samples)
    scales = np.repeat([0.004, 300.0, 250.0], 4)[:, None]
    grown = np.minimum(np.arange(samples) / RATE, 1.0)
    return (rows / rows.std(axis=1, keepdims=True) * scales * grown).T


def _test(experiment, seed, seconds=20.0, noise=0.003, **changes):
    """Return a test of the true car as a record with shock forces F = dF + c v."""
    car, table = _car(experiment, **changes)
    inputs = _drive(seed, seconds)
    values = {p.name: p.start for p in table}
    y = simulate(car, values, table, inputs)
    y = y + noise * y.std(axis=0) * np.random.default_rng(seed + 1).standard_normal(y.shape)
    channels = {name: ("1", row) for name, row in zip((*RIG, *OUTPUTS), (*inputs[:, :8].T, *y.T), strict=True)}
    for k, c in enumerate(CORNERS):
        channels[f"{c}.force"] = ("N", inputs[:, 8 + k] + 3000.0 * channels[f"{c}.velocity"][1])
    return TimeSeries.from_channels(np.arange(len(inputs)) / RATE, channels)


LOADS = (*RIG[:4], "heave_force", "roll_moment", "pitch_moment")
MORE = (*OUTPUTS, "lf.chassis_acceleration", "rr.chassis_acceleration", "driver.acceleration")
#: Every effect of the family, another on each corner.
EFFECTS = {"front.mass coupling": 6.0, "front.shock_share": 0.05, "friction_reach": 1.5e-4, "front.aero_spread": 0.6}
EFFECTS |= {
    f"{c}.{name}": value * (1.0 + 0.1 * k)
    for k, c in enumerate(CORNERS)
    for name, value in (("spring_progression", 1.5), ("tire_stiffening", 3.0), ("motion_ratio", 0.8))
}


@pytest.mark.parametrize("rig", [RIG, LOADS], ids=["aeroloaders", "loads"])
def test_the_motion_and_the_linear_model_of_a_car_are_the_kept_ones(experiment, rig, unchanged):
    """The tires lift off in this motion."""
    other = replace(experiment, rig=rig, outputs=MORE)
    table = declared(TRUE | EFFECTS, rig)
    values = {p.name: p.start for p in table}
    inputs = 2.0 * _drive(8, 1.6)[:, [*range(len(rig)), *range(8, 12)]]
    outputs = GreyBoxCar(other, table.names, np.full(4, 1500.0)).run(np.array([list(values.values())]), inputs, RATE)
    model = linear_model(values, other)
    fast = {name: outputs[0, :, k] for k, name in enumerate(MORE)}
    lines = dict(zip(model.output_names, model.frequency_response([0.7, 3.0, 12.0, 60.0]), strict=True))
    laws = {port: np.array([*astuple(law.bristle), law.spring]) for port, law in port_laws(values, other).items()}
    sizes = {name: np.abs(line) for name, line in lines.items()}
    unchanged({"motion": fast, "model": sizes, "modes": np.array(model.modes()), "laws": laws})


def test_the_parameters_and_their_limits_are_the_kept_ones(unchanged):
    every = {p.name: p for rig in (RIG, LOADS) for p in declared({}, rig)}
    unchanged({name: f"{p.unit} {p.start} {p.low} {p.high} {p.size} {p.prior}" for name, p in every.items()})


@pytest.mark.parametrize("kind", ["aeroloaders", "loads", "extreme"])
def test_the_start_values_are_the_kept_ones(experiment, kind, unchanged):
    """The records are noise, for which the balances give values far away, up to their limits."""
    rig = RIG if kind == "aeroloaders" else LOADS
    generator, count = np.random.default_rng(7), 1250
    names = (*rig, *OUTPUTS, *(f"{c}.force" for c in CORNERS))
    size = 1e-6 if kind == "extreme" else 1.0
    rows = {name: ("1", generator.standard_normal(count) * (size if name.endswith("road") else 1.0)) for name in names}
    test = TimeSeries.from_channels(np.arange(count) / RATE, rows)
    unchanged(start_values([test], replace(experiment, rig=rig)), relative=1e-4)


def test_the_family_contains_the_seven_degrees_of_freedom_of_the_dissertation(experiment):
    vehicle = read_vehicle(shipped("seven_dof"))
    p = vehicle.parameters
    assert isinstance(p, SevenDof)
    rig = (*(f"{c}.road" for c in CORNERS), "heave_force", "roll_moment", "pitch_moment")
    a, b, L, half = p.cg_to_front_axle, p.cg_to_rear_axle, p.wheelbase, 0.5 * p.track_width
    values = {
        "front.mass heave": (p.sprung_mass * b**2 + p.pitch_inertia) / L**2,
        "rear.mass heave": (p.sprung_mass * a**2 + p.pitch_inertia) / L**2,
        "mass coupling heave": (p.sprung_mass * a * b - p.pitch_inertia) / L**2,
        "front.mass roll": p.roll_inertia * b / L / half**2, "rear.mass roll": p.roll_inertia * a / L / half**2,
        "twist_stiffness": 1e8, "heave_share": b / L, "pitch_arm": 1.0 / L,
        "front.roll_arm": b / L / half, "rear.roll_arm": a / L / half,
        "front.overhang": p.front_overhang / L, "rear.overhang": p.rear_overhang / L,
    }  # fmt: skip
    for c, m, k, t in zip(CORNERS, p.unsprung_mass, p.spring_rate, p.tire_stiffness, strict=True):
        values |= {f"{c}.hub_mass": m, f"{c}.spring_rate": k, f"{c}.tire_stiffness": t,
                   f"{c}.tire_damping": 0.1, f"{c}.motion_ratio": 1.0}  # fmt: skip
    known = add_port_damping(vehicle.coupled(), dict.fromkeys(CORNERS, 3000.0))
    outputs = tuple(n for n in known.output_names if n.rpartition(".")[2] in (*QUANTITIES, "ride_height"))
    other = Experiment("seven", rig, tuple(f"{c}.force" for c in CORNERS), outputs, dict.fromkeys(CORNERS, 3000.0))
    table = declared(values, rig)
    model = linear_model({p.name: p.start for p in table}, other)
    frequency = np.array([0.8, 2.0, 8.0, 15.0])
    expected = known.select(inputs=other.inputs, outputs=outputs).frequency_response(frequency)
    found = model.frequency_response(frequency)
    for part in (slice(0, 4), slice(4, 7), slice(7, 11)):  # roads, loads, shock forces: each has its own scale
        largest = np.abs(expected[:, part]).max(axis=(1, 2), keepdims=True)
        assert (np.abs(found - expected)[:, part] < 0.01 * largest).all()


AERO = {"front.aero_place": 1.1, "front.aero_spread": 0.6, "rear.aero_place": -0.1, "rear.aero_spread": 0.8}
MODAL = {"heave_share": 0.55, "pitch_arm": 0.4, "front.roll_arm": 0.7, "rear.roll_arm": 0.9}


@pytest.mark.parametrize(("loads", "known"), [(RIG[4:], AERO), (("heave_force", "roll_moment", "pitch_moment"), MODAL)])
def test_balances_of_forces_give_the_parameters_of_a_linear_car(experiment, loads, known):
    """Records in the steady state have the response of the linear model at every frequency."""
    linear = replace(experiment, rig=(*RIG[:4], *loads))
    names = {p.name for p in declared({}, linear.rig)}
    expected = {name: value for name, value in (TRUE | known).items() if name in names}
    values = {p.name: p.start for p in declared(expected, linear.rig)}
    sizes = np.repeat([0.004, 300.0, 250.0], (4, len(loads), 4))
    spectra = np.fft.rfft(sizes[:, None] * np.random.default_rng(5).standard_normal((sizes.size, 5000)))
    spectra[:, 0] = 0.0
    response = linear_model(values, linear).frequency_response(np.fft.rfftfreq(5000, 1.0 / RATE))
    outputs = np.einsum("pmf,mf->pf", response, spectra)
    channels = dict(zip((*linear.inputs, *OUTPUTS), np.fft.irfft(np.vstack([spectra, outputs]), 5000), strict=True))
    channels |= {f"{c}.force": channels[f"{c}.force"] + 3000.0 * channels[f"{c}.velocity"] for c in CORNERS}
    test = TimeSeries.from_channels(np.arange(5000) / RATE, {name: ("1", row) for name, row in channels.items()})
    found = start_values([test], linear)
    assert found.keys() > {name for name in expected if not name.endswith("friction")}
    for name, value in found.items():
        assert value == pytest.approx(values[name], rel=0.06, abs=0.02), name


@pytest.fixture(scope="module")
def quick():
    return GreyBox(seconds=(10.0, 12.0))


@pytest.fixture(scope="module")
def explained(experiment, quick):
    """Return a test and the fit to it."""
    tests = [_test(experiment, 21)]
    return tests, quick.explain(tests, experiment)


@pytest.mark.nightly
def test_the_recipe_recovers_a_known_car_down_to_the_noise(explained):
    _, fit = explained
    for name in ("lf.spring_rate", "rr.tire_stiffness", "rear.mass coupling", "lf.friction", "rear.shock_share"):
        assert fit.values[name] == pytest.approx(TRUE[name], rel=0.03)
    assert max(fit.residual.values()) < 0.02


@pytest.mark.slow
def test_the_fit_to_a_short_test_is_the_kept_one(experiment, unchanged):
    """The records have static loads of the tires; a prior holds the stiffness of one spring."""
    recipe = GreyBox(seconds=(8.0, 8.0), priors={"lf.spring_rate": (2.2e5, 0.02)})
    tests = [_test(experiment, 21, 12.0)]
    loaded = replace(experiment, means={f"{c}.tire_force": 3000.0 for c in CORNERS})
    found = recipe.explain(tests, loaded)
    fit = recipe.vehicle_fit(found, tests, loaded, 0.0)
    values = {p.name: np.array([p.value, p.low, p.high, p.at_bound]) for p in fit.parameters}
    trusts = {name: np.array([one.response, one.measure, one.misfit]) for name, one in fit.trust.outputs.items()}
    forces = {"friction": fit.trust.friction, "springs": fit.trust.springs, "flags": fit.trust.flags}
    kept = {"residual": fit.residual, "notes": fit.notes, "ranges": fit.ranges}
    unchanged({**kept, "values": values, "trusts": trusts, **forces, "message": found.message}, relative=1e-3)


@pytest.fixture(scope="module")
def identified(experiment, quick, explained):
    tests, fit = explained
    return quick.vehicle_fit(fit, tests, experiment, 0.0)


@pytest.mark.nightly
def test_the_file_of_a_fit_carries_the_parameters_and_the_friction_of_its_own_law(identified, tmp_path):
    assert identified.stable
    assert "gate" not in identified.trust.flags
    write_fit(tmp_path / "car.json", identified)
    again = read_fit(tmp_path / "car.json")
    assert again.parameters == identified.parameters
    assert {p.name for p in again.parameters} >= {"lf.spring_rate", "friction_reach"}
    bristle = again.vehicle.friction["lf"].bristle
    assert bristle.force == pytest.approx(60.0, rel=0.2)
    assert bristle.reach == pytest.approx(1e-4, rel=0.3)


@pytest.mark.nightly
def test_a_car_with_another_mode_is_flagged_and_states_larger_errors_where_it_acts(experiment, quick, identified):
    hidden = quick.identify([_with_hidden_mode(_test(experiment, 41))], experiment)
    known, found = identified.trust, hidden.trust
    assert "gate" in found.flags
    assert set(known.measures) == {*OUTPUTS, TOTAL}
    assert max(one.common for one in known.measures.values()) < 0.01
    for name in ("lf.tire_force", "rf.hub_acceleration"):
        assert found.measures[name].own > 3.0 * known.measures[name].own


def test_drawn_cars_have_the_covariance_of_the_fit(experiment):
    """Only a tire's stiffness is uncertain, by 2 %: drawn cars scatter by what a change of 2 % makes."""
    table = declared(TRUE, experiment.rig)
    values = {p.name: p.start for p in table}
    variance = np.array([(0.02 if p.name == "lf.tire_stiffness" else 0.0) ** 2 for p in table.free])
    fit = SimpleNamespace(table=table, theta=table.theta(values), covariance=np.diag(variance))
    drawn = sampled_cars(fit, experiment, 400)
    known = linear_model(values, experiment)
    rate = np.array([car.A[8:16, :8] for car in drawn])
    deviation, changed = (
        rate.std(axis=0),
        known.A[8:16, :8]
        - linear_model(values | {"lf.tire_stiffness": 1.02 * values["lf.tire_stiffness"]}, experiment).A[8:16, :8],
    )
    np.testing.assert_allclose(deviation, np.abs(changed), rtol=0.1, atol=1e-9)


def test_the_misfit_is_the_distance_of_the_model_in_standard_deviations(experiment):
    """The model is 3 standard deviations away at half of the known frequencies in the band."""
    model = linear_model({p.name: p.start for p in declared(TRUE, experiment.rig)}, experiment)
    frequency = np.linspace(1.0, 10.0, 10)
    exact = response_of(model, frequency)
    away = np.where((frequency > 2.5) & (frequency < 5.5), 3.0, 0.0)
    away[0] = 1e6  # below the band
    variance = np.full(exact.H.shape, 4.0)
    variance[..., 7], away[7] = np.inf, 1e6
    measured = replace(exact, H=exact.H + 2.0j * away, variance=variance)
    found = _misfit(model, measured, (2.0, 8.0))
    np.testing.assert_allclose(found, np.full(len(OUTPUTS), 3.0 * np.sqrt(0.5)))


def a_fit(values, deviations=None, **changes):
    """Return a stand-in for a fit with the parameters of the true car."""
    values = {p.name: p.start for p in declared(TRUE, RIG)} | values
    plain = {"residual": {"lf.velocity": 0.02, "lf.tire_force": 0.05}, "message": "", "at_bounds": ()}
    return SimpleNamespace(values=values, deviations=deviations or {}, **plain | changes)


def test_the_notes_of_a_fit_state_the_sprung_mass_and_every_trouble():
    plain = a_fit({})
    sound = _notes(plain, a_fit({}, residual={"lf.velocity": 0.061, "lf.tire_force": 0.01}))
    assert sound[0] == "sprung mass 1130.0 kg; residuals of the simulation are 2 to 5 % of the outputs"
    assert sound[1].endswith("Its residuals are up to 6.1 %")
    assert len(sound) == 2
    stiffening = {"lf.tire_stiffening": 3.0, "rr.tire_stiffening": -3.0, "rf.tire_stiffening": 3.0}
    bad = a_fit(stiffening, {"lf.tire_stiffening": 0.1, "rr.tire_stiffening": 0.1, "rf.tire_stiffening": 9.0},
                message="no step", at_bounds=("lf.hub_mass",))  # fmt: skip
    assert _notes(bad, plain)[2:] == [
        "tires stiffen with deflection: lf, rr",
        "the search did not converge: no step",
        "parameters at a bound of the fit, whose intervals are not valid: lf.hub_mass",
    ]


def test_the_force_of_a_progressive_spring_is_that_at_the_rms_travel_of_the_wheel():
    """k p w^2 with 2e5 N/m, p = 3 +- 0.5 per metre and w = 8 mm / 0.8."""
    travel = np.tile([-0.008, 0.008], 50)
    test = TimeSeries.from_channels(np.arange(100) / RATE, {"lf.displacement": ("m", travel)})
    fitted = {"lf.spring_progression": 3.0, "rf.spring_progression": 3.0, "lf.spring_rate": 2e5, "lf.motion_ratio": 0.8}
    found = _springs(a_fit(fitted, {"lf.spring_progression": 0.5, "rf.spring_progression": 0.5}), [test])
    assert list(found) == ["lf"]
    assert (found["lf"].value, found["lf"].deviation) == pytest.approx((60.0, 10.0))


def test_a_record_begins_after_a_twentieth_and_has_port_forces_without_the_baseline_damping(experiment):
    """The inputs are 4 roads, 4 loads and F - c v of the ports; each channel has its own number here."""
    names = (*experiment.inputs, *experiment.outputs)
    count = round(40.0 * RATE)
    ramp = np.arange(count) / RATE
    rows = {name: ("1", ramp + 100.0 * k) for k, name in enumerate(names)}
    record = _record(TimeSeries.from_channels(ramp, rows), experiment, 12.0)
    assert (len(record.inputs), record.settling) == (round(14.0 * RATE), round(2.0 * RATE))
    first = 2.0  # a twentieth of 40 s
    velocity = first + 100.0 * names.index("lr.velocity")
    assert record.inputs[0, [1, 6]] == pytest.approx([first + 100.0, first + 600.0])
    assert record.inputs[0, 10] == pytest.approx(first + 1000.0 - 3000.0 * velocity)
    assert record.outputs[0] == pytest.approx(first + 100.0 * (12 + np.arange(len(OUTPUTS))))


def test_parameters_that_no_output_or_load_shows_are_not_fitted(experiment):
    blind = replace(
        experiment, outputs=tuple(n for n in OUTPUTS if n != "front.ride_height"), rig=(*RIG[:4], "heave_force")
    )
    assert set(_unused(declared({}, blind.rig), blind)) == {
        "driver_place", "driver_spread", "front.overhang", "pitch_arm", "front.roll_arm", "rear.roll_arm"
    }  # fmt: skip
    assert _unused(declared({}, RIG), replace(experiment, outputs=(*OUTPUTS, "driver.acceleration"))) == ()


def test_a_prior_is_relative_to_its_value(experiment):
    recipe = GreyBox(priors={"lf.spring_rate": (2.2e5, 0.02), "rear.aero_place": (-0.2, 0.1)})
    table = {p.name: p for p in recipe._with_priors(declared(TRUE, experiment.rig))}
    assert (table["lf.spring_rate"].start, table["lf.spring_rate"].prior) == (2.2e5, 0.02)
    assert (table["rear.aero_place"].start, table["rear.aero_place"].prior) == (-0.2, pytest.approx(0.02))
    assert table["rf.spring_rate"].prior is None


def _with_hidden_mode(test):
    """Return a test in which an engine on mounts at 11 Hz pushes on the front tires and hubs."""
    frequency = np.fft.rfftfreq(len(test), 1.0 / RATE)
    mode = 0.3 / (1.0 - (frequency / 11.0) ** 2 + 2j * 0.04 * frequency / 11.0)
    for c in CORNERS[:2]:
        for name in (f"{c}.tire_force", f"{c}.hub_acceleration"):
            added = np.fft.irfft(np.fft.rfft(test[name]) * mode * (frequency > 8.0) * (frequency < 14.0), len(test))
            test = test.with_channel(name, "1", test[name] + added)
    return test


@pytest.mark.slow
def test_a_short_test_is_refused_with_the_duration_that_is_needed(experiment, quick):
    with pytest.raises(TooShortError, match="record at least 11 s"):
        quick.identify([_test(experiment, 71, seconds=8.0)], experiment)


def test_a_quarter_car_is_refused(experiment):
    quarter = replace(experiment, rig=("road",), forces=("force",), outputs=("velocity",), baseline_damping={"": 1.0})
    with pytest.raises(InputError, match="needs the corners lf, rf, lr, rr"):
        GreyBoxCar(quarter, (), np.zeros(4))


def test_a_prior_of_an_unknown_parameter_is_refused(experiment):
    with pytest.raises(ParameterError, match="no parameter spring"):
        GreyBox(priors={"spring": (1.0, 0.1)}).identify([_test(experiment, 81)], experiment)
