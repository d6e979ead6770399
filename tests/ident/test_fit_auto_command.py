"""`eightpost fit` chooses the law by default, prints the comparison and stores it."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.shock import LAWS, Lpf1, law_title


@pytest.fixture
def dyno(tmp_path, monkeypatch, rising, law_record):
    monkeypatch.setattr("eightpost.ident.plot_force_velocity", lambda *_: None)
    series = law_record(Lpf1(rising, 3e-3), 1, rate=500.0).series.window(2.0, 6.0)
    rows = zip(series.time - series.time[0], series["velocity"], series["force"], strict=True)
    text = "time [s],velocity [m/s],force [N]\n" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in rows)
    (tmp_path / "dyno.csv").write_text(text)
    return tmp_path / "dyno.csv"


def fitted(dyno, *words):
    output = dyno.with_suffix(".json")
    shown = CliRunner().invoke(main, ["fit", str(dyno), "-o", str(output), *words])
    assert shown.exit_code == 0, shown.output
    return shown.output, output.read_bytes()


@pytest.mark.nightly
def test_the_default_compares_all_laws_and_the_same_input_gives_the_same_bytes(dyno):
    shown, written = fitted(dyno)
    shock = json.loads(written)
    assert shock["law"] == "lpf1"
    assert "Choice of the law" in shown
    assert all(law_title(law) in shown for law in LAWS)
    assert f"{shock['fit']['law_choice']['reason']}." in shown
    assert "choice of the law" in {reason["about"] for reason in shock["validity"]["verdict"]["reasons"]}
    assert fitted(dyno, "--law", "auto")[1] == written


@pytest.mark.nightly
def test_a_law_by_name_and_the_dissertations_recipe_compare_nothing(dyno):
    for words, law in (("--law", "lpf1"), "lpf1"), (("--recipe", "boggs"), "lpnl2"):
        shown, written = fitted(dyno, *words)
        assert "Choice of the law" not in shown
        assert json.loads(written)["law"] == law
        assert "law_choice" not in json.loads(written)["fit"]
