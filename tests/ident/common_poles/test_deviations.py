"""The uncertainty of an output: excitation of a test, sizes with several dampers, and the factor of the misfit."""

from dataclasses import replace

import numpy as np
import pytest

from eightpost.corners import CORNERS
from eightpost.errors import InputError
from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit
from eightpost.ident.vehicle.common_poles import Excitation, output_trust, relative_deviations
from eightpost.ident.vehicle.estimators import powered
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.stability import closed_loop_stability, safe_slopes
from eightpost.signals import TimeSeries
from eightpost.vehicle import Channel, IdentifiedVehicle, StateSpace, add_port_damping

from .conftest import BASELINE, noisy

RATE, BAND = 100.0, (1.0, 20.0)
TIME = np.arange(0.0, 80.0, 1.0 / RATE)


def record(frequency):
    return TimeSeries.from_channels(TIME, {"road": ("m", 3.0 + np.sin(2.0 * np.pi * frequency * TIME))})


def test_the_excitation_is_the_spectrum_of_the_first_minute_in_the_band():
    drive = Excitation.of(record(5.0), ("road",), BAND)
    assert drive.frequency[np.argmax(np.abs(drive.spectra[0]))] == pytest.approx(5.0)
    assert np.diff(drive.frequency) == pytest.approx(1.0 / 60.0)
    assert (drive.frequency[0], drive.frequency[-1]) == pytest.approx(BAND)
    # Neither the mean nor a line outside the band is part of it.
    outside = Excitation.of(record(40.0), ("road",), BAND)
    assert np.abs(outside.spectra).max() < 1e-4 * np.abs(drive.spectra).max()


def test_an_input_at_rest_has_no_spectrum_and_one_that_is_zero_everywhere_is_an_error():
    rest = TimeSeries.from_channels(TIME, {"road": ("m", np.full(TIME.size, 3.0))})
    assert np.abs(Excitation.of(rest, ("road",), BAND).spectra).max() < 1e-9
    with pytest.raises(InputError, match="the input 'road' is zero in all records"):
        powered(np.zeros((4, 1)), 0.1, ["road"])
    assert powered(np.array([[1.0], [0.05], [0.2]]), 0.1, ["road"])[:, 0].tolist() == [True, False, True]


def test_sizes_are_those_with_half_the_damping_the_damping_and_twice_the_damping(quarter_car):
    drive, damping = Excitation.of(record(5.0), ("road",), BAND), 800.0
    sizes = drive.rms(quarter_car, {"": damping})
    for row, part in zip(sizes, (0.5, 1.0, 2.0), strict=True):
        car = add_port_damping(quarter_car, {"": (part - 1.0) * damping}).select(inputs=("road",))
        expected = np.abs(car.frequency_response(drive.frequency)[:, 0] * drive.spectra[0])
        assert row == pytest.approx(np.sqrt(np.sum(expected**2, axis=1)), rel=1e-9)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_relative_deviation_does_not_depend_on_the_size_of_a_response(quarter_car, scale):
    few, many, model = (
        replace(quarter_car, B=factor * scale * quarter_car.B, D=factor * scale * quarter_car.D)
        for factor in (0.9, 1.1, 1.0)
    )
    experiment = Experiment("car", ("road",), ("force",), tuple(model.output_names), {"": 0.0})
    for deviation in relative_deviations(model, (few, many), record(5.0), experiment, BAND):
        assert deviation == pytest.approx(np.full(len(model.outputs), 0.1 * np.sqrt(2.0)))


@pytest.mark.nightly
def test_a_misfit_above_one_deviation_raises_the_uncertainty_and_one_below_does_not(quarter_car):
    found = CommonPoleFit(order=4, high=19.9, floor=1e-5, max_states=4).fit(noisy(quarter_car, 0.02, 3))
    experiment = Experiment("car", ("road",), ("force",), tuple(found.model.output_names), {"": 800.0})

    def trusts(misfit):
        changed = replace(found, excess=dict.fromkeys(found.excess, misfit))
        listed = output_trust(changed, [record(5.0)], experiment, samples=4, with_friction={})
        return np.array([[one.response, one.measure] for one in listed.values()])

    at_one = trusts(1.0)
    assert (at_one > 0.0).all()
    assert trusts(0.5) == pytest.approx(at_one)
    assert trusts(3.0) == pytest.approx(3.0 * at_one)


@pytest.mark.parametrize(("name", "ports"), [("quarter_car", ("",)), ("seven_dof", CORNERS)])
def test_a_car_of_masses_and_springs_is_stable_with_any_shock(name, ports, request):
    found = safe_slopes(request.getfixturevalue(name), dict.fromkeys(ports, BASELINE))
    assert found.softest is not None
    assert found.softest <= 0.02
    assert "any shocks" in found.summary().lower()


def test_a_port_whose_force_acts_in_the_wrong_direction_is_reported():
    # v' = -v - 20 v + F / 50 around 1000 N.s/m: the damper's force drives the motion.
    model = StateSpace(np.array([[-30.0]]), np.array([[0.02]]), np.array([[1.0]]), np.zeros((1, 1)),
                       (Channel("force", "N"),), (Channel("velocity", "m/s"),))  # fmt: skip
    found = safe_slopes(model, {"": 1000.0})
    assert found.softest is None
    assert "not proved" in found.summary()


@pytest.mark.parametrize("in_the_loop", [False, True])
def test_only_a_growing_part_between_shock_force_and_velocity_makes_the_loop_unstable(quarter_car, in_the_loop):
    one, n = quarter_car, len(quarter_car.A)
    force, velocity = one.input_names.index("force"), one.output_names.index("velocity")
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[n, n] = one.A, 5.0
    B, C = np.vstack([one.B, np.zeros(len(one.inputs))]), np.hstack([one.C, np.zeros((len(one.outputs), 1))])
    B[n, force if in_the_loop else one.input_names.index("road")] = 1e-6
    C[velocity if in_the_loop else one.output_names.index("tire_force"), n] = 1.0
    model = StateSpace(A, B, C, one.D, one.inputs, one.outputs)
    assert closed_loop_stability(IdentifiedVehicle("car", model, {"": BASELINE})).stable is not in_the_loop
