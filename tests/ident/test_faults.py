"""Injected faults are corrected, reported or rejected; none distorts a fit without a warning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eightpost.errors import InputError
from eightpost.ident import fit_shock
from eightpost.ident.shock.fit import _spikes_of
from eightpost.shock import Lpf1

few = settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)


@pytest.fixture(scope="module")
def record(curve, law_record):
    return law_record(Lpf1(curve, 1.3e-3), 1)


def with_force(test, force):
    return replace(test, series=test.series.with_channel("force", "N", force))


@pytest.mark.nightly
@few
@given(seed=st.integers(0, 10_000), count=st.integers(20, 200), size=st.floats(1500.0, 8000.0))
def test_spikes_are_removed_and_counted(record, seed, count, size):
    generator = np.random.default_rng(seed)
    force = record.series["force"].copy()
    where = generator.choice(np.arange(2500, 19000, 3), count, replace=False)
    force[where] += size * generator.choice([-1.0, 1.0], count)
    fit = fit_shock(with_force(record, force), "lpf1")
    assert fit.downweighted == pytest.approx(count, abs=0.1 * count + 3)
    assert any("spikes" in change for change in fit.changes)
    assert fit.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.01)
    assert fit.shock.fit["weighed_down"] == fit.downweighted


@pytest.mark.nightly
@few
@given(start=st.integers(3000, 17000), length=st.integers(60, 200))
def test_a_dropout_is_downweighted_or_reported(record, start, length):
    force = record.series["force"].copy()
    force[start : start + length] = 5000.0
    fit = fit_shock(with_force(record, force), "lpf1")
    assert fit.downweighted > 0.3 * length
    assert any("outliers" in change for change in fit.changes)
    assert fit.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.03)


@pytest.mark.nightly
@few
@given(seed=st.integers(0, 10_000), share=st.floats(1.0, 4.0))
def test_a_noisy_force_is_reported(record, seed, share):
    noise = np.random.default_rng(seed).standard_normal(len(record.series))
    force = record.series["force"] + share * 10.0 * record.series["force"].std() * noise
    fit = fit_shock(with_force(record, force), "lpf1")
    assert [reason.rule for reason in fit.verdict.decisive] == ["large error"]


@few
@given(start=st.floats(10.6, 50.0), length=st.floats(0.5, 20.0))
def test_a_segment_outside_the_record_is_refused(record, start, length):
    with pytest.raises(InputError, match="must lie within the record"):
        fit_shock(record, "lpf1", segment=(start, start + length))


@pytest.mark.nightly
def test_a_clean_record_loses_nothing_to_robustness(record):
    plain, robust = fit_shock(record, "lpf1", robust="none"), fit_shock(record, "lpf1")
    assert robust.downweighted == 0
    assert robust.shock.law == plain.shock.law


@pytest.mark.nightly
@given(st.lists(st.floats(-5.0, 5.0), min_size=30, max_size=60), st.integers(10, 20), st.floats(200.0, 1e4))
def test_a_lone_spike_is_found_whatever_the_noise(noise, place, size):
    raw = np.array(noise)
    raw[place] += size
    clean, spiked = _spikes_of(raw, np.zeros_like(raw), 100.0)
    assert spiked[place]
    assert abs(clean[place]) <= 10.0
