"""Results in a notebook: short, as tables, as pictures; and mistakes of newcomers."""

import sys
import time
from itertools import pairwise

import numpy as np
import pytest

import eightpost as ep
from eightpost.display import Summary, some
from eightpost.errors import InputError, MissingChannelError
from eightpost.extras import MissingExtraError
from eightpost.ident import fit_shock
from eightpost.shock import Port
from eightpost.signals import Drivefile, TimeSeries
from eightpost.vehicle import IdentifiedVehicle
from tests.unchanged import refusals

DATA = ep.examples() / "data"
BANK = ep.examples() / "bank"


@pytest.fixture(scope="module")
def test():
    return ep.read(DATA / "dyno_A.csv", "dyno")


@pytest.fixture(scope="module")
def fit(test):
    return ep.fit(test, "lpf1", gas="included")


@pytest.mark.repeated(2)
@pytest.mark.parametrize("file, kind", [
    ("data/dyno_A.csv", "DynoTest"), ("data/track.parquet", "Drivefile"), ("bank/B_B.json", "Shock"),
    ("car.toml", "StructuralVehicle"),
])  # fmt: skip
def test_a_file_is_read_as_what_it_is(file, kind):
    assert type(ep.read(ep.examples() / file)).__name__ == kind


def test_a_fit_equals_that_of_the_library_and_takes_paths(test, fit):
    alone = fit_shock(test, "lpf1", gas="included")
    assert fit.shock.law == alone.shock.law == ep.fit(str(DATA / "dyno_A.csv"), "lpf1", gas="included").shock.law


def test_a_fit_is_a_table_of_parameters_an_array_of_forces_and_a_picture(fit):
    table = fit.to_pandas()
    assert table["value"]["time_constant"] == fit.parameter("time_constant").value
    assert (table["low"] < table["value"]).all() and (table["value"] < table["high"]).all()
    forces = fit.to_xarray()
    error = forces["fitted_force"] - forces["measured_force"]
    assert float(np.sqrt((error**2).mean())) == pytest.approx(fit.rms, rel=0.05)
    assert forces["measured_force"].attrs["units"] == "N"
    assert fit.plot()._repr_png_().startswith(b"\x89PNG")
    assert len(repr(fit).splitlines()) <= 10


def test_a_record_is_a_table_and_a_picture(test, tmp_path):
    assert test.to_pandas().shape == (24001, 4)
    assert test.to_xarray()["force"].attrs["units"] == "N"
    test.plot().save(tmp_path / "test.png")
    assert (tmp_path / "test.png").read_bytes().startswith(b"\x89PNG")
    assert test.plot("force", stop=0.5).figure.axes[0].get_ylabel().startswith("force")  # over time if it is named
    assert len(repr(test).splitlines()) <= 10


def test_a_law_shows_its_own_parameters_and_where_its_curve_ends(fit):
    shown = repr(fit.shock.law)
    assert len(shown) < 250 and f"time_constant={fit.shock.law.time_constant!r}" in shown
    assert "StaticCurve: 25 knots" in shown and "N from -" in shown
    port = Port(gas_preload=3.0, motion_ratio=0.9)
    assert repr(port) == "Port(motion_ratio=0.9, gas_preload=3.0)"


def test_time_series_and_drive_files_are_drawn_over_time():
    drive = ep.read(DATA / "track.parquet", "drive")
    for one in (drive, drive.series):
        picture = one.plot(drive.names[:2], start=1.0, stop=2.0)
        assert [axes.get_ylabel().split("\n")[0] for axes in picture.figure.axes] == list(drive.names[:2])
        low, high = picture.figure.axes[0].lines[0].get_xdata()[[0, -1]]
        assert 1.0 <= low < high <= 2.0
        with pytest.raises(MissingChannelError):
            one.plot("lf.raod")


@pytest.fixture(scope="module")
def corner_run(fit, tmp_path_factory):
    """Return the result of a run, and the folder of its FMUs with the result in it."""
    folder = tmp_path_factory.mktemp("run")
    fmus = {"car": ep.build(ep.examples() / "corner.toml", folder), "shock": ep.build(fit, folder)}
    system = ep.System.load(fmus, bonds=[("car", "shock")], constants={"car.aero_force": 0.0})
    drive = Drivefile(TimeSeries.from_channels([0.0, 0.5, 1.0], {"road": ("m", [0.0, 0.01, 0.0])}))
    result = ep.run(system, ep.Scenario(stop=1.0, drive=drive, record_step=0.01), step=1e-3)
    result.write(folder / "result")
    return result, folder


