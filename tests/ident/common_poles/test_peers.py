"""Comparison with other packages: vector fitting of scikit-rf, and a response estimated by pyFRF."""

import warnings

import numpy as np
import pytest

from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of

from .conftest import FREQUENCY


def test_vector_fitting_finds_the_same_poles(quarter_car):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        skrf = pytest.importorskip("skrf", reason="scikit-rf is not installed")
        fitting = pytest.importorskip("skrf.vectorFitting", reason="this scikit-rf has no vector fitting")
    response = response_of(quarter_car, FREQUENCY).select(inputs=["road", "force"], outputs=["velocity", "tire_force"])
    scale = np.abs(response.H).max(axis=2)
    network = skrf.Network(f=FREQUENCY, f_unit="Hz", s=(response.H / scale[:, :, None]).transpose(2, 0, 1), z0=1.0)
    peer = fitting.VectorFitting(network)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        peer.vector_fit(n_poles_real=0, n_poles_cmplx=2, fit_constant=True, fit_proportional=False)
    poles = CommonPoleFit(high=19.9).fit(response).model.poles()
    expected = np.sort_complex(np.asarray(peer.poles))
    np.testing.assert_allclose(np.sort_complex(poles[poles.imag > 0.0]), expected, rtol=1e-5)


def test_the_fit_of_a_response_estimated_by_pyfrf_has_the_modes_of_the_car(quarter_car):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pyfrf = pytest.importorskip("pyFRF", reason="pyFRF is not installed")
    rate, samples = 100, 2**16
    generator = np.random.default_rng(5)
    lines = np.fft.rfftfreq(samples, 1.0 / rate)
    spectrum = np.exp(2j * np.pi * generator.random(lines.size)) * (lines > 0.0)
    road = np.fft.irfft(spectrum)  # periodic: its response has no leakage
    answers = quarter_car.select(inputs=["road"]).frequency_response(lines)[:, 0]
    outputs = np.fft.irfft(answers * spectrum, axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        peer = pyfrf.FRF(rate, exc=road[None, None], resp=outputs[None], exc_type="d", resp_type="d", window="none")
        H = np.asarray(peer.get_H1()).reshape(len(outputs), -1)
    frequency = np.asarray(peer.get_f_axis())
    kept = (frequency > 0.1) & (frequency < 20.0)
    chosen = np.flatnonzero(kept)[::64]
    response = FrequencyResponse(
        frequency[chosen], H[:, None, chosen], quarter_car.select(inputs=["road"]).inputs, quarter_car.outputs
    )
    found = CommonPoleFit(high=19.9, order=4).fit(response)
    np.testing.assert_allclose(np.array(found.model.modes()), np.array(quarter_car.modes()), rtol=1e-4)
