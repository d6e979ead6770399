"""One scenario, five hosts: FMPy, a C program, ecos, libcosim and our own component give the same outputs to 1e-9.

The scenario: inputs are 0 in initialization, then sines and steps, held over steps of 1 ms for 0.5 s. No host ramps
inputs, so an output with a direct term has, at the end of a step, the value for the input that was held in it: one
step late compared with an input known at that time. All five do so; outputs without a direct term are unaffected.

ecos prints six decimals: amplitudes are so large that this resolves 1e-9 of each output's peak. The vehicles are
linear, so the size of their inputs has no other effect. ecos is started at time 0 only: with another start time it
sets up the experiment there but steps from 0, which an FMU must refuse.
"""

import csv
import importlib.metadata
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import quoteattr

import fmpy
import numpy as np
import pytest

from builder.toolchain import Zig, find_toolchain, fmi_headers, this_platform
from cosim import FmuComponent
from eightpost.archive import extract_archive
from eightpost.cache import cache_folder

STEP, COUNT = 1e-3, 500
SOURCE = Path(__file__).with_name("host.c")
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I", str(fmi_headers())]
NAMES = ("polylinear", "lpf1", "lpnl2", "quarter_car", "seven_dof")
SHOCK, VEHICLE = {"m/s": 0.6, "m": 0.03}, {"N": 1e8, "N.m": 1e9, "m": 1e4}


@dataclass(frozen=True)
class Case:
    """An FMU, its inputs (names, and values (K+1, inputs) at the communication points), and the outputs to compare."""

    fmu: Path
    inputs: tuple[str, ...]
    values: np.ndarray
    outputs: tuple[str, ...]
    start: float = 0.0

    @property
    def times(self) -> np.ndarray:
        return self.start + STEP * np.arange(COUNT + 1)

    @property
    def description(self):
        return fmpy.read_model_description(str(self.fmu))

    def references(self, names):
        found = {v.name: v.valueReference for v in self.description.modelVariables}
        return [found[name] for name in names]


def case_of(fmu, **options):
    variables = fmpy.read_model_description(str(fmu)).modelVariables
    inputs = [v for v in variables if v.causality == "input"]
    amplitudes = SHOCK if any(v.unit == "m/s" for v in inputs) else VEHICLE
    time = STEP * np.arange(COUNT + 1)
    shapes = [np.sin(2.0 * np.pi * 4.0 * time), (time > 0.1) * 0.7, np.sin(2.0 * np.pi * 11.0 * time)]
    values = [amplitudes[v.unit] * shapes[k % 3] for k, v in enumerate(inputs)]
    outputs = [v.name for v in variables if v.causality == "output" or v.name == "lagged_force"]
    return Case(fmu, tuple(v.name for v in inputs), np.array(values).T, tuple(outputs), **options)


def by_our_component(case, tmp_path):
    component = FmuComponent(case.fmu, "reference")
    component.begin(case.start, 1e6, {})
    component.end_initialization()
    rows = [component.get(case.outputs)]
    for time, held in zip(case.times[:-1], case.values, strict=False):
        component.set(case.inputs, list(held))
        component.step(float(time), STEP)
        rows.append(component.get(case.outputs))
    component.finish()
    return np.array(rows)


def by_fmpy(case, tmp_path):
    kinds = [("time", float), *((name, float) for name in case.inputs)]
    signals = np.array([(t, *row) for t, row in zip(case.times, case.values, strict=True)], dtype=kinds)
    result = fmpy.simulate_fmu(
        str(case.fmu), start_time=case.start, stop_time=case.times[-1], step_size=STEP, output_interval=STEP,
        input=signals, output=list(case.outputs), fmi_type="CoSimulation",
    )  # fmt: skip
    return np.array([[row[name] for name in case.outputs] for row in result])


@pytest.fixture(scope="session")
def c_host(tmp_path_factory):
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None:
        pytest.skip("there is no C compiler on this machine")
    program = tmp_path_factory.mktemp("host") / "host"
    libraries = ["-ldl"] if sys.platform == "linux" else []
    subprocess.run([compiler, *STRICT, str(SOURCE), "-o", str(program), *libraries], check=True)
    return program


def library_of(case, folder):
    extract_archive(case.fmu, folder)
    return folder / this_platform().member(case.description.coSimulation.modelIdentifier)


def by_c_host(case, tmp_path, program, **options):
    library = options.pop("library", None) or library_of(case, tmp_path / "unpacked")
    drive, rows = tmp_path / "inputs.csv", tmp_path / "outputs.csv"
    with drive.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time", *case.references(case.inputs)])
        writer.writerows([repr(float(x)) for x in row] for row in np.column_stack([case.times, case.values]))
    line = [program, library, case.description.guid, drive, rows, *case.references(case.outputs)]
    ran = subprocess.run([str(part) for part in line], capture_output=True, text=True, check=False, **options)
    assert (ran.returncode, ran.stderr) == (0, "")
    return np.loadtxt(rows, delimiter=",", ndmin=2)[:, 1:]


