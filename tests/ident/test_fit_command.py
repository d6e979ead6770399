"""`eightpost fit`: tables and runs of a file are fitted, and suspicious records are reported."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

from eightpost.__main__ import main
from eightpost.ident import fit_shock, fit_table
from eightpost.ident.validation.shock_tests import evaluate
from eightpost.shock import Lpf1, Polylinear
from eightpost.verdict import Verdict

HEADER = "time [s],velocity [m/s],force [N],temperature [degC]\n"


def table(record, *, duration, warming=0.0, spike=0.0):
    series = record.series.window(2.0, 2.0 + duration)
    time = series.time - series.time[0]
    force = series["force"].copy()
    force[force.size // 2] += spike
    columns = (time, series["velocity"], force, 30.0 + warming * time / duration)
    return HEADER + "".join(",".join(f"{value:.7g}" for value in row) + "\n" for row in zip(*columns, strict=True))


@pytest.fixture
def record(curve, law_record):
    return law_record(Lpf1(curve, 1.3e-3), 1, rate=500.0)


@pytest.fixture
def fit(tmp_path):
    def call(text, *words):
        (tmp_path / "dyno.csv").write_text(text)
        output = tmp_path / "shock.json"
        arguments = ["fit", str(tmp_path / "dyno.csv"), "--law", "polylinear", "-o", str(output), *words]
        shown = CliRunner().invoke(main, arguments)
        assert shown.exit_code == 0, shown.output
        return shown.output, json.loads(output.read_text())

    return call


def test_the_temperatures_of_a_record_are_on_the_screen_and_in_the_file(fit, record, tmp_path):
    shown, shock = fit(table(record, duration=3.0, warming=20.0))
    assert not list(tmp_path.glob("*.png"))
    verdict = Verdict.from_json(shock["validity"]["verdict"])
    assert any(" to 4" in reason.figure and "degC" in reason.figure for reason in verdict.reasons)
    assert "degC" in shown


@pytest.mark.nightly
def test_the_tables_of_a_file_are_fitted_together_and_a_note_names_its_run(fit, record):
    clean, torn = table(record, duration=3.0), table(record, duration=3.0, spike=1e4)
    shown, shock = fit(f"{clean}\n{torn}")
    assert "2 runs are fitted together" in shown
    assert shock["fit"]["runs"] == 2
    assert len(shock["inputs"]) == 1
    assert any(w.startswith("run 2: ") and "jump" in w for w in shock["fit"]["warnings"])
    assert not any(w.startswith("run 1: ") for w in shock["fit"]["warnings"])


@pytest.mark.nightly
def test_a_record_is_split_into_its_runs_only_on_request(fit):
    time = np.arange(500 * 8) / 500.0
    amplitude = np.select([time < 3.0, time < 5.0], [0.01, 0.0], 0.02)
    phase = 4.0 * np.pi * time
    channels = (amplitude * np.sin(phase), 4.0 * np.pi * amplitude * np.cos(phase))
    rows = zip(time, *channels, 2000.0 * channels[1] + 100.0, strict=True)
    header = "time [s],displacement [m],velocity [m/s],force [N]\n"
    text = header + "".join(",".join(f"{value:.7g}" for value in row) + "\n" for row in rows)
    assert fit(text)[1]["fit"]["runs"] == 1
    assert fit(text, "--split")[1]["fit"]["runs"] == 2


def test_the_held_out_error_is_a_line_on_the_screen_and_a_picture_is_drawn_on_request(fit, record, tmp_path):
    shown, shock = fit(table(record, duration=3.0), "--plot", str(tmp_path / "curve.png"))
    error = f"held out {shock['fit']['held_out']['percent']:.3g} % of the force's standard deviation (LPNL2: "
    assert error in " ".join(shown.split())
    assert (tmp_path / "curve.png").stat().st_size > 10_000


def test_the_removed_choice_is_named_with_the_way_out(tmp_path, record):
    (tmp_path / "dyno.csv").write_text(table(record, duration=3.0))
    shown = CliRunner().invoke(main, ["fit", str(tmp_path / "dyno.csv"), "--law", "auto"])
    assert shown.exit_code == 2
    assert "the choice among laws was removed; omit the law, or choose from polylinear" in shown.output


def text(table):
    console = Console(file=io.StringIO(), width=140)
    console.print(table)
    return console.file.getvalue()


@pytest.fixture(scope="module")
def fits(curve, law_record, smooth_fit):
    record = law_record(Lpf1(curve, 1.3e-3), 1)
    static, faded = (fit_shock(record, law, name="build 1") for law in ("polylinear", "lpnl2"))
    return [static, smooth_fit, faded]


def test_the_table_has_what_table_3_4_has(fits):
    shown = text(fit_table(fits))
    for word in ("Polylinear", "LPF1", "LPNL2", "RMS, lbf", "RMS, N", "% of std", "% less than static", "time, s"):
        assert word in shown
    assert f"{100.0 * (1.0 - fits[1].rms / fits[0].rms):.1f}" in shown


def test_the_fit_states_the_error_of_its_static_curve_alone(fits, curve, law_record):
    record = law_record(Lpf1(curve, 1.3e-3), 1)
    static, lagged = (fit.shock for fit in fits[:2])
    assert static.fit["percent_of_static_curve"] == static.fit["percent"]
    alone = replace(lagged, law=Polylinear(lagged.law.curve, port=lagged.law.port))
    assert lagged.fit["percent_of_static_curve"] == pytest.approx(evaluate(alone, record).percent, rel=1e-6)
    assert lagged.fit["percent_of_static_curve"] > 2.0 * lagged.fit["percent"]
