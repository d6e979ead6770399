"""Estimated frequency responses: those of cars that were tested, coherence and variance, and noise of the inputs."""

from dataclasses import replace

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.ident.vehicle.estimators import (
    H1,
    LocalPolynomial,
    SameDrive,
    estimate_response,
    input_noise,
    input_power,
    regress,
)
from eightpost.ident.vehicle.experiment import Blocks, Record, Records, gather
from eightpost.ident.vehicle.frequency_response import contribution_error, response_of
from eightpost.signals import TimeSeries
from eightpost.vehicle import Channel


def _estimate(rig, recipe):
    found = estimate_response(
        rig.records, inputs=rig.inputs, outputs=rig.outputs, recipe=recipe, baseline_damping=rig.damping
    )
    return found.band(0.3, 25.0)


def _errors(rig, found):
    return contribution_error(found, response_of(rig.truth, found.frequency), rig.input_power(found.frequency))


def test_the_local_polynomial_method_is_within_a_tenth_of_a_percent_for_the_quarter_car(quarter_car):
    assert _errors(quarter_car, _estimate(quarter_car, LocalPolynomial(degree=4, spacing=0.1))).max() < 1e-3


def test_the_local_polynomial_method_is_within_half_a_percent_for_the_seven_dof_car(seven_dof):
    assert _errors(seven_dof, _estimate(seven_dof, LocalPolynomial(spacing=0.2))).max() < 5e-3


@pytest.mark.repeated
@pytest.mark.parametrize("window", ["hann", "hamming"])
def test_the_leakage_of_windowed_blocks_decreases_with_their_length(quarter_car, window):
    lengths = (2.5, 5.0, 10.0, 20.0)
    errors = [_errors(quarter_car, _estimate(quarter_car, H1(Blocks(length, window)))).max() for length in lengths]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.25 * errors[0]


@pytest.mark.parametrize(
    "recipe",
    [H1(Blocks(5.0)), H1(Blocks(4.0, "hamming")), LocalPolynomial(degree=4, spacing=0.5), LocalPolynomial(spacing=0.5),
     LocalPolynomial.of_width(0.4, 20.0), SameDrive(H1(Blocks(5.0)), ("force",))],
    ids=["hann", "hamming", "fourth degree", "local", "of a width", "same drive"],
)  # fmt: skip
def test_an_estimate_is_the_kept_one(quarter_car, recipe, unchanged):
    found = _estimate(quarter_car, recipe)
    unchanged({name: array for name, array in found.arrays().items() if array is not None}, relative=1e-4)
    records = gather(quarter_car.records, quarter_car.inputs, quarter_car.outputs, quarter_car.damping)
    unchanged(input_power(records, found.frequency), "power")


def test_the_noise_of_the_inputs_is_the_kept_one(unchanged):
    found = input_noise(records(0.03), (1.0, 25.0))
    unchanged({"found": found, "says": found.summary(LocalPolynomial())}, relative=1e-4)


def test_short_windows_overestimate_damping(quarter_car):
    found = _estimate(quarter_car, H1(Blocks(4.0, "hamming")))
    near = np.abs(found.frequency - 3.04) < 0.13
    truth = response_of(quarter_car.truth, found.frequency)
    measured, exact = (r.between("ride_height", "aero_force")[near] for r in (found, truth))
    assert np.abs(measured).max() < 0.97 * np.abs(exact).max()


def test_the_estimate_from_one_drive_agrees_with_the_global_one(quarter_car):
    blocks = Blocks(10.0)
    recipes = (SameDrive(H1(blocks), ("force",)), H1(blocks))
    errors, together = (_errors(quarter_car, _estimate(quarter_car, r)).max() for r in recipes)
    assert errors < 3.0 * together


def test_the_two_experiment_method_with_local_polynomials_is_within_half_a_percent(quarter_car):
    recipe = SameDrive(LocalPolynomial(spacing=0.1), ("force",))
    assert _errors(quarter_car, _estimate(quarter_car, recipe)).max() < 5e-3


def test_forces_of_linear_shocks_alone_are_rejected_as_dependent(quarter_car):
    with pytest.raises(InputError, match="depend linearly"):
        estimate_response(
            quarter_car.records[:1],
            inputs=quarter_car.inputs,
            outputs=quarter_car.outputs,
            recipe=LocalPolynomial(spacing=0.2),
        )


# ---- Coherence and variance against their closed forms ---------------------------------------------------------------

