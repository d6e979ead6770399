"""The output-error engine: known parameters, stated intervals, the gate, multiple shooting, and a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from eightpost.errors import ParameterError
from eightpost.ident.output_error import (
    Band,
    OutputError,
    Parameter,
    ParameterTable,
    Record,
    Shooting,
    SteppedModel,
    derivative_function,
    simulate,
)
from eightpost.ident.output_error.gate import Gate, OutputGate, Tolerance

RATE = 50.0


@derivative_function
def _resonators(x, u, p, dx):
    for k in range(2):
        w = p[3 * k]
        dx[2 * k] = x[2 * k + 1]
        dx[2 * k + 1] = w * w * (p[3 * k + 2] * u[0] - x[2 * k]) - 2.0 * p[3 * k + 1] * w * x[2 * k + 1]


@derivative_function
def _sum(x, u, p, y):
    y[0] = x[0] + x[2]


def resonators(second_gain: float, *, fixed: tuple[str, ...] = ()) -> ParameterTable:
    """Return the parameters of two resonators in parallel."""
    table = []
    for k, (w, gain) in enumerate(((6.0, 1.0), (25.0, second_gain)), start=1):
        table += [
            Parameter(f"w{k}", "rad/s", w, 1.0, 100.0, "logarithmic"),
            Parameter(f"zeta{k}", "1", 0.1, 1e-3, 1.0, "logarithmic"),
            Parameter(f"gain{k}", "1", gain, size=1.0),
        ]
    return ParameterTable(tuple(table)).fixed(*fixed)


@pytest.fixture(scope="module")
def model() -> SteppedModel:
    return SteppedModel(_resonators, _sum, outputs=1, state_sizes=np.array([1.0, 6.0, 1.0, 25.0]), steps=2)


SECOND = ("w2", "zeta2", "gain2")


def _random_record(model, seed, second_gain, *, noise=0.05, seconds=30.0):
    """Return a record of a random system with coloured noise, and its parameters."""
    generator = np.random.default_rng(seed)
    w1, w2 = generator.uniform(4.0, 8.0), generator.uniform(20.0, 30.0)
    zetas = generator.uniform(0.05, 0.2, 2)
    true = {"w1": w1, "zeta1": zetas[0], "gain1": 1.0, "w2": w2, "zeta2": zetas[1], "gain2": second_gain}
    samples = round(seconds * RATE)
    u = lfilter([1.0], [1.0, -0.6], generator.standard_normal(samples))[:, None]
    empty = Record(u, np.zeros((samples, 1)), RATE)
    y = simulate(model, true, resonators(second_gain), empty)
    coloured = lfilter([1.0], [1.0, -0.8], generator.standard_normal((samples + 200, 1)), axis=0)[200:]
    return Record(u, y + noise * y.std() * coloured / coloured.std(), RATE), true


@pytest.mark.nightly
def test_known_parameters_are_within_their_intervals_as_often_as_stated_in_coloured_noise(model):
    inside, shares = [], []
    for seed in range(30):
        record, true = _random_record(model, seed, 0.3)
        fit = OutputError().fit(model, resonators(0.3), [record])
        assert fit.converged
        inside += [low <= true[name] <= high for name, (low, high) in fit.intervals(0.95).items()]
        shares += [(fit.values[name] - true[name]) / fit.deviations[name] for name in true]
    assert 0.90 <= np.mean(inside) <= 0.99
    assert np.std(shares) == pytest.approx(1.0, abs=0.15)


@pytest.mark.nightly
def test_the_gate_accepts_the_true_structure_and_never_one_without_a_mode(model):
    complete, lacking = [], []
    for seed in range(100, 115):
        record, _ = _random_record(model, seed, 0.1)
        complete.append(OutputError().fit(model, resonators(0.1), [record]).gate)
        one_mode = resonators(0.0, fixed=SECOND)
        lacking.append(OutputError().fit(model, one_mode, [record]).gate)
    assert all(gate.is_adequate for gate in complete)
    assert not any(gate.is_adequate for gate in lacking)
    assert "the model lacks an effect" in lacking[0].summary()


@pytest.mark.nightly
def test_the_gate_names_the_frequency_of_the_missing_mode(model):
    record, true = _random_record(model, 7, 0.3)
    gate = OutputError().fit(model, resonators(0.0, fixed=SECOND), [record]).gate
    assert gate.outputs["y1"].frequency == pytest.approx(true["w2"] / (2.0 * np.pi), rel=0.15)


@pytest.mark.nightly
def test_the_probability_of_the_gate_is_uniform_at_most_where_only_noise_is_left(model):
    found = []
    for seed in range(200, 230):
        record, _ = _random_record(model, seed, 0.3)
        found.append(OutputError(passes=1).fit(model, resonators(0.3), [record]).gate.outputs["y1"].probability)
    assert np.mean(np.array(found) < 0.1) <= 0.25


def test_a_gate_fails_on_what_inputs_explain_beyond_chance_and_on_large_residuals():
    """Two outputs share the probability of a false alarm, a thousandth."""
    sound = OutputGate(residual=0.09, explained=0.02, upper=0.03, probability=6e-4, frequency=3.0)
    explained, small = sound._replace(probability=4e-4), sound._replace(probability=0.0, upper=0.009)
    assert Gate({"a": sound, "b": small}, Tolerance()).is_adequate
    assert not Gate({"a": sound}, Tolerance()).is_adequate
    assert Gate({"b": small}, Tolerance()).summary() == "The inputs explain no part of the residual that matters."
    found = Gate({"a": explained, "b": sound._replace(residual=0.11)}, Tolerance())
    assert list(found.failures) == ["a", "b"]
    assert found.failures["a"].startswith(
        "a: the inputs explain a part of the residual that is 2 % of the output (limit 1 %), most at 3 Hz"
    )
    assert "b: the residual is 11 % of the output (limit 10 %)" in found.summary()


@pytest.mark.nightly
def test_noise_that_no_test_can_tell_from_a_missing_effect_is_not_accepted(model):
    record, _ = _random_record(model, 3, 0.3, noise=0.4)
    fit = OutputError().fit(model, resonators(0.3), [record])
    assert not fit.gate.is_adequate
    assert "it is not known whether this is noise" in fit.gate.summary()


# ---- Multiple shooting ----------------------------------------------------------------------------------------------


@derivative_function
def _double_well(x, u, p, dx):
    dx[0] = x[1]
    dx[1] = p[0] * x[0] - p[1] * x[0] ** 3 - p[2] * x[1] + u[0]


@derivative_function
def _position(x, u, p, y):
    y[0] = x[0]


def _wells(start):
    pairs = (("negative_stiffness", "1/s2", start), ("cubic_stiffness", "1/s2", start), ("damping", "1/s", 0.1))
    return ParameterTable(tuple(Parameter(name, unit, s, 1e-4, 100.0, "logarithmic") for name, unit, s in pairs))


@pytest.mark.nightly
@pytest.mark.parametrize("start", [0.5, 2.0, 3.0])
def test_multiple_shooting_converges_on_a_chaotic_oscillator_where_single_shooting_does_not(start):
    model = SteppedModel(
        _double_well, _position, outputs=1, state_sizes=np.ones(2), steps=2,
        start=lambda values: np.tile([1.0, 0.0], (len(values), 1)),
    )  # fmt: skip
    true = {"negative_stiffness": 1.0, "cubic_stiffness": 1.0, "damping": 0.3}
    time = np.arange(0.0, 50.0, 0.1)
    empty = Record(0.4 * np.sin(1.2 * time)[:, None], np.zeros((time.size, 1)), 10.0)
    noise = 0.02 * np.random.default_rng(1).standard_normal((time.size, 1))
    record = Record(empty.inputs, simulate(model, true, _wells(1.0), empty) + noise, 10.0)
    shooting = Shooting(
        segments=10,
        states=lambda one: np.column_stack([one.outputs[:, 0], np.gradient(one.outputs[:, 0], 1.0 / one.rate)]),
    )
    single = OutputError(passes=1).fit(model, _wells(start), [record])
    multiple = OutputError(passes=1, shooting=shooting).fit(model, _wells(start), [record])
    assert single.residual["y1"] > 0.5
    assert multiple.residual["y1"] < 0.03
    assert multiple.values == pytest.approx(true, rel=0.02)


# ---- Closed form, priors, bounds ------------------------------------------------------------------------------------


class _Regression:
    """Model without states: outputs are inputs times parameters."""

    state_sizes = np.zeros(0)

    def start(self, values):
        return np.zeros((len(values), 0))

    def run(self, values, states, inputs, rate):
        return (inputs[:-1] @ values.T).T[..., None], states


def _regression(*, priors=(None, None)):
    pairs = zip(("a", "b"), (2.01, 1.0), priors, strict=True)
    return ParameterTable(tuple(Parameter(name, "1", start, prior=prior) for name, start, prior in pairs))


def _regression_record(noise=0.1):
    generator = np.random.default_rng(4)
    u = generator.standard_normal((500, 2)) @ np.array([[1.0, 0.5], [0.0, 1.0]])
    return Record(u, u @ np.array([[2.0], [-3.0]]) + noise * generator.standard_normal((500, 1)), RATE)


def test_a_linear_model_gives_least_squares_and_its_covariance():
    record = _regression_record()
    fit = OutputError().fit(_Regression(), _regression(), [record])
    expected, (squares,), _, _ = np.linalg.lstsq(record.inputs, record.outputs, rcond=None)
    assert list(fit.values.values()) == pytest.approx(expected[:, 0].tolist(), abs=1e-9)
    covariance = np.linalg.inv(record.inputs.T @ record.inputs) * float(squares) / 498
    assert list(fit.deviations.values()) == pytest.approx(np.sqrt(np.diag(covariance)).tolist(), rel=0.1)


def test_a_prior_weighs_as_much_as_a_measurement_of_its_precision():
    record = _regression_record()
    engine = OutputError(noise=(0.1,))
    fit = engine.fit(_Regression(), _regression(priors=(0.003, None)), [record])
    precision = record.inputs.T @ record.inputs / 0.1**2
    whole = precision + np.diag([0.003**-2.0, 0.0])
    moment = record.inputs.T @ record.outputs[:, 0] / 0.1**2 + np.array([2.01 * 0.003**-2.0, 0.0])
    assert list(fit.values.values()) == pytest.approx(np.linalg.solve(whole, moment).tolist(), rel=1e-6)
    assert fit.deviations["a"] == pytest.approx(np.linalg.inv(whole)[0, 0] ** 0.5, rel=0.1)


def test_settling_at_the_start_does_not_count():
    record = _regression_record()
    wrong = record.outputs.copy()
    wrong[:50] += 100.0
    fit = OutputError().fit(_Regression(), _regression(), [Record(record.inputs, wrong, RATE, settling=50)])
    assert fit.values == pytest.approx({"a": 2.0, "b": -3.0}, abs=0.03)


def test_the_whole_band_is_the_time_domain():
    values = np.random.default_rng(2).standard_normal((3, 101))
    assert np.sum(np.abs(Band().lines(values, RATE)) ** 2, axis=1) == pytest.approx(np.sum(values**2, axis=1))


def test_a_parameter_at_its_bound_is_reported():
    table = ParameterTable((Parameter("a", "1", 1.0, 0.0, 1.5), Parameter("b", "1", 1.0)))
    fit = OutputError().fit(_Regression(), table, [_regression_record()])
    assert fit.at_bounds == ("a",)
    assert "(at a bound)" in fit.as_markdown()


def test_a_start_outside_of_the_bounds_is_refused_with_its_value():
    with pytest.raises(ParameterError, match="start 3 kg must be within the bounds 0 to 2 kg"):
        Parameter("mass", "kg", 3.0, 0.0, 2.0)


def test_an_unknown_start_value_is_refused_with_the_names_that_exist():
    with pytest.raises(ParameterError, match="no parameter c; the parameters are a, b"):
        OutputError().fit(_Regression(), _regression(), [_regression_record()], start={"c": 1.0})