def test_a_run_in_a_folder_has_the_tables_and_the_picture_of_its_result(corner_run):
    result, folder = corner_run
    saved = ep.read(folder / "result", "run")
    assert saved.to_pandas().equals(result.to_pandas())
    assert (saved.to_xarray()["car.tire_force"] == result["car.tire_force"]).all()
    assert saved.verdict.grade is result.verdict.grade and saved.order == result.order
    assert saved.plot("car.tire_force")._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=r"start = 5 s and stop = 4 s contain no sample; the channels cover 0 to 1 s"):
        saved.plot("car.tire_force", start=5.0, stop=4.0)


def test_everything_that_is_read_shows_itself_in_at_most_ten_lines(corner_run, fit, tmp_path):
    _, folder = corner_run
    table = "speed [in/s],compression [lbf],rebound [lbf]\n1,50,-60\n5,90,-120\n10,120,-180\n"
    (tmp_path / "pvp.csv").write_text(table)
    (tmp_path / "system.toml").write_text(
        f"schema = 1\nname = 'corner'\n[components]\ncar.fmu = '{folder / 'corner.fmu'}'\n"
        f"shock.fmu = '{folder / 'dyno_A.fmu'}'\n[[bond]]\nbetween = ['car', 'shock']\n[scenario]\nstop = '2 s'\n"
    )
    model = ep.read(ep.examples() / "corner.toml", "vehicle")
    identified = IdentifiedVehicle("corner", model.coupled(), {"": 900.0})
    given = (BANK / "B_B.json", DATA / "track.parquet", folder / "result")
    for one in (model, identified, fit.shock, *map(ep.read, (*given, tmp_path / "pvp.csv", tmp_path / "system.toml"))):
        lines = repr(one).splitlines()
        assert 2 <= len(lines) <= 10 and max(map(len, lines)) <= 120, f"{type(one).__name__}: {lines}"
        assert one._repr_html_().startswith("<table>")
    assert list(ep.read(tmp_path / "pvp.csv").to_pandas()["compression"].round()) == [222.0, 400.0, 534.0]
    assert list(ep.read(DATA / "track.parquet", "drive").to_pandas()) == list(ep.read(DATA / "track.parquet").names)


def test_columns_are_named_by_channel_in_a_mapping(folder):
    time = np.linspace(0.0, 2.0, 2001)
    rows = np.column_stack([time, np.sin(20.0 * time), 900.0 * np.sin(20.0 * time)])
    np.savetxt("named.csv", rows, delimiter=",", header="time [s],rod [m/s],cell 2 [N]", comments="")
    test = ep.read("named.csv", "dyno", channel_map={"velocity": "rod", "force": "cell 2"})
    assert np.array_equal(test.series["force"], rows[:, 2])


def test_a_shock_simulates_a_record_as_its_fit_does(test, fit):
    simulated = ep.simulate(fit, test)
    assert simulated.units == ("N",)
    assert (ep.simulate(fit.shock, test.series)["force"] == simulated["force"]).all()
    assert (ep.simulate(fit.shock.law, test)["force"] == simulated["force"]).all()


def test_an_fmu_is_built_from_a_fit_and_from_its_file(fit, tmp_path):
    built = ep.build(fit, tmp_path)
    (again,) = ep.build([fit.write(tmp_path / "same" / "dyno_A.json")], tmp_path / "same")
    assert built.path.read_bytes() == again.path.read_bytes()
    assert len(repr(built).splitlines()) <= 10
    system = ep.System.load({"shock": built})
    assert "dyno_A.fmu" in repr(system)


def test_a_missing_package_is_reported_with_the_extra_that_has_it(test, monkeypatch):
    for package in ("pandas", "xarray"):
        monkeypatch.setitem(sys.modules, package, None)
    for convert in (test.to_pandas, test.to_xarray):
        with pytest.raises(MissingExtraError, match=r'pip install "eightpost\[notebook\]"'):
            convert()


def test_a_display_cuts_long_values_and_escapes_html():
    summary = Summary.of("<b>", ("channels", some(f"channel_{k}" for k in range(100))), ("none", ""), ("x", "y" * 500))
    assert "... (100)" in summary.text()
    assert "none" not in summary.text()
    assert max(map(len, summary.text().splitlines())) < 120
    assert "&lt;b&gt;" in summary.html()


def test_every_stage_of_a_fit_is_reported_however_short_it_is(test):
    told = []
    ep.fit(test, "polylinear", gas="included", progress=lambda *amounts: told.append(amounts))
    assert told[0] == (0.0, 1.0) and told[-1] == (1.0, 1.0)
    shares = [done for done, _ in told]
    assert shares == sorted(shares) and {0.0, 0.2, 0.9, 1.0} <= set(shares)