SLOW, SAMPLES, GAIN = 100.0, 100_000, 3.0


def _white(**channels):
    return TimeSeries.from_channels(np.arange(SAMPLES) / SLOW, {name: ("m", row) for name, row in channels.items()})


def _estimated(record, recipe, *inputs):
    return estimate_response([record], inputs=inputs, outputs=["y"], recipe=recipe)


@pytest.fixture
def generator():
    return np.random.default_rng(11)


@pytest.mark.nightly
@pytest.mark.parametrize("recipe", [H1(Blocks(2.0)), LocalPolynomial(spacing=0.5, half_width=0.1)])
def test_the_variance_is_that_of_repeated_estimates(generator, recipe):
    values, variances = [], []
    for _ in range(20):
        u, noise = generator.normal(size=(2, SAMPLES))
        found = _estimated(_white(u=u, y=GAIN * u + noise), recipe, "u")
        assert found.variance is not None
        values.append(found.H[0, 0])
        variances.append(found.variance[0, 0].mean())
    assert np.mean(variances) == pytest.approx(np.mean(np.abs(np.array(values) - GAIN) ** 2), rel=0.15)


def test_h1_is_unbiased_by_output_noise_and_too_small_by_input_noise(generator):
    u, noise = generator.normal(size=(2, SAMPLES))
    for record, gain in (
        (_white(u=u, y=GAIN * (u + 0.5 * noise)), GAIN),
        (_white(u=u + 0.5 * noise, y=GAIN * u), GAIN / 1.25),
    ):
        assert _estimated(record, H1(Blocks(2.0)), "u").H.real.mean() == pytest.approx(gain, rel=0.01)


def test_an_input_is_dropped_where_it_has_no_power(generator):
    wide = generator.normal(size=SAMPLES)
    spectrum = np.fft.rfft(generator.normal(size=SAMPLES))
    spectrum[np.fft.rfftfreq(SAMPLES, 1.0 / SLOW) > 5.0] = 0.0
    slow = np.fft.irfft(spectrum)
    found = _estimated(_white(wide=wide, slow=slow, y=wide + slow + 0.1 * generator.normal(size=SAMPLES)),
                      H1(Blocks(4.0)), "wide", "slow")  # fmt: skip
    above = found.frequency > 6.0
    assert found.variance is not None
    assert not found.H[0, 1, above].any()
    assert np.isinf(found.variance[0, 1, above]).all()
    assert found.H[0, 0, above] == pytest.approx(np.ones(above.sum()), abs=0.05)
    assert np.abs(found.H[0, 1, found.frequency < 4.5] - 1.0).max() < 0.05


# ---- Bias from noise of the measured inputs --------------------------------------------------------------------------

RATE, COUNT = 125.0, 50_000
INPUTS = (Channel("road", "m"), Channel("force", "N"))


def records(noise, *, seed=3):
    """Return a test with a gain of 2 from road and 3 from force, driven below 30 Hz, with white noise on the inputs.

    The force follows the road, apart from a tenth of its amplitude.
    """
    generator = np.random.default_rng(seed)
    spectra = np.fft.rfft(generator.standard_normal((2, COUNT)), axis=1)
    spectra[:, np.fft.rfftfreq(COUNT, 1.0 / RATE) > 30.0] = 0.0
    road, own = np.fft.irfft(spectra, COUNT, axis=1)
    force = road + 0.1 * own
    y = 2.0 * road + 3.0 * force
    u = np.stack([road, force]) + noise * generator.standard_normal((2, COUNT))
    return Records((Record(u, y[None]),), RATE, INPUTS, (Channel("y", "m"),))


def test_without_noise_there_is_no_bias():
    assert max(input_noise(records(0.0), (1.0, 25.0)).bias.values()) < 1e-6


def test_the_stated_bias_is_that_of_noise_in_the_force_only():
    """Compare with the estimate: the force's own part is small, so its noise matters and that of the road does not."""
    plain, noise = records(0.0), 0.04
    u = plain.tests[0].u.copy()
    u[1] += noise * np.random.default_rng(5).standard_normal(COUNT)
    noisy = Records((Record(u, plain.tests[0].y),), RATE, INPUTS, plain.outputs)
    response = LocalPolynomial(half_width=1.0, spacing=0.5, high=25.0).estimate(noisy)
    inside = (response.frequency > 2.0) & (response.frequency < 24.0)
    found = 1.0 - np.median(response.H[0, 1, inside].real) / 3.0
    stated = input_noise(noisy, (1.0, 25.0)).bias
    assert stated["force"] == pytest.approx(found, rel=0.25)
    assert 0.05 < found < 0.2
    assert stated["road"] < 1e-3


