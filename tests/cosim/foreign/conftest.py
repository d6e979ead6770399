"""Fixtures: an FMU that differs from ours (foreign_fmu.c) with a configurable description, alone and in a system."""

import contextlib
import os
import subprocess
import tempfile
import time
from pathlib import Path

import fmpy
import numpy as np
import pytest

from cosim import FmuComponent, IsolatedComponent, Scenario, System
from eightpost.archive import write_archive
from eightpost.compilers import find_compiler
from eightpost.errors import FmuError
from eightpost.signals import Drivefile

from . import lag_fmus, version_2

SOURCE = Path(__file__).with_name("foreign_fmu.c")

VARIABLES = (
    ("piston.u", 1000, "input", 'Real unit="mm/s" start="0"'),
    ("piston.y", 7, "output", 'Real unit="kN"', "1"),
    ("alias", 7, "output", 'Real unit="kN"', "1"),
    ("angle", 400000, "output", 'Real unit="deg"'),
    ("late", 12, "output", "Real"),
    ("length", 20, "output", "Real"),
    ("seen", 21, "output", "Real", "9"),
    ("made", 22, "output", "Real"),
    ("gear", 3, 'input" variability="discrete', 'Integer start="4"'),
    ("flag", 4, 'parameter" variability="fixed', 'Boolean start="false"'),
    ("manner", 5, 'parameter" variability="fixed', 'String start="polite"'),
)


def write_fmu(path, library, *, tool="", **declared):
    attributes = (tool and f'generationTool="{tool}" ') + 'variableNamingConvention="structured"'
    files = {"resources/note.txt": b"seven b"}
    return version_2.write(path, library, "foreign", VARIABLES, files=files, attributes=attributes, **declared)


def compiled(target, *definitions, source=SOURCE):
    if os.name == "nt":
        pytest.skip("the C file is for POSIX")
    try:
        compiler = find_compiler()
    except FmuError:
        pytest.skip("there is no C compiler here")
    headers = Path(fmpy.__file__).with_name("c-code")
    options = ["-shared", "-fPIC", "-O1", "-w", *definitions, "-I", str(headers)]
    subprocess.run([*compiler, *options, str(source), "-o", str(target), "-lm"], check=True)
    return target.read_bytes()


@pytest.fixture(scope="session")
def foreign_compiler():
    """Compile a C file into a library: foreign_compiler(target, *definitions, source=...) returns its bytes."""
    return compiled


@pytest.fixture(scope="session")
def foreign_library(tmp_path_factory):
    """Return the library compiled from the C file."""
    return compiled(tmp_path_factory.mktemp("foreign") / "foreign.so")


@pytest.fixture(scope="session")
def sparse_library(tmp_path_factory):
    """Return the library compiled without the optional functions."""
    return compiled(tmp_path_factory.mktemp("sparse") / "sparse.so", "-DSPARSE")


@pytest.fixture(scope="session")
def build(foreign_compiler, tmp_path_factory):
    """Return a function that compiles the C file with definitions, each set of them once."""
    libraries = {}

    def library(*definitions):
        if definitions not in libraries:
            target = tmp_path_factory.mktemp("lag") / "lag.so"
            libraries[definitions] = foreign_compiler(target, *definitions, source=lag_fmus.SOURCE)
        return libraries[definitions]

    return library


@pytest.fixture(scope="session")
def three(build, tmp_path_factory):
    """Return the FMI 3.0 FMU."""
    return lag_fmus.write_three(tmp_path_factory.mktemp("three") / "lag3.fmu", build())


@pytest.fixture
def source_fmu(tmp_path):
    """Write an FMU that contains sources but no binary."""

    def make(*, listed="", **sources):
        files = "".join(f'<File name="{name}"/>' for name in listed.split())
        listing = f"<SourceFiles>{files}</SourceFiles>" if files else ""
        xml = version_2.description("foreign", VARIABLES, guid="{sources}", sources=listing)
        members = {"modelDescription.xml": xml, "sources/foreign_fmu.h": SOURCE.read_bytes()}
        members |= {f"sources/{name}.c": text.encode() for name, text in sources.items()}
        write_archive(tmp_path / "sources.fmu", members)
        return tmp_path / "sources.fmu"

    return make


