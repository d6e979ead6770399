"""Tests of model reduction and of the simulation of many setups, each against an independent construction."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eightpost.errors import FmuError, InputError, ParameterError, StepError
from eightpost.ident.vehicle.simulation import ManySetups
from eightpost.ident.vehicle.siso_models import TransferFunction, balance, parallel_model
from eightpost.shock import Lpf1, Lpnl2
from eightpost.shock.file import read_shock
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Channel, IdentifiedVehicle, add_port_damping, discretise, read_vehicle, shipped
from eightpost.vehicle.vehicles import Friction

from .rig_tests import BASELINE, noise

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
