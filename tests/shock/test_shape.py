"""Shapes: curves that rise, fits that find them again, and steeper sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from eightpost.errors import ParameterError
from eightpost.shock import Hysteresis, Lpnl2, Polylinear, read_shock
from eightpost.shock import shape as shapes
from eightpost.shock.curve import KNOTS
from eightpost.shock.shape import (
    BOUNDS,
    CURVE_NUMBERS,
    SIDES,
    UNITS,
    Shape,
    Side,
    curve_parameters,
    difference,
    fit_force,
    fit_law,
    range_of,
    unit_of,
    with_slope,
)

BANK = sorted((Path(__file__).resolve().parents[2] / "examples" / "bank").glob("*.json"))


def rises(curve):
    """Return whether the force rises at 500 steps on each side of the fitted range, and beyond it."""
    ends = -1.01 * curve.rebound_speed, 0.0, 1.01 * curve.compression_speed
    speeds = np.interp(np.linspace(0.0, 2.0, 1001), [0.0, 1.0, 2.0], ends)
    return bool(np.diff([curve.force(v) for v in speeds.tolist()]).min() > 0.0)


#: Any side within the bounds of a fit.
ANY = st.builds(Side, **{name: st.floats(*ends) for name, ends in BOUNDS.items()})


@given(ANY, ANY)
@example(Side(4e3, 3e3, 0.1, 1e3, 0.0), Side(4e3, 3e3, 0.02, 50.0, 0.0))
def test_the_force_of_every_shape_rises_through_zero_and_takes_energy(compression, rebound):
    curve = Shape(compression, rebound).curve()
    assert rises(curve) and curve.force(0.0) == 0.0
    assert all(curve.force(v) * v > 0.0 for v in (-2.0, -0.3, -1e-3, 1e-3, 0.3, 2.0))


def misfit(compression, rebound):
    """Return the relative residual of the fit to a shape."""
    return fit_law(Polylinear(Shape(compression, rebound).curve())).relative


@pytest.mark.parametrize(
    ("compression", "rebound"),
    [
        (Side(2e3, 1500.0, 0.3, 200.0, 200.0), Side(8e3, 1500.0, 0.05, 200.0, 200.0)),  # they share the slope at rest
        (Side(8e3, 1500.0, 0.3, 200.0, 200.0), Side(5806.0, 1500.0, 0.25, 200.0, 200.0)),  # several local minima
    ],
)
def test_curves_that_mislead_a_fit_are_found_again(compression, rebound):
    assert misfit(compression, rebound) < 2e-4


@pytest.mark.parametrize("knee", [0.02, 0.1, 0.5])
def test_the_slope_changes_with_the_knee_as_its_difference_quotient(knee):
    higher, lower = (shapes._slope_weights(shapes._KNOTS, knee * np.exp(change)) for change in (1e-5, -1e-5))
    assert shapes._knee_weights(knee) == pytest.approx((higher - lower) / 2e-5, abs=1e-8)


def test_a_search_starts_at_every_pair_of_knees_that_no_neighbour_is_better_than(monkeypatch):
    count = shapes._KNEES.size
    errors = np.random.default_rng(2).uniform(1.0, 2.0, (count, count))
    given_errors = iter(errors.ravel())
    monkeypatch.setattr(shapes, "nnls", lambda *_: (np.ones(8), next(given_errors)))
    found = shapes._Problem(np.zeros((2, 2 * shapes._KNOTS.size)), np.zeros(2))._starts()
    best = [
        (i, j)
        for i, j in np.ndindex(count, count)
        if errors[i, j] == errors[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].min()
    ]
    knees = np.exp([start[shapes._KNEE] for start in found])
    assert len(found) == len(best) > 3
    np.testing.assert_allclose(knees, shapes._KNEES[np.array(best)])


@pytest.mark.nightly
def test_the_curves_of_600_extreme_shapes_are_found_again():
    rng, bounds = np.random.default_rng(600), np.log([BOUNDS[name] for name in UNITS])
    at = rng.random((600, len(SIDES), len(UNITS)))
    at = np.where(rng.random(at.shape) < 0.7, np.round(at), at)  # most numbers at an end of their bounds
    errors = []
    for sides in np.exp(bounds[:, 0] + at * np.diff(bounds, axis=1)[:, 0]).tolist():
        errors.append(misfit(*(Side(*numbers) for numbers in sides)))
    assert max(errors) < 5e-4 and np.median(errors) < 2e-4


@pytest.mark.parametrize("path", BANK[::3], ids=lambda path: path.stem)
def test_the_curves_of_the_shipped_bank_are_shapes_within_a_percent(path):
    law = read_shock(path).law
    found = fit_law(law)
    assert found.relative < 0.01
    assert found.shape.lag == law.time_constant and found.shape.lag_force == law.lag_zero_force
    assert difference(found.shape, law.curve.force, 1.0)[1] < 0.01


def test_a_law_with_other_dynamics_than_one_lag_keeps_the_lag_of_a_shape():
    curve = Shape(Side(4e3, 3e3, 0.1, 1e3, 500.0), Side(5e3, 4e3, 0.2, 2e3, 600.0)).curve()
    law = Hysteresis(curve, (500.0,) * KNOTS, (1e-3, 2e-3, 3e-3), stop_stiffness=1e5, stop_yield=1e-4, stop_time=1e-3)
    assert fit_law(law).shape == fit_law(Polylinear(curve)).shape and fit_law(law).shape.lag == 1e-3


def test_the_parameters_of_an_fmu_are_those_of_the_law():
    shape = fit_law(read_shock(BANK[0]).law).shape
    law, parameters = shape.law(), shape.parameters()
    assert isinstance(law, Lpnl2) and parameters["time_constant"] == law.time_constant
    for name, value in curve_parameters(law.curve, ("knot_force", "knot_slope")).items():
        assert parameters[name] == value
    # The velocities of the knots are not among them: they must be those of every shape.
    assert law.curve.knot_velocity == shape.with_numbers({"rebound.knee": 0.05}).curve().knot_velocity


def test_numbers_are_read_and_changed_by_name():
    shape = Shape(Side(4e3, 3e3, 0.1, 1e3, 500.0), Side(5e3, 4e3, 0.2, 2e3, 600.0))
    assert shape.with_numbers(shape.numbers()) == shape
    assert shape.with_numbers({"rebound.low": 1e3}).rebound.low == 1e3
    assert set(CURVE_NUMBERS) < set(shape.numbers())
    with pytest.raises(ParameterError, match=r"no number 'rebound\.bump'"):
        shape.with_numbers({"rebound.bump": 1.0})
    with pytest.raises(ParameterError, match="knee must be positive, not -1"):
        shape.with_numbers({"rebound.knee": -1.0})
    with pytest.raises(ParameterError, match=r"lag is 0\.001 s in all shocks"):
        range_of([shape, shape], "lag")


@pytest.mark.parametrize("path", BANK[:2], ids=lambda path: path.stem)
@pytest.mark.parametrize("side", ["compression", "rebound"])
def test_a_steeper_side_changes_that_side_at_the_speeds_that_are_named(path, side):
    curve, sign = read_shock(path).law.curve, 1.0 if side == "compression" else -1.0
    same, low = with_slope(curve, side, 0.1, "low")
    _, high = with_slope(curve, side, 0.1, "high")
    _, both = with_slope(curve, side, 0.1, "all")
    own, other = sign * np.array([0.02, 0.4, 1.0]), -sign * np.array([0.02, 0.4, 1.0])
    for v in same.knot_velocity:
        assert same.force(v) == pytest.approx(curve.force(v), rel=1e-9, abs=1e-9)
    for v in other:
        assert low.force(v) == pytest.approx(same.force(v), rel=1e-12)
        assert high.force(v) == pytest.approx(same.force(v), rel=1e-12)
    slow, _, _ = own
    assert low.force(slow) / same.force(slow) == pytest.approx(1.1, abs=0.01)
    assert high.force(slow) / same.force(slow) == pytest.approx(1.0, abs=0.01)
    for v in own:
        assert both.force(v) == pytest.approx(1.1 * same.force(v), rel=1e-9)
        parts = low.force(v) + high.force(v) - same.force(v)
        assert parts == pytest.approx(both.force(v), rel=1e-3)
    assert rises(low) or not rises(curve)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"lag": 0.0}, "lag must be positive, not 0.0"), ({"lag_force": -1.0}, "lag_force must be positive"),
     ({"lag_force": 1e-3}, "lag_force must be above"), ({"gas": np.inf}, "gas must be finite, not inf")],
)  # fmt: skip
def test_a_number_of_a_shape_out_of_range_is_named(change, message):
    side = Side(2000.0, 2000.0, 0.1, 1000.0, 10.0)
    with pytest.raises(ParameterError, match=message):
        Shape(side, side, **change)


def test_a_change_of_no_side_or_of_the_whole_slope_is_refused():
    curve = read_shock(BANK[0]).law.curve
    for side, speeds in (("bump", "low"), ("rebound", "medium")):
        with pytest.raises(ParameterError, match=f"not {side}, {speeds}"):
            with_slope(curve, side, 0.1, speeds)
    with pytest.raises(ParameterError, match="cannot change by -1: nothing would be left"):
        with_slope(curve, "rebound", -1.0, "all")


SPEEDS = np.concatenate([-np.geomspace(1.5, 1e-3, 12), [0.0], np.geomspace(1e-3, 1.5, 12)])


def test_shapes_of_the_shipped_bank(unchanged):
    fits = [fit_law(read_shock(path).law) for path in BANK[:3]]
    shapes = [fit.shape for fit in fits]
    numbers = shapes[0].numbers()
    unchanged({
        "fits": [{**fit.shape.numbers(), "relative": fit.relative} for fit in fits],
        "law": np.array(shapes[0].law().curve.knot_force), "parameters": len(shapes[0].parameters()),
        "difference": difference(shapes[0], shapes[1].curve().force),
        "units": {name: unit_of(name) for name in numbers},
        "ranges": {name: range_of(shapes, name) for name in numbers if name.startswith("rebound")},
        "asymmetric": fit_force(lambda v: 2e3 * np.tanh(v / 0.1) + (500.0 * v if v > 0.0 else 900.0 * v), 0.8, 0.6),
    }, relative=1e-3)  # fmt: skip


@pytest.mark.parametrize("speeds", ["low", "high", "all"])
def test_a_steeper_side(speeds, unchanged):
    curve = read_shock(BANK[0]).law.curve
    unchanged([np.array([one.force(v) for v in SPEEDS.tolist()]) for side in ("compression", "rebound")
               for one in with_slope(curve, side, 0.2, speeds)])  # fmt: skip
