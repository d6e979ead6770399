"""Upper end of the band that rig tests support."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.experiment import CoherentBand
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.vehicle import Channel

FREQUENCY = np.arange(0.1, 32.0, 0.1)
INPUTS = (Channel("road", "m"), Channel("aero_force", "N"), Channel("force", "N"))
BAND = CoherentBand(margin=0.0)


def response(limits, *, powered=32.0):
    """Return a response of outputs that are coherent up to `limits` [Hz], with roads that have power up to `powered`.

    The aerodynamic force has no power above 5 Hz, as on rigs.
    """
    outputs = tuple(Channel(f"output {k}", "N") for k in range(len(limits)))
    coherence = np.array([np.where(limit >= FREQUENCY, 0.99, 0.3) for limit in limits])
    shape = (len(limits), len(INPUTS), FREQUENCY.size)
    variance = np.ones(shape)
    variance[:, 1, FREQUENCY > 5.0] = np.inf
    variance[:, 0, powered < FREQUENCY] = np.inf
    return FrequencyResponse(FREQUENCY, np.ones(shape), INPUTS, outputs, coherence, None, variance)


@given(st.floats(7.0, 29.0))
def test_the_band_ends_where_the_coherence_does(limit):
    assert BAND.of(response([limit] * 3)).high == pytest.approx(limit, abs=0.3)


@given(st.lists(st.floats(7.0, 29.0), min_size=1, max_size=12))
def test_three_quarters_of_the_outputs_are_supported_up_to_the_end(limits):
    found = BAND.of(response(limits))
    assert np.mean(np.array(limits) >= found.high - 0.3) >= 0.75
    assert all(found.outputs[f"output {k}"] == pytest.approx(limit, abs=0.3) for k, limit in enumerate(limits))


def test_a_noisy_output_does_not_end_the_band_and_is_named():
    found = BAND.of(response([25.0, 25.0, 25.0, 9.0]))
    assert found.high == pytest.approx(25.0, abs=0.3)
    assert "output 3 9" in found.summary()
    assert "stays below 0.9" in found.summary()


def test_the_band_ends_where_a_road_has_no_power_although_the_coherence_is_good():
    found = BAND.of(response([32.0] * 3, powered=14.0))
    assert found.high == pytest.approx(14.0, abs=0.11)
    assert "no power" in found.summary()


def test_a_narrow_dip_as_at_an_antiresonance_does_not_end_the_band():
    whole = response([28.0] * 3)
    coherence = np.array(whole.coherence)
    coherence[:, (FREQUENCY > 12.0) & (FREQUENCY < 13.5)] = 0.1
    dipped = FrequencyResponse(FREQUENCY, whole.H, INPUTS, whole.outputs, coherence, None, whole.variance)
    assert BAND.of(dipped).high == pytest.approx(28.0, abs=0.3)


def test_the_margin_is_left_out_of_the_fit_and_both_ends_are_stated():
    found = CoherentBand(margin=0.2).of(response([20.0] * 3))
    assert found.high == pytest.approx(16.0, abs=0.3)
    assert found.supported == pytest.approx(20.0, abs=0.3)
    assert "up to 16.1 Hz" in found.summary()
    assert "up to 20" in found.summary()


def test_records_without_coherence_are_examined_up_to_the_highest_frequency_or_their_power():
    bare = FrequencyResponse(FREQUENCY, np.ones((1, 3, FREQUENCY.size)), INPUTS, (Channel("y", "m"),))
    assert BAND.of(bare).high == pytest.approx(30.0)
    assert "highest frequency" in BAND.of(bare).summary()


def test_a_coherence_above_one_is_refused():
    with pytest.raises(ParameterError, match="between 0 and 1"):
        CoherentBand(coherence=1.2)
