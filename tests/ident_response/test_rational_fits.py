"""Tests of rational fits, their parallel realisation, and simulation with shocks."""

import numpy as np
import pytest
from scipy.signal import residue

from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident.vehicle.frequency_response import response_of
from eightpost.ident.vehicle.simulation import simulate_with_shocks
from eightpost.ident.vehicle.siso_models import (
    BandWeights,
    RationalFit,
    SisoFits,
    TransferFunction,
    has_direct_term,
    parallel_model,
)
from eightpost.shock import Polylinear, StaticCurve
from eightpost.signals import TimeSeries
from eightpost.vehicle import Channel, IdentifiedVehicle, add_port_damping, read_vehicle, shipped

from .rig_tests import BASELINE

F = np.arange(0.2, 25.0, 0.05)
EVERYWHERE = BandWeights(((0.0, 100.0, 1.0),))


def _quarter_car():
    return response_of(add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": BASELINE}), F)


def _linear_shock(rate):
    """Return a linear shock, F = rate v."""
    speed = 0.4
    inner = (rate * speed, *[0.0] * 14)
    line = (rate * speed, rate * speed, 0.0, 0.0)
    rebound = (-rate * speed, -rate * speed, 0.0, 0.0)
    return Polylinear(StaticCurve(inner, line, rebound, speed, 0.01, 5.0, 5.0, rate, rate))


def test_known_polynomials_are_recovered_to_rounding():
    b, a = [2.0, 300.0, 4e4], [1.0, 8.0, 900.0, 1500.0]
    s = 2j * np.pi * F
    fit = RationalFit(3, 2).fit(F, np.polyval(b, s) / np.polyval(a, s), np.ones(F.size))
    residues, poles, _ = residue(b, a)
    order = np.lexsort((fit.poles.imag, fit.poles.real))
    expected = np.lexsort((poles.imag, poles.real))
    np.testing.assert_allclose(fit.poles[order], poles[expected], rtol=1e-9)
    np.testing.assert_allclose(fit.residues[order], residues[expected], rtol=1e-9)


def test_the_output_error_does_not_exceed_that_of_the_initial_reweighted_fit():
    generator = np.random.default_rng(3)
    path = _quarter_car().between("tire_force", "road")
    noisy = path * (1.0 + 0.1 * (generator.normal(size=F.size) + 1j * generator.normal(size=F.size)))
    errors = [
        np.linalg.norm(RationalFit(4, 4, iterations=n).fit(F, noisy, np.ones(F.size)).frequency_response(F) - noisy)
        for n in (0, 30)
    ]
    assert errors[1] <= errors[0]


def test_fits_of_pure_noise_are_stable():
    generator = np.random.default_rng(5)
    for _ in range(5):
        wild = generator.normal(size=F.size) + 1j * generator.normal(size=F.size)
        assert (RationalFit(8, 7).fit(F, wild, np.ones(F.size)).poles.real < 0.0).all()


def test_frequencies_without_weight_have_no_effect():
    path = _quarter_car().between("velocity", "road").copy()
    path[F > 20.0] = 1e6
    fit = RationalFit(4, 4).fit(F, path, BandWeights(((0.0, 20.0, 1.0),)).at(F))
    below = F < 20.0
    assert np.abs(fit.frequency_response(F) - path)[below].max() < 1e-9 * np.abs(path[below]).max()


def test_the_parallel_realisation_equals_the_transfer_functions_at_every_frequency():
    response = _quarter_car().select(outputs=["velocity", "tire_force"])
    paths: dict[tuple[str, str], TransferFunction] = {}
    for i, output in enumerate(response.output_names):
        for j, source in enumerate(response.input_names):
            paths[output, source] = RationalFit(4, 4).fit(F, response.H[i, j], np.ones(F.size))
    model = parallel_model(paths, response.inputs, response.outputs)
    assert len(model.A) == 24
    np.testing.assert_allclose(model.frequency_response(F), response.H, rtol=1e-9, atol=1e-14)


def test_degrees_that_cannot_be_simulated_and_too_few_frequencies_are_rejected():
    with pytest.raises(ParameterError, match="numerator"):
        RationalFit(3, 4)
    with pytest.raises(TooShortError, match="coefficients"):
        RationalFit(8, 8).fit(F[:5], np.ones(5, dtype=complex), np.ones(5))


@pytest.mark.parametrize("name", ["quarter_car", "seven_dof"])
def test_direct_terms_predicted_from_names_are_those_of_the_models(name):
    model = read_vehicle(shipped(name)).coupled()  # type: ignore[arg-type]
    direct = model.direct_terms()
    predicted = np.array([[has_direct_term(o, i) for i in model.input_names] for o in model.output_names])
    np.testing.assert_array_equal(predicted, direct)


def _identified():
    weights = dict.fromkeys(("road", "aero_force", "force"), EVERYWHERE)
    fits = SisoFits((4,), tolerance=1e-6, weights=weights).fit(_quarter_car())
    return IdentifiedVehicle("identified", fits.model, {"": BASELINE})


def test_a_drive_with_unknown_channels_is_rejected():
    drive = TimeSeries.from_channels(np.arange(100) * 0.001, {"lf.road": ("m", np.zeros(100))})
    with pytest.raises(InputError, match=r"lf\.road"):
        simulate_with_shocks(_identified(), {}, drive)
    with pytest.raises(InputError, match="no port 'lf'"):
        simulate_with_shocks(_identified(), {"lf": _linear_shock(1.0)}, drive)


def test_a_velocity_with_a_direct_term_from_its_own_force_is_rejected():
    one = TransferFunction(np.array([-1.0 + 0j]), np.array([1.0 + 0j]), 0.5)
    model = parallel_model({("velocity", "force"): one}, [Channel("force", "N")], [Channel("velocity", "m/s")])
    drive = TimeSeries(np.arange(100) * 0.001, np.empty((0, 100)), (), ())
    with pytest.raises(ParameterError, match="algebraic loop"):
        simulate_with_shocks(IdentifiedVehicle("loop", model), {}, drive)
