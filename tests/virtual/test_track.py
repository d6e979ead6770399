"""The track has the spectra of Table 6.3, one road under both axles, and starts at rest."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import csd, welch

from eightpost.corners import CORNERS
from eightpost.units import convert
from eightpost.virtual.drivefiles import AEROLOADER, WHEELLOADER, Track, track_drivefile

TRACK = Track()
SEGMENT = 800  # 4 s: lines every 0.25 Hz


@pytest.fixture(scope="module")
def long():
    return track_drivefile(1, duration=600.0, rate=200.0).series


@pytest.fixture(scope="module")
def short():
    return track_drivefile(2).series


@pytest.mark.parametrize("corner", CORNERS)
def test_the_road_has_the_wheelloader_spectrum(long, corner):
    frequency, power = welch(long[f"{corner}.road"], 200.0, nperseg=SEGMENT)
    band = (frequency >= 0.5) & (frequency <= 20.0)
    shape = np.interp(frequency[band], *np.array(WHEELLOADER).T)
    relative = np.sqrt(power[band]) / shape
    np.testing.assert_allclose(relative / np.median(relative), 1.0, atol=0.2)
    assert np.sqrt(power[frequency > 31.0]).max() < 0.01 * np.sqrt(power[frequency == 1.0])[0]


@pytest.mark.parametrize("load", ["heave_force", "roll_moment", "pitch_moment"])
def test_the_loads_have_the_aeroloader_spectrum(long, load):
    frequency, power = welch(long[load], 200.0, nperseg=5 * SEGMENT)
    amplitude = np.sqrt(power / np.mean(power[(frequency > 0.5) & (frequency < 2.6)]))
    for middle in (1.5, 3.5, 4.5):
        band = np.abs(frequency - middle) < 0.3
        expected = np.interp(frequency[band], *np.array(AEROLOADER).T)
        assert np.mean(amplitude[band]) == pytest.approx(np.mean(expected), rel=0.15)
    assert amplitude[frequency > 6.0].max() < 0.01


def test_left_and_right_are_coherent_only_at_long_wavelengths(long):
    left, right = long["lf.road"], long["rf.road"]
    frequency, cross = csd(left, right, 200.0, nperseg=SEGMENT)
    powers = [welch(side, 200.0, nperseg=SEGMENT)[1] for side in (left, right)]
    coherence = np.real(cross) / np.sqrt(powers[0] * powers[1])
    band = (frequency > 0.5) & (frequency < 20.0)
    np.testing.assert_allclose(coherence[band], TRACK.likeness(frequency[band]), atol=0.25)
    assert coherence[frequency == 1.0][0] > 0.75
    assert coherence[(frequency > 18.0) & (frequency < 20.0)].mean() < 0.35


@pytest.mark.parametrize("side", ["l", "r"])
def test_the_rear_axle_follows_the_front_axles_road_with_the_delay_of_the_wheelbase(short, side):
    assert TRACK.delay == pytest.approx(110 * 0.0254 / 45.0)
    front = CubicSpline(short.time, short[f"{side}f.road"])
    later = short.time > 1.0 + TRACK.delay
    expected = front(short.time[later] - TRACK.delay)
    np.testing.assert_allclose(short[f"{side}r.road"][later], expected, atol=1e-3 * TRACK.road_peak)


def test_peaks_and_means_are_those_of_the_dissertation(long, short):
    roads = short.values[:4]
    assert np.abs(roads).max() == pytest.approx(convert(0.4, "in", "m"))
    # 6.1.3: a peak of 0.4 in gives about 0.11 in RMS.
    assert convert(float(long["lf.road"].std()), "m", "in") == pytest.approx(0.11, abs=0.03)
    heave = convert(long["heave_force"], "N", "lbf")
    assert heave.mean() == pytest.approx(-1000.0, rel=0.05)
    assert heave.std() == pytest.approx(160.0, rel=0.02)


def test_the_track_starts_smoothly_from_its_mean(short):
    np.testing.assert_allclose(short.values[:4, 0], 0.0)
    np.testing.assert_allclose(short.values[4:, 0], [-TRACK.downforce, 0.0, 0.0])
    np.testing.assert_allclose(np.diff(short.values[:4, :2]), 0.0, atol=1e-4 * TRACK.road_peak)


def test_a_seed_is_reproducible_and_a_low_sample_rate_is_refused(short):
    np.testing.assert_array_equal(track_drivefile(2).series.values, short.values)
    assert not np.allclose(track_drivefile(3).series.values, short.values)
    with pytest.raises(ValueError, match="above 60 Hz"):
        track_drivefile(1, rate=60.0)
    assert track_drivefile(1, duration=2.0, rate=61.0).series.sample_rate == pytest.approx(61.0)
