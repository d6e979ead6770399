"""Wheel and source distribution contain what an installation outside the checkout needs to build FMUs."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from eightpost import __version__

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).parents[1]


def hatchling(kind, source, folder):
    command = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (path,) = folder.iterdir()
    return path


def unpacked(sdist, folder):
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    return folder / f"eightpost-{__version__}"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return hatchling("wheel", ROOT, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def sdist(tmp_path_factory):
    return hatchling("sdist", ROOT, tmp_path_factory.mktemp("sdist"))


def test_the_wheel_contains_fmu_sources_examples_types_and_parameters(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    for name in (
        "builder/fmus/common/table_slave.py",
        "builder/fmus/shock_lpnl2/interface.toml",
        "builder/fmus/vehicle_ss/slave.py",
        "eightpost/examples/seven_dof.toml",
        "eightpost/examples/data/dyno_A.csv",
        "eightpost/examples/starter/README.md",
        "eightpost/vehicle/seven_dof.toml",
        *(f"cosim/report/page.{suffix}" for suffix in ("html", "css", "js")),
        *(f"{package}/py.typed" for package in ("eightpost", "builder", "cosim")),
    ):
        assert name in names
    own = f"eightpost-{__version__}.dist-info"
    assert {name.split("/")[0] for name in names} == {"eightpost", "builder", "cosim", own}


def test_the_source_distribution_contains_the_checkout(sdist):
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for name in (
        "pyproject.toml", "Makefile", "LICENSE", "CHANGELOG.md", "fmus/common/shock_slave.py",
        "examples/starter/study.toml", "tests/test_wheel.py", "benchmarks/orders.py",
        "dissertation/printed/chapter_3.toml",
    ):  # fmt: skip
        assert name in names
    assert not {name.split("/")[0] for name in names} & {".git", ".venv", "build", "demo", "dist", "out"}


@pytest.mark.nightly
def test_a_wheel_built_from_the_source_distribution_has_the_same_files(wheel, sdist, tmp_path):
    (tmp_path / "wheel").mkdir()
    again = hatchling("wheel", unpacked(sdist, tmp_path), tmp_path / "wheel")
    contents = [{entry.filename: entry.CRC for entry in zipfile.ZipFile(path).infolist()} for path in (wheel, again)]
    assert contents[0] == contents[1]


@pytest.mark.nightly
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


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_an_installation_outside_the_checkout_runs_the_starter(kind, request, tmp_path):
    """A virtual environment of its own, with all verbs, and the commands of the starter's README."""
    source = request.getfixturevalue(kind)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def call(*words, folder=tmp_path):
        ran = subprocess.run(
            list(map(str, words)), cwd=folder, env=environment, check=False, capture_output=True, text=True
        )
        assert ran.returncode == 0, f"{words}\n{ran.stdout}{ran.stderr}"
        return ran.stdout

    programs = tmp_path / "venv" / ("Scripts" if sys.platform == "win32" else "bin")
    call(sys.executable, "-m", "venv", tmp_path / "venv")
    call(programs / "python", "-m", "pip", "install", "--quiet", f"{source}[all]")
    assert str(tmp_path) in call(programs / "python", "-c", "import cosim; print(cosim.__file__)")
    assert "The installation works." in call(programs / "eightpost", "doctor")
    call(programs / "eightpost", "new", "car7")
    text = (tmp_path / "car7" / "README.md").read_text(encoding="utf-8")
    for line in text.partition("```sh\n")[2].partition("```")[0].splitlines():
        call(programs / "eightpost", *line.split()[1:], folder=tmp_path / "car7")
    assert (tmp_path / "car7" / "study" / "report.html").is_file()
