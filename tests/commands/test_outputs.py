"""No output option of any command replaces an input, a file of another kind or a folder, and none can be forgotten."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from eightpost.__main__ import every_verb, main
from eightpost.app.options import FilePath, OutputFile, OutputFolder
from eightpost.examples_folder import examples_folder

#: Content of a file with a suffix, as it is recognised.
CONTENT = {
    ".csv": b"Time [s],Force [N]\n0,1\n", ".fmu": b"PK\x03\x04", ".html": b"<!DOCTYPE html>\n<html>",
    ".mat": b"MATLAB 5.0", ".parquet": b"PAR1", ".png": b"\x89PNG\r\n\x1a\n", ".ssp": b"PK\x03\x04",
}  # fmt: skip

#: Options with which an output that may be a file or a folder is a folder.
FOLDER = {
    "study compare": ["--measured", "list.csv"], "virtual dyno": ["--test", "all"], "virtual rig": ["--program", "all"],
}  # fmt: skip

#: Every parameter that names a file or a folder to read. A new one is either an input, or an `OutputFile` or
#: `OutputFolder`.
INPUTS = {
    "build": {"sources"}, "check": {"files"}, "drivefile next": {"folder", "--record"},
    "drivefile simulate": {"folder"},
    "drivefile start": {"track", "--car"}, "export": {"sources"}, "fit": {"dyno_files"},
    "identify": {"rig_files", "--preparation", "--static"}, "inspect": {"files"},
    "report": {"files", "--car", "--limits"}, "run": {"case_file", "--drive"},
    "study clicks": {"shock_file", "--curve"},
    "study compare": {"folders", "--measured"}, "study confirm": {"folder"}, "study optimise": {"study_file"},
    "study robust": {"folder", "uncertain"}, "study run": {"study_file"}, "study select": {"folder"},
    "study sensitivity": {"folder"}, "study shapes": {"study_file"}, "study whatif": {"folder"}, "validate": {"paths"},
}  # fmt: skip

COMMANDS = every_verb()
OUTPUTS = {
    f"{name} {parameter.opts[0]}": (name, parameter)
    for name, command in COMMANDS.items()
    for parameter in command.params
    if isinstance(parameter.type, OutputFile | OutputFolder)
}
FILES = {name: one for name, one in OUTPUTS.items() if isinstance(one[1].type, OutputFile)}
FOLDERS = {name: one for name, one in OUTPUTS.items() if isinstance(one[1].type, OutputFolder)}


def inputs_of(name: str) -> list[click.Parameter]:
    """Return the parameters of a command that name a file to read."""
    return [parameter for parameter in COMMANDS[name].params if type(parameter.type) is FilePath]


def words(parameter: click.Parameter, value: str) -> list[str]:
    """Return the words that give a parameter."""
    return [value] if isinstance(parameter, click.Argument) else [f"{parameter.opts[0]}", value]


def called(monkeypatch: pytest.MonkeyPatch, name: str, *given: tuple[click.Parameter, str], more: list[str]) -> Result:
    """Call a command that must not begin to compute, with other files for its required inputs."""
    known = [parameter for parameter, _ in given]
    needed = [one for one in inputs_of(name) if one.required and one not in known]
    values = [*given, *((one, "other.txt") for one in needed)]
    line = [word for parameter, value in values for word in words(parameter, value)]
    monkeypatch.setattr(COMMANDS[name], "callback", lambda **_: click.echo("computing"))
    return CliRunner().invoke(main, [*name.split(), *line, *more], env={"COLUMNS": "400"})


def planted(path: Path, content: bytes) -> Path:
    """Write a file and return it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    planted(tmp_path / "other.txt", b"")
    return tmp_path


