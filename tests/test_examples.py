"""Every example runs in an empty folder."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cosim
from builder.build import build
from cosim.system_file import read_case
from eightpost.archive import read_archive, write_archive
from eightpost.corners import CORNERS
from eightpost.shock import write_shock
from eightpost.signals import Drivefile, TimeSeries, read_series

ROOT = Path(__file__).parents[1]


def python(*arguments, cwd):
    environment = os.environ | {"PYTHONWARNINGS": "error", "MPLBACKEND": "Agg"}
    return subprocess.run(
        [sys.executable, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, check=False, env=environment
    )


@pytest.fixture
def workplace(tmp_path):
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    return tmp_path


def holding(fmu, folder):
    """Return a copy of an FMU that declares no support for input derivatives, so that the master holds its inputs."""
    members = read_archive(fmu)
    description = members["modelDescription.xml"]
    held = description.replace(b'canInterpolateInputs="true"', b'canInterpolateInputs="false"')
    assert held != description
    write_archive(folder / fmu.name, members | {"modelDescription.xml": held})
    return folder / fmu.name


@pytest.mark.nightly
def test_the_loop_with_fmpy_only_agrees_with_the_master(workplace, shocks, tmp_path):
    write_shock(shocks["lpnl2"], tmp_path / "shock.json")
    (tmp_path / "ramping").mkdir()
    built = build([ROOT / "examples" / "car.toml", tmp_path / "shock.json"], tmp_path / "ramping")
    for item in built:
        holding(item.path, tmp_path)
    ran = python("examples/fmpy_only.py", tmp_path / "car.fmu", tmp_path / "shock.fmu", cwd=workplace)
    assert ran.returncode == 0, ran.stderr
    fastest, change = map(float, re.search(r"fastest (\S+) m/s, tire force changed by (\S+) N", ran.stdout).groups())

    # The loop holds a step of the road from 0.1 s on; the master holds the drive's mean, so the edge is put between.
    time = np.array([0.0, 0.1 - 1e-9, 0.1, 0.5])
    drive = Drivefile(TimeSeries.from_channels(time, {"lf.road": ("m", [0.0, 0.0, 0.01, 0.01])}))
    still = ("rf.road", "lr.road", "rr.road", "heave_force", "roll_moment", "pitch_moment")
    system = cosim.System.load(
        {"car": tmp_path / "car.fmu"} | dict.fromkeys(CORNERS, tmp_path / "shock.fmu"),
        [cosim.Bond.between(f"car.{c}", c) for c in CORNERS],
        constants={f"car.{name}": 0.0 for name in still},
    )
    held = cosim.GaussSeidel(values="held")
    series = cosim.run(system, cosim.Scenario(0.5, drive), algorithm=held, step=1e-3).series
    assert fastest == pytest.approx(series["car.lf.velocity"].max(), abs=1e-4)
    tire = series["car.lf.tire_force"]
    assert change == pytest.approx(tire[-1] - tire[0], abs=0.5)


@pytest.mark.nightly
def test_the_quarter_car_example_runs(workplace, shocks):
    write_shock(shocks["lpnl2"], workplace / "dist" / "dyno_A.json")
    build([workplace / "dist" / "dyno_A.json", workplace / "examples" / "corner.toml"], workplace / "dist")
    case = read_case(workplace / "examples" / "quarter_car.toml")
    scenario = replace(case.scenario, stop=3.0)
    result = cosim.run(case.system, scenario, algorithm=case.algorithm, step=case.step)
    assert result.acceptable
    # 750 lbf of car, 250 lbf of downforce.
    assert result.series["corner.tire_force"][0] == pytest.approx(1000 * 4.4482216152605, rel=1e-3)
    assert any("counts twice" in note for note in result.notes), "the test's shock has a gas preload of its own"


@pytest.mark.nightly
def test_the_demo_data_are_the_output_of_their_script(tmp_path):
    """Bytes may differ between versions of numpy and scipy; the samples may not."""
    shutil.copy(ROOT / "examples" / "make_demo_data.py", tmp_path)
    (tmp_path / "data").mkdir()
    ran = python("make_demo_data.py", cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    made = sorted(path.name for path in (tmp_path / "data").iterdir())
    assert made == sorted(path.name for path in (ROOT / "examples" / "data").iterdir())
    for name in made:
        new, shipped = (read_series(folder / name) for folder in (tmp_path / "data", ROOT / "examples" / "data"))
        assert new.names == shipped.names
        scale = np.ptp(shipped.values, axis=1, keepdims=True)
        np.testing.assert_allclose(new.values / scale, shipped.values / scale, atol=5e-4)
