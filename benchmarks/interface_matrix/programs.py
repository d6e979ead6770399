"""Tools of the matrix that run as programs of their own, and C programs of this project."""

from __future__ import annotations

import csv
import importlib.metadata
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from benchmarks.interface_matrix.direct import EULER_STEP, STEP, Array, Subject, co_simulation
from builder.native.toolchain import fmi_headers, this_platform
from eightpost.archive import extract_archive

ROOT = Path(__file__).resolve().parents[2]


class NotInstalledError(Exception):
    """The tool, or something that it needs, is not installed here."""


class UnsuitableError(Exception):
    """The tool is not made for such an FMU."""


LIBCOSIM = """
import json, sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
case = json.loads(sys.stdin.read())
run = CosimExecution.from_step_size(round(case["step"] * 1e9))
index = run.add_local_slave(CosimLocalSlave(case["fmu"], "one"))
values, drive = CosimObserver.create_last_value(), CosimManipulator.create_override()
run.add_observer(values), run.add_manipulator(drive)
rows = []
for held in case["values"]:
    drive.slave_real_values(index, case["inputs"], held)
    assert run.step()
    rows.append(list(values.last_real_values(index, case["outputs"])))
json.dump(rows, open(case["result"], "w"))
"""


def libcosim(subject: Subject) -> Array:
    """Run in a process of its own, because libcosim writes to the standard output; its rows begin after a step."""
    with tempfile.TemporaryDirectory() as folder:
        case = {"step": STEP, "fmu": str(subject.path), "values": subject.values[:-1].tolist()}
        case |= {"inputs": [subject.references[n] for n in subject.inputs], "result": f"{folder}/rows.json"}
        case |= {"outputs": [subject.references[n] for n in subject.outputs]}
        _printed([sys.executable, "-c", LIBCOSIM], input=json.dumps(case))
        rows = json.loads(Path(folder, "rows.json").read_text(encoding="utf-8"))
    return np.vstack([co_simulation(subject)[:1], rows])


SCENARIO = "http://github.com/Ecos-platform/libecos/resources/schema/ScenarioConfig"


def ecos(subject: Subject) -> Array:
    """Run the program of ecospy with a scenario of held inputs; it writes six decimals."""
    spec = importlib.util.find_spec("ecospy")
    tbb = [f for f in importlib.metadata.files("tbb") or () if f.name == "libtbb.so.12"]
    if spec is None or spec.origin is None or not tbb:
        raise NotInstalledError("the program of ecospy, or its library libtbb, is not installed")
    lines = [f'<ecos:Scenario xmlns:ecos="{SCENARIO}">']
    for time, row in zip(subject.times.tolist(), subject.values.tolist(), strict=True):
        lines.append(f'<ecos:action t="{time!r}" eps="1e-6">')
        for name, value in zip(subject.inputs, row, strict=True):
            place = quoteattr(f"instance::{name}")
            lines.append(f'<ecos:variable id={place}><ecos:real value="{value!r}"/></ecos:variable>')
        lines.append("</ecos:action>")
    with tempfile.TemporaryDirectory() as folder:
        program = Path(shutil.copy(Path(spec.origin).parent / "binaries" / "ecos", folder))
        program.chmod(0o755)
        Path(folder, "inputs.xml").write_text("\n".join([*lines, "</ecos:Scenario>"]), encoding="utf-8")
        line = [str(program), "simulate", "--path", str(subject.path.resolve()), "--scenarioConfig", "inputs.xml"]
        line += ["--stepSize", repr(STEP), "--stopTime", repr(STEP * (subject.count + 0.5)), "--logLevel", "err"]
        libraries = os.environ | {"LD_LIBRARY_PATH": str(Path(str(tbb[0].locate())).resolve().parent)}
        _printed(line, cwd=folder, env=libraries)
        with Path(folder, f"{subject.path.stem}.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    return np.array([[float(row[f"instance::{name}[REAL]"]) for name in subject.outputs] for row in rows])[
        : subject.count + 1
    ]


def compliance_checker_version() -> str:
    """Return the version of the FMU Compliance Checker on the PATH."""
    ran = subprocess.run([_checker(), "-v"], capture_output=True, text=True, check=False)
    return (ran.stdout + ran.stderr).split("checker", 1)[-1].split("(")[0].split("[")[0].strip()


def _checker() -> str:
    program = shutil.which("fmuCheck.linux64") or shutil.which("fmuCheck")
    if program is None:
        raise NotInstalledError("fmuCheck is not on the PATH")
    return program


