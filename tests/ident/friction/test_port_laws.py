"""Tests of the forces of bristles and port springs in a record."""

import numpy as np
import pytest

from eightpost.ident.vehicle.simulation import bristle_force, direction, with_port_laws
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction
from eightpost.vehicle.compiled import deflections

RATE, LAW = 500.0, Bristle(80.0, 1e-4, 1.15, 0.01)
TIME = np.arange(0.0, 20.0, 1.0 / RATE)
VELOCITY = 0.05 * np.sin(2 * np.pi * 1.3 * TIME) + 0.03 * np.sin(2 * np.pi * 9.7 * TIME)


def record():
    displacement = np.concatenate(([0.0], np.cumsum(0.5 * (VELOCITY[1:] + VELOCITY[:-1])) / RATE))
    channels = {"force": ("N", 300.0 * VELOCITY), "velocity": ("m/s", VELOCITY), "displacement": ("m", displacement)}
    return TimeSeries.from_channels(TIME, channels)


def test_the_signal_is_that_of_a_fine_simulation_below_half_the_rate():
    fine = np.arange(TIME.size * 40) / (40.0 * RATE)
    velocity = 0.05 * np.sin(2 * np.pi * 1.3 * fine) + 0.03 * np.sin(2 * np.pi * 9.7 * fine)
    exact = np.fft.rfft(LAW.force_at(deflections(velocity, 1.0 / (40.0 * RATE), LAW)))[: TIME.size // 2] / 40.0
    found = np.fft.rfft(bristle_force(VELOCITY, RATE, LAW))[: TIME.size // 2]
    band = slice(0, TIME.size // 10)  # 50 Hz
    assert np.linalg.norm(found[band] - exact[band]) < 2e-3 * np.linalg.norm(exact[band])


def test_a_bristle_of_another_force_has_a_signal_in_proportion():
    np.testing.assert_allclose(
        bristle_force(VELOCITY, RATE, LAW), 80.0 * bristle_force(VELOCITY, RATE, Bristle(1.0, 1e-4, 1.15)), rtol=1e-12
    )


def test_friction_bristle_and_spring_are_added_to_the_shock_force():
    series, law = record(), Friction(20.0, 0.01, LAW, 1e5)
    creeping, sticking = 20.0 * direction(VELOCITY, RATE, 0.01), bristle_force(VELOCITY, RATE, LAW)
    expected = series["force"] + creeping + sticking + 1e5 * series["displacement"] ** 2
    np.testing.assert_array_equal(with_port_laws(series, {"": law})["force"], expected)


@pytest.mark.parametrize("rate", [2500.0, 4000.0])
def test_a_fast_record_is_not_resampled(rate):
    v = VELOCITY[:4000]
    np.testing.assert_array_equal(bristle_force(v, rate, LAW), LAW.force_at(deflections(v, 1.0 / rate, LAW)))
