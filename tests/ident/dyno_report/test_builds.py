"""Files are grouped into builds, builds are compared with the reference, and repeated runs with each other."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eightpost.errors import InputError, ParameterError
from eightpost.files import sha256_of
from eightpost.ident.dyno_report.builds import (
    SPEEDS,
    CarCorner,
    Reading,
    corners_of_car,
    deviation_of,
    dyno_report,
    heat_effect,
    read_entries,
    repeated_runs,
    short_names,
)
from eightpost.ident.dyno_report.cycles import STROKES, Cycles, Unknown
from eightpost.ident.dyno_report.entry import entry_of_shock, entry_of_table, entry_of_test
from eightpost.ident.dyno_report.page import difference_table, loop_table, peak_table, repeat_table
from eightpost.rig import PeakVelocityTable
from eightpost.shock import Hysteresis, Polylinear, Port, Shock, read_shock, write_shock
from eightpost.units import convert
from eightpost.validity import judged
from tests.shock.example_curve import knot_curve

from .conftest import run, sine, two_lines, valve, viscous

ROOT = Path(__file__).parents[3]
DATA, BANK = ROOT / "examples" / "data", sorted((ROOT / "examples" / "bank").glob("*.json"))


def entry(name, build, rate=2000.0, *, amplitude=0.025, heat=None, **conditions):
    series = sine(valve(viscous(rate), viscous(2.0 * rate), gas=80.0), amplitude=amplitude, heat=heat, duration=3.0)
    return entry_of_test(run(series, **conditions), name, build)


def written(path, *, build=None, clicks=None, rate=2000.0, flip=1.0):
    """Write the record of a sine as a text file with a preamble."""
    series = sine(valve(viscous(rate), viscous(rate)), duration=3.0, rate=400.0)
    above = [f"Build: {build}"] * bool(build) + [f"Clicks: {clicks}"] * bool(clicks)
    rows = [f"{t:.6g},{x:.9g},{flip * f:.9g}" for t, x, f in
            zip(series.time, series["displacement"], series["force"], strict=True)]  # fmt: skip
    path.write_text("\n".join([*above, "Time [s],Displacement [m],Force [N]", *rows]) + "\n")
    return path


def known_shock(**conditions):
    shock = read_shock(BANK[0])
    return judged(shock, conditions={**shock.conditions, **conditions})


# ---- Builds ---------------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_the_build_is_the_given_one_else_that_in_the_file_else_the_name_of_the_file(tmp_path):
    a, b, c = (written(tmp_path / f"{name}.csv", build=build) for name, build in
               (("a", "front"), ("b", None), ("c", "rear")))  # fmt: skip
    found = read_entries([a, b, c], Reading(builds={"c.csv": "spare"}))
    assert [one.setting.build for one in found] == ["front", "b", "spare"]


@pytest.mark.nightly
def test_a_shock_belongs_to_the_build_of_the_record_that_it_was_fitted_to(tmp_path):
    record = written(tmp_path / "run.csv", build="front")
    inputs = ({"name": "run.csv", "sha256": sha256_of(record)},)
    write_shock(replace(known_shock(), inputs=inputs), tmp_path / "fitted.json")
    write_shock(replace(known_shock(build="rear"), inputs=inputs), tmp_path / "stated.json")
    write_shock(replace(known_shock(), inputs=()), tmp_path / "lonely.json")
    found = read_entries([*tmp_path.glob("*.json"), record], Reading())
    assert {one.name: one.setting.build for one in found} == {
        "run": "front", "fitted": "front", "stated": "rear", "lonely": "lonely",
    }  # fmt: skip


def test_clicks_divide_a_build_and_a_law_without_clicks_joins_the_only_ones(tmp_path):
    entries = [entry("1", "A", clicks="3"), entry("2", "A", clicks="6"), entry("3", "B", clicks="3")]
    law = entry_of_shock(known_shock(), "law", "B")
    report = dyno_report([*entries, law])
    assert [variant.label for variant in report.variants] == ["A, 3", "A, 6", "B"]
    assert [one.name for one in report.variants[2].entries] == ["3", "law"]


def test_one_file_can_be_flipped_and_clicks_be_given(tmp_path):
    right, wrong = written(tmp_path / "right.csv"), written(tmp_path / "wrong.csv", flip=-1.0)
    found = read_entries([right, wrong], Reading(flip={"wrong.csv": ("force",)}, clicks={"wrong": "5"}))
    forces = [one.curve.force_at(0.1, "compression") for one in found]
    assert forces == pytest.approx([200.0, 200.0], rel=0.01)
    assert found[1].setting.clicks == "5"


def test_the_name_of_a_record_states_its_clicks_and_a_record_may_be_json(tmp_path):
    record = written(tmp_path / "front_12clicks.csv")
    columns = np.loadtxt(record, delimiter=",", skiprows=1).T.tolist()
    names = ("Time [s]", "Displacement [m]", "Force [N]")
    path = tmp_path / "front_3clicks.json"
    path.write_text(json.dumps(dict(zip(names, columns, strict=True))))
    found = read_entries([record, path], Reading())
    assert [one.setting.clicks for one in found] == ["12 clicks", "3 clicks"]
    assert found[1].curve.force_at(0.1, "rebound") == pytest.approx(found[0].curve.force_at(0.1, "rebound"))


def test_names_of_entries_are_unique(tmp_path):
    (tmp_path / "x").mkdir()
    record, other = written(tmp_path / "run.csv"), written(tmp_path / "x" / "run.csv")
    write_shock(known_shock(), tmp_path / "run.json")
    found = read_entries([record, other, tmp_path / "run.json"], Reading())
    assert [one.name for one in found] == ["run", "run (2)", "run lpnl2"]


@pytest.mark.parametrize(
    "reading", [Reading(builds={"q": "A"}), Reading(clicks={"q": "3"}), Reading(flip={"q": ("f",)})]
)
def test_an_option_for_a_file_that_is_not_given_is_an_error(reading):
    with pytest.raises(InputError, match=r"'q' is not one of the files: run\.csv"):
        reading.check([Path("run.csv")])


def test_no_file_is_an_error():
    with pytest.raises(InputError, match="there is no file"):
        read_entries([], Reading())


# ---- Tables and laws ------------------------------------------------------------------------------------------------


def test_a_table_has_its_points_and_no_figure_that_needs_time():
    speed = np.linspace(0.02, 0.5, 25)
    line = two_lines(5000.0, 1000.0, 0.13)(speed)
    found = entry_of_table(PeakVelocityTable(speed, line, -0.5 * line, clicks="3"), "t", "A")
    one = found.strokes["compression"]
    assert (one.knee, one.low, one.high) == pytest.approx((0.13, 5000.0, 1000.0), rel=1e-6)
    assert found.strokes["rebound"].low == pytest.approx(2500.0, rel=1e-6)
    for figure in (found.cycles, found.lag, found.slow.friction, found.warming.energy):
        assert isinstance(figure, Unknown) and "no time" in figure.reason
    assert isinstance(found.slow.gas_force, Unknown)


def test_the_curve_of_a_law_is_that_of_the_law_with_its_seal_friction():
    law = read_shock(BANK[1]).law
    law = replace(law, port=Port(seal_friction=30.0, compression_scale=1.1))
    curve = entry_of_shock(Shock("s", law), "s", "s").curve
    for v in (0.05, 0.3, 0.9):
        for stroke, sign in zip(STROKES, (1.0, -1.0), strict=True):
            expected = law.response(law.static_force(sign * v), sign * v, 0.0).force
            assert curve.force_at(v, stroke) == pytest.approx(sign * expected, rel=2e-3)


def test_a_law_without_lag_has_no_time_constant_and_a_file_without_estimates_no_gas():
    shock = read_shock(BANK[0])
    found = entry_of_shock(Shock("s", Polylinear(shock.law.curve)), "s", "s")
    assert isinstance(found.lag, Unknown) and "Polylinear" in found.lag.reason
    assert isinstance(found.slow.gas_force, Unknown)
    assert entry_of_shock(shock, "s", "s").lag == shock.law.time_constant


def test_a_band_of_another_form_is_left_out():
    shock = read_shock(BANK[0])
    for band in (None, {"velocity [m/s]": "x"}, {"velocity [m/s]": [0, 1], "force [N]": [0, 1]}):
        assert entry_of_shock(judged(shock, fit={**shock.fit, "curve_band": band}), "s", "s").band is None
    good = entry_of_shock(shock, "s", "s").band
    half = np.array(shock.fit["curve_band"]["half_width [N]"])
    np.testing.assert_allclose(good.high - good.low, 2.0 * half)


# ---- Comparisons ----------------------------------------------------------------------------------------------------


def test_differences_are_those_of_the_forces_from_the_build_of_the_first_file():
    (table,) = difference_table(dyno_report([entry("a", "A"), entry("b", "B", 2600.0)], speeds=[0.1, 0.2]))
    assert [row[:2] for row in table.rows] == [("B", stroke) for stroke in STROKES]
    for row, rate in zip(table.rows, (600.0, 1200.0), strict=True):
        for cell, speed in zip(row[2:], (0.1, 0.2), strict=True):
            change, share = re.search(r'class="si">(.*)</span> \((.*)\s%\)', cell).groups()
            assert float(change) == pytest.approx(rate * speed, rel=0.01)
            assert float(share) == pytest.approx(30.0, rel=0.02)


def test_measured_curves_are_not_compared_with_laws():
    law = entry_of_shock(known_shock(), "law", "L")
    (table,) = difference_table(dyno_report([entry("b", "B"), entry("a", "A"), law], speeds=[0.1]))
    assert {row[0] for row in table.rows} == {"A"}


def test_a_slow_run_does_not_represent_its_build():
    slow = entry("slow", "B", 9000.0, amplitude=0.01)
    (table,) = difference_table(dyno_report([entry("a", "A"), entry("b", "B", 2600.0), slow], speeds=[0.1]))
    assert "(30" in table.rows[0][2]


def test_repeated_runs_have_the_scatter_of_their_forces():
    rates = (1900.0, 2000.0, 2160.0)
    entries = [entry(str(rate), "A", rate) for rate in rates] + [entry("far", "A", amplitude=0.012)]
    report = dyno_report(entries, speeds=[0.1])
    (group,) = repeated_runs(report.variants[0])
    assert len(group) == 3
    for stroke, factor in zip(STROKES, (0.1, 0.2), strict=True):
        expected = factor * np.std(rates, ddof=1)
        assert deviation_of(group, 0.1, stroke) == pytest.approx(expected, rel=0.01)
    assert isinstance(deviation_of(group, 2.0, "rebound"), Unknown)
    (table,) = repeat_table(report)
    assert [row[:3] for row in table.rows] == [("A", "3", stroke) for stroke in STROKES]
    assert "(6.5" in table.rows[0][3]


def test_runs_at_other_gas_pressures_or_clicks_do_not_repeat_each_other():
    for conditions in ({"gas_pressure": 1e6}, {"clicks": "9"}):
        report = dyno_report([entry("a", "A"), entry("b", "A", **conditions)])
        assert not any(repeated_runs(variant) for variant in report.variants)


def test_long_names_are_without_their_common_beginning_up_to_a_separator():
    names = ["ohlins_t1_18_18_s5_150psi", "ohlins_t1_18_24_s5_100psi"]
    assert list(short_names(names).values()) == ["18_s5_150psi", "24_s5_100psi"]
    assert short_names(["run_1", "run_2"]) == {"run_1": "run_1", "run_2": "run_2"}
    assert short_names(names[:1]) == {names[0]: names[0]}
    assert list(short_names(["another_long_name_of_one", "b"]).values()) == ["another_long_name_of_one", "b"]


def test_the_effect_of_temperature_is_that_of_repeated_runs():
    hot = entry("hot", "A", 1800.0, heat=lambda t: 320.0 + 0.0 * t)
    cold = entry("cold", "A", 2000.0, heat=lambda t: 300.0 + 0.0 * t)
    effect = heat_effect(dyno_report([hot, cold]).variants[0])
    assert effect.per_kelvin == pytest.approx(np.log(0.9) / 20.0, rel=0.02)
    assert "(standard error unknown), from 2 repeated runs" in str(effect)
    assert heat_effect(dyno_report([entry("a", "A")]).variants[0]) is None


def test_speeds_are_the_given_ones_or_those_that_a_curve_reaches():
    one = entry("a", "A")  # up to 0.314 m/s, 12.4 in/s
    assert dyno_report([one]).speeds == SPEEDS[:5]
    assert dyno_report([one], speeds=[0.2, 0.1, 2.0]).speeds == (0.1, 0.2, 2.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"fitted_to": {"lf": "Q"}}, "--corner lf=Q"), ({"speeds": [-1.0]}, "--set speed must be above 0")],
)
def test_a_wrong_name_or_speed_is_an_error(options, message):
    with pytest.raises(InputError, match=message):
        dyno_report([entry("a", "A")], **options)


# ---- Cars and verdicts ----------------------------------------------------------------------------------------------


def test_corners_of_cars_have_their_static_weight():
    quarter = corners_of_car(ROOT / "examples" / "corner.toml", 0.8)
    assert len(quarter) == 1 and quarter[0].motion_ratio == 0.8
    assert quarter[0].mass == pytest.approx(convert(675.0, "lbm", "kg"))
    car = corners_of_car(ROOT / "examples" / "car.toml")
    assert [corner.name for corner in car] == ["lf", "rf", "lr", "rr"]
    total, a, b = convert(2550.0, "lbm", "kg"), 60.0, 50.0
    assert sum(corner.mass for corner in car) == pytest.approx(total)
    assert a * (car[0].mass + car[1].mass) == pytest.approx(b * (car[2].mass + car[3].mass))
    assert car[2].wheel_rate == pytest.approx(convert(588.0, "lbf/in", "N/m"))


def test_the_damping_ratio_of_the_dissertations_corner_is_that_of_its_damper():
    corner = corners_of_car(ROOT / "examples" / "corner.toml")[0]
    rate = convert(16.67, "lbf/(in/s)", "N.s/m")
    k, m = convert(1280.0, "lbf/in", "N/m"), convert(675.0, "lbm", "kg")
    assert corner.damping_ratio(rate) == pytest.approx(rate / (2.0 * np.sqrt(k * m)))
    assert isinstance(corner.damping_ratio(Unknown("no")), Unknown)


@pytest.mark.parametrize("values", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, 0.0)])
def test_a_corner_needs_positive_values(values):
    with pytest.raises(ParameterError, match="must be above 0"):
        CarCorner("lf", *values)


def test_the_lag_of_a_law_with_several_time_constants_is_that_at_zero_velocity():
    law = Hysteresis(knot_curve(), (0.0,) * 25, (0.004, 0.001, 0.002))
    one = entry_of_shock(Shock("new", law), "new", "front")
    assert one.lag == 0.001
    table = loop_table(dyno_report([one]))[0]
    place = [head for head, _ in table.heads].index("lag (ms)")
    assert table.rows[0][place].value == pytest.approx(1.0)


def test_the_peaks_of_both_strokes_are_without_the_level_of_the_force_and_with_their_scatter():
    """The gas force of 50 N raises the force in compression and lowers that in rebound; the last peak is a stop."""
    velocity = np.array([0.3, -0.2, 0.3, -0.2, -0.2, 0.1])
    force = np.array([640.0, -430.0, 660.0, -450.0, -470.0, 99.0])
    cycles = Cycles(velocity, force, 3, True, *(Unknown("no"),) * 4)
    random = replace(cycles, peak_velocity=np.array([0.1, 0.2, 0.3, 0.4]), peak_force=np.arange(4.0))
    assert random.peaks(1.0) == ()
    run = replace(
        entry("run", "A"), cycles=replace(cycles, peak_velocity=velocity * [1, 1.5, 1, 1.5, 1.5, 1]), level=50.0
    )
    (table,) = peak_table(dyno_report([run, replace(run, name="none", cycles=random)]))
    ((name, *cells, peaks),) = table.rows
    assert (name, peaks) == ("run", "3")
    expected = [0.3, 600.0, np.sqrt(200.0), 0.3, 500.0, 20.0, 500.0 / 600.0]
    assert [cell.value for cell in cells] == pytest.approx(expected)
