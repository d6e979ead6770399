"""Tests of exported shock curves: read back equal, within the stated error, rising, and with a message if refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from scipy.io import loadmat

from eightpost.__main__ import main
from eightpost.errors import InputError, ParameterError
from eightpost.ident.shock_table import TABLE_FORMATS, TableSetting, shock_table, table_points
from eightpost.rig.peak_velocity import read_peak_velocity
from eightpost.shock import (
    LAWS,
    Axis,
    Lpf1,
    Lpnl2,
    Polylinear,
    Port,
    Settings,
    Shock,
    ShockLaw,
    StaticCurve,
    Term,
    fit_parameters,
    own_parameters,
    parameter_units,
    read_shock,
    write_shock,
)
from eightpost.shock.law import valve_force
from eightpost.signals.formats import read_record
from tests.shock.example_curve import curve, knot_curve

PORT = Port(motion_ratio=0.7, compression_scale=1.1, gas_preload=210.0, gas_stiffness=900.0, seal_friction=35.0)


def written(folder: Path, name: str, scale: float = 1.0, **changes: Any) -> Path:
    law = Lpnl2(curve(**changes), 1.3e-3, 2500.0, 4400.0, port=replace(PORT, rebound_scale=scale))
    path = folder / f"{name}.json"
    write_shock(Shock(name, law, {"build": "B7", "clicks": "4 from closed"}), path)
    return path


def exported(*words: object) -> Result:
    return CliRunner().invoke(main, ["export", *(str(word) for word in words)])


def succeeded(*words: object) -> str:
    result = exported("-v", *words)
    assert result.exit_code == 0, result.output
    return " ".join(result.output.split())


def refused(*words: object) -> str:
    result = exported(*words)
    assert result.exit_code == 2, result.output
    return str(result.output)


@pytest.fixture
def shock(tmp_path: Path) -> Path:
    return written(tmp_path, "front")


@pytest.fixture
def clicks(tmp_path: Path) -> list[Path]:
    """Three shocks, not in the order of their clicks."""
    return [written(tmp_path, f"c{k}", scale) for k, scale in ((8, 1.8), (0, 1.0), (4, 1.4))]


def numbers(lines: list[str]) -> np.ndarray:
    return np.array([[float(word) for word in line.split()] for line in lines])


# ---- Choice of points -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("error", [1e-4, 1e-2])
@pytest.mark.parametrize("kind", [Polylinear, Lpnl2])
def test_a_table_of_a_curve_through_knots_rises_and_is_within_the_permitted_error(
    kind: type[ShockLaw], error: float
) -> None:
    own = {entry.name: entry.start for entry in fit_parameters(kind)}
    shape = knot_curve()
    cubic = replace(shape, knot_slope=tuple(0.8 * slope for slope in shape.knot_slope))  # its cells are not quadratic
    for law in (kind(shape, **own), kind(cubic, port=Port(rebound_scale=1.3), **own)):
        check_table(law, error)


def check_table(law: ShockLaw, error: float) -> None:
    shape = law.curve
    velocity, force, found = table_points([law], error=error)
    assert found <= error
    assert (np.diff(velocity) > 0.0).all()
    assert 0.0 in velocity
    assert (np.diff(force[0]) > 0.0).all()
    assert (velocity[0], velocity[-1]) == (-shape.rebound_speed, shape.compression_speed)
    tried = np.random.default_rng(1).uniform(velocity[0], velocity[-1], 400)
    exact = np.array([valve_force(law.valve, v) for v in tried.tolist()])
    assert np.abs(np.interp(tried, velocity, force[0]) - exact).max() <= error * np.ptp(force)


def test_a_smaller_permitted_error_gives_more_points_and_they_are_dense_where_the_curve_bends() -> None:
    law = Polylinear(curve())
    coarse, fine = (table_points([law], error=error)[0] for error in (1e-2, 1e-4))
    assert coarse.size < 20 < fine.size < 200
    bend = np.abs(np.abs(fine) - 0.381) < 0.02
    assert np.diff(fine)[bend[1:]].min() < 0.5 * np.median(np.diff(fine))


def test_a_higher_speed_continues_the_straight_lines_beyond_the_fit() -> None:
    shape = curve()
    velocity, force, _ = table_points([Polylinear(shape)], speed=3.0)
    assert (velocity[0], velocity[-1]) == (-3.0, 3.0)
    assert force[0, -1] == pytest.approx(shape.force(1.2) + 3000.0 * 1.8)


@pytest.mark.parametrize(("words", "message"), [({"error": 0.0}, "between"), ({"speed": -1.0}, "-1 m/s")])
def test_an_impossible_choice_of_points_is_refused(words: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        table_points([Polylinear(curve())], **words)


# ---- Formats, read back ---------------------------------------------------------------------------------------------


def test_csv_is_read_back_by_eightpost_with_all_digits(shock: Path, tmp_path: Path) -> None:
    succeeded(shock, "-o", tmp_path / "t.csv")
    table = shock_table([shock])
    record = read_record(tmp_path / "t.csv")
    assert record.names == ("velocity", "force")
    assert record.units == ("m/s", "N")
    np.testing.assert_array_equal(np.array(record.columns, dtype=float), [table.velocity, table.force[0]])


@pytest.mark.parametrize("name", TABLE_FORMATS)
def test_every_format_states_signs_units_parameters_and_what_it_omits(shock: Path, tmp_path: Path, name: str) -> None:
    path = tmp_path / "file.any"
    printed = succeeded(shock, "--format", name, "-o", path)
    text = "\n".join(loadmat(path, simplify_cells=True)["comments"]) if name == "mat" else path.read_text()
    for words in ("gas force 210 N", "seal friction 35 N", "LPNL2", "time_constant 0.0013 s", "within", "build B7"):
        assert words in text
        assert words in printed
    assert "velocity and force are positive in" in text
    assert "motion ratio 0.7 is not" in text


@pytest.mark.repeated
@pytest.mark.parametrize("law", LAWS)
def test_the_shock_of_every_law_is_exported_in_every_format_with_all_its_own_parameters(
    shocks: dict[str, Shock], tmp_path: Path, law: str
) -> None:
    path, shock = tmp_path / f"{law}.json", shocks[law]
    write_shock(shock, path)
    printed = {name: succeeded(path, "--format", name, "-o", tmp_path / name) for name in TABLE_FORMATS}
    units = parameter_units(type(shock.law))
    for name in own_parameters(type(shock.law)):
        value = getattr(shock.law, name)
        numbers = " ".join(f"{one:.6g}" for one in (value if isinstance(value, tuple) else (value,)))
        assert all(f"{name} {numbers} {units[name]}" in text for text in printed.values())
    table = shock_table([path])
    forces = [valve_force(shock.law.valve, v) for v in table.velocity.tolist()]
    np.testing.assert_array_equal(table.force[0], forces)


def test_shocks_of_different_laws_and_curves_make_one_table(shocks: dict[str, Shock], tmp_path: Path) -> None:
    names = ("lpnl2", "hysteresis", "lpf1")
    for name in names:
        write_shock(shocks[name], tmp_path / f"{name}.json")
    table = shock_table([tmp_path / f"{name}.json" for name in names], over="gas pressure=1,2,3")
    assert table.names == names
    assert table.error <= 1e-3
    assert (np.diff(table.force, axis=1) > 0.0).all()


def test_a_curve_that_falls_is_exported_with_a_remark(tmp_path: Path) -> None:
    falling = written(tmp_path, "falls", inner=(1800.0, 60.0, -400.0, *[0.0] * 11, -900.0))
    assert "the curve falls at -0.3676 m/s, and so does the table" in succeeded(falling, "-o", tmp_path / "t.csv")
    assert "the curve falls" not in succeeded(written(tmp_path, "rises"), "-o", tmp_path / "t.csv")


def test_without_a_record_the_file_states_the_error_of_the_table_on_the_loop_of_the_law(tmp_path: Path) -> None:
    """F + tau F' = C v on a sine: the error of the table C v is omega tau times the force, omega = v / 25 mm."""
    speeds = np.linspace(-0.5, 0.5, 25)
    line = StaticCurve.through_knots(tuple(speeds), tuple(3000.0 * speeds), (3000.0,) * 25)
    write_shock(Shock("line", Lpf1(line, time_constant=5e-3)), tmp_path / "line.json")
    stated = "error of this table on the law's own loop, a sine of 25 mm and 0.5 m/s: 10 % of the force's"
    assert stated in succeeded(tmp_path / "line.json", "-o", tmp_path / "t.csv")
    assert f"# {stated}" in (tmp_path / "t.csv").read_text()


