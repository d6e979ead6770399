"""Joint and boggs on the shipped records: the ordering of Table 3.4, on the fit and on another phase draw."""

from pathlib import Path

import pytest

from eightpost.ident import evaluate, fit_shock
from eightpost.rig.dyno_test import DynoTest, read_dyno_test
from eightpost.virtual.dynamometer import measure, random_multisine
from eightpost.virtual.shocks import demo_damper

pytestmark = pytest.mark.nightly

DATA = Path(__file__).parents[2] / "examples" / "data"
LAWS = ("polylinear", "lpf1", "lpnl2")


@pytest.fixture(scope="module", params=["A", *(pytest.param(one, marks=pytest.mark.nightly) for one in "BC")])
def build(request):
    return request.param


@pytest.fixture(scope="module")
def record(build):
    return read_dyno_test(DATA / f"dyno_{build}.csv")


@pytest.fixture(scope="module")
def joint(record):
    return {law: fit_shock(record, law) for law in LAWS}


@pytest.fixture(scope="module")
def boggs(record):
    return {law: fit_shock(record, law, recipe="boggs") for law in LAWS}


@pytest.fixture(scope="module")
def other_draw(build):
    return DynoTest(measure(demo_damper(build), random_multisine(101, duration=5.0), seed=102))


def test_the_ordering_holds_on_another_phase_draw(joint, other_draw):
    errors = {law: evaluate(fit.shock, other_draw).percent for law, fit in joint.items()}
    assert errors["polylinear"] > 1.5 * errors["lpf1"]
    assert errors["lpnl2"] < errors["lpf1"]
    assert errors["lpf1"] < 3.0


def test_the_dissertation_recipe_orders_the_laws_in_the_same_way(boggs):
    rms = {law: fit.rms for law, fit in boggs.items()}
    assert rms["polylinear"] > 1.5 * rms["lpf1"]
    assert rms["lpnl2"] < 1.01 * rms["lpf1"]


def test_the_dissertation_recipe_finds_tau_on_its_grid(boggs):
    tenths = boggs["lpf1"].parameter("time_constant").value / 1e-4
    assert tenths == pytest.approx(round(tenths), abs=1e-9)
    assert 1 <= round(tenths) <= 100


@pytest.mark.parametrize("law", LAWS)
def test_joint_is_better_than_one_after_the_other(joint, boggs, other_draw, law):
    assert joint[law].rms < boggs[law].rms
    assert evaluate(joint[law].shock, other_draw).rms < evaluate(boggs[law].shock, other_draw).rms


def test_the_gas_force_of_the_truth_comes_back(joint, build):
    truth = demo_damper(build)
    fit = joint["lpnl2"]
    assert fit.parameter("gas_preload").value == pytest.approx(truth.gas_preload, rel=0.1)
    assert fit.parameter("gas_stiffness").value == pytest.approx(truth.gas_stiffness, rel=0.3)


def test_conditions_say_where_the_fit_holds(joint):
    conditions = joint["lpf1"].shock.conditions
    low, high = conditions["temperature_range [K]"]
    assert 295.0 < low < high < 310.0
    assert conditions["frequency_range [Hz]"][1] < 30.1  # Table 3.2
    assert conditions["displacement_range [m]"][0] == pytest.approx(-0.0254, rel=0.1)
    assert joint["lpf1"].shock.inputs[0]["name"].startswith("dyno_")