def test_frequencies_without_drive_do_not_count():
    noisy = records(0.02)
    driven, all_of_them = (input_noise(noisy, (1.0, high)).bias for high in (28.0, 0.5 * RATE))
    assert all_of_them == pytest.approx(driven, rel=0.1)


@pytest.mark.parametrize(("recipe", "name"), [(LocalPolynomial(), "local polynomials"), (H1(None), "H1")])
def test_the_sentence_names_the_estimator_and_the_direction_of_its_bias(recipe, name):
    noise = input_noise(records(0.01), (1.0, 25.0))
    sentence = noise.summary(recipe)
    assert sentence.startswith(f"Estimator: {name}")
    assert "makes its responses too small: if the noise" in sentence
    assert "force" in sentence
    assert replace(noise, bias={}).summary(recipe).endswith("makes its responses too small.")


# ---- Coherences and variances of an averaged response, against their definitions -------------------------------------


@pytest.fixture(scope="module")
def blocks():
    """40 blocks of three inputs and two outputs at five frequencies; the second input follows the first in part."""
    rng = np.random.default_rng(5)

    def normal(*shape):
        return rng.normal(size=shape) + 1j * rng.normal(size=shape)

    U = normal(5, 40, 3)
    U[:, :, 1] += 0.8 * U[:, :, 0]
    Y = U @ normal(5, 3, 2) + 2.0 * normal(5, 40, 2)
    return U, Y, regress(U, Y, power_floor=1e-6, names=("a", "b", "c"))


def left_over(x, inputs):
    return x - inputs @ np.linalg.lstsq(inputs, x, rcond=None)[0]


def test_multiple_coherence_is_the_share_of_power_that_all_inputs_explain(blocks):
    U, Y, solved = blocks
    found = solved.coherence()
    for k in range(5):
        for i in range(2):
            y = Y[k, :, i]
            expected = 1.0 - np.sum(np.abs(left_over(y, U[k])) ** 2) / np.sum(np.abs(y) ** 2)
            assert found[i, k] == pytest.approx(expected, rel=1e-10)
    silent = solved._replace(total=np.zeros_like(solved.total))
    assert silent.coherence().tolist() == np.zeros((2, 5)).tolist()


def test_partial_coherence_is_that_of_what_the_other_inputs_leave_of_both(blocks):
    U, Y, solved = blocks
    found = solved.partial_coherence()
    for k, i, j in np.ndindex(5, 2, 3):
        others = np.delete(U[k], j, axis=1)
        y, u = left_over(Y[k, :, i], others), left_over(U[k, :, j], others)
        expected = np.abs(np.vdot(u, y)) ** 2 / (np.vdot(u, u).real * np.vdot(y, y).real)
        assert found[i, j, k] == pytest.approx(expected, rel=1e-9)


def test_partial_coherence_is_zero_where_an_input_was_dropped_or_nothing_is_left(blocks):
    _, _, solved = blocks
    active = solved.active.copy()
    active[1, 2] = False
    found = solved._replace(active=active).partial_coherence()
    assert found[:, 1, 2].tolist() == [0.0, 0.0]
    assert (found[:, 0] > 0.0).all()
    nothing = solved._replace(H=np.zeros_like(solved.H), residual=np.zeros_like(solved.residual))
    assert nothing.partial_coherence().tolist() == np.zeros((2, 3, 5)).tolist()


def test_the_variance_of_a_response_is_that_of_least_squares(blocks):
    U, _, solved = blocks
    found = solved.variance(40, 40.0)
    for k in range(5):
        inverse = np.linalg.inv(U[k].conj().T @ U[k]).real.diagonal()
        for i in range(2):
            assert found[i, :, k] == pytest.approx(solved.residual[i, k] / (40 - 3) * inverse, rel=1e-9)
    # Blocks that overlap are worth fewer; with as many inputs as blocks one degree of freedom is left to tell.
    assert solved.variance(40, 20.0) == pytest.approx(2.0 * found, rel=1e-12)
    assert solved.variance(3, 3.0) == pytest.approx(37.0 * found, rel=1e-12)
