"""The verdict on a run, rule by rule."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.session.verdict import Coupled
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade, Verdict

from .test_kept_runs import sound


def only(verdict: Verdict, rule: str):
    (reason,) = [reason for reason in verdict.reasons if reason.rule == rule]
    return reason


SETTINGS = [
    ({}, {}, {}, []),
    ({"lf": 0.0}, {"lf": 0.0}, {"lf": 0.0}, ["within the settings of a shock"]),
    ({"lf": 0.1}, {"lf": 0.0}, {"lf": 0.0}, ["beyond the settings of a shock"]),
    ({"lf": 1.0}, {"lf": 1.0}, {"lf": 0.0}, ["far beyond the settings of a shock"]),
    ({"lf": 0.0}, {"lf": 0.0}, {"lf": 1.0}, ["untested settings of a shock"]),
    ({"lf": 1.0}, {"lf": 0.0}, {"lf": 1.0}, ["untested settings of a shock", "beyond the settings of a shock"]),
]


@pytest.mark.parametrize(("beyond", "far", "untested", "expected"), SETTINGS)
def test_a_shock_at_settings_that_were_not_measured_is_a_reason(beyond, far, untested, expected):
    shares = {"share_beyond_settings": beyond, "share_far_beyond_settings": far, "share_untested_settings": untested}
    reasons = sound(**shares).verdict.about("settings of the shocks").reasons
    assert [reason.rule for reason in reasons] == expected
    assert all(reason.origin == "component lf" for reason in reasons)


def test_a_large_local_error_makes_a_run_not_usable_even_if_the_stated_error_is_small():
    """Two runs that oscillate from step to step can agree at the recorded points."""
    chatter = sound(coupled={"lf": Coupled(1.4, 0.5, 1.0, 800.0, 0.5, 800.0)}, stated_error={"car.velocity": 1e-3})
    assert chatter.verdict.grade is Grade.NOT_USABLE
    assert not chatter.acceptable
    assert "280 %" in only(chatter.verdict, "local error of a bond").figure


def test_the_energy_beyond_the_fitted_velocities_is_limited_like_the_time():
    """A shock that is beyond its fitted range for a short time, but dissipates most of its energy then."""
    time = np.linspace(0.0, 10.0, 1001)
    beyond = (time > 9.9).astype(float)
    series = TimeSeries.from_channels(
        time, {"lf.beyond_fit": ("1", beyond), "lf.dissipated_power": ("W", 1.0 + 1e4 * beyond)}
    )
    reason = only(sound(series=series, share_beyond_fit={"lf": 0.01}).verdict, "mostly outside the fitted velocities")
    assert "99.0% of its energy" in reason.figure