def _checked(subject: Subject, kind: str, step: float) -> Array:
    """Run the FMU Compliance Checker with the inputs in a file, and return the rows at the communication points."""
    with tempfile.TemporaryDirectory() as name:
        drive, rows, log = (Path(name, file) for file in ("in.csv", "out.csv", "log.txt"))
        with drive.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["time", *subject.inputs])
            writer.writerows(np.column_stack([subject.times, subject.values]).tolist())
        line = ["-k", kind, "-l", "3", "-h", repr(step), "-n", "0", "-s", repr(STEP * subject.count)]
        line += ["-i", str(drive), "-o", str(rows), "-e", str(log), str(subject.path)]
        ran = subprocess.run([_checker(), *line], capture_output=True, check=False)
        text = log.read_text(encoding="utf-8")
        if ran.returncode:
            raise RuntimeError(text.strip().splitlines()[0])
        if "Checker reported:\n\t0 Warning(s)\n\t0 Error(s)" not in text or "\n\t0 warning(s) and error(s)" not in text:
            raise RuntimeError(text.strip().splitlines()[0])
        found = np.loadtxt(rows, delimiter=",", skiprows=1, ndmin=2)
    return found[:: round(STEP / step), 1:]


def checked_steps(subject: Subject) -> Array:
    """Run co-simulation in the FMU Compliance Checker."""
    return _checked(subject, "cs", STEP)


def checked_euler(subject: Subject) -> Array:
    """Run model exchange in the FMU Compliance Checker."""
    return _checked(subject, "me", EULER_STEP)


def _printed(line: list[str], **options: Any) -> str:
    """Run a program and return what it prints.

    Raises:
        RuntimeError: The program failed; the message is its last line, or its exit code.
    """
    ran = subprocess.run(line, capture_output=True, text=True, check=False, **options)
    if ran.returncode:
        lines = [text.strip() for text in (ran.stdout + ran.stderr).splitlines() if "[debug]" not in text]
        raise RuntimeError(lines[-1] if lines else f"the program ended with exit code {ran.returncode}")
    return ran.stdout


def compiler_version() -> str:
    """Return the version of the C compiler."""
    return _printed([_compiler(), "-dumpfullversion"]).strip()


def _compiler() -> str:
    program = shutil.which("cc") or shutil.which("gcc")
    if program is None or sys.platform == "win32":
        raise NotInstalledError("there is no C compiler")
    return program


def _compiled(source: Path, folder: Path) -> str:
    program = folder / "program"
    places = ["-I", str(fmi_headers()), "-I", str(ROOT / "examples" / "hosts")]
    _printed([_compiler(), "-std=c99", "-O1", *places, str(source), "-o", str(program), "-lm", "-ldl"])
    return str(program)


def c_host(subject: Subject) -> Array:
    """Run the plain C host of the tests."""
    references = subject.references
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        extract_archive(subject.path, folder / "fmu")
        program = _compiled(ROOT / "tests" / "hosts" / "host.c", folder)
        with (folder / "in.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["time", *(references[n] for n in subject.inputs)])
            writer.writerows(np.column_stack([subject.times, subject.values]).tolist())
        library = folder / "fmu" / this_platform().member(subject.description.coSimulation.modelIdentifier)
        line = [program, str(library), subject.description.guid, str(folder / "in.csv"), str(folder / "out.csv")]
        _printed([*line, *(str(references[n]) for n in subject.outputs)])
        return np.loadtxt(folder / "out.csv", delimiter=",", ndmin=2)[:, 1:]


HOLD = r"""
#include "force_law.h"
int main(int count, char **arguments) {
    ForceLaw law;
    double t, h, v, x, force;
    if (force_law_open(&law, arguments[count - 1], "velocity", "displacement", "force") != 0 ||
        force_law_start(&law, 0.0, 0.0, 0.0, &force) != 0) return puts(law.error), 1;
    printf("%.17g\n", force);
    while (scanf("%lf %lf %lf %lf", &t, &h, &v, &x) == 4) {
        if (force_law_hold(&law, t, h, v, x, &force) != 0) return puts(law.error), 1;
        printf("%.17g\n", force);
    }
    force_law_close(&law);
    return 0;
}
"""


def force_law_header(subject: Subject) -> Array:
    """Run loop A of examples/hosts/force_law.h."""
    if "velocity" not in subject.inputs:
        raise UnsuitableError("shocks only")
    rows = zip(subject.times[:-1].tolist(), subject.values.tolist(), strict=False)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        extract_archive(subject.path, folder / "fmu")
        (folder / "hold.c").write_text(HOLD, encoding="utf-8")
        program = _compiled(folder / "hold.c", folder)
        text = "\n".join(f"{t!r} {STEP!r} {v!r} {x!r}" for t, (v, x) in rows)
        return np.array([[float(line)] for line in _printed([program, str(folder / "fmu")], input=text).split()])
