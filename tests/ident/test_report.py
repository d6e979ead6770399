"""Tables and plots of fits."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest
from rich.console import Console

from eightpost.ident import fit_shock, fit_table, parameter_table, plot_force_velocity
from eightpost.ident.validation.shock_tests import evaluate
from eightpost.shock import Lpf1, Polylinear


def text(table):
    console = Console(file=io.StringIO(), width=140)
    console.print(table)
    return console.file.getvalue()


@pytest.fixture(scope="module")
def fits(curve, law_record):
    record = law_record(Lpf1(curve, 1.3e-3), 1)
    return [fit_shock(record, law, name="build 1") for law in ("polylinear", "lpf1", "lpnl2")]


def test_the_table_has_what_table_3_4_has(fits):
    shown = text(fit_table(fits))
    for word in ("Polylinear", "LPF1", "LPNL2", "RMS, lbf", "RMS, N", "% of std", "% less than static", "time, s"):
        assert word in shown
    assert f"{100.0 * (1.0 - fits[1].rms / fits[0].rms):.1f}" in shown


def test_without_a_static_fit_there_is_no_reduction(fits):
    assert text(fit_table(fits[1:])).count("-") >= 2


def test_parameters_are_in_both_unit_systems(fits):
    shown = text(parameter_table(fits[1]))
    for word in ("time_constant", " ms", " s ", "gas_preload", "lbf", "0.1 to 10 ms"):
        assert word in shown


@pytest.mark.nightly
@pytest.mark.parametrize("count", [1, 3])
def test_a_plot_is_written_whole(fits, tmp_path, count):
    path = tmp_path / "plots" / "fit.png"
    plot_force_velocity(fits[0] if count == 1 else fits, path)
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert [p.name for p in path.parent.iterdir()] == ["fit.png"]


def test_the_fit_states_the_error_of_its_static_curve_alone(fits, curve, law_record):
    record = law_record(Lpf1(curve, 1.3e-3), 1)
    static, lagged = (fit.shock for fit in fits[:2])
    assert static.fit["percent_of_static_curve"] == static.fit["percent"]
    alone = replace(lagged, law=Polylinear(lagged.law.curve, port=lagged.law.port))
    assert lagged.fit["percent_of_static_curve"] == pytest.approx(evaluate(alone, record).percent, rel=1e-6)
    assert lagged.fit["percent_of_static_curve"] > 2.0 * lagged.fit["percent"]
