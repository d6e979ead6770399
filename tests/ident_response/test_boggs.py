"""Tests of the dissertation's identification chain, compared with the car that was tested."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eightpost.corners import CORNERS
from eightpost.errors import FileFormatError, FmuError, InputError, ParameterError, StepError
from eightpost.ident.vehicle.boggs import CHAPTER_4, CHAPTER_5, CHAPTER_6, Boggs, _doubts, chapter_of
from eightpost.ident.vehicle.experiment import Experiment, experiment_of, find_baseline
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, contribution_error, response_of
from eightpost.ident.vehicle.plan import recipe
from eightpost.ident.vehicle.simulation import ManySetups
from eightpost.ident.vehicle.siso_models import TransferFunction, balance, parallel_model
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.ident.vehicle.trust import MeasuredLevels
from eightpost.ident.vehicle.vehicle_fit import fit_path, fit_verdict, read_fit, with_validity, write_fit
from eightpost.progress import reported_to
from eightpost.shock import Lpf1, Lpnl2
from eightpost.shock.file import read_shock
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Channel, IdentifiedVehicle, add_port_damping, discretise, read_vehicle, shipped
from eightpost.vehicle.vehicles import Friction
from eightpost.verdict import Grade, Reason, sealed

from .rig_tests import ALTERNATE, BASELINE, noise


def _experiment(rig):
    return Experiment("car", rig.rig, rig.forces, rig.outputs, rig.damping, sources={"base.parquet": "0" * 64})


#: Progress that the identification of the fixture `fit` reported [1].
SHARES: list[float] = []


@pytest.fixture(scope="module")
def fit(quarter_car):
    with reported_to(lambda done, _total: SHARES.append(done)):
        return recipe("boggs").identify(quarter_car.records, _experiment(quarter_car))


def test_poor_fits_are_named_with_their_error_if_their_output_depends_on_them():
    H = np.array([[[1.0], [1.0], [0.01]]])
    channels = [Channel(name, "m") for name in ("y", "u", "v", "w")]
    response = FrequencyResponse(np.array([1.0]), H, tuple(channels[1:]), tuple(channels[:1]))
    fits = SimpleNamespace(
        paths={("y", one): SimpleNamespace(error=error) for one, error in {"u": 0.2, "v": 0.8, "w": 0.9}.items()}
    )
    (note,) = _doubts(fits, response, np.ones(1))
    assert note == "poor fits of paths that contribute to their outputs: y / v (80 %)"
    assert _doubts(SimpleNamespace(paths={("y", "u"): fits.paths["y", "u"]}), response, np.ones(1)) == ()


def test_the_chain_identifies_the_quarter_car_within_leakage_errors(quarter_car, fit):
    frequency = np.arange(0.5, 18.0, 0.05)
    truth, found = (response_of(model, frequency) for model in (quarter_car.truth, fit.vehicle.state_space))
    errors = contribution_error(found, truth, quarter_car.input_power(frequency))
    assert errors.max() < 0.1  # error of the estimate with blocks of 9.5 s; with local polynomials it is below 0.001


def test_the_identification_reports_every_stage_and_every_path(fit):
    model = fit.vehicle.state_space
    assert sorted(SHARES) == SHARES and SHARES[-1] == 1.0
    assert len({share for share in SHARES if 0.2 < share <= 0.6}) >= len(model.inputs) * len(model.outputs)


def test_shock_velocities_have_no_direct_term_so_an_fmu_can_be_built(fit):
    assert not fit.vehicle.state_space.select(outputs=["velocity"]).D.any()
    assert "force" in fit.vehicle.coupled().input_names


@pytest.mark.slow
def test_the_reduction_changes_outputs_within_its_tolerance(quarter_car, fit):
    full = Boggs(reduction=None).identify(quarter_car.records, _experiment(quarter_car))
    whole, reduced = (response_of(one.vehicle.state_space, one.response.frequency) for one in (full, fit))
    assert fit.states < full.states
    power = quarter_car.input_power(whole.frequency)
    assert contribution_error(reduced, whole, power).max() < 0.02  # another measure of the inputs than the recipe's


def test_the_chapter_follows_from_the_inputs_of_the_car():
    inputs = [f"{c}.{q}" for q in ("road", "force", "velocity", "displacement", "tire_force") for c in CORNERS]
    damping = dict.fromkeys(CORNERS, 1.0)
    seven = experiment_of([*inputs, "heave_force", "roll_moment", "pitch_moment"], damping)
    eight = experiment_of([*inputs, *(f"{c}.aero" for c in CORNERS)], damping)
    quarter = experiment_of(["road", "force", "velocity", "aero_force"], {"": 1.0})
    assert [chapter_of(one) for one in (quarter, seven, eight)] == [CHAPTER_4, CHAPTER_5, CHAPTER_6]
    assert eight.rig[4:] == tuple(f"{c}.aero" for c in CORNERS)
    assert eight.inputs[-4:] == tuple(f"{c}.force" for c in CORNERS)


def test_an_experiment_without_a_ports_velocity_or_damping_is_rejected():
    with pytest.raises(ParameterError, match="velocity must be an output"):
        Experiment("car", ("road",), ("force",), ("tire_force",), {"": 1.0})
    with pytest.raises(ParameterError, match="no baseline damping"):
        Experiment("car", ("road",), ("force",), ("velocity",), {})
    with pytest.raises(ParameterError, match="no output spin"):
        Experiment("car", ("road",), ("force",), ("velocity",), {"": 1.0}).of("spin")


def test_an_unknown_recipe_is_rejected_with_the_known_ones():
    with pytest.raises(ParameterError, match="use one of boggs, common-poles, grey-box"):
        recipe("guess")


def _with_shocks(damping):
    """Return a test of linear shocks at random velocities."""
    velocity = dict(zip(CORNERS, np.random.default_rng(4).normal(size=(4, 500)), strict=True))
    channels = {f"{corner}.velocity": ("m/s", values) for corner, values in velocity.items()}
    channels |= {f"{corner}.force": ("N", damping[corner] * values) for corner, values in velocity.items()}
    return TimeSeries.from_channels(np.arange(500) / 250.0, channels)


def test_the_baseline_is_the_test_with_the_most_common_shocks():
    usual = dict.fromkeys(CORNERS, BASELINE)
    changed = [usual | {corner: ALTERNATE} for corner in CORNERS]
    found = find_baseline(
        [_with_shocks(one) for one in (changed[2], changed[0], usual, changed[3], changed[1])], CORNERS
    )
    assert found.test == 2
    assert found.order == (2, 1, 4, 0, 3)
    assert found.damping["lf"] == pytest.approx(BASELINE, rel=1e-6)
    assert not found.notes()


def test_the_baseline_of_two_tests_is_the_one_with_more_damping(quarter_car):
    assert find_baseline(quarter_car.records[::-1], ("",)).test == 1


def test_tests_without_another_shock_are_rejected(quarter_car):
    with pytest.raises(InputError, match="no test has another shock"):
        find_baseline([quarter_car.records[0]] * 2, ("",))


def test_an_unstable_loop_is_detected_and_reported(fit):
    model = fit.vehicle.state_space
    force = model.input_names.index("force")
    pushed = replace(model, B=np.where(np.arange(model.B.shape[1]) == force, -4.0, 1.0) * model.B)
    found = closed_loop_stability(IdentifiedVehicle("pushed", pushed, fit.vehicle.baseline_damping))
    assert not found.stable
    assert found.growth > 0.0
    assert "UNSTABLE" in found.summary()


def test_a_fit_that_is_read_back_is_equal(fit, tmp_path):
    files = write_fit(tmp_path / "car.json", fit)
    assert sorted(file.name for file in files) == ["car.fit.json", "car.json", "car.response.npz"]
    found = read_fit(tmp_path / "car.json")
    assert (found.recipe, found.residual, found.notes, found.stable) == ("boggs", fit.residual, fit.notes, True)
    assert found.vehicle.state_space == fit.vehicle.state_space
    assert found.sources == {"base.parquet": "0" * 64}
    np.testing.assert_array_equal(found.response.H, fit.response.H)


def test_a_fit_states_the_levels_of_its_own_tests_and_is_judged_by_them(fit):
    assert fit.trust is not None
    assert set(fit.trust.measures) == set(fit.vehicle.state_space.output_names)
    assert not fit.trust.flags
    assert [reason.about for reason in fit_verdict(fit).reasons] == ["fit of the vehicle"]
    assert "own tests" in fit_verdict(fit).reasons[0].rule


def test_a_car_that_cannot_be_simulated_with_its_own_shocks_is_not_usable(quarter_car, monkeypatch):
    simulated: list[float] = []

    def diverges(levels, *_given):
        simulated.append(levels.seconds)
        return {}

    monkeypatch.setattr(MeasuredLevels, "uncertainty", diverges)
    found = recipe("boggs").identify(quarter_car.records, _experiment(quarter_car))
    assert simulated == [30.0]
    assert [reason.rule for reason in fit_verdict(found).decisive] == ["vehicle cannot be simulated"]


def test_a_fit_of_the_removed_recipe_auto_is_read_with_its_verdict(fit, tmp_path):
    """Version 0.2.0 wrote the choice of that recipe, which is left out, and a reason by a removed rule."""
    gone = Reason(
        "recipe chosen by a left-out test", "choice of the recipe", Grade.USABLE, "common-poles was chosen",
        "common-poles 2 %, grey-box 3 %", "common-poles fit to base.parquet", "nothing",
    )  # fmt: skip
    old = with_validity(fit, [gone])
    path = write_fit(tmp_path / "car.json", old)[2]
    content = json.loads(path.read_text(encoding="utf-8"))
    choice = {"trials": [], "reason": gone.statement, "recipe": "common-poles"}
    path.write_text(json.dumps(sealed(content | {"choice": choice})), encoding="utf-8")
    found = read_fit(tmp_path / "car.json")
    assert found.verdict == old.verdict
    assert gone in found.verdict.reasons


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema": 99}, "update eightpost"),
        ({"kind": "shock"}, "not a vehicle fit file; identify again"),
    ],
)
def test_a_file_of_a_newer_schema_or_another_kind_is_refused(fit, tmp_path, change, said):
    car = tmp_path / "car.json"
    write_fit(car, fit)
    content = json.loads(fit_path(car).read_text(encoding="utf-8"))
    fit_path(car).write_text(json.dumps(content | change), encoding="utf-8")
    with pytest.raises(FileFormatError, match=said):
        read_fit(car)


RATE = 1250.0
BANK = Path(__file__).resolve().parents[2] / "examples" / "bank"


def _copies(count):
    """Return transfer functions of one mode to several outputs, as if each output had its own mode."""
    poles = np.array([-2.0 + 20.0j, -2.0 - 20.0j])
    return {(f"y{k}", "u"): TransferFunction(poles, (k + 1.0) * np.array([1 - 2j, 1 + 2j]), 0.1) for k in range(count)}


def test_reduction_merges_copies_of_one_mode():
    outputs = [Channel(f"y{k}", "m") for k in range(5)]
    model = parallel_model(_copies(5), [Channel("u", "N")], outputs)
    found = balance(model, np.array([1e3]), np.full(5, 1e-6))
    assert len(model.A) == 10
    assert (found.hankel[2:] < 1e-6 * found.hankel[0]).all()
    frequency = np.geomspace(0.1, 50.0, 60)
    reduced = found.truncated(2)
    np.testing.assert_allclose(
        reduced.frequency_response(frequency), model.frequency_response(frequency), rtol=1e-6, atol=1e-9
    )
    assert (reduced.poles().real < 0.0).all()


def test_the_truncation_error_is_below_twice_the_sum_of_the_omitted_hankel_values():
    generator = np.random.default_rng(2)
    paths = {}
    for k in range(6):
        pole = complex(-generator.uniform(0.5, 5.0), generator.uniform(5.0, 60.0))
        residue = complex(*generator.normal(size=2))
        poles, residues = (np.array([z, z.conjugate()]) for z in (pole, residue))
        paths[f"y{k}", "u"] = TransferFunction(poles, residues, 0.0)
    model = parallel_model(paths, [Channel("u", "N")], [Channel(f"y{k}", "m") for k in range(6)])
    found = balance(model, np.ones(1), np.ones(6))
    frequency = np.geomspace(0.01, 100.0, 400)
    for states in (2, 4, 8):
        wrong = found.truncated(states).frequency_response(frequency) - model.frequency_response(frequency)
        bound = 2.0 * found.hankel[states:].sum()
        assert np.linalg.norm(wrong[:, 0], axis=0).max() <= bound * (1.0 + 1e-6)


@pytest.fixture(scope="module")
def car():
    model = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": BASELINE})
    return IdentifiedVehicle("car", model, {"": BASELINE})


@pytest.fixture(scope="module")
def drive():
    road = 0.004 * noise(np.random.default_rng(8), 1500, RATE, 20.0)
    return TimeSeries.from_channels(np.arange(road.size) / RATE, {"road": ("m", road - road.mean())})


@pytest.fixture(scope="module")
def bank():
    """Two shipped builds, one of them with a gas spring and a constant lag that is long compared with the steps."""
    first, second = (read_shock(BANK / f"{name}.json").law for name in ("AA_AA", "C_B"))
    assert isinstance(first, Lpnl2)
    assert isinstance(second, Lpnl2)
    return [first, Lpf1(curve=second.curve, port=replace(second.port, gas_stiffness=700.0), time_constant=1e-3)]


def test_outputs_are_stored_at_every_nth_sample(car, drive, bank):
    every, fifth = (ManySetups(car, bank, drive, step).run([[0]]) for step in (1, 5))
    np.testing.assert_array_equal(fifth, every[..., ::5])


def test_setups_that_cannot_be_simulated_together_are_rejected(car, drive, bank):
    with pytest.raises(InputError, match="each setup needs one shock"):
        ManySetups(car, bank, drive).run([[0, 1]])
    wrong = TimeSeries.from_channels(drive.time, {"lf.road": ("m", drive["road"])})
    with pytest.raises(InputError, match=r"lf\.road"):
        ManySetups(car, bank, wrong).run([[0]])
    stepped = IdentifiedVehicle("stepped", discretise(car.state_space, 0.001), {})
    with pytest.raises(ParameterError, match="discrete"):
        ManySetups(stepped, bank, drive).run([[0]])


@pytest.fixture
def pushed(drive):
    """The drive with a force at the port in addition to the shock, with a mean that has no effect."""
    force = 200.0 + 300.0 * np.sin(2.0 * np.pi * 4.0 * drive.time)
    return drive.with_channel("force", "N", force)


def test_without_a_compiler_setups_run_step_by_step_and_each_responds_as_it_does_alone(car, pushed, bank, monkeypatch):
    rubbing = replace(car, friction={"": Friction(30.0, 0.01, Bristle(100.0, 1e-4, 1.1, 0.01), 1e5)})
    short = pushed.window(0.0, 0.3)
    *compiled, again = ManySetups(rubbing, bank, short, 2).run([[0], [1], [0]])
    np.testing.assert_array_equal(again, compiled[0])

    def none(*_, **__):
        raise FmuError("no C compiler was found")

    monkeypatch.setattr("eightpost.machine.run.compiled", none)
    found = ManySetups(rubbing, bank, short, 2).run([[0], [1]])
    error = np.std(found - compiled, axis=2) / np.std(compiled, axis=2)
    assert np.delete(error, car.state_space.output_names.index("hub_acceleration"), axis=1).max() < 2e-3


def test_the_port_of_a_car_without_displacement_has_no_gas_spring(car, drive, bank):
    kept = [name for name in car.state_space.output_names if name != "displacement"]
    blind = replace(car, state_space=car.state_space.select(outputs=kept))
    without = replace(bank[1], port=replace(bank[1].port, gas_stiffness=0.0))
    first, second = ManySetups(blind, [bank[1], without], drive).run([[0], [1]])
    np.testing.assert_array_equal(first, second)
    seen = ManySetups(car, [bank[1], without], drive).run([[0], [1]])
    assert np.std(seen[0] - seen[1]) > 1e-3 * seen[1].std()


def test_shocks_that_are_too_stiff_for_the_step_and_growing_motions_are_step_errors(car, drive, bank):
    for scale in (20.0, 400.0):  # the forces of a step do not converge, or the motion diverges
        stiff = replace(bank[0], port=replace(bank[0].port, rebound_scale=scale))
        with pytest.raises(StepError, match="resample the drive"):
            ManySetups(car, [bank[0], stiff, *[bank[0]] * 20], drive).run([[0], [1]])
    growing = replace(car, state_space=add_port_damping(car.state_space, {"": -4.0 * BASELINE}))
    with pytest.raises(StepError, match="not stable"):
        ManySetups(growing, bank, drive).run([[0]])


def test_a_setup_with_a_steep_lagged_shock_moves_as_its_differential_equations(car, pushed, bank):
    law, model = replace(bank[1], port=replace(bank[1].port, motion_ratio=0.9, seal_friction=20.0)), car.state_space
    short = pushed.window(0.0, 0.4)
    inputs = np.zeros((len(model.inputs), len(short)))
    for name in short.names:
        inputs[model.input_names.index(name)] = short[name] - short[name].mean()
    at, row, place = (names.index(n) for names, n in ((model.input_names, "force"), (model.output_names, "velocity"),
                                                      (model.output_names, "displacement")))  # fmt: skip

    def motion(t, x):
        u = np.array([np.interp(t, short.time, one) for one in inputs])
        v = model.C[row] @ x[:-1] + model.D[row] @ u
        own = replace(law.port, gas_preload=0.0)
        static = law.static_force(v)
        force = own.motion_ratio * (
            x[-1] + own.seal_force(own.motion_ratio * v)
            + own.gas_stiffness * own.motion_ratio * (model.C[place] @ x[:-1])
        )  # fmt: skip
        u[at] += force - BASELINE * v
        return u, model.A @ x[:-1] + model.B @ u, (static - x[-1]) / law.time_constant

    solved = solve_ivp(
        lambda t, x: np.append(*motion(t, x)[1:]), (0.0, short.time[-1]), np.zeros(len(model.A) + 1),
        t_eval=short.time, rtol=1e-7, atol=1e-9, max_step=1e-3,
    )  # fmt: skip
    right = np.array(
        [model.C @ x[:-1] + model.D @ motion(t, x)[0] for t, x in zip(solved.t, solved.y.T, strict=True)]
    ).T
    found = ManySetups(car, [law], short).run([[0]])[0]
    error = dict(zip(model.output_names, np.std(found - right, axis=1) / right.std(axis=1), strict=True))
    assert error["velocity"] < 1e-3 and error["hub_acceleration"] < 1e-2 and error["tire_force"] < 1e-3, error
