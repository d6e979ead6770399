"""FMUs that end this process or change its environment are named, also without --isolate; the changes are undone."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cosim import FmuComponent, run
from cosim.components.watch import Surroundings
from eightpost.__main__ import main

CASE = """
schema = 1
[components.calm]
fmu = "{fmu}"
inputs = {{ "piston.u" = 250.0 }}
[components.odd]
fmu = "{fmu}"
parameters = {{ manner = "{manner}" }}
inputs = {{ "piston.u" = 250.0 }}
[scenario]
stop = "0.6 s"
coupling_step = "1 ms"
record = ["odd.angle", "calm.angle"]
"""

IN_PYTHON = """
import sys
from cosim import run
from cosim.system_file import read_case
case = read_case(sys.argv[1])
run(case.system, case.scenario, step=1e-3, engine=sys.argv[2])
print("came to its end")
"""


@pytest.fixture
def case(foreign, tmp_path):
    def write(manner):
        (tmp_path / "case.toml").write_text(CASE.format(fmu=foreign(flags="").name, manner=manner))
        return tmp_path / "case.toml"

    return write


@pytest.fixture
def ended():
    """Run Python in a separate process; return its exit code, output and errors after all its children have ended."""

    def start(*arguments):
        command = [sys.executable, *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)

    return start


@pytest.mark.repeated
@pytest.mark.parametrize(
    ("manner", "engine", "code"),
    [
        ("exit", "compiled", 1),
        ("exit with 0", "python", 1),
        ("exit at start", "python", 1),
        ("_exit with 0", "compiled", 0),  # the operating system's own call: nobody can change the code
        ("abort", "compiled", -6),
        ("segfault", "python", -11),
    ],
)
def test_the_error_names_the_fmu_that_ends_the_process(manner, engine, code, case, ended):
    found = ended("-c", IN_PYTHON, case(manner), engine)
    assert found.returncode == code, found.stderr
    assert found.stderr.count("error: this process ended while component 'odd' (foreign.fmu) was called") == 1
    assert "--isolate" in found.stderr and "came to its end" not in found.stdout


def test_the_run_command_names_the_fmu_and_exits_with_1(case, ended, tmp_path):
    found = ended("-m", "eightpost", "run", case("exit with 0"), "-o", tmp_path / "out")
    assert found.returncode == 1
    assert "component 'odd' (foreign.fmu) was called" in found.stderr and "--isolate" in found.stderr


@pytest.mark.repeated
@pytest.mark.parametrize("engine", ["python", "compiled"])
def test_an_fmu_that_was_not_being_called_is_not_blamed_for_the_end_of_the_process(engine, case, ended):
    found = ended("-c", IN_PYTHON + "\nimport os; os._exit(5)", case("polite"), engine)
    assert (found.returncode, found.stderr) == (5, "")


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory and a rounding mode that must not change."""
    monkeypatch.chdir(tmp_path)
    before = Surroundings.now()
    yield tmp_path
    assert before.restore() == ()


@pytest.mark.parametrize("engine", ["python", "compiled"])
@pytest.mark.parametrize(
    ("manner", "message"),
    [
        ("change folder", "odd: it changed the working directory (to /) while stepping; that was undone"),
        ("round up", "odd: it changed the floating-point environment"),
    ],
)
def test_a_change_of_the_process_environment_while_stepping_is_reported_and_undone(
    manner, message, engine, here, foreign, pair
):
    result = run(*pair(FmuComponent(foreign(), "odd"), manner), step=1e-3, engine=engine)
    assert [note for note in result.notes if note.startswith(message)], result.notes
    assert Path.cwd() == here
    assert not [note for note in run(*pair(FmuComponent(foreign(), "odd")), step=1e-3).notes if "changed" in note]


def test_a_change_of_the_process_environment_at_the_start_does_not_affect_the_result(here, foreign, pair):
    """The rounding mode is back before anything is computed."""
    changed, polite = (
        run(*pair(FmuComponent(foreign(), "odd"), manner), step=1e-3, engine="python")
        for manner in ("change all at start", "polite")
    )
    for message in (
        "it changed the working directory (to /); that was undone",
        "it changed the floating-point environment",
    ):
        assert any(note.startswith(f"odd: {message}") for note in changed.notes), changed.notes
    for name in polite.series.names:
        np.testing.assert_array_equal(polite.series[name], changed.series[name])


def test_all_fmus_that_may_have_changed_the_working_directory_are_named(here, foreign, pair):
    system, scenario = pair(FmuComponent(foreign(), "odd"), "change folder")
    system = type(system)(
        {**system.components, "other": FmuComponent(foreign("other.fmu", guid="{other}"), "other")},
        constants={**system.constants, "other.piston.u": 0.0},
        parameters=system.parameters,
    )
    notes = run(system, scenario, step=1e-3, engine="python").notes
    assert any("odd: it changed the working directory (to /) while stepping, or 'other' did" in n for n in notes)


def test_results_are_written_to_the_requested_folder_if_an_fmu_changes_the_working_directory(here, case):
    done = CliRunner().invoke(main, ["run", str(case("change folder")), "-o", "results"])
    assert done.exit_code == 0, done.output
    assert {path.name for path in (here / "results").iterdir()} >= {"series.parquet", "result.json", "traces.png"}


@pytest.mark.skipif(sys.platform != "linux", reason="the rounding mode is set by its number on Linux")
def test_a_changed_rounding_mode_is_detected_and_restored():
    before, mathematics = Surroundings.now(), ctypes.CDLL("libm.so.6")
    assert before.restore() == ()
    upward = {"x86_64": 0x800, "aarch64": 0x400000}[os.uname().machine]
    mathematics.fesetround(upward)
    assert len(before.restore()) == 1
    assert mathematics.fegetround() == 0 and before.restore() == ()
