"""A system file contains a system and its scenario; errors in it are reported."""

import shutil
from functools import partial

import numpy as np
import pytest

import cosim
from cosim.session.run import Case
from cosim.system_file import read_case
from eightpost.signals import TimeSeries, write_series
from tests.unchanged import refusals

TEXT = """
schema = 1
name = "quarter car"

[components.car]
fmu = "quarter_car.fmu"
parameters = { static_tire_force = "750 lbf", start_at_equilibrium = true }
inputs = { aero_force = "100 lbf" }

[components.shock]
fmu = "lpnl2.fmu"
parameters = { compression_scale = 1.2 }

[[bond]]
between = ["car", "shock"]

[scenario]
drivefile = "road.csv"
stop = "0.2 s"
coupling_step = "1 ms"
record = ["car.velocity", "car.tire_force", "shock.force"]
record_step = 0.01
settling = "50 ms"
"""


@pytest.fixture
def folder(tmp_path, fmus):
    for name in ("quarter_car", "lpnl2", "polylinear"):
        shutil.copy(fmus[name], tmp_path / f"{name}.fmu")
    time = np.linspace(0.0, 1.0, 101)
    road = 0.005 * np.sin(2 * np.pi * 3 * time)
    write_series(TimeSeries.from_channels(time, {"road": ("m", road)}), tmp_path / "road.csv")
    return tmp_path


def write(folder, text):
    path = folder / "case.toml"
    path.write_text(text)
    return path


def test_a_case_is_read_with_units_converted_and_can_be_run(folder):
    case = read_case(write(folder, TEXT))
    assert case.name == "quarter car"
    assert case.step == pytest.approx(1e-3)
    assert case.scenario.stop == pytest.approx(0.2)
    assert case.scenario.settling == pytest.approx(0.05)
    assert case.system.parameters["car"]["static_tire_force"] == pytest.approx(750 * 4.4482216152605)
    assert case.system.constants["car.aero_force"] == pytest.approx(444.82216152605)
    result = cosim.run(case.system, case.scenario, algorithm=case.algorithm, step=case.step)
    assert result.series.names == ("car.velocity", "car.tire_force", "shock.force")
    # 750 lbf of static load, 100 lbf of downforce.
    assert result.series["car.tire_force"][0] == pytest.approx(850 * 4.4482216152605, rel=1e-6)
    assert result.share_tire_off == {"car.tire_force": 0.0}
    assert set(result.identities) == {"car", "shock"}


def test_a_shock_is_swapped_without_changing_the_file(folder, fmus):
    swapped = read_case(write(folder, TEXT), fmus={"shock": fmus["polylinear"]})
    assert "time_constant" not in swapped.system.components["shock"].variables


#: Changes of the file that are errors.
WRONG = [
    ("schema = 1", "schema = 9"), ("schema = 1", "schema = "), ("[scenario]", "[scenery]"), ("name =", "nome ="),
    ('stop = "0.2 s"', 'stop = "0.2 m"'), ('stop = "0.2 s"', 'stop = "soon"'), ('stop = "0.2 s"', "stop = -1.0"),
    ('stop = "0.2 s"', 'stop = "0.2 s"\nalgorithm = "magic"'), ('"750 lbf"', '"750 in"'), ('"750 lbf"', '"heavy"'),
    ("compression_scale", "compresion_scale"), ("aero_force", "aerial_force"),
    ('["car", "shock"]', '["cart", "shock"]'),
    ("road.csv", "street.csv"), ("lpnl2.fmu", "none.fmu"),
    ('stop = "0.2 s"', 'stop = "0.2 s"\nalgorithm = "jacobi"\nsequence = ["car", "shock"]'),
]  # fmt: skip


def test_an_error_in_a_system_file_is_reported_with_the_entry_and_the_file(folder, fmus, unchanged):
    def read(old, new, **given):
        assert old in TEXT
        return read_case(write(folder, TEXT.replace(old, new)), **given)

    def ran(old, new):
        found = read(old, new)
        return cosim.run(found.system, found.scenario)

    calls = {new: partial(read, old, new) for old, new in WRONG}
    unchanged(refusals(calls | {
        "an unknown channel to record": partial(ran, "car.tire_force", "car.tyre_force"),
        "an unknown component to swap": partial(read, "", "", fmus={"damper": fmus["polylinear"]}),
        "no file": partial(read_case, folder / "none.toml"),
        "a tolerance of a fixed step": lambda: case().with_coupling(tolerance=0.5),
    }))  # fmt: skip


def test_time_beyond_the_fitted_range_and_without_contact_is_counted_whatever_is_recorded(folder):
    time = np.linspace(0.0, 1.0, 101)
    road = 0.2 * np.sin(2 * np.pi * 3 * time)
    write_series(TimeSeries.from_channels(time, {"road": ("m", road)}), folder / "road.csv")
    shares = []
    for text in (TEXT, TEXT.replace('"car.velocity", "car.tire_force", ', "").replace("0.01", "0.1")):
        case = read_case(write(folder, text))
        result = cosim.run(case.system, case.scenario, step=case.step)
        shares.append((result.share_beyond_fit, result.share_tire_off))
    assert shares[0] == shares[1]
    assert 0.2 < shares[0][0]["shock"] < 1.0
    assert 0.1 < shares[0][1]["car.tire_force"] < 0.9


def test_units_and_a_channel_map_can_be_given_for_a_drive_file(folder):
    (folder / "road.csv").write_text("t [s],Z1\n0,0\n1,10\n")
    (folder / "map.toml").write_text('[channels.road]\nsource = "Z1"\nunit = "mm"\ngain = -1\n')
    mapped = TEXT.replace('drivefile = "road.csv"', 'drivefile = "road.csv"\nchannel_map = "map.toml"')
    assert read_case(write(folder, mapped)).scenario.drive.at(1.0) == pytest.approx([-0.01])
    named = TEXT.replace('drivefile = "road.csv"', 'drivefile = "road.csv"\nunits = { Z1 = "mm" }')
    named = named.replace('settling = "50 ms"', 'targets = { Z1 = "car.road" }')
    assert read_case(write(folder, named)).scenario.drive.at(1.0) == pytest.approx([0.01])


# ==== The coupling of a case file can be overridden ==================================================================


def case(algorithm: str = "gauss-seidel", step: float | None = 1e-3) -> Case:
    return Case("empty", cosim.System({}), cosim.Scenario(stop=1.0), cosim.SCHEMES[algorithm], step)


def test_without_options_the_coupling_of_the_file_is_used() -> None:
    assert case().with_coupling() == case()
    assert case().with_coupling("gauss-seidel").step == 1e-3


def test_an_algorithm_that_chooses_its_own_step_ignores_the_step_of_the_file() -> None:
    chosen = case().with_coupling("default")
    assert chosen.algorithm == cosim.SCHEMES["default"] and chosen.step is None
    assert case().with_coupling("default", step=2e-3).step == 2e-3
    assert case().with_coupling("jacobi").step == 1e-3


def test_a_tolerance_is_in_percent() -> None:
    default = case().with_coupling("default", tolerance=0.5).algorithm
    adaptive = case().with_coupling("adaptive", tolerance=0.5).algorithm
    assert isinstance(default, cosim.Automatic) and default.tolerance == 0.5
    assert isinstance(adaptive, cosim.Adaptive) and adaptive.relative == pytest.approx(0.005)