@pytest.fixture(scope="session")
def ecos(tmp_path_factory):
    """The command that runs ecos, and its environment."""
    spec = importlib.util.find_spec("ecospy")  # importing it fails where the library path lacks TBB
    if spec is None or spec.origin is None:
        pytest.skip("ecospy has no wheel for this platform, or is not installed")
    name = "ecos.exe" if sys.platform == "win32" else "ecos"
    program = tmp_path_factory.mktemp("ecos") / name  # a wheel's file that pip installs may not be executable
    shutil.copy(Path(spec.origin).parent / "binaries" / name, program)
    program.chmod(0o755)
    needed = [f for f in importlib.metadata.files("tbb") or () if f.name == "libtbb.so.12"]
    folders = [str(Path(f.locate()).resolve().parent) for f in needed]
    return program, os.environ | {"LD_LIBRARY_PATH": os.pathsep.join(folders)}


SCENARIO = "http://github.com/Ecos-platform/libecos/resources/schema/ScenarioConfig"
COLUMNS = "http://github.com/Ecos-platform/ecos/resources/schema/CsvConfig"


def write_scenario(path, case):
    """Write the input changes at each communication point; ecos names a single FMU `instance`."""
    lines = [f'<ecos:Scenario xmlns:ecos="{SCENARIO}">']
    rows = np.vstack([np.zeros(len(case.inputs)), case.values[:-1]])
    for k, (before, now) in enumerate(pairwise(rows)):
        lines.append(f'<ecos:action t="{k * STEP!r}" eps="1e-6">')
        lines += [
            f'<ecos:variable id={quoteattr("instance::" + name)}><ecos:real value="{float(new)!r}"/></ecos:variable>'
            for name, old, new in zip(case.inputs, before, now, strict=True)
            if new != old
        ]
        lines.append("</ecos:action>")
    path.write_text("\n".join([*lines, "</ecos:Scenario>"]))


def write_columns(path, case):
    variables = "".join(f"<ecos:variable name={quoteattr(name)}/>" for name in case.outputs)
    path.write_text(
        f'<ecos:CsvConfig xmlns:ecos="{COLUMNS}"><ecos:components><ecos:component name="instance">{variables}'
        "</ecos:component></ecos:components></ecos:CsvConfig>"
    )


def by_ecos(case, tmp_path, ecos):
    program, environment = ecos
    write_scenario(tmp_path / "scenario.xml", case)
    write_columns(tmp_path / "columns.xml", case)
    # ecos accumulates its time and ends before a step would pass the stop time, so the stop time is half a step later.
    line = [program, "simulate", "--path", case.fmu, "--stepSize", STEP, "--stopTime", (COUNT + 0.5) * STEP]
    line += ["--scenarioConfig", "scenario.xml", "--csvConfig", "columns.xml", "--logLevel", "warn"]
    ran = subprocess.run(
        [str(part) for part in line], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stdout) == (0, ""), ran.stderr
    with (tmp_path / f"{case.fmu.stem}.csv").open(newline="") as file:
        rows = list(csv.DictReader(file, skipinitialspace=True))
    return np.array([[float(row[f"instance::{name}[REAL]"]) for name in case.outputs] for row in rows])


LIBCOSIM = """
import json, sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
case = json.load(open(sys.argv[1]))
run = CosimExecution.from_step_size(round(case["step"] * 1e9))
slave = CosimLocalSlave(case["fmu"], "instance")
index = run.add_local_slave(slave)
observer, manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
run.add_observer(observer), run.add_manipulator(manipulator)
rows = []
for held in case["values"][:-1]:
    manipulator.slave_real_values(index, case["inputs"], held)
    assert run.step()
    rows.append(list(observer.last_real_values(index, case["outputs"])))
json.dump(rows, open(sys.argv[2], "w"))
"""


