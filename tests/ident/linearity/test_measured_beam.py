"""Tests on a measured 2x2 response of a beam with two piezo inputs: held-out records are predicted."""

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import loadmat

from eightpost.errors import InputError
from eightpost.ident.vehicle.estimators import LocalPolynomial, estimate_response
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.signals import TimeSeries

FOLDER = os.environ.get("EIGHTPOST_DATA")
pytestmark = pytest.mark.skipif(not FOLDER, reason="EIGHTPOST_DATA does not name the folder of measured records")

RATE, SAMPLES = 1000.0, 120_000
INPUTS, OUTPUTS = ("u1", "u2"), ("y1", "y2")


def beam(name: str) -> TimeSeries:
    """Return a sweep of 120 s with both inputs equal (symexc) or opposite (asymexc) [V], and two accelerations."""
    assert FOLDER is not None
    content = loadmat(Path(FOLDER) / "beam" / f"{name}.mat")
    u, y = content["inputvalues"][:SAMPLES].T, content["outputvalues"][:SAMPLES].T
    units = {**dict.fromkeys(INPUTS, "1"), **dict.fromkeys(OUTPUTS, "m/s2")}
    rows = zip(units.items(), (*u, *y), strict=True)
    return TimeSeries.from_channels(np.arange(SAMPLES) / RATE, {n: (unit, row) for (n, unit), row in rows})


def spectra(record: TimeSeries, names: tuple[str, ...]) -> NDArray[np.complex128]:
    values = record.select(names).values
    return np.asarray(np.fft.rfft(values - values.mean(axis=1, keepdims=True)))


def estimated(*names: str) -> FrequencyResponse:
    recipe = LocalPolynomial(spacing=0.05, high=200.0)
    return estimate_response([beam(name) for name in names], inputs=INPUTS, outputs=OUTPUTS, recipe=recipe)


def errors(response: FrequencyResponse, name: str, repeat: str, band: tuple[float, float]) -> NDArray[np.float64]:
    """Return the relative errors of a record's prediction and of its repetition over a band (2, p) [1]."""
    record = beam(name)
    bins = np.round(response.frequency * SAMPLES / RATE).astype(int)
    inside = (response.frequency >= band[0]) & (response.frequency < band[1])
    measured, again = (spectra(series, OUTPUTS)[:, bins] for series in (record, beam(repeat)))
    predicted = np.einsum("pmk,mk->pk", response.H, spectra(record, INPUTS)[:, bins])
    return np.stack(
        [
            np.linalg.norm((measured - other)[:, inside], axis=1) / np.linalg.norm(measured[:, inside], axis=1)
            for other in (predicted, again)
        ]
    )


@pytest.fixture(scope="module")
def response() -> FrequencyResponse:
    return estimated("symexc_1", "asymexc_1")


@pytest.mark.parametrize("kind", ["symexc", "asymexc"])
def test_the_prediction_error_of_a_held_out_record_is_about_its_repeatability(
    response: FrequencyResponse, kind: str
) -> None:
    predicted, repeated = errors(response, f"{kind}_2", f"{kind}_1", (60.0, 200.0))
    assert (predicted < 0.05).all()
    assert (repeated > 0.015).all()


@pytest.mark.parametrize("kind", ["symexc", "asymexc"])
def test_a_mode_of_four_bins_is_too_narrow_for_the_record(response: FrequencyResponse, kind: str) -> None:
    predicted, repeated = errors(response, f"{kind}_2", f"{kind}_1", (10.0, 12.0))
    assert (predicted > 2.0 * repeated).all()


@pytest.mark.nightly
def test_equal_inputs_cannot_be_separated() -> None:
    with pytest.raises(InputError, match="depend linearly on each other"):
        estimated("symexc_1", "symexc_2")
