"""Order and shape of the curve follow the record and the options, and several runs share one curve."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.ident import fit_shock
from eightpost.ident.shock.curve import curve_forces
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Lpf1, Port, lpf1
from eightpost.signals import lowpass


def forces(fit):
    curve = fit.shock.law.curve
    velocity = np.linspace(-curve.rebound_speed, curve.compression_speed, 401)
    return velocity, curve_forces(curve, velocity)


@pytest.fixture(scope="module")
def falling(law_record, curve):
    """A shock whose force falls about 0.2 m/s, and pushes with the motion about 0.02 m/s."""
    test = law_record(Lpf1(curve, 1.3e-3), 1)
    v = test.series["velocity"]
    bent = (
        test.series["force"] - 900.0 * np.exp(-(((v - 0.25) / 0.06) ** 2)) - 150.0 * np.exp(-(((v - 0.02) / 0.03) ** 2))
    )
    return DynoTest(test.series.with_channel("force", "N", bent))


def test_a_monotone_curve_does_not_fall(falling):
    _, force = forces(fit_shock(falling, "lpf1", shape="monotone"))
    assert np.diff(force).min() > -1e-6 * np.ptp(force)


def test_a_passive_curve_never_pushes_with_the_motion(falling):
    velocity, force = forces(fit_shock(falling, "lpf1", shape="passive"))
    assert (force * velocity >= -1e-6 * np.ptp(force)).all()
    assert np.diff(force).min() < 0.0


def test_a_free_curve_that_falls_is_reported(falling):
    fit = fit_shock(falling, "lpf1", shape="free")
    assert any("not monotone" in warning for warning in fit.warnings)


def test_a_noisy_record_gets_no_higher_order_than_it_determines(curve, law_record):
    test = law_record(Lpf1(curve, 1.3e-3), 1)
    noise = lowpass(np.random.default_rng(5).standard_normal(len(test.series)), 2000.0, 8.0)
    force = test.series["force"] + 20.0 * noise / noise.std()
    fit = fit_shock(DynoTest(test.series.with_channel("force", "N", force)), "lpf1", curve="polynomial")
    assert any("cross-validation" in change for change in fit.changes)
    assert fit.shock.law.curve.inner[4] != 0.0  # the truth ends at v^5
    assert fit.shock.law.curve.inner[13:] == (0.0, 0.0)


def test_an_order_can_be_requested(curve, law_record):
    fit = fit_shock(law_record(Lpf1(curve, 1.3e-3), 1), "lpf1", order=9)
    assert fit.shock.law.curve.inner[9:] == (0.0,) * 6
    with pytest.raises(ParameterError, match="1 to 15, not 16"):
        fit_shock(law_record(Lpf1(curve, 1.3e-3), 1), "lpf1", order=16)


@pytest.mark.nightly
def test_runs_share_the_curve_and_keep_their_gas_offsets(curve, law_record):
    runs = [law_record(Lpf1(curve, 1.3e-3, port=Port(gas_preload=p, gas_stiffness=700.0)), 1) for p in (100.0, 200.0)]
    fit = fit_shock(runs, "lpf1")
    assert fit.percent < 0.2
    assert fit.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.01)
    assert fit.parameter("gas_preload").value == pytest.approx(150.0, abs=5.0)
    assert fit.shock.fit["runs"] == 2
    assert len(fit.measured) == len(fit.predicted) == 2 * 18001


@pytest.mark.nightly
def test_a_law_known_by_its_file_alone_is_fitted(curve, law_record, monkeypatch):
    monkeypatch.delattr(lpf1, "FIT_FORM")
    fit = fit_shock(law_record(Lpf1(curve, 1.3e-3), 1), "lpf1", curve="polynomial")
    low, high = fit.parameter("time_constant").interval
    assert fit.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.01)
    assert low < high
    assert fit.percent < 0.2