def test_a_fit_that_takes_seconds_reports_several_times_per_second(test):
    times = [time.monotonic()]
    ep.fit(test, "lpnl2", gas="included", progress=lambda *_: times.append(time.monotonic()))
    assert len(times) > 4.0 * (times[-1] - times[0])
    assert max(after - before for before, after in pairwise(times)) < 0.5 * (times[-1] - times[0])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run7.csv").write_text("time [s],velocity [m/s],force [N]\n0,0,0\n")
    return tmp_path


#: Mistakes of newcomers.
MISTAKES = {
    "a misspelled file": lambda: ep.read("run8.csv"), "a folder that does not exist": lambda: ep.read("data/run8.csv"),
    "a kind that does not exist": lambda: ep.read("run7.csv", "dynamometer"),
    "a record of another kind": lambda: ep.read(DATA / "track.parquet", "dyno"),
    "a study that is read": lambda: ep.read(ep.examples() / "study.toml"),
    "units of a shock": lambda: ep.read(BANK / "B_B.json", units={"force": "N"}),
    "a law that does not exist": lambda: ep.fit(DATA / "dyno_A.csv", "lpf2"), "no test": lambda: ep.fit([]),
    "a number as a test": lambda: ep.fit(42), "an FMU of a record": lambda: ep.build(DATA / "dyno_A.csv", "x"),
    "an FMU of a list of numbers": lambda: ep.build([1.0], "x"),
    "a vehicle as a system": lambda: ep.run(ep.examples() / "car.toml"),
    "a vehicle as a study": lambda: ep.study(ep.examples() / "car.toml", "x"),
    "a system without a scenario": lambda: ep.run(ep.System({})),
    "a duration as the scenario": lambda: ep.run(ep.System({}), 5.0),
    "a scheme that does not exist": lambda: ep.run(ep.System({}), ep.Scenario(1.0), algorithm="gauss-seidl"),
    "seconds as a text": lambda: ep.Scenario(stop="5 s"),
    "a path as the drive": lambda: ep.Scenario(5.0, drive="lap.parquet"),
    "one channel to record": lambda: ep.Scenario(5.0, record="car.x"), "one run to compare": lambda: ep.compare([]),
    "a number to compare": lambda: ep.compare([1, 2]), "one rig test": lambda: ep.identify(["a.parquet"]),
    "a missing rig test": lambda: ep.identify(["a.parquet", "b.parquet"]),
    "a recipe that does not exist": lambda: ep.identify(["a", "b"], recipe="greybox"),
    "a baseline that is no test": lambda: ep.identify(["a", "b"], baseline=2),
    "no worker": lambda: ep.study("x", "y", workers=0), "a number to simulate": lambda: ep.simulate(5, 6),
    "nothing to build": lambda: ep.build([], "x"),
    "an FMU of a study": lambda: ep.build(ep.examples() / "study.toml", "x"),
    "units as a text": lambda: ep.read("run7.csv", units="force=N"),
    "a channel to flip": lambda: ep.read("run7.csv", flip="force"), "a folder without a run": lambda: ep.read(DATA),
    "a cutoff as a text": lambda: ep.fit(DATA / "dyno_A.csv", cutoff="9"),
    "a frequency as a text": lambda: ep.fit(DATA / "dyno_A.csv", cutoff="20 Hz"),
    "a duration as the segment": lambda: ep.fit(DATA / "dyno_A.csv", segment=5),
    "a step as a text": lambda: ep.run(ep.System({}), ep.Scenario(1.0), step="1 ms"),
    "a tolerance as a text": lambda: ep.run(ep.System({}), ep.Scenario(1.0), tolerance="1 %"),
    "a system of nothing": lambda: ep.run(ep.System({}), ep.Scenario(1.0)), "no file at all": lambda: ep.read(None),
    "a list as a channel map": lambda: ep.read("run7.csv", channel_map=["force"]),
    "a number as rig tests": lambda: ep.identify(3), "workers as a text": lambda: ep.study("x", "y", workers="2"),
    "nothing as a study": lambda: ep.study(None, "y"),
    "an engine that does not exist": lambda: ep.run(ep.System({}), ep.Scenario(1.0), engine="pyton"),
}  # fmt: skip


def test_a_mistake_is_an_error_of_the_call_that_says_what_to_do(folder, test, fit, unchanged):
    drive = ep.read(DATA / "track.parquet", "drive")
    unchanged(refusals(MISTAKES | {
        "a run that is too long for its drive": lambda: ep.Scenario(stop=500.0, drive=drive),
        "a channel that does not exist": lambda: test.series["forse"],
        "a parameter that does not exist": lambda: fit.parameter("time_const"),
        "a record that does not exist": lambda: ep.fit("dyno.csv"),
    }))  # fmt: skip
