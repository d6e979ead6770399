"""A newcomer's wrong file, unit, name or verb ends a command with exit code 2, advice, and every file as it was.

The starter folder is in a path with spaces and umlauts.
"""

import shlex
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.examples_folder import examples_folder

#: Command and what its message says, for each kind of reader.
WRONG = {
    # Damper engineer
    "fitt shocks/dyno_A.csv": "there is no verb 'fitt'; did you mean fit",
    "fit shocks/dyno_a.csv": "there is no such file; did you mean dyno_A.csv?",
    "fit shoks/dyno_A.csv": "there is no folder shoks; the current folder is",
    "fit shocks": "shocks: is a folder, not a file; name the files in it",
    "report car.json": "is a vehicle file, not a shock file; eightpost inspect shows it, validate compares it with rig",
    "fit B_B.json": "is a shock file, not a record; give the record",
    "fit shocks/dyno_A.csv --law lpnl3": "one of polylinear, lpf1, lpnl2, hysteresis; did you mean lpnl2?",
    "fit shocks/dyno_A.csv --law hysterisis": "did you mean hysteresis?",
    "fit shocks/dyno_A.csv --set 'cutof=3 Hz'": "there is no such setting; did you mean cutoff?",
    "fit shocks/dyno_A.csv --channel force": "write CHANNEL=COLUMN",
    "study optimize none.toml": "there is no verb 'optimize'; did you mean optimise?",
    "run system.toml --fmu lf": "write it as NAME=FILE",
    "check other.json": "is not a readable zip archive",
    "fit shocks/dyno_A.csv --lew lpnl2": "No such option '--lew'. (Did you mean one of: '--law'",
    "fit shocks/dyno_A.csv --law lpf1 -o car.toml": "a shock file ends in .json; write -o car.json",
    "fit no_unit.csv": "the column 'Force' has no unit; write `Force [unit]` in the header",
    "virtual dyno --build C/B --set gas=150 -o d.csv": "--set gas='150' has no unit; add it: '150 Pa' if it is in Pa",
    # Rig engineer
    "identify rig/*.parquet -o c.json": "there is no such file: there is no folder rig",
    "identify shocks -o c.json": "shocks is a folder; name its files, such as",
    "identify shocks/dyno_A.csv shocks/dyno_B.csv -o c.json": "the file has: Time, Position, Velocity, Force",
    "rig --test random --shock dmo:B -o r.parquet": "a shock is one of demo:A, configuration:1, build:C/B",
    "inspect B_B.json --vary damping": "B_B.json is not a vehicle file, and --vary varies a parameter of one; omit it",
    "inspect study.toml": "study.toml defines a study: run it with study -o FOLDER, and inspect the folder",
    # Simulation engineer
    "build other.json -o dist": "is not a file that eightpost wrote or documents: it contains 'a'",
    "build study.toml -o dist": "the file defines a study or a system, not a vehicle; a vehicle file has model =",
    "build car.toml -o car.fmu": "car.fmu: FMUs are named after their SOURCES; name a folder with -o",
    "check car.toml": "car.toml defines a vehicle, not a system; make an FMU of it with build",
    "export car.toml": "Missing option '-o'",
    # Python developer and researcher
    "run car.toml": "car.toml defines a vehicle, not a system; make an FMU of it with build",
    "run study.toml": "study.toml defines a study, not a system; run it with study",
    "run B_B.json": "is a .json file; a .toml file is needed here",
    "run other.fmu": "is an FMU, not a system; name it in the file of a system, e.g. one of eightpost new",
    "study other.fmu -o out": "other.fmu is an FMU, not a study; name it in the file of a study",
    "run track.parquet": "track.parquet: is not a text file, which is needed here",
    "run sytem.toml": "there is no such file; did you mean system.toml?",
    "study compare shocks nowhere": "shocks: there is no run here; name a folder that `eightpost run` wrote",
    "study study.toml -o out": "the file shocks/dyno_A.json does not exist; correct its name there, or make it first",
    "reproduce 99.9 -o out": "there is no item '99.9'; the nearest are",
    "reproduce --all 3.1 -o out": "give either --all or items, not both",
    # Empty files, folders in place of files, links to nothing, empty names
    "fit empty.csv": "empty.csv: is empty: it has 0 bytes",
    "inspect empty.tdms": "empty.tdms: is empty: it has 0 bytes",
    "fit shocks/dyno_A.csv --channel empty.toml": "empty.toml: is empty; write it again",
    "study clicks empty.json --curve B_B.json": "empty.json: is empty; write it again",
    "run shocks": "shocks: is a folder, not a file",
    "build shocks -o dist": "shocks: is a folder, not a file; name the files in it",
    "build B_B.json -o ''": "'--output': the name of a file or folder is empty",
    "report cut.json -o page.html": "cut.json, line 3: cannot be read as JSON",
    "validate car.json shocks/dyno_A.csv": "car.json: needs the report of its fit, car.fit.json, in the same folder",
    "validate left.json shocks/dyno_A.csv": "needs the responses of its tests, left.response.npz, in the same folder",
    # Numbers that no comparison finds out of range, or that would take hours and the whole memory
    "validate B_B.json shocks/dyno_A.csv --limit nan": "'nan' is not a finite number",
    "study compare out --measured out --set rank=nan": "--set rank=nan: 'nan' is not a finite number",
    "virtual dyno --configuration 5 --test sine --set amplitude='900 m' --set speed='1 in/s' -o d.csv":
        "use a higher speed, or a",
    "virtual dyno --configuration 5 --test sine --set amplitude='1 in' --set speed='1e-6 in/s' -o d.csv":
        "at most 3600 s; use a",
    "virtual rig --car quarter_car --set duration='1e9 s' -o r.parquet":
        "--set duration must be at most 7200 s, not '1e9 s'",
    "study shapes study.toml --set keep='200 %'":
        "keep, the share of the gain, must be above 0 and at most 100 %, not 200 %",
    "study shapes study.toml --set tolerance='-3 %'": "tolerance must be 0 to 33 %, not -3 %",
    "study shapes study.toml --limit rebound.low=1,2": "--limit rebound.low=1,2: '1' has no unit",
    "study sensitivity out -o terms.txt": "a table ends in .parquet; write -o terms.parquet",
    # Entries of the wrong type
    "run wrong.toml": "components: must be a table, not 3; scenario: is missing",
    "inspect no_parameters.toml": "parameters: is missing",
}  # fmt: skip


