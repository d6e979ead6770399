"""Deviations and warnings of a fit, against their definitions and at their bounds."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import t as student

from eightpost.ident.shock.problem import blocks_of, covariances, curve_band, quantile
from eightpost.ident.vehicle.common_poles import (
    correlated_noise,
    correlation_length,
    response_deviation,
    spread,
    unmodelled,
)
from eightpost.ident.vehicle.experiment import Ranges, ranges_of
from eightpost.ident.vehicle.trust import ForceEstimate
from eightpost.least_squares import Directions, standard_error
from eightpost.signals import TimeSeries
from eightpost.vehicle import Channel, StateSpace

# ---- Covariance of a shock's parameters ----------------------------------------------------------


def runs_of(rows, rate=100.0):
    """Records of so many rows each, whose blocks are as long as is asked, and in which nothing changes slowly."""

    def blocks(length):
        size = round(length * rate)
        starts = np.concatenate([[0], np.cumsum(rows)])
        return [slice(k, min(k + size, stop)) for start, stop in pairwise(starts) for k in range(start, stop, size)]

    still = np.zeros(sum(rows))
    return SimpleNamespace(
        filters=[SimpleNamespace(rows=np.arange(n), row_rate=rate) for n in rows], blocks=blocks,
        weights=np.ones(sum(rows)), covariate=still, target=still, row_velocity=still,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("rows", "length", "count"), [((6000,), 30, 200), ((3000, 3000), 30, 200), ((400,), 20, 20), ((100, 100), 10, 20)]
)
def test_blocks_last_three_tenths_of_a_second_and_are_at_least_twenty(rows, length, count):
    blocks = blocks_of(runs_of(rows))
    assert {block.stop - block.start for block in blocks} == {length}
    assert len(blocks) == count
    assert quantile(runs_of(rows)) == pytest.approx(student.ppf(0.975, count - 1), rel=1e-12)


def test_half_widths_count_the_change_of_a_fit_without_each_penalty():
    """Every fit is repeated without one of two penalties."""
    generator = np.random.default_rng(4)
    jacobian = np.vstack([generator.standard_normal((600, 3)), [[5.0, 0.0, 0.0], [0.0, 4.0, -4.0], [0.0, 0.0, 0.0]]])
    y = np.append(jacobian[:600] @ np.array([3.0, -2.0, 1.0]) + generator.standard_normal(600), np.zeros(3))
    runs, solution = runs_of((600,)), np.linalg.lstsq(jacobian, y, rcond=None)[0]
    error = jacobian @ solution - y
    directions = Directions.of(jacobian)
    found = covariances(directions, error[:600], runs, (error[600:601], error[601:602]))
    without = [np.linalg.lstsq(np.delete(jacobian, k, 0), np.delete(y, k), rcond=None)[0] for k in (600, 601)]
    bias = (np.array(without) - solution) / quantile(runs)
    difference = found - covariances(directions, error[:600], runs)
    np.testing.assert_allclose(difference, [bias.T @ bias] * 3, rtol=1e-6, atol=1e-12)
    assert np.abs(bias).max() > 1e-3


def test_a_band_has_the_deviation_of_the_sum_that_the_curve_is():
    columns, b = np.array([[1.0, 0.0], [1.0, 2.0], [0.0, 3.0]]), np.array([10.0, -1.0])
    band = curve_band(columns, columns, b, np.array([[4.0, -1.0], [-1.0, 9.0]]), np.array([0.0, 0.1, 0.2]), 2.0)
    assert band.force.tolist() == [10.0, 8.0, -3.0]
    assert band.half_width == pytest.approx([4.0, 2.0 * 36.0**0.5, 18.0], rel=1e-14)
    # A variance that is negative by rounding counts as zero.
    exact = curve_band(columns, columns, b, -1e-20 * np.eye(2), band.velocity, 2.0)
    assert exact.half_width.tolist() == [0.0, 0.0, 0.0]


def test_the_factor_of_a_side_has_the_deviation_of_its_own_estimates():
    """Factors are fitted to drawn curves by least squares; their scatter is the stated one."""
    generator = np.random.default_rng(5)
    velocity = generator.uniform(-0.5, 0.5, 400)
    samples = np.column_stack([np.maximum(velocity, 0.0), np.minimum(velocity, 0.0), velocity**3])
    b, root = np.array([900.0, 1400.0, 300.0]), generator.normal(size=(3, 3)) * 20.0
    covariance = root @ root.T
    band = curve_band(samples[:2], samples, b, covariance, velocity[:2], 2.0)
    drawn = samples @ (b + generator.standard_normal((4000, 3)) @ root.T).T
    for side, factor in ((velocity > 0.0, band.factors[0]), (velocity < 0.0, band.factors[1])):
        force = samples[side] @ b
        estimates = [np.linalg.lstsq(force[:, None], one[side], rcond=None)[0][0] for one in drawn.T]
        assert factor == pytest.approx(2.0 * np.std(estimates), rel=0.05)


def test_errors_that_are_independent_over_velocity_cancel_in_the_factor_and_common_ones_do_not():
    samples = np.eye(50)
    b = np.linspace(1.0, 2.0, 50)
    one = curve_band(samples, samples, b, 0.01 * np.outer(b, b), b, 1.0)
    own = curve_band(samples, samples, b, 0.01 * np.diag(b**2), b, 1.0)
    np.testing.assert_allclose(one.half_width, own.half_width)  # the bands are the same
    assert one.factors[0] == pytest.approx(0.1)
    assert own.factors[0] == pytest.approx(0.1 * np.sqrt(np.sum(b**4)) / np.sum(b**2))
    assert own.factors[0] < 0.2 * one.factors[0]
    assert np.isnan(one.factors[1])  # no sample in rebound


def gain(value):
    return StateSpace(
        np.array([[-1.0]]), np.array([[0.0]]), np.array([[0.0]]), np.array([[value]]), (Channel("force", "N"),),
        (Channel("velocity", "m/s"),),
    )  # fmt: skip


def test_the_deviation_of_sampled_models_is_that_of_a_sample():
    """Use 1, 2 and 6: mean 3, squared differences 4, 1 and 9, divided by two."""
    models = tuple(map(gain, (1.0, 2.0, 6.0)))
    found = response_deviation(models, [0.5, 2.0])
    assert found.shape == (1, 1, 2)
    assert found.ravel() == pytest.approx([7.0**0.5] * 2, rel=1e-12)
    scatter = spread(models, lambda model: np.array([model.D[0, 0], 2.0 * model.D[0, 0]]))
    assert scatter == pytest.approx([7.0**0.5, 2.0 * 7.0**0.5], rel=1e-12)


@pytest.mark.parametrize(
    ("value", "deviation", "significant"),
    [(40.1, 10.0, True), (-40.1, 10.0, True), (40.0, 10.0, False), (5.0, 0.0, True)],
)  # fmt: skip
def test_a_force_is_significant_above_four_deviations(value, deviation, significant):
    assert ForceEstimate(value, deviation).is_significant == significant
    assert ForceEstimate(12.34, 1.5).text == "12.3 +- 3.0 N"


# ---- What the tests covered ----------------------------------------------------------------------


def series(**channels):
    """Return ten seconds at 100 Hz; "__" in a channel name stands for a point."""
    time = np.arange(1000) / 100.0
    units = {"velocity": "m/s", "force": "N", "tire_force": "N", "displacement": "m", "hub_acceleration": "m/s2"}
    named = {name.replace("__", "."): values(time) for name, values in channels.items()}
    return TimeSeries.from_channels(time, {n: (units[n.rpartition(".")[2]], v) for n, v in named.items()})


def sine(amplitude, hz, mean=0.0):
    return lambda time: mean + amplitude * np.sin(2.0 * np.pi * hz * time + 1e-3)


@pytest.mark.parametrize(("amplitude", "reported"), [(0.330, ""), (0.337, "lf.velocity 10 %")])
def test_more_than_a_tenth_of_the_power_above_the_fitted_frequencies_is_reported(amplitude, reported):
    """The power is that about the mean; only velocities and tire forces are checked."""
    ranges, wave = Ranges((0.2, 16.0), {}), lambda t: 5.0 + sine(1.0, 2.0)(t) + sine(amplitude, 20.0)(t)
    notes = ranges.beyond(series(lf__velocity=wave))
    assert [note.rpartition(": ")[2] for note in notes] == ([reported] if reported else [])
    assert all(note.startswith("power above 16 Hz") for note in notes)
    assert len(ranges.beyond(series(lf__tire_force=wave))) == bool(reported)
    assert ranges.beyond(series(lf__displacement=wave)) == ()


def test_a_frequency_at_the_end_of_the_range_is_within_it():
    assert Ranges((0.2, 20.0), {}).beyond(series(velocity=sine(1.0, 20.0))) == ()
    assert len(Ranges((0.2, 19.9), {}).beyond(series(velocity=sine(1.0, 20.0)))) == 1


def test_ranges_are_the_extremes_of_all_tests_and_are_stored_and_read_back():
    tests = [series(lf__force=sine(3.0, 1.0), lf__velocity=sine(1.0, 1.0, mean=m), lf__hub_acceleration=sine(1.0, 1.0))
             for m in (0.5, -0.25)]  # fmt: skip
    experiment = SimpleNamespace(forces=("lf.force",), outputs=("lf.velocity", "lf.hub_acceleration"))
    ranges = ranges_of(tests, experiment, (0.3, 12.0))
    assert ranges.channels.keys() == {"lf.force", "lf.velocity"}
    assert ranges.channels["lf.velocity"] == pytest.approx((-1.25, 1.5), rel=1e-3)
    assert Ranges.of_mapping(ranges.as_mapping()) == ranges


# ---- Effects in the car that the model does not have ----------------------------------------------


def model_with(excess=None, band=(1.0, 10.0)):
    return SimpleNamespace(excess=excess or {}, band=band)


def response_with(coherence):
    """Return a response of one output with the given coherence (K,) at 0, 2, ... Hz."""
    frequency = 2.0 * np.arange(len(coherence))
    return SimpleNamespace(coherence=np.array([coherence]), frequency=frequency, output_names=("lf.velocity",))


SILENT = SimpleNamespace(coherence=None)


def test_a_misfit_above_one_and_a_half_deviations_is_reported_with_the_worst_of_each_quantity():
    found = model_with({"lf.velocity": 1.6, "rf.velocity": 2.4, "lf.tire_force": 1.5, "rear.ride_height": 0.9})
    flags = unmodelled(SILENT, found, (), {})
    assert flags.keys() == {"misfit"}
    assert "worst of each: velocity 2.4)" in flags["misfit"]
    assert unmodelled(SILENT, model_with({"lf.velocity": 1.5}), (), {}) == {}


@pytest.mark.parametrize(("amplitude", "lifts"), [(985.0, False), (995.0, True)])
def test_a_tire_has_lifted_at_a_hundredth_of_its_mean_load(amplitude, lifts):
    test = series(lf__tire_force=sine(amplitude, 2.0), rf__tire_force=sine(100.0, 2.0))
    calm = series(lf__tire_force=sine(1.0, 2.0), rf__tire_force=sine(100.0, 2.0))
    for tests in ((test, calm), (test,)):
        flags = unmodelled(
            SILENT, model_with(), tests, {"lf.tire_force": 1000.0, "rf.tire_force": 1000.0, "lf.force": 1.0}
        )
        assert flags.keys() == ({"lift-off"} if lifts else set())
        assert not lifts or "(lf.tire_force)" in flags["lift-off"]


def test_a_tire_at_exactly_a_hundredth_of_its_mean_load_has_lifted():
    test = series(lf__tire_force=lambda time: np.where(time < 1.0, -990.0, 110.0))
    assert unmodelled(SILENT, model_with(), (test,), {"lf.tire_force": 1000.0}).keys() == {"lift-off"}


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_the_correlation_length_of_a_misfit_does_not_depend_on_its_size(size):
    rng = np.random.default_rng(6)
    white = rng.normal(size=(3, 4, 2003)) + 1j * rng.normal(size=(3, 4, 2003))
    shared = sum(white[..., k : k + 2000] for k in range(4))
    assert correlation_length(size * white) == 1
    assert correlation_length(size * shared) == 4


def test_a_misfit_of_zero_is_uncorrelated():
    assert correlation_length(np.zeros((1, 2, 50), dtype=complex)) == 1


def test_a_mean_below_the_scatter_is_a_change_from_rest_and_shows_no_lift_off():
    test = series(lf__tire_force=sine(1000.0, 2.0))
    assert unmodelled(SILENT, model_with(), (test,), {"lf.tire_force": 700.0}) == {}
    assert unmodelled(SILENT, model_with(), (test,), {"lf.tire_force": 715.0}).keys() == {"lift-off"}


@pytest.mark.parametrize(
    ("coherence", "reported"), [(0.9980, False), (0.9970, True), (0.92, True), (0.90, False), (1.0, False)]
)
def test_an_output_that_is_noisy_although_coherence_is_good_is_reported(coherence, reported):
    """The limits are 5 % and 31 % of the output: 1 - 0.05^2 and 0.95^2, for the median within the band."""
    inside = [coherence, coherence, 0.0, coherence, coherence]
    found = unmodelled(response_with([0.5, *inside, 0.5]), model_with(), (), {})
    assert found.keys() == ({"unexplained"} if reported else set())
    if reported:
        assert f"lf.velocity {100.0 * (1.0 - coherence) ** 0.5:.0f} %" in found["unexplained"]


def test_the_band_of_the_fit_includes_its_edges():
    """Two of the three values at 2, 4 and 6 Hz are noisy."""
    response = response_with([1.0, 0.98, 1.0, 0.98, 1.0])
    assert unmodelled(response, model_with(band=(2.0, 6.0)), (), {}).keys() == {"unexplained"}
    assert unmodelled(response, model_with(band=(2.1, 6.0)), (), {}) != {}
    assert unmodelled(response, model_with(band=(2.1, 5.9)), (), {}) == {}


def test_resampled_noise_has_power_one_and_is_correlated_over_neighbours():
    generator = np.random.default_rng(3)
    drawn = [correlated_noise(generator, (2, 3, 4000), 3) for _ in range(5)]
    assert drawn[0].shape == (2, 3, 4000)
    # Power 1, half of it in each part; correlated over three neighbours: correlations 2/3 and 1/3, then 0.
    noise = np.concatenate([sample.reshape(-1, 4000) for sample in drawn])
    assert np.mean(np.abs(noise) ** 2) == pytest.approx(1.0, abs=0.03)
    assert np.var(noise.imag) == pytest.approx(0.5, abs=0.02)
    assert abs(np.mean(noise**2)) < 0.03  # real and imaginary part are independent
    correlations = [np.mean((noise[:, lag:] * noise[:, : 4000 - lag].conj()).real) for lag in (1, 2, 3, 4)]
    assert correlations == pytest.approx([2.0 / 3.0, 1.0 / 3.0, 0.0, 0.0], abs=0.03)


def test_a_drift_that_short_blocks_do_not_show_widens_the_interval_of_a_mean():
    """The residual of a mean falls by 60 from start to end."""
    noise, drift = np.random.default_rng(1).normal(size=6000), np.linspace(30.0, -30.0, 6000)
    column, runs, row = np.ones((6000, 1)), runs_of((6000,)), np.ones((1, 1))
    still, moving = (
        covariances(Directions.of(column), residual - residual.mean(), runs) for residual in (noise, noise + drift)
    )
    assert still.shape == moving.shape == (3, 1, 1)
    assert standard_error(row, still)[0] < 2.0 * still[0, 0, 0] ** 0.5
    assert standard_error(row, moving)[0] > 3.0 * moving[0, 0, 0] ** 0.5
    # The true change over the record, 60, is about the width of the interval of quarters: 30 to either side.
    assert quantile(runs) * standard_error(row, moving)[0] == pytest.approx(26.0, abs=4.0)