def test_every_parameter_that_names_a_file_is_either_an_input_or_an_output_that_is_checked() -> None:
    found = {name: {one.opts[0] if one.opts[0][0] != "-" else max(one.opts, key=len) for one in inputs_of(name)}
             for name in COMMANDS}  # fmt: skip
    assert {name: names for name, names in found.items() if names} == INPUTS
    paths = [one.type for command in COMMANDS.values() for one in command.params if isinstance(one.type, click.Path)]
    assert {type(one) for one in paths} == {FilePath, OutputFile, OutputFolder}
    assert not any(isinstance(one.type, click.File) for command in COMMANDS.values() for one in command.params)
    short = {name for name, command in COMMANDS.items() for one in command.params if "-o" in one.opts}
    assert short == {name for name, _ in OUTPUTS.values()} - {"app", "new", "study clicks"}


def _pairs() -> list[tuple[str, str]]:
    return [(output, one.opts[0]) for output, (name, _) in OUTPUTS.items() for one in inputs_of(name)]


@pytest.mark.parametrize(("output", "option"), _pairs(), ids=lambda text: text)
def test_an_output_never_replaces_an_input_of_its_command(
    monkeypatch: pytest.MonkeyPatch, folder: Path, output: str, option: str
) -> None:
    name, parameter = OUTPUTS[output]
    source = next(one for one in inputs_of(name) if one.opts[0] == option)
    suffix = next(iter(FILES[output][1].type.kind.suffixes), ".csv") if output in FILES else ".csv"
    file = planted(folder / f"input{suffix}", CONTENT.get(suffix, b"{}"))
    (folder / f"link{suffix}").symlink_to(file)
    (folder / f"second{suffix}").hardlink_to(file)
    for written in (file.name, f"./{file.name}", f"link{suffix}", f"second{suffix}"):
        ran = called(monkeypatch, name, (parameter, written), (source, file.name), more=[])
        assert ran.exit_code == 2, ran.output
        as_folder = "is a file, not a folder; choose another output folder"
        assert f"{written.removeprefix('./')} is an input of this command" in ran.output or as_folder in ran.output
    assert file.read_bytes() == CONTENT.get(suffix, b"{}")


@pytest.mark.parametrize("output", FILES)
def test_an_output_never_replaces_a_file_of_another_kind(
    monkeypatch: pytest.MonkeyPatch, folder: Path, output: str
) -> None:
    name, parameter = FILES[output]
    for suffix in parameter.type.kind.suffixes:
        foreign = CONTENT[".parquet" if suffix != ".parquet" else ".csv"]
        file = planted(folder / f"kept{suffix}", foreign)
        ran = called(monkeypatch, name, (parameter, file.name), more=[])
        assert ran.exit_code == 2 and "would replace it; choose another output, or delete that file" in ran.output
        assert file.read_bytes() == foreign
    document = planted(folder / "kept.json", b'{"kind": "study"}')
    if parameter.type.kind.document:
        ran = called(monkeypatch, name, (parameter, document.name), more=[])
        assert ran.exit_code == 2 and "is a JSON file of the kind 'study'" in ran.output


@pytest.mark.parametrize("output", FILES)
def test_an_output_replaces_an_earlier_one(monkeypatch: pytest.MonkeyPatch, folder: Path, output: str) -> None:
    name, parameter = FILES[output]
    for suffix in parameter.type.kind.suffixes or (".mat", ".csv"):
        earlier = f'{{"kind": "{parameter.type.kind.document}"}}'.encode()
        content = {**CONTENT, ".json": earlier, ".htm": CONTENT[".html"], ".pdf": b"%PDF-1.4", ".svg": b"<svg>"}
        for kept in (content[suffix], b""):
            file = planted(folder / f"kept{suffix}", kept)
            ran = called(monkeypatch, name, (parameter, file.name), more=[])
            assert ran.exit_code == 0 and "computing" in ran.output, ran.output


