"""Intervals of a shock that warms or drifts contain its states during the record."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eightpost.ident import fit_shock
from eightpost.ident.shock.runs import prepare_runs
from eightpost.ident.shock.settings import fit_settings
from eightpost.ident.shock.settings_table import SettingsTable
from eightpost.shock import Axis, Lpf1
from tests.ident.dyno_records import curve_of, record_of


def law():
    return Lpf1(curve_of(), 3e-3)


def record(*, loss=0.0, rebound_loss=0.0, kelvin=None, seed=3, noise=4.0):
    """A record whose force falls by a share from start to end, and by a further share in rebound.

    Args:
        loss: Share by which the force falls.
        rebound_loss: Further share by which the rebound force falls.
        kelvin: Rise of the measured temperature; None: it is not measured.
        seed: Seed of motion and noise.
        noise: Standard deviation of the noise [N].
    """

    def factor(series, force):
        share = series.time / series.time[-1]
        return 1.0 - share * np.where(force < 0.0, loss + rebound_loss, loss)

    test = record_of(law(), seed, duration=11.0, noise=noise, factor=factor)
    if kelvin is None:
        return test
    share = test.series.time / test.series.time[-1]
    heat = 320.0 + kelvin * share + 0.1 * np.random.default_rng(seed).standard_normal(share.size)
    return replace(test, series=test.series.with_channel("temperature", "K", heat))


def band(fit, velocity):
    return np.interp(velocity, fit.band.velocity, fit.band.force), np.interp(
        velocity, fit.band.velocity, fit.band.half_width
    )


@pytest.mark.parametrize("kelvin", [None, 6.0])
def test_the_band_contains_the_curves_at_the_beginning_and_at_the_end(kelvin):
    fit = fit_shock(record(loss=0.06, kelvin=kelvin), "lpf1")
    velocity = np.array([-0.4, -0.2, -0.1, 0.1, 0.2, 0.4])
    force, half_width = band(fit, velocity)
    truth = np.array([law().curve.force(float(v)) for v in velocity])
    for share in (1.0 / 11.0, 10.0 / 11.0):  # the ends of the fitted seconds
        assert (np.abs(force - (1.0 - 0.06 * share) * truth) <= half_width).all()
    assert (half_width < 0.06 * np.abs(truth)).all()


def test_a_change_of_rebound_widens_the_band_of_rebound_far_more_than_that_of_compression():
    widths = []
    for change in (0.0, 0.1):
        _, half_width = band(fit_shock(record(rebound_loss=change), "lpf1"), np.array([-0.3, 0.3]))
        widths.append(half_width)
    rebound, compression = widths[1] - widths[0]
    assert rebound > 5.0 * max(compression, widths[0][1])


def test_the_covariate_is_the_temperature_if_it_changes_and_else_the_time():
    warm, constant, unknown = (prepare_runs([record(kelvin=kelvin)]).covariate for kelvin in (6.0, 0.0, None))
    assert np.ptp(warm) == pytest.approx(6.0 * 9.0 / 11.0, rel=0.1)  # of which 9 of 11 s are fitted
    assert np.ptp(constant) == pytest.approx(9.0, rel=0.02)
    assert np.ptp(unknown) == pytest.approx(9.0, rel=0.02)
    assert abs(warm.mean()) < 1e-9 and abs(unknown.mean()) < 1e-9


def test_the_temperature_of_several_runs_is_about_their_common_mean():
    runs = prepare_runs([record(kelvin=2.0), record(kelvin=8.0)])
    ends = np.cumsum([f.rows.size for f in runs.filters])
    first, second = np.split(runs.covariate, ends[:1])
    assert second.mean() - first.mean() == pytest.approx(3.0, abs=0.3)


def at(kelvin, seed):
    test = record_of(law(), seed)
    heat = np.full(len(test.series), kelvin)
    return replace(test, series=test.series.with_channel("temperature", "K", heat))


def test_runs_of_constant_but_different_temperatures_determine_the_preload():
    assert 1.0 < fit_shock([at(302.35, 3), at(320.0, 4)], "polylinear").parameter("gas_preload").error < 50.0


def test_settings_of_different_temperatures_determine_their_preloads():
    axis = Axis("temperature", (302.35, 320.0), 320.0, unit="K")
    files = (Path("cold.csv"), Path("warm.csv"))
    tests = ((at(302.35, 3),), (at(320.0, 4),))
    table = SettingsTable("shock", "polylinear", "estimate", (axis,), ((302.35,), (320.0,)), tests, files)
    assert all(1.0 < fit.parameter("gas_preload").error < 50.0 for fit in fit_settings(table).fits)