@pytest.fixture(scope="module")
def starter(tmp_path_factory):
    folder = tmp_path_factory.mktemp("Prüfstand 7") / "Dämpfer (neu)"
    assert CliRunner().invoke(main, ["new", str(folder)]).exit_code == 0
    shutil.copy(examples_folder() / "car.toml", folder)
    shutil.copy(examples_folder() / "bank" / "B_B.json", folder)
    record = (folder / "shocks" / "dyno_A.csv").read_text(encoding="utf-8")
    (folder / "no_unit.csv").write_text(record.replace("Force [lbf]", "Force"), encoding="utf-8")
    (folder / "other.json").write_text('{"a": 1}', encoding="utf-8")
    (folder / "other.fmu").write_bytes(b"PK\x03\x04\xad")
    (folder / "cut.json").write_text('{\n"kind": "shock",\n"law":', encoding="utf-8")
    (folder / "wrong.toml").write_text("components = 3\n", encoding="utf-8")
    (folder / "no_parameters.toml").write_text('model = "seven_dof"\n', encoding="utf-8")
    for name in ("car.json", "left.json"):
        shutil.copy(examples_folder() / "identified" / "car.json", folder / name)
    (folder / "left.fit.json").touch()
    for suffix in ("csv", "tdms", "toml", "json"):
        (folder / f"empty.{suffix}").touch()
    return folder


@pytest.mark.parametrize("line", WRONG)
def test_a_wrong_input_ends_with_2_and_advice_and_loses_nothing(starter, monkeypatch, line):
    monkeypatch.chdir(starter)
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    shown = CliRunner().invoke(main, shlex.split(line), env={"COLUMNS": "400"})
    assert shown.exit_code == 2, shown.output
    assert WRONG[line] in " ".join(shown.output.split()), shown.output
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before
