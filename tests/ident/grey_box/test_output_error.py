"""The output-error fit: known parameters, stated intervals, the gate, and a closed form."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from eightpost.errors import ParameterError
from eightpost.ident.grey_box.output_error import Band, OutputErrorMethod, Parameter, ParameterTable, Record
from eightpost.ident.grey_box.recipe import OutputGate, failures, residual_gate

RATE = 50.0
SECOND = ("w2", "zeta2", "gain2")


class Resonators:
    """Two resonators in parallel, with frequency, damping ratio and gain each."""

    def run(self, values, inputs, rate):
        return np.array([sum(self._one(row[k : k + 3], inputs, rate) for k in (0, 3)) for row in values])

    def _one(self, row, inputs, rate):
        w, zeta, gain = row
        b, a, _ = cont2discrete(([w * w], [1.0, 2.0 * zeta * w, w * w]), 1.0 / rate)
        return gain * lfilter(b.ravel(), a, inputs, axis=0)


def resonators(second_gain, *, fixed=()):
    """Return the parameters of two resonators."""
    table = []
    for k, (w, gain) in enumerate(((6.0, 1.0), (25.0, second_gain)), start=1):
        table += [
            Parameter(f"w{k}", "rad/s", w, 1.0, 100.0, None),
            Parameter(f"zeta{k}", "1", 0.1, 1e-3, 1.0, None),
            Parameter(f"gain{k}", "1", gain, -10.0, 10.0, 1.0),
        ]
    return ParameterTable(tuple(table)).fixed(*fixed)


def random_record(seed, second_gain, *, noise=0.03, seconds=30.0):
    """Return a record of a random system with coloured noise, and its parameters."""
    generator = np.random.default_rng(seed)
    w1, w2 = generator.uniform(4.0, 8.0), generator.uniform(20.0, 30.0)
    zetas = generator.uniform(0.05, 0.2, 2)
    true = {"w1": w1, "zeta1": zetas[0], "gain1": 1.0, "w2": w2, "zeta2": zetas[1], "gain2": second_gain}
    samples = round(seconds * RATE)
    u = lfilter([1.0], [1.0, -0.6], generator.standard_normal(samples))[:, None]
    (y,) = Resonators().run(np.array([list(true.values())]), u, RATE)
    coloured = lfilter([1.0], [1.0, -0.8], generator.standard_normal((samples + 200, 1)), axis=0)[200:]
    return Record(u, y + noise * y.std() * coloured / coloured.std(), RATE), true


def fitted(table, record, **settings):
    return OutputErrorMethod(**settings).fit(Resonators(), table, [record], ["y"])


def gate_of(fit, record):
    """Return the gate of the output and its failure."""
    outputs = residual_gate(["y"], [record], fit.simulated, band=Band())
    return outputs["y"], failures(outputs).get("y", "")


@pytest.mark.slow
def test_known_parameters_are_within_their_intervals_as_often_as_stated_in_coloured_noise():
    inside, shares = [], []
    for seed in range(15):
        record, true = random_record(seed, 0.3)
        fit = fitted(resonators(0.3), record)
        assert not fit.message
        inside += [low <= true[name] <= high for name, (low, high) in fit.intervals().items()]
        shares += [(fit.values[name] - true[name]) / fit.deviations[name] for name in true]
    assert 0.90 <= np.mean(inside) <= 0.99
    assert np.std(shares) == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_the_gate_accepts_the_true_structure_and_never_one_without_a_mode_and_names_its_frequency():
    for seed in range(100, 102):
        record, true = random_record(seed, 0.3)
        assert not gate_of(fitted(resonators(0.3), record), record)[1]
        gate, failure = gate_of(fitted(resonators(0.0, fixed=SECOND), record), record)
        assert failure.endswith("the model lacks an effect.")
        assert gate.frequency == pytest.approx(true["w2"] / (2.0 * np.pi), rel=0.15)


@pytest.mark.nightly
def test_the_probability_of_the_gate_is_uniform_at_most_where_only_noise_is_left():
    found = []
    for seed in range(200, 215):
        record, _ = random_record(seed, 0.3)
        found.append(gate_of(fitted(resonators(0.3), record, passes=1), record)[0].probability)
    assert np.mean(np.array(found) < 0.1) <= 0.25


def test_a_gate_fails_on_what_inputs_explain_beyond_chance_and_on_large_residuals():
    """Two outputs share the probability of a false alarm, a thousandth."""
    sound = OutputGate(residual=0.05, explained=0.03, upper=0.04, probability=6e-4, frequency=3.0)
    explained, small = sound._replace(probability=4e-4), sound._replace(probability=0.0, upper=0.02)
    assert not failures({"a": sound, "b": small})
    assert list(failures({"a": sound})) == ["a"]
    found = failures({"a": explained, "b": sound._replace(residual=0.06)})
    assert found["a"].startswith(
        "a: the inputs explain a part of the residual that is 3 % of the output (limit 2 %), most at 3 Hz"
    )
    assert found["b"] == ("b: the residual is 6 % of the output (limit 5 %); it is not known whether this is noise.")


@pytest.mark.parametrize("second", [0.3, 0.0])
def test_the_gate_of_a_simulation_is_the_kept_one(second, unchanged):
    """The simulation has a wrong damping; without its second resonator it lacks a mode."""
    record, true = random_record(100, 0.3, seconds=20.0)
    values = list((true | {"zeta1": 1.1 * true["zeta1"], "gain2": second}).values())
    simulated = [Resonators().run(np.array([values]), record.inputs, RATE)[0]]
    gate = residual_gate(["y"], [record], simulated, band=Band(0.5, 12.0))
    unchanged({"gate": gate["y"]._asdict(), "failures": failures(gate)}, relative=1e-4)


@pytest.mark.slow
def test_a_fit_of_resonators_is_the_kept_one(unchanged):
    record, _ = random_record(7, 0.3, seconds=12.0)
    fit = fitted(resonators(0.3), record)
    lines = [Band(1.0, 10.0, window).lines(record.outputs[:, 0], RATE) for window in ("boxcar", "hann")]
    unchanged({"values": fit.values, "deviations": fit.deviations, "intervals": fit.intervals(), "lines": lines,
               "residual": fit.residual, "covariance": fit.covariance}, relative=1e-3)  # fmt: skip


def test_noise_that_no_test_can_tell_from_a_missing_effect_is_not_accepted():
    record, _ = random_record(3, 0.3, noise=0.4)
    assert "it is not known whether this is noise" in gate_of(fitted(resonators(0.3), record), record)[1]


def test_a_simulation_that_diverged_is_never_adequate():
    record, _ = random_record(3, 0.3, seconds=4.0)
    assert failures(residual_gate(["y"], [record], [np.full(record.outputs.shape, np.nan)], band=Band()))


# ---- Closed form, priors, bounds ------------------------------------------------------------------------------------


class Regression:
    """Model without states: outputs are inputs times parameters."""

    def run(self, values, inputs, rate):
        return (inputs @ values.T).T[..., None]


def regression(start=1.2, prior=None, high=100.0):
    return ParameterTable(
        (Parameter("a", "1", start, -100.0, high, 2.0, prior), Parameter("b", "1", 1.0, -100.0, 100.0, 1.0))
    )


def regression_record():
    generator = np.random.default_rng(4)
    u = generator.standard_normal((500, 2)) @ np.array([[1.0, 0.5], [0.0, 1.0]])
    return Record(u, u @ np.array([[2.0], [-3.0]]) + 0.1 * generator.standard_normal((500, 1)), RATE)


def least_squares_of(record, noise, prior):
    """Return the minimum of the squared residuals and of the prior of a about 2.01, and its covariance."""
    precision = record.inputs.T @ record.inputs / noise**2 + np.diag([prior**-2.0, 0.0])
    moment = record.inputs.T @ record.outputs[:, 0] / noise**2 + np.array([2.01 * prior**-2.0, 0.0])
    return np.linalg.solve(precision, moment), np.linalg.inv(precision)


def test_a_linear_model_gives_least_squares_and_its_covariance():
    record = regression_record()
    fit = OutputErrorMethod().fit(Regression(), regression(), [record], ["y"])
    expected, (squares,), _, _ = np.linalg.lstsq(record.inputs, record.outputs, rcond=None)
    assert list(fit.values.values()) == pytest.approx(expected[:, 0].tolist(), abs=1e-6)
    covariance = np.linalg.inv(record.inputs.T @ record.inputs) * float(squares) / 498
    assert list(fit.deviations.values()) == pytest.approx(np.sqrt(np.diag(covariance)).tolist(), rel=0.1)
    assert fit.residual["y"] == pytest.approx(float(np.sqrt(squares / 500.0)) / record.outputs.std(), rel=1e-6)
    assert (fit.message, fit.at_bounds) == ("", ())


def test_a_prior_weighs_as_much_as_a_measurement_of_its_precision():
    """The first pass expects a noise of 2 % of the output, the second the residual of the first, on 251 lines."""
    record, prior = regression_record(), 0.003
    first, _ = least_squares_of(record, 0.02 * np.sqrt(record.outputs.var() * 500 / 502), prior)
    noise = np.sqrt(np.sum((record.inputs @ first - record.outputs[:, 0]) ** 2) / 502)
    expected, covariance = least_squares_of(record, noise, prior)
    alone, _ = least_squares_of(record, noise, 1e6)
    assert abs(expected[0] - 2.01) < 0.5 * abs(alone[0] - 2.01)
    fit = OutputErrorMethod().fit(Regression(), regression(2.01, prior), [record], ["y"])
    assert list(fit.values.values()) == pytest.approx(expected.tolist(), rel=1e-4)
    assert fit.deviations["a"] == pytest.approx(covariance[0, 0] ** 0.5, rel=0.1)


def test_a_logarithmic_parameter_has_an_interval_of_ratios_and_a_prior_of_the_logarithm():
    record = regression_record()
    table = ParameterTable((Parameter("a", "1", 1.0, 0.01, 100.0, None), Parameter("b", "1", 1.0, -9.0, 9.0, 1.0)))
    fit = OutputErrorMethod().fit(Regression(), table, [record], ["y"])
    plain = OutputErrorMethod().fit(Regression(), regression(), [record], ["y"])
    assert fit.values["a"] == pytest.approx(plain.values["a"], rel=1e-5)
    assert fit.deviations["a"] == pytest.approx(plain.deviations["a"], rel=0.02)
    low, high = fit.intervals()["a"]
    assert low * high == pytest.approx(fit.values["a"] ** 2)
    assert np.log(high / low) == pytest.approx(2.0 * 1.96 * fit.deviations["a"] / fit.values["a"], rel=1e-3)
    assert ParameterTable((Parameter("a", "1", 5.0, 1.0, 9.0, None, 0.1),)).prior_weights() == pytest.approx([10.0])


def test_settling_at_the_start_does_not_count():
    record = regression_record()
    wrong = record.outputs.copy()
    wrong[:50] += 100.0
    shortened = Record(record.inputs, wrong, RATE, settling=50)
    fit = OutputErrorMethod().fit(Regression(), regression(), [shortened], ["y"])
    assert fit.values == pytest.approx({"a": 2.0, "b": -3.0}, abs=0.03)


def test_several_records_count_together():
    record = regression_record()
    parts = [Record(record.inputs[rows], record.outputs[rows], RATE) for rows in (slice(0, 200), slice(200, 500))]
    together, whole = (OutputErrorMethod().fit(Regression(), regression(), r, ["y"]) for r in (parts, [record]))
    assert together.values == pytest.approx(whole.values, rel=1e-4)
    assert [len(y) for y in together.simulated] == [200, 300]


def test_the_whole_band_is_the_time_domain():
    values = np.random.default_rng(2).standard_normal((3, 101))
    assert np.sum(np.abs(Band().lines(values, RATE)) ** 2, axis=1) == pytest.approx(np.sum(values**2, axis=1))


def test_a_parameter_at_its_bound_is_reported():
    fit = OutputErrorMethod().fit(Regression(), regression(high=1.5), [regression_record()], ["y"])
    assert fit.at_bounds == ("a",)


def test_a_start_outside_of_the_bounds_and_a_prior_of_zero_are_refused_with_their_values():
    with pytest.raises(ParameterError, match="start 3 kg must be within the bounds 0 to 2 kg"):
        Parameter("mass", "kg", 3.0, 0.0, 2.0, 1.0)
    with pytest.raises(ParameterError, match="prior is 0"):
        Parameter("mass", "kg", 1.0, 0.0, 2.0, 1.0, prior=0.0)