@pytest.fixture
def foreign(foreign_library, tmp_path):
    """Write the FMU with the given declarations in its description."""

    def make(name="foreign.fmu", *, library=foreign_library, **declared):
        return write_fmu(tmp_path / name, library, **declared)

    return make


@pytest.fixture(params=[FmuComponent, IsolatedComponent])
def kind(request):
    """Component class: in this process, or isolated in a separate process."""
    return request.param


@pytest.fixture(scope="session", params=[FmuComponent, IsolatedComponent], ids=["direct", "isolated"])
def odd(request, foreign_library, tmp_path_factory):
    """The FMU as a component that many tests begin in turn; no test may affect the next."""
    path = write_fmu(tmp_path_factory.mktemp("odd") / "foreign.fmu", foreign_library)
    component = request.param(path, "odd")
    yield component
    component.close()


@pytest.fixture
def begun():
    """Begin a component and leave initialization."""

    def begin(component, manner="polite", **parameters):
        component.begin(0.0, 2.0, {"manner": manner, **parameters})
        component.end_initialization()
        return component

    return begin


@pytest.fixture
def march():
    """Step with a constant input and read an output after each step, as the master does."""

    def steps(component, count=600):
        for k in range(count):
            component.set(("piston.u",), (250.0,))
            component.step(k * 1e-3, 1e-3)
            component.get(("angle",))

    return steps


@pytest.fixture
def runs(march):
    """Check that a component that has begun steps as it should, and finish it."""

    def check(component):
        march(component, 4)
        assert component.get(("angle",))[0] == pytest.approx(1.0)
        component.finish()

    return check


@pytest.fixture
def drive(tmp_path):
    """A drive file whose only channel `speed` is a constant in m/s."""

    def write(value, seconds=1.0):
        path = tmp_path / "drive.csv"
        times = np.arange(0.0, seconds + 0.05, 0.01)
        path.write_text("time [s],speed [m/s]\n" + "".join(f"{t:.6g},{value}\n" for t in times))
        return Drivefile.read(path)

    return write


@pytest.fixture
def road(tmp_path):
    """A drive file with a sinusoidal road of amplitude 5 mm and frequency 4 Hz."""
    path = tmp_path / "road.csv"
    times = np.arange(0.0, 0.5, 2e-3)
    rows = (f"{t:.6g},{0.005 * np.sin(8.0 * np.pi * t):.9g}\n" for t in times)
    path.write_text("time [s],road [m]\n" + "".join(rows))
    return Drivefile.read(path)


@pytest.fixture
def pair(drive, fmus):
    """A system of the foreign FMU and one of our shocks, and its scenario."""

    def build(part, manner="polite", *, stop=1.0):
        system = System(
            {"odd": part, "shock": FmuComponent(fmus["lpf1"], "shock")},
            constants={"shock.velocity": 0.1, "shock.displacement": 0.0},
            parameters={"odd": {"manner": manner}},
        )
        targets = {"speed": "odd.piston.u"}
        record = ("odd.piston.y", "odd.alias", "odd.angle", "shock.force")
        return system, Scenario(stop=stop, drive=drive(0.25, stop), targets=targets, record=record)

    return build


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """Folder for the temporary files of components."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def eventually():
    """Wait until a condition is true, for a limited time; return whether it became true."""

    def wait(condition, seconds=6.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if condition():
                return True
            time.sleep(0.02)
        return condition()

    return wait


@pytest.fixture
def alive():
    """Return whether a process group has a running process."""

    def look(group):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            return "Z" not in Path(f"/proc/{group}/stat").read_text().rpartition(")")[2].split()[0]
        return True

    return look