def test_with_a_record_the_file_states_the_error_of_the_table_beside_that_of_the_law(tmp_path: Path) -> None:
    fit = {"percent": 0.52, "percent_of_static_curve": 24.1}
    write_shock(Shock("front", Polylinear(knot_curve()), fit=fit), tmp_path / "front.json")
    stated = "error of this table on the records of the fit: 24 %, that of the law 0.52 % of the force's"
    assert stated in succeeded(tmp_path / "front.json", "-o", tmp_path / "t.csv")


# ---- One shock over its settings ------------------------------------------------------------------------------------


@pytest.fixture
def adjustable(tmp_path: Path) -> Path:
    """A shock with a rebound adjuster and a temperature."""
    axes = (Axis("rebound", (0.0, 4.0, 8.0), 4.0, highest=12.0), Axis("temperature", (300.0, 340.0), 300.0, unit="K"))
    rebound = tuple((size,) * 12 + (0.0,) * 14 for size in (400.0, 0.0, -150.0))
    terms = (Term(("rebound",), rebound), Term(("temperature",), ((0.0,) * 26, (-60.0,) * 26)))
    tested = ((0.0, 300.0), (4.0, 300.0), (8.0, 300.0), (4.0, 340.0))
    law = Lpnl2(knot_curve(), 1.3e-3, 2500.0, 4400.0, port=PORT)
    path = tmp_path / "adjustable.json"
    write_shock(Shock("adjustable", law, settings=Settings(axes, (), terms, tested, ((1.0,) * 25,) * 4)), path)
    return path


