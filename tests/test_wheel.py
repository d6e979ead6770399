"""An installation outside the checkout can build FMUs and run the demo with the contents of the wheel."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    return path


def test_the_wheel_contains_fmu_sources_examples_types_and_parameters(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    for name in (
        "builder/fmus/common/table_slave.py",
        "builder/fmus/shock_lpnl2/interface.toml",
        "builder/fmus/vehicle_ss/slave.py",
        "eightpost/examples/seven_dof.toml",
        "eightpost/examples/data/dyno_A.csv",
        "eightpost/vehicle/seven_dof.toml",
        *(f"cosim/report/page.{suffix}" for suffix in ("html", "css", "js")),
        *(f"{package}/py.typed" for package in ("eightpost", "builder", "cosim")),
    ):
        assert name in names
    assert {name.split("/")[0] for name in names} == {"eightpost", "builder", "cosim", "eightpost-0.1.0.dist-info"}


def test_an_unpacked_wheel_builds_an_fmu_without_the_checkout(wheel, tmp_path):
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    script = (
        "from pathlib import Path; import builder.build as b, eightpost.vehicle as v; "
        "from eightpost.examples_folder import examples_folder; "
        "assert 'site' in b.__file__ and 'site' in str(examples_folder()); "
        "print(b.build([v.shipped('quarter_car')], 'out')[0].path)"
    )
    paths = [str(tmp_path / "site"), *sys.path]
    command = [
        sys.executable,
        "-S",
        "-c",
        f"import sys; sys.path[:0] = {paths!r}; {script}",
    ]
    ran = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "out" / "quarter_car.fmu").is_file()
