"""A law's own parameters stay within the declared bounds, including those that depend on another parameter."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident.shock.dynamics import SteppedLaw, _OwnParameters
from eightpost.ident.shock.force import Limits
from eightpost.shock import FitParameter, Lpnl2, Port, fit_parameters

CHAIN = (
    FitParameter("first", "N", low=1.0, start=2.0, high=90.0, scale="logarithmic"),
    FitParameter("second", "N", low=20.0, start=1.0, high=100.0, scale="logarithmic", above="first", gap=5.0),
    FitParameter("third", "N", low=0.0, start=300.0, high=100.0, scale="linear", above="second", gap=2.0),
)


@pytest.fixture(params=[CHAIN, fit_parameters(Lpnl2)])
def own(request):
    return _OwnParameters(request.param)


def inside(own, count, generator):
    low, high = own.bounds()
    return [*generator.uniform(low, high, (count, low.size)), low, high]


def test_every_theta_of_the_box_keeps_bounds_and_gaps(own):
    assert own.declared
    for theta in inside(own, 200, np.random.default_rng(1)):
        values = dict(zip([p.name for p in own.declared], own.values(theta).tolist(), strict=True))
        for p in own.declared:
            assert p.low * (1.0 - 1e-12) <= values[p.name] <= p.high * (1.0 + 1e-12)
            assert not p.above or values[p.name] - values[p.above] >= p.gap * (1.0 - 1e-9)


def test_values_come_back_from_theta(own):
    for theta in inside(own, 50, np.random.default_rng(2))[:50]:
        np.testing.assert_allclose(own.theta(own.values(theta)), theta, rtol=1e-9, atol=1e-9)


def test_the_jacobian_is_the_central_difference(own):
    low, high = own.bounds()
    for theta in inside(own, 20, np.random.default_rng(3))[:20]:
        found = own.jacobian(theta)
        for i, small in enumerate(1e-6 * (high - low)):
            step = small * np.eye(theta.size)[i]
            expected = (own.values(theta + step) - own.values(theta - step)) / (2.0 * small)
            np.testing.assert_allclose(found[:, i], expected, rtol=1e-5, atol=1e-6 * np.abs(found).max())


def test_a_start_that_breaks_a_gap_is_moved_inside():
    own = _OwnParameters(CHAIN)
    first, second, third = own.values(own.start())
    assert first == pytest.approx(2.0)
    assert second == pytest.approx(20.0)
    assert third == pytest.approx(100.0)


def test_a_parameter_above_an_undeclared_one_is_rejected():
    with pytest.raises(ValueError, match="second is above 'first', which must be declared before it"):
        _OwnParameters(CHAIN[1:])


def test_the_generic_path_makes_no_law_that_refuses_its_parameters(curve):
    dynamics = SteppedLaw(Limits((1e-4, 1e-2), (1.0, 2.0), 1.0), Lpnl2)
    for theta in inside(dynamics.own, 100, np.random.default_rng(4)):
        assert isinstance(dynamics.law(curve, Port(), theta), Lpnl2)
