"""FMUs that end this process or change its environment are named, also without --isolate; the changes are undone."""

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

#: Tool that an FMU names as its maker, which anybody can write.
OURS = "eightpost 9"

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
    def write(manner, **declared):
        (tmp_path / "case.toml").write_text(CASE.format(fmu=foreign(**declared).name, manner=manner))
        return tmp_path / "case.toml"

    return write


@pytest.fixture
def ended(tmp_path):
    """Run Python in a separate process; return its exit code, output and errors after all its children have ended."""

    def start(*arguments, **variables):
        command = [sys.executable, *map(str, arguments)]
        (tmp_path / "temporary").mkdir(exist_ok=True)
        environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary"), **variables}
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=environment)

    return start


@pytest.mark.repeated
@pytest.mark.parametrize(
    ("manner", "engine", "code", "tool"),
    [
        ("exit", "compiled", 1, ""),
        ("exit with 0", "python", 1, OURS),
        ("exit at start", "python", 1, ""),
        ("_exit with 0", "compiled", 0, OURS),  # the operating system's own call: nobody can change the code
        ("abort", "compiled", -6, OURS),
        ("segfault", "python", -11, ""),
    ],
)
def test_the_error_names_the_fmu_that_ends_the_process(manner, engine, code, tool, case, ended):
    found = ended("-c", IN_PYTHON, case(manner, tool=tool), engine)
    assert found.returncode == code, found.stderr
    assert found.stderr.count("error: this process ended while component 'odd' (foreign.fmu) was called") == 1
    assert "--isolate" in found.stderr and "came to its end" not in found.stdout


@pytest.mark.slow
@pytest.mark.repeated("_exit with 0", "hang at start")
@pytest.mark.parametrize(("manner", "declared", "when"), [
    ("_exit with 0", {"tool": OURS}, "'odd' (foreign.fmu) was called at 0.5 s"),
    ("polite", {"tool": OURS, "guid": "{no birth}"}, "'calm' (foreign.fmu) was called to instantiate"),
    ("hang at start", {}, "'odd' (foreign.fmu) was called to enter initialization and did not return within 1 s"),
])  # fmt: skip
def test_a_run_that_an_fmu_ends_or_blocks_exits_with_1_names_it_and_marks_the_folder(
    manner, declared, when, case, ended, tmp_path
):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "result.json").write_text('{"kind": "result"}')
    options = ["-m", "eightpost", "run", case(manner, **declared), "-o", tmp_path / "out", "--step", "10 ms"]
    found = ended(*options, EIGHTPOST_TIME_LIMIT="1")
    assert found.returncode == 1
    assert found.stderr.count("error: ") == 1 and when in found.stderr and "--isolate" in found.stderr
    assert f"The results in {tmp_path / 'out'} are of an earlier run" in found.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"result.json", "unfinished.txt"}
    assert not [*(tmp_path / "temporary").iterdir()]


@pytest.mark.nightly
def test_a_run_of_a_slow_fmu_comes_to_its_end_and_leaves_neither_a_mark_nor_temporary_files(case, ended, tmp_path):
    options = ["-o", tmp_path / "out", "--step", "50 ms", "--set", "comparison=no"]  # 12 steps of 0.2 s
    found = ended("-m", "eightpost", "run", case("slow", tool=OURS), *options, EIGHTPOST_TIME_LIMIT="0.8")
    assert (found.returncode, found.stderr) == (0, "")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"series.parquet", "series.csv", "result.json"}
    assert not [*(tmp_path / "temporary").iterdir()]


@pytest.mark.slow
def test_the_folder_of_a_run_that_did_not_finish_is_named_by_who_reads_it(case, tmp_path):
    for folder in ("one", "two"):
        done = CliRunner().invoke(main, ["run", str(case("polite")), "-o", str(tmp_path / folder)])
        assert done.exit_code == 0, done.output
    failed = CliRunner().invoke(main, ["run", str(case("error")), "-o", str(tmp_path / "one")])
    assert failed.exit_code == 1 and f"The results in {tmp_path / 'one'} are of an earlier run" in failed.stderr
    compared = CliRunner().invoke(main, ["study", "compare", str(tmp_path / "one"), str(tmp_path / "two")])
    assert "warning: results in" in compared.stderr and compared.stderr.count("did not finish") == 1


@pytest.mark.nightly
def test_an_fmu_that_was_not_being_called_is_not_blamed_for_the_end_of_the_process(case, ended):
    found = ended("-c", IN_PYTHON + "\nimport os; os._exit(5)", case("polite"), "python")
    assert (found.returncode, found.stderr) == (5, "")


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory and a rounding mode that must not change."""
    monkeypatch.chdir(tmp_path)
    before = Surroundings.now()
    yield tmp_path
    assert before.restore() == ()


@pytest.mark.repeated
@pytest.mark.parametrize("engine", ["python", "compiled"])
@pytest.mark.parametrize(("manner", "message"), [
    ("change folder", "odd: it changed the working directory (to /) while stepping; that was undone"),
    ("round up", "odd: it changed the floating-point environment"),
])  # fmt: skip
def test_a_change_of_the_process_environment_while_stepping_is_reported_and_undone(
    manner, message, engine, here, foreign, pair
):
    result = run(*pair(FmuComponent(foreign(), "odd"), manner), step=1e-3, engine=engine)
    assert [note for note in result.notes if note.startswith(message)], result.notes
    assert Path.cwd() == here
    assert not [note for note in run(*pair(FmuComponent(foreign(), "odd")), step=1e-3).notes if "changed" in note]


def test_a_change_by_an_fmu_that_claims_to_be_ours_is_undone_too(here, foreign, pair):
    notes = run(*pair(FmuComponent(foreign(tool=OURS), "odd"), "change folder"), step=1e-3, engine="python").notes
    message = "it changed the working directory (to /) while stepping, or {} did; that was undone"
    assert {"odd: " + message.format(repr("shock")), "shock: " + message.format(repr("odd"))} <= {*notes}
    assert Path.cwd() == here


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


def test_results_are_written_to_the_requested_folder_if_an_fmu_changes_the_working_directory(here, case):
    done = CliRunner().invoke(main, ["run", str(case("change folder")), "-o", "results"])
    assert done.exit_code == 0, done.output
    assert {path.name for path in (here / "results").iterdir()} >= {"series.parquet", "result.json"}
