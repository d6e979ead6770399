"""`eightpost fit` of a table of peak velocities: a polylinear shock for each setting, through the table's points."""

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.shock import Polylinear, read_shock

TABLE = (
    "speed (mm/s),comp 3 (N),reb 3 (N),comp 6 (N),reb 6 (N)\n"
    "50,200,250,120,160\n150,420,560,300,400\n300,600,840,450,640\n500,760,1150,600,900\n"
)


def fit(*words):
    shown = CliRunner().invoke(main, ["fit", *map(str, words)], env={"COLUMNS": "200"})
    return shown.exit_code, shown.output


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "valve.csv"
    path.write_text(TABLE)
    return path


@pytest.mark.nightly
def test_each_setting_becomes_a_shock_through_its_points(table, tmp_path):
    code, shown = fit(table, "-o", tmp_path / "valve.json", "--build", "V17", "--plot", tmp_path / "valve.png", "-v")
    assert code == 0, shown
    assert "joined by a monotone interpolant" in shown
    assert (tmp_path / "valve.png").stat().st_size > 10_000
    for clicks, force in (("3", 600.0), ("6", 450.0)):
        shock = read_shock(tmp_path / f"valve_{clicks}.json")
        assert isinstance(shock.law, Polylinear)
        assert shock.conditions["build"] == "V17"
        assert shock.name == f"valve {clicks}"
        np.testing.assert_allclose(shock.law.curve.force(0.3), force, rtol=0.03)


def test_a_table_of_one_setting_is_written_to_the_named_file(tmp_path):
    path = tmp_path / "one.csv"
    path.write_text("speed (m/s),comp (N),reb (N)\n.05,100,-200\n.1,180,-330\n.25,300,-500\n")
    code, shown = fit(path, "-o", tmp_path / "one.json", "--law", "polylinear")
    assert code == 0, shown
    assert read_shock(tmp_path / "one.json").name == "one"


def test_a_law_with_dynamics_is_refused_and_nothing_is_written(table, tmp_path):
    code, shown = fit(table, "--law", "lpnl2", "-o", tmp_path / "valve.json")
    assert code == 2
    assert "no information on lag" in shown
    assert sorted(path.name for path in tmp_path.iterdir()) == ["valve.csv"]


def test_a_table_together_with_another_file_is_refused(table, tmp_path):
    code, shown = fit(table, table, "-o", tmp_path / "valve.json")
    assert code == 2
    assert "fit it alone" in shown


@pytest.mark.nightly
def test_the_gas_force_of_a_table_is_kept_left_out_or_part_of_the_curve(tmp_path):
    """150 N of gas: both strokes of a symmetric valve are shifted by it, and the points at rest show it."""
    path = tmp_path / "gas.csv"
    path.write_text("speed (m/s),comp (N),reb (N)\n0,150,150\n.02,250,-50\n.1,450,-150\n.25,750,-450\n")
    shocks = {}
    for gas in ("estimate", "included", "subtracted"):
        code, shown = fit(path, "--gas", gas, "-o", tmp_path / f"{gas}.json")
        assert code == 0, shown
        shocks[gas] = read_shock(tmp_path / f"{gas}.json").law
    assert {gas: law.port.gas_preload for gas, law in shocks.items()} == {
        "estimate": pytest.approx(150.0), "included": 0.0, "subtracted": 0.0,
    }  # fmt: skip
    for gas, offset in (("estimate", 150.0), ("included", 150.0), ("subtracted", 0.0)):
        np.testing.assert_allclose(shocks[gas].curve.force(0.25), 750.0 - offset, rtol=0.03)
