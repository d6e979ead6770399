"""The gas force is estimated, left to the car, or already subtracted; the curve always passes through zero."""

import numpy as np
import pytest

from eightpost.ident import evaluate, fit_shock
from eightpost.rig.dyno_test import DynoTest, read_dyno_test
from eightpost.shock import Lpf1, Port


@pytest.fixture(scope="module")
def with_gas(knots, law_record, gas_port):
    return law_record(Lpf1(knots, 1.3e-3, port=gas_port), 1)


@pytest.fixture(scope="module")
def estimated(with_gas):
    return fit_shock(with_gas, "lpf1")


def test_estimate_finds_preload_and_stiffness(estimated, gas_port):
    fit = estimated
    reference = fit.shock.conditions["displacement_reference [m]"]
    at_reference = gas_port.gas_preload + gas_port.gas_stiffness * reference
    assert fit.shock.law.port.gas_preload == pytest.approx(at_reference, abs=2.0)
    assert fit.shock.law.port.gas_stiffness == pytest.approx(gas_port.gas_stiffness, rel=0.05)
    assert fit.shock.law.curve.force(0.0) == 0.0


def test_without_displacement_only_the_preload_is_estimated(with_gas):
    blind = DynoTest(with_gas.series.select(["velocity", "force"]))
    fit = fit_shock(blind, "lpf1")
    assert fit.shock.law.port.gas_stiffness == 0.0
    assert fit.shock.law.port.gas_preload == pytest.approx(204.6, abs=3.0)
    assert any("no displacement" in change for change in fit.changes)


@pytest.mark.repeated
@pytest.mark.parametrize("recipe", ["joint", "boggs"])
def test_a_gas_spring_never_pulls(curve, law_record, recipe):
    record = law_record(Lpf1(curve, 1e-4, port=Port()), 1)
    series = record.series.with_channel("force", "N", record.series["force"] - 3000.0 * record.series["displacement"])
    fit = fit_shock(DynoTest(series), "polylinear", recipe=recipe)
    assert fit.shock.law.port.gas_stiffness >= 0.0
    assert fit.shock.law.port.gas_stiffness < 5.0


def test_the_reference_travels_with_the_shock(with_gas, estimated):
    shifted = with_gas.series.with_channel("displacement", "m", with_gas.series["displacement"] + 0.01)
    offset = evaluate(estimated.shock, DynoTest(shifted)).offset
    assert offset == pytest.approx(-0.01 * estimated.shock.law.port.gas_stiffness, abs=0.5)


@pytest.mark.nightly
def test_a_gas_force_that_pulls_is_reported(with_gas, tmp_path):
    """The same record seen from the other end: every channel negated, compression and rebound swapped."""
    series = with_gas.series
    rules = {}
    for sign in (1.0, -1.0):
        rows = np.vstack([series.time, sign * series.values]).T
        header = "time [s]," + ",".join(f"{name} [{series.units[n]}]" for n, name in enumerate(series.names))
        np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=header, comments="", fmt="%.9g")
        fit = fit_shock(read_dyno_test(tmp_path / "run.csv"), "lpf1")
        assert sign * fit.parameter("gas_preload").value == pytest.approx(205.0, abs=5.0)
        rules[sign] = [reason.rule for reason in fit.verdict.reasons]
    assert rules == {1.0: ["small error"], -1.0: ["negative force at standstill", "small error"]}
