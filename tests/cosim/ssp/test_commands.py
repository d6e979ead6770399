"""The commands `ssp` and `run` on packages."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import cosim
from cosim.ssp import Given
from cosim.system_file import read_case
from eightpost.__main__ import main
from eightpost.signals import read_series, write_series

from .corner import CAR_ALONE, LBF, LINKS, SHOCK, by_hand, corner, read, renamed, run, values
from .document import link

SYSTEM_FILE = """
schema = 1
[components.car]
fmu = "resources/quarter_car.fmu"
inputs = { aero_force = "25 lbf" }
[components.shock]
fmu = "resources/lpnl2.fmu"
parameters = { rebound_scale = 1.3, friction_velocity = "4 mm/s" }
[[bond]]
between = ["car", "shock"]
[scenario]
drivefile = "road.csv"
stop = "0.2 s"
coupling_step = "0.5 ms"
record_step = "2 ms"
"""


def test_a_package_written_again_keeps_its_offsets_and_is_not_overwritten(folder):
    offset = link("car.velocity", "shock.velocity", '<ssc:LinearTransformation factor="1" offset="0.1"/>')
    (folder / "corner.ssd").write_bytes(corner(links=LINKS.replace(link("car.velocity", "shock.velocity"), offset)))
    for first, second in (("corner.ssd", "once.ssp"), ("once.ssp", "twice.ssp")):
        ran = CliRunner().invoke(main, ["export", str(folder / first), "-o", str(folder / second)])
        assert ran.exit_code == 0, ran.output
    series, expected = (
        run(read_case(folder / name, given=Given(folder / "road.csv"))).series for name in ("twice.ssp", "corner.ssd")
    )
    assert all(np.array_equal(series[name], expected[name]) for name in expected.names)
    before = (folder / "twice.ssp").read_bytes()
    ran = CliRunner().invoke(main, ["export", str(folder / "twice.ssp"), "-o", str(folder / "twice.ssp")])
    assert ran.exit_code == 2 and "twice.ssp is an input of this command and would be replaced" in ran.output
    ran = CliRunner().invoke(main, ["export", str(folder / "twice.ssp")])
    assert ran.exit_code == 0 and (folder / "twice_new.ssp").is_file()
    assert (folder / "twice.ssp").read_bytes() == before


def test_a_run_never_replaces_the_drive_file_that_its_system_names(folder, monkeypatch):
    monkeypatch.setattr("cosim.run", None)
    (folder / "out").mkdir()
    drive = shutil.copy(folder / "road.csv", folder / "out" / "series.csv")
    (folder / "corner.toml").write_text(SYSTEM_FILE.replace("road.csv", "out/series.csv"))
    ran = CliRunner().invoke(main, ["run", str(folder / "corner.toml"), "-o", str(folder / "out")])
    assert ran.exit_code == 2 and "series.csv is an input of this command and would be replaced" in ran.output
    assert drive.read_bytes() == (folder / "road.csv").read_bytes()
    assert list((folder / "out").iterdir()) == [drive]


def test_the_run_command_takes_drive_inputs_and_times_that_a_package_lacks(folder):
    (folder / "corner.ssd").write_bytes(corner(CAR_ALONE + SHOCK))
    line = ["run", str(folder / "corner.ssd"), "-o", str(folder / "out"), "--drive", str(folder / "road.csv")]
    line += ["--input", "car.aero_force=100 N", "--set", "stop=200 ms", "--set", "record-step=10 ms", "--step", "2 ms"]
    ran = CliRunner().invoke(main, line)
    assert ran.exit_code == 0, ran.output
    assert "100 of 2 ms" in ran.output and "energy residual" in ran.output
    assert read_series(folder / "out" / "series.parquet").time == pytest.approx(np.linspace(0.0, 0.2, 21))


def test_the_run_command_refuses_options_for_packages_with_a_system_file(folder):
    (folder / "case.toml").write_text("schema = 1\n")
    for option in (["--set", "stop=1 s"], ["--drive", "road.csv"], ["--input", "a.b=1"], ["--set", "record-step=1 ms"]):
        ran = CliRunner().invoke(main, ["run", str(folder / "case.toml"), "-o", str(folder / "out"), *option])
        assert ran.exit_code == 2 and "change them there" in ran.output
    ran = CliRunner().invoke(main, ["run", str(folder / "case.toml"), "-o", str(folder / "out"), "--set", "stop=1 m"])
    assert ran.exit_code == 2 and "--set stop='1 m': cannot convert" in ran.output


@pytest.mark.nightly
def test_the_example_of_the_documentation_gives_the_documented_result(folder, monkeypatch):
    page = (Path(__file__).parents[3] / "docs" / "how_to" / "ssp.md").read_text(encoding="utf-8")
    example, command = re.search(r"```xml\n(.*?)```\n.*?\n```sh\n(.*?)```", page, re.DOTALL).groups()
    for ours, name in (("quarter_car", "car"), ("lpnl2", "shock")):
        shutil.copy(folder / "resources" / f"{ours}.fmu", folder / "resources" / f"{name}.fmu")
    case = read(folder, example.encode(), drive=renamed(folder, "z"))
    assert values(case) == {"gas_preload": pytest.approx(54.48, abs=0.005)}
    expected = by_hand(
        folder,
        bonds=[cosim.Bond.between("car", "shock", gain=-1.0)],
        parameters={"shock": {"gas_preload": 10.0 * LBF + 10.0}},
        constants={"car.aero_force": 25.0 * LBF},
    )
    series = read_series(renamed(folder, "z"))
    write_series(series, folder / "road.csv")
    monkeypatch.chdir(folder)
    ran = CliRunner().invoke(main, [*shlex.split(command)[1:], "--step", "1 ms", "-v"])
    assert ran.exit_code == 0, ran.output
    assert "bond car: energy residual" in ran.output and "have no source" not in ran.output
    found = read_series(folder / "out" / "series.parquet")
    for name in expected.series.names:
        assert found[name] == pytest.approx(expected.series[name], rel=1e-9, abs=1e-9), name