@pytest.mark.parametrize("output", FILES)
def test_a_file_to_write_is_no_folder_and_has_a_suffix_of_its_kind(
    monkeypatch: pytest.MonkeyPatch, folder: Path, output: str
) -> None:
    name, parameter = FILES[output]
    (folder / "place.fmu").mkdir()
    for place in (".", "place.fmu")[name == "build" :]:
        ran = called(monkeypatch, name, (parameter, place), more=[])
        assert ran.exit_code == 2 and f"{place} is a folder; name a file in it, such as" in ran.output
    for wrong in ("1 s", "x.docx"):
        if name not in ("build", "export"):  # any other name is a folder there; the format of an export is an option
            ran = called(monkeypatch, name, (parameter, wrong), more=[])
            proposed = Path(wrong).with_suffix(Path(parameter.type.kind.example).suffix)
            assert ran.exit_code == 2 and f"write {parameter.opts[0]} {proposed}" in ran.output
    ran = called(monkeypatch, name, (parameter, "other.txt/" + parameter.type.kind.example), more=[])
    assert ran.exit_code == 2 and "other.txt is a file, not a folder" in ran.output


@pytest.mark.parametrize("output", [*FOLDERS, "build -o", "study compare -o", "virtual dyno -o", "virtual rig -o"])
def test_a_folder_to_write_is_no_file_and_keeps_files_of_another_kind(
    monkeypatch: pytest.MonkeyPatch, folder: Path, output: str
) -> None:
    name, parameter = OUTPUTS[output]
    for place in ("other.txt", "other.txt/out"):
        ran = called(monkeypatch, name, (parameter, place), more=FOLDER.get(name, []))
        assert ran.exit_code == 2 and "other.txt is a file, not a folder; choose another output folder" in ran.output
    for file in getattr(parameter.type, "files", ()):
        planted(folder / "out" / file, foreign := CONTENT[".png" if Path(file).suffix != ".png" else ".csv"])
        ran = called(monkeypatch, name, (parameter, "out"), more=[])
        assert ran.exit_code == 2 and f"{Path('out', file)} is a" in ran.output and "would replace it" in ran.output
        assert (folder / "out" / file).read_bytes() == foreign
        (folder / "out" / file).unlink()
    ran = called(monkeypatch, name, (parameter, "new/out"), more=FOLDER.get(name, []))
    assert ran.exit_code == 0 and "computing" in ran.output


#: Command line without an output, and the output that it writes.
DEFAULTS = {
    "fit a/d.csv": "d.json",
    "fit a/t.toml": "t.json",
    "report a/shock.json --live": "shock.html",
    "report a/shock.json": "report.html",
    "study sensitivity a": "a/sensitivity.parquet",
}


@pytest.mark.parametrize("line", DEFAULTS)
def test_an_output_that_is_not_named_is_checked_too(monkeypatch: pytest.MonkeyPatch, folder: Path, line: str) -> None:
    name = next(verb for verb in COMMANDS if line.startswith(verb))
    monkeypatch.setattr(COMMANDS[name], "callback", lambda **given: click.echo(f"computing {given}"))
    ran = CliRunner().invoke(main, line.split())
    assert ran.exit_code == 0 and f"Path('{DEFAULTS[line]}')" in ran.output, ran.output
    planted(folder / DEFAULTS[line], b"a letter to my aunt")
    ran = CliRunner().invoke(main, line.split(), env={"COLUMNS": "400"})
    assert ran.exit_code == 2 and f"{DEFAULTS[line]} is a text file, and " in ran.output


def test_an_export_whose_format_is_an_option_never_replaces_a_file_of_another_format(folder: Path) -> None:
    shock = examples_folder() / "bank" / "B_B.json"
    for line in (["--format", "carmaker", "-o", "kept.info"], ["-o", "kept.csv"], ["--format", "csv", "-o", "kept"]):
        kept = planted(folder / line[-1], CONTENT[".png"])
        ran = CliRunner().invoke(main, ["export", str(shock), *line], env={"COLUMNS": "400"})
        assert ran.exit_code == 2 and "is a PNG picture, and a text file would replace it" in ran.output, ran.output
        assert kept.read_bytes() == CONTENT[".png"]