def by_libcosim(case, tmp_path):
    """Run in a separate process, because libcosim writes its log to the standard output."""
    pytest.importorskip("libcosimpy", reason="libcosimpy has no wheel for this platform, or is not installed")
    settings = {"step": STEP, "fmu": str(case.fmu), "values": case.values.tolist()}
    settings |= {"inputs": case.references(case.inputs), "outputs": case.references(case.outputs)}
    (tmp_path / "case.json").write_text(json.dumps(settings))
    line = [sys.executable, "-c", LIBCOSIM, str(tmp_path / "case.json"), str(tmp_path / "rows.json")]
    ran = subprocess.run(line, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[-2000:]
    return np.array(json.loads((tmp_path / "rows.json").read_text()))


def assert_agree(found, expected):
    """Equal to 1e-9 of each output's peak; libcosim's rows begin after the first step."""
    expected = expected[-len(found) :]
    assert len(found) >= COUNT and found.shape == expected.shape
    peak = np.abs(expected).max(axis=0)
    assert (peak > 500.0).all(), "too small an output for ecos's six decimals to show 1e-9"
    assert (np.abs(found - expected).max(axis=0) < 1e-9 * peak).all()


HOSTS = {"FMPy": (by_fmpy, None), "a C program": (by_c_host, "c_host"), "ecos": (by_ecos, "ecos"),
         "libcosim": (by_libcosim, None)}  # fmt: skip


@pytest.mark.repeated(*(f"{host}-{name}" for host in HOSTS for name in NAMES[: 2 - (host == "ecos")]))
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("host", HOSTS)
def test_a_host_gives_the_outputs_of_our_component(fmus, tmp_path, request, host, name):
    case, (simulate, needed) = case_of(fmus[name]), HOSTS[host]
    found = simulate(case, tmp_path, *([request.getfixturevalue(needed)] if needed else []))
    assert_agree(found, by_our_component(case, tmp_path))


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("start", [0.25, 1234.5])
def test_a_run_with_a_later_start_time_gives_the_same_outputs(fmus, tmp_path, c_host, name, start):
    now, later = case_of(fmus[name]), case_of(fmus[name], start=start)
    expected = by_our_component(now, tmp_path)
    assert_agree(by_c_host(later, tmp_path, c_host), expected)
    assert_agree(by_fmpy(later, tmp_path), expected)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("folder", ["with spaces", "größe-速度", "100%", "%20", "#1", "a+b&c;d", "-dash"])
def test_a_c_program_loads_from_any_folder(fmus, tmp_path, c_host, folder):
    case = case_of(fmus["lpnl2"])
    library = library_of(case, tmp_path / folder)
    found = by_c_host(case, tmp_path, c_host, library=library)
    np.testing.assert_array_equal(found, by_c_host(case, tmp_path, c_host))


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", NAMES)
def test_a_run_needs_no_environment_variables_and_writes_no_files_beside_the_library(fmus, tmp_path, c_host, name):
    case, folder = case_of(fmus[name]), tmp_path / "read-only"
    library = library_of(case, folder)
    places = [folder, *folder.rglob("*")]
    for place in places:
        place.chmod(0o555 if place.is_dir() else 0o444)
    found = by_c_host(case, tmp_path, c_host, library=library, env={}, cwd=folder)
    np.testing.assert_array_equal(found, by_c_host(case, tmp_path, c_host))
    assert [folder, *folder.rglob("*")] == places  # root can write to read-only folders, so check the files
    for place in places:
        place.chmod(0o755)


def test_the_c_program_reports_a_call_that_the_fmu_refuses(fmus, tmp_path, c_host):
    case = case_of(fmus["lpf1"])
    (tmp_path / "inputs.csv").write_text("time,0\n0,0\n0.001,nan\n0.002,0\n")
    line = [c_host, library_of(case, tmp_path / "unpacked"), case.description.guid]
    line += [tmp_path / "inputs.csv", tmp_path / "outputs.csv", 2]
    ran = subprocess.run([str(part) for part in line], capture_output=True, text=True, check=False)
    assert ran.returncode == 1
    assert "velocity" in ran.stderr and "the FMU refused: fmi2SetReal" in ran.stderr


@pytest.mark.nightly
def test_the_c_program_compiles_for_windows(tmp_path):
    toolchain = find_toolchain()
    if not isinstance(toolchain, Zig):
        pytest.skip("zig's compiler is not installed (pip install 'eightpost[build]')")
    made = tmp_path / "host.obj"
    line = [toolchain.path, "cc", "-target", "x86_64-windows-gnu", *STRICT, "-c", str(SOURCE), "-o", str(made)]
    environment = os.environ | {
        "ZIG_GLOBAL_CACHE_DIR": str(cache_folder() / "zig"),
        "ZIG_LOCAL_CACHE_DIR": str(tmp_path),
    }
    subprocess.run(line, check=True, cwd=tmp_path, env=environment)
    assert made.read_bytes()[:2] == b"\x64\x86"  # IMAGE_FILE_MACHINE_AMD64


def test_the_comparison_detects_inputs_that_are_one_step_late(fmus, tmp_path, c_host):
    """This checks the sensitivity of the comparison itself."""
    case = case_of(fmus["lpf1"])
    late = Case(case.fmu, case.inputs, np.roll(case.values, 1, axis=0), case.outputs)
    with pytest.raises(AssertionError):
        assert_agree(by_c_host(late, tmp_path, c_host), by_our_component(case, tmp_path))
