"""Odd records end in a message, not in a traceback."""

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.ident import fit_shock
from eightpost.ident.shock.dynamics import NoLag
from eightpost.ident.shock.force import limits_for
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Lpf1, Port, StaticCurve
from eightpost.signals import TimeSeries


def slow_test() -> DynoTest:
    """Return a record at 1 Hz, as of a file with ms labelled s."""
    t = np.arange(1500.0)
    x, v = 0.02 * np.sin(0.02 * t), 4e-4 * np.cos(0.02 * t)
    channels = {"displacement": ("m", x), "velocity": ("m/s", v), "force": ("N", 100.0 + 1e6 * v)}
    return DynoTest(TimeSeries.from_channels(t, channels))


@pytest.mark.parametrize(
    ("law", "recipe"), [("lpf1", "joint"), ("lpnl2", "joint"), ("lpf1", "boggs"), ("lpnl2", "boggs")]
)
def test_a_record_that_is_too_slow_for_a_lag_is_refused_with_advice(law, recipe):
    with pytest.raises(ParameterError, match=r"sampled at 1 Hz.*If time is in ms but labelled s"):
        fit_shock(slow_test(), law, recipe=recipe, segment=(20.0, 1400.0))


class WithoutLag(NoLag):
    """Dynamics that give the law a time constant of zero."""

    def values(self, theta):
        return np.array([0.0])


def test_parameters_that_their_law_refuses_end_in_advice():
    outer = (100.0, 50.0, 0.0, 0.0), (-100.0, -50.0, 0.0, 0.0)
    curve = StaticCurve((100.0, *[0.0] * 14), *outer, 0.1, 0.01, 0.5, 0.5, 100.0, 100.0)
    dynamics = WithoutLag(limits_for(np.array([-100.0, 100.0]), 1000.0), Lpf1)
    with pytest.raises(ParameterError, match=r"is not valid: time_constant must be positive.*--segment"):
        dynamics.law(curve, Port(), np.empty(0))
