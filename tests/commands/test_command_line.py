"""The command line reports its results and exits with 0 (done), 1 (not acceptable) or 2 (wrong input)."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost import __main__ as program
from eightpost import __version__
from eightpost.__main__ import SECTIONS, VERBS, every_verb, main
from eightpost.archive import read_archive, write_archive
from eightpost.shock import read_shock

ROOT = Path(__file__).parents[2]


@pytest.fixture
def eightpost():
    def call(*words):
        return CliRunner().invoke(main, [str(word) for word in words])

    return call


def test_help_lists_the_commands_in_the_order_of_the_work(eightpost):
    shown = eightpost("--help")
    assert shown.exit_code == 0
    listed = [verb for section in SECTIONS.values() for verb in section]
    places = [shown.output.index(f"\n  {verb} ") for verb in listed]
    assert places == sorted(places)
    assert len(listed) <= 16 and set(VERBS) - set(listed) == {"reproduce", "units"}
    assert __version__ in eightpost("--version").output


def test_the_help_of_every_command_begins_with_its_summary_in_the_list(eightpost):
    for verb in every_verb():
        shown = eightpost(*verb.split(), "--help")
        group, _, member = verb.partition(" ")
        entry = VERBS[group].members[member] if member else VERBS[group]
        assert shown.exit_code == 0 and entry.text.rstrip(".") in " ".join(shown.output.split()), verb
        assert verb == "demo" or "Example" in shown.output, verb


@pytest.mark.parametrize(("words", "completes", "is_supervised"), [
    (["run", "case.toml"], "", True), (["-v", "fit", "dyno.csv"], "", True), (["--help"], "", False),
    (["--version"], "", False), ([], "", False), (["run", "case.toml"], "bash_complete", False),
])  # fmt: skip
def test_every_command_but_help_and_completion_is_supervised(monkeypatch, words, completes, is_supervised):
    started, codes = [], []
    monkeypatch.setattr(program, "supervised", lambda work, _complain: started.append(work) or 7)
    monkeypatch.setattr(os, "_exit", codes.append)
    monkeypatch.setattr(sys, "argv", ["eightpost", *words])
    if completes:
        monkeypatch.setenv("_EIGHTPOST_COMPLETE", completes)
        monkeypatch.setenv("COMP_WORDS", "eightpost ru")
        monkeypatch.setenv("COMP_CWORD", "1")
    with contextlib.suppress(SystemExit):
        main(prog_name="eightpost")
    assert (len(started), codes) == ((1, [7]) if is_supervised else (0, []))


def test_a_call_with_arguments_is_not_a_program(monkeypatch):
    monkeypatch.setattr(program, "supervised", None)
    monkeypatch.setattr(sys, "argv", ["eightpost", "run"])
    for words in ([["--version"]], []):
        with pytest.raises(SystemExit) as ended:
            main(*words, **({} if words else {"args": ["--version"]}))
        assert ended.value.code == 0


@pytest.mark.slow
def test_fit_prints_at_most_twelve_lines_of_80_columns_or_the_tables_and_writes_shock_and_picture(eightpost, tmp_path):
    output, picture = tmp_path / "a.json", tmp_path / "curve.png"
    words = (
        "fit", ROOT / "examples" / "data" / "dyno_C.csv", "--law", "LPF1", "-o", output, "--build", "C",
        "--set", "clicks=3 from closed", "--set", "gas-pressure=150 psi",
    )  # fmt: skip
    lines = eightpost(*words).output.splitlines()
    assert len(lines) <= 12
    assert max(len(line) for line in lines if not line.startswith(("wrote", "/"))) <= 80
    labels = [line.split()[0] for line in lines if line.startswith("  ")]
    wanted = ["law", "error", "held", "range"]
    assert [label for label in labels if label in wanted] == wanted
    assert lines[-1] == f"wrote {output}"
    shown = eightpost(*words, "--plot", picture, "-v")
    assert shown.exit_code == 0, shown.output
    assert len(shown.output.splitlines()) > 20 and "LPF1" in shown.output and "time_constant" in shown.output
    shock = read_shock(output)
    assert 0.0005 < shock.law.time_constant < 0.003
    assert shock.conditions["clicks"] == "3 from closed"
    assert picture.stat().st_size > 10_000


def test_check_exits_1_if_there_are_findings(eightpost, fmus, tmp_path):
    """It exits with 0 for an FMU without findings: tests/test_name_clash.py."""
    description = read_archive(fmus["lpf1"])["modelDescription.xml"].replace(b'unit="m/s"', b'unit="knots"')
    write_archive(tmp_path / "lpf1.fmu", {"modelDescription.xml": description})
    shown = eightpost("check", tmp_path / "lpf1.fmu")
    assert shown.exit_code == 1
    assert "knots" in shown.output


def test_a_component_that_fails_exits_1_with_its_name(eightpost, fmus, tmp_path):
    shutil.copy(fmus["quarter_car"], tmp_path / "car.fmu")
    shutil.copy(fmus["lpnl2"], tmp_path / "shock.fmu")
    (tmp_path / "case.toml").write_text(
        '[components.car]\nfmu = "car.fmu"\ninputs = { road = 0, aero_force = 0 }\n'
        '[components.shock]\nfmu = "shock.fmu"\nparameters = { lag_zero_force = 1.0 }\n'
        '[[bond]]\nbetween = ["car", "shock"]\n[scenario]\nstop = 0.1\n'
    )
    shown = eightpost("run", tmp_path / "case.toml", "-o", tmp_path / "out")
    assert shown.exit_code == 1, shown.output
    assert "shock" in shown.output
    assert "lag_zero_force" in shown.output
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_run_draws_the_named_picture_and_no_other(eightpost, fmus, tmp_path):
    (tmp_path / "case.toml").write_text(
        f'[components.car]\nfmu = "{fmus["quarter_car"]}"\ninputs = {{ road = 0, aero_force = 0, force = 0 }}\n'
        "[scenario]\nstop = 0.1\n"
    )
    words = ("-o", tmp_path / "out", "--step", "10 ms", "--plot", tmp_path / "pictures" / "car.png")
    shown = eightpost("run", tmp_path / "case.toml", *words)
    assert shown.exit_code == 0, shown.output
    assert {path.name for path in tmp_path.rglob("*.png")} == {"car.png"}
    assert "car.png" in shown.output.splitlines()[-1]
    assert (tmp_path / "pictures" / "car.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.nightly
def test_two_runs_are_compared_and_their_fmus_and_parameters_named(eightpost, fmus, tmp_path):
    for name, shock in (("a", "lpnl2"), ("b", "lpf1")):
        (tmp_path / f"{name}.toml").write_text(
            f'[components.car]\nfmu = "{fmus["quarter_car"]}"\ninputs = {{ aero_force = 0 }}\n'
            f'[components.shock]\nfmu = "{fmus[shock]}"\nparameters = {{ rebound_scale = 0.9 }}\n'
            '[[bond]]\nbetween = ["car", "shock"]\n[scenario]\nstop = 2\nsettling = 0.5\n'
            f'drivefile = "{ROOT}/examples/data/track.parquet"\n[scenario.targets]\n"lf.road" = "car.road"\n'
        )
        assert eightpost("run", tmp_path / f"{name}.toml", "-o", tmp_path / name).exit_code == 0
    shown = eightpost("-v", "study", "compare", tmp_path / "a", tmp_path / "b", "-o", tmp_path / "changes.png")
    assert shown.exit_code == 0, shown.output
    for expected in ("shock = lpnl2.fmu", "shock = lpf1.fmu", "shock.rebound_scale = 0.9", "%"):
        assert expected in shown.output
    assert (tmp_path / "changes.png").stat().st_size > 5_000
    assert eightpost("study", "compare", tmp_path / "a").exit_code == 2
    assert eightpost("study", "compare", tmp_path / "a", tmp_path).exit_code == 2


def test_the_default_output_of_a_json_record_has_another_name(eightpost, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    time = np.arange(1500) / 500.0
    speed = np.cos(10.0 * time) + 0.3 * np.cos(23.0 * time)
    columns = {"time [s]": time, "velocity [m/s]": 0.1 * speed, "force [N]": 100.0 * np.tanh(speed)}
    (tmp_path / "run.json").write_text(json.dumps({name: values.tolist() for name, values in columns.items()}))
    shown = eightpost("fit", "run.json", "--law", "polylinear")
    assert "wrote run_shock.json" in shown.output, shown.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.json", "run_shock.json"]


def test_a_record_is_not_fitted_together_with_itself(eightpost, tmp_path):
    record = tmp_path / "own.csv"
    shutil.copy(ROOT / "examples" / "data" / "dyno_A.csv", record)
    shown = eightpost("fit", record, record, "-o", tmp_path / "a.json")
    assert shown.exit_code == 2
    assert "own.csv has the content of" in shown.output


PLOTS = {"fit_laws.png", "fit_builds.png", "traces.png", "spectra.png", "measures.png"}


def test_the_demo_of_this_clone_has_written_all_plots_and_pages():
    """Of `make demo`, which runs before the tests in CI; `make nightly` runs the demo itself."""
    demo = Path(__file__).parents[2] / "demo"
    if not (demo / "study").is_dir():
        pytest.skip("there is no demo/: run make demo first")
    assert {path.name for path in demo.glob("*.png")} == PLOTS
    assert (demo / "study" / "report.html").stat().st_size > 1_000_000


@pytest.mark.nightly
@pytest.mark.usefixtures("all_platforms")
def test_the_demo_runs_the_whole_workflow_and_writes_plots(eightpost, tmp_path):
    shown = eightpost("demo", "-o", tmp_path / "demo")
    assert shown.exit_code == 0, shown.output[-3000:]
    assert "synthetic" in shown.output
    assert len(shown.output.splitlines()) <= 60
    assert [line.split()[0] for line in shown.output.splitlines()[-3:]][::2] == ["best", "page:"]
    assert "total tire force" in shown.output
    page = tmp_path / "demo" / "study" / "report.html"
    assert str(page) in shown.output.replace("\n", "")
    assert page.stat().st_size > 1_000_000
    names = {path.name for path in (tmp_path / "demo").glob("*.png")}
    assert names == PLOTS


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have Unicode names of files in every locale")
@pytest.mark.parametrize(("chosen", "used"), [(None, "1"), ("4", "4")])
def test_linear_algebra_has_one_thread_unless_the_user_chose_a_number(eightpost, monkeypatch, chosen, used):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", chosen or "")
    if chosen is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    assert eightpost("inspect", ROOT / "examples" / "car.toml").exit_code == 0
    assert os.environ["OPENBLAS_NUM_THREADS"] == used


def test_a_file_name_that_is_not_text_in_the_locale_is_reported_with_what_to_set():
    ascii_only = os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-m", "eightpost", "fit", "Dämpfer.csv"]
    ran = subprocess.run(command, env=ascii_only, capture_output=True, text=True, encoding="utf-8", check=False)
    assert ran.returncode == 2
    assert "is not text in the encoding ascii" in ran.stderr and "set PYTHONUTF8=1" in ran.stderr