@pytest.mark.parametrize(
    ("over", "values"), [("rebound=8,0,6", (0.0, 6.0, 8.0)), ("temperature [degC]=60,30", (30.0, 60.0))]
)
def test_a_shock_over_its_settings_is_one_table_of_the_curves_at_them(
    adjustable: Path, tmp_path: Path, over: str, values: tuple[float, ...]
) -> None:
    succeeded(adjustable, "--over", over, "-o", tmp_path / "t.csv")
    record = read_record(tmp_path / "t.csv")
    table = np.array(record.columns, dtype=float)
    shock = read_shock(adjustable)
    for k, value in enumerate(values, start=1):
        at = {"clicks": {"rebound": value}} if over.startswith("rebound") else {"temperature": value + 273.15}
        law = shock.at(**at).law  # type: ignore[arg-type]
        assert table[k] == pytest.approx([valve_force(law.valve, v) for v in table[0].tolist()], rel=1e-12)
    assert not np.array_equal(table[1], table[2])


def test_an_exported_csv_is_read_back_as_peak_velocity_tables_of_the_same_forces(
    adjustable: Path, tmp_path: Path
) -> None:
    succeeded(adjustable, "--over", "rebound=0,8", "-o", tmp_path / "t.csv")
    table = shock_table([adjustable], over="rebound=0,8")
    tables = read_peak_velocity(tmp_path / "t.csv")
    assert [float(str(each.clicks).split("=")[1]) for each in tables] == [0.0, 8.0]
    for each, force in zip(tables, table.force, strict=True):
        for side, found in ((1.0, each.compression), (-1.0, each.rebound)):
            expected = np.interp(side * each.speed, table.velocity, force)
            np.testing.assert_allclose(found, expected, atol=1e-9 * np.ptp(force))


def test_the_file_says_which_of_its_settings_were_not_measured(adjustable: Path, tmp_path: Path) -> None:
    printed = succeeded(adjustable, "--over", "rebound=0,10", "-o", tmp_path / "t.mat")
    assert "rebound = 0: usable: the setting is within the measured ones" in printed
    assert "rebound = 10: usable within limits: the setting is beyond the measured ones" in printed
    assert "that of the reference setting, rebound 4" in succeeded(adjustable, "-o", tmp_path / "t.dpr")


# ---- Refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["dpr", "carmaker"])
def test_a_format_of_one_shock_refuses_several(clicks: list[Path], tmp_path: Path, name: str) -> None:
    message = refused(*clicks, "--over", "clicks=8,0,4", "--format", name, "-o", tmp_path / "t")
    assert "has one shock, not 3" in message
    assert not (tmp_path / "t").exists()


def test_several_shocks_need_a_setting_and_one_shock_has_none(clicks: list[Path], tmp_path: Path) -> None:
    assert "--over clicks=0,4,8" in refused(*clicks, "-o", tmp_path / "t.csv")
    assert "measured at one setting" in refused(clicks[0], "--over", "clicks=1,2", "-o", tmp_path / "t.csv")


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ("rebound=4", "one value"),
        ("clicks=0,4", "has no 'clicks', but rebound, temperature"),
        ("rebound=0,99", "beyond the adjuster's stops"),
        ("temperature [mm]=1,2", "dimensions differ"),
    ],
)
def test_a_setting_that_a_shock_does_not_have_is_refused(
    adjustable: Path, tmp_path: Path, over: str, message: str
) -> None:
    assert message in refused(adjustable, "--over", over, "-o", tmp_path / "t.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [("clicks", "no name"), ("clicks=a,b", "not a list"), ("clicks=1", "1 values for 2"), ("clicks=1,1", "different")],
)
def test_an_impossible_setting_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        TableSetting.parse(text, 2)


def test_an_unknown_suffix_is_refused_with_the_suffixes_and_replaces_nothing(shock: Path, tmp_path: Path) -> None:
    path = tmp_path / "t.xls"
    path.write_text("mine")
    assert ".dpr (dpr)" in refused(shock, "-o", path)
    assert path.read_text() == "mine"


def test_a_vehicle_among_shocks_and_options_of_the_other_kind_are_refused(shock: Path, tmp_path: Path) -> None:
    other = tmp_path / "vehicle.json"
    other.write_text('{"kind": "vehicle"}')
    assert "is not a shock file" in refused(shock, other, "-o", tmp_path / "t.csv")
    assert "does not apply to shocks" in refused(shock, "--high", "20 Hz", "-o", tmp_path / "t.csv")
    assert "does not apply to vehicles" in refused(other, "--over", "a=1", "-o", tmp_path / "t.mat")
