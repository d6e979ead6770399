"""Shocks with adjusters and temperature in an assembly: parameters of each corner, results of the separate FMUs."""

import zipfile

import numpy as np
import pytest

from builder.assembly import read_parts
from builder.build import build
from cosim import FmuComponent
from cosim.system_file import read_case
from eightpost.errors import FmuError
from eightpost.shock import write_shock

from ..shock_over_settings import shock_of
from .hosts import corner_file, difference, grid, host, master, observed, replayed, road

SYSTEM = """
schema = 1
[components.car]
fmu = "{car}"
[components.lf]
fmu = "{folder}/lpf1.fmu"
parameters = {{ "clicks.rebound" = 17.0 }}
[components.rf]
fmu = "{folder}/lpf1.fmu"
[components.lr]
fmu = "{folder}/hysteresis_lagged.fmu"
parameters = {{ "clicks.compression" = 3.0, temperature = "60 degC" }}
[components.rr]
fmu = "{plain}"
[[bond]]
between = ["car.lf", "lf"]
[[bond]]
between = ["car.rf", "rf"]
[[bond]]
between = ["car.lr", "lr"]
[[bond]]
between = ["car.rr", "rr"]
[scenario]
stop = 1.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """FMUs of shocks with settings; `warm` has the temperature as an input."""
    folder = tmp_path_factory.mktemp("settings")
    for name in ("lpf1", "hysteresis_lagged", "warm"):
        write_shock(shock_of("lpf1" if name == "warm" else name), folder / f"{name}.json")
    build([folder / "lpf1.json", folder / "hysteresis_lagged.json"], folder)
    build([folder / "warm.json"], folder, temperature_input=True)
    return folder


@pytest.fixture(scope="module")
def case(folder, fmus):
    path = folder / "system.toml"
    names = {"car": fmus["seven_dof"], "plain": fmus["lpnl2"], "folder": folder}
    path.write_text(SYSTEM.format(**{name: file.as_posix() for name, file in names.items()}))
    return read_case(path)


@pytest.fixture(scope="module")
def car(case, made):
    return made(case, "car_over_settings")


def test_every_corner_has_the_settings_of_its_shock_as_parameters(car):
    variables = FmuComponent(car, "car").variables
    for corner, clicks in (("lf", 17.0), ("rf", 5.0), ("lr", 5.0)):
        known = variables[f"{corner}.clicks.rebound"]
        assert (known.causality, known.variability, float(known.start)) == ("parameter", "tunable", clicks)
    assert float(variables["lr.temperature"].start) == pytest.approx(333.15)
    assert "lf.beyond_settings" in variables
    assert not [name for name in variables if name.startswith("rr.clicks")]


def test_equal_shocks_share_their_tables_and_different_ones_do_not(car):
    with zipfile.ZipFile(car) as archive:
        tables = [name for name in archive.namelist() if name.endswith("_settings.h")]
    assert sorted(name.split("/")[-1].rpartition("_")[0].rpartition("_")[0] for name in tables) == [
        "shock_hysteresis",
        "shock_lpf1",
    ]


def test_at_the_settings_of_the_system_file_the_assembly_equals_the_separate_fmus(car, case):
    outputs = observed(FmuComponent(car, "car"))
    expected, _ = master(case, 0.0005, drive_step=0.004, outputs=outputs)
    assert difference(host(car, 0.004), expected).max() < 1e-9


@pytest.mark.nightly
def test_a_temperature_input_of_a_corner_is_an_input_of_the_assembly(folder, fmus, made):
    path = corner_file(folder / "warm.toml", fmus["quarter_car"], folder / "warm.fmu")
    built = made(read_case(path), "warm_corner")
    ends = []
    for temperature in (320.0, 345.0):
        fmu = FmuComponent(built, "corner")
        fmu.begin(0.0, 1.0, {})
        fmu.set(("damper.temperature",), (temperature,))
        fmu.end_initialization()
        for k, height in enumerate(road(grid(0.001))[0][:50]):
            fmu.set(("corner.road",), (height,))
            fmu.step(0.001 * k, 0.001)
        ends.append(fmu.get(("damper.force", "damper.beyond_settings")))
        fmu.finish()
    assert ends[0][0] != ends[1][0]
    assert ends[0][1] == ends[1][1] == 0.0


def test_tables_of_another_version_are_refused(folder, tmp_path):
    changed = tmp_path / "lpf1.fmu"
    with zipfile.ZipFile(folder / "lpf1.fmu") as archive, zipfile.ZipFile(changed, "w") as other:
        for name in archive.namelist():
            content = archive.read(name)
            if name.endswith("settings_data.h"):
                content = content.replace(b"read_setting", b"take_setting")
            other.writestr(name, content)
    with pytest.raises(FmuError, match=r"contains a different model .* build it again"):
        read_parts({"shock": changed})


def test_the_reference_results_of_an_assembly_are_those_at_its_settings(car):
    """The library computed them from the equations: the binaries must agree."""
    outputs, found, expected = replayed(car, 100)
    forces = [outputs.index(name) for name in ("lf.force", "lr.force")]
    assert np.abs(found - expected)[:, forces].max() < 1e-8 * np.abs(expected[:, forces]).max()
