"""Values of options: quantities with units, assignments, channel maps, and old spellings, which still work."""

from __future__ import annotations

import shlex
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from eightpost.__main__ import every_verb, main
from eightpost.app import options
from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.former import current_verb
from eightpost.errors import InputError, ParameterError
from eightpost.outputs import EXPORT


def given(*words: str, **option: object) -> Result:
    """Return the result of a verb that prints its only option."""

    @click.command(cls=options.Verb)
    @click.option("--value", **option)
    def verb(value: object) -> None:
        click.echo(repr(value))

    return CliRunner().invoke(verb, words)


@pytest.mark.parametrize(("text", "value"), [("10 mm", 0.01), ("1 in", 0.0254), ("-2 m", -2.0), ("1e3 mm", 1.0)])
def test_a_quantity_is_converted_to_the_unit_of_its_option(text: str, value: float) -> None:
    shown = given("--value", text, type=options.Quantity("m"))
    assert float(shown.stdout) == pytest.approx(value) and not shown.stderr


def test_a_default_is_a_quantity_too() -> None:
    assert given(type=options.Quantity("Hz"), default="0.125 kHz").stdout == "125.0\n"
    assert given(type=options.Quantity("Hz")).stdout == "None\n"


@pytest.mark.parametrize(("text", "option", "error", "message"), [
    ("10", options.Quantity("m"), InputError, "--value '10' has no unit; add it: '10 m' if it is in m"),
    ("ten mm", options.Quantity("m", bare=True), InputError, "--value 'ten mm': 'ten mm' is not a value"),
    ("10 s", options.Quantity("m"), InputError, "--value '10 s': cannot convert"),
    ("0 s", options.Quantity("s", positive=True), ParameterError, "--value must be above 0, not '0 s'"),
])  # fmt: skip
def test_a_wrong_quantity_is_an_error_that_names_the_option(
    text: str, option: options.Quantity, error: type[Exception], message: str
) -> None:
    shown = given("--value", text, type=option)
    assert isinstance(shown.exception, error) and message in str(shown.exception)


def test_a_number_without_a_unit_still_works_where_it_did_with_a_warning() -> None:
    shown = given("--value", "50", type=options.Quantity("Hz", bare=True))
    assert shown.stdout == "50.0\n"
    assert shown.stderr == ("warning: --value 50 has no unit; write --value '50 Hz', which the next version requires\n")


def test_an_assignment_is_a_pair() -> None:
    assert given("--value", "a=b=c", type=options.Assignment("NAME=VALUE")).stdout == "('a', 'b=c')\n"
    for word in ("a", "a=", "=b"):
        shown = given("--value", word, type=options.Assignment("NAME=VALUE"))
        assert shown.exit_code == 2 and "write it as NAME=VALUE" in shown.stderr


@pytest.mark.parametrize(("old", "new", "warnings"), [
    ("settings t.toml --cutoff '50 Hz'", "fit t.toml --set 'cutoff=50 Hz'", 2),
    ("fit a.csv --units force=lbf --flip force", "fit a.csv --channel 'force=[lbf]' --channel force=-", 2),
    ("fit a.csv --flip none --map m.toml", "fit a.csv --channel force=+ --channel m.toml", 2),
    ("fit a.csv --segment '1 s' '10 s' --law lpf1", "fit a.csv --set 'segment=1 s, 10 s' --law lpf1", 1),
    ("fit a.csv --name=x --split", "fit a.csv --set name=x --split", 1),
    ("report a.csv --flip a.csv=force", "report a.csv --channel a.csv:force=-", 1),
    ("page shock.json --vehicle c.toml", "report --live shock.json --car c.toml", 2),
    ("validate s.json r/ --report x.html", "validate s.json r/ --output x.html", 1),
    ("vehicle car.toml --vary damping --factors 1,2", "inspect car.toml -o vehicle --vary damping=1,2", 1),
    ("linearity a b --output lf.force -o x", "inspect a b --set channel=lf.force -o x", 1),
    ("build --assemble s.toml -o a.fmu", "build s.toml -o a.fmu", 1),
    ("run s.toml --no-comparison --verify", "run s.toml --set comparison=no --set verify=yes", 2),
    ("ssp s.toml", "export s.toml", 1), ("study s.toml --scheduler tcp://h:1", "study s.toml --workers tcp://h:1", 1),
    ("study s.toml --no-certainty", "study s.toml --set certainty=no", 1),
    ("-v optimise s.toml --seed 3", "-v study optimise s.toml --set seed=3", 2),
    ("rig --only lf.road -o a.csv", "virtual rig --set only=lf.road -o a.csv", 2),
    ("drivefile next f --map m.toml", "drivefile next f --channel m.toml", 1),
])  # fmt: skip
def test_an_old_spelling_is_the_new_one_with_a_warning(
    old: str, new: str, warnings: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert current(old) == current(new) == shlex.split(new)
    assert capsys.readouterr().err.count("the next version will not accept") == warnings


def current(line: str) -> list[str]:
    """Return the words of a command line in their current spellings."""
    words = current_verb(shlex.split(line), report=options.warn)
    begin = next(place for place, word in enumerate(words) if not word.startswith("-"))
    group = words[begin] in ("study", "drivefile", "virtual") and " ".join(words[begin : begin + 2]) in every_verb()
    verb = " ".join(words[begin : begin + 1 + group])
    command = every_verb()["study run" if verb == "study" else verb]
    return [*words[:begin], *verb.split(), *command.current(verb, words[begin + 1 + group :])]


@pytest.mark.parametrize(
    "line", ["fit none.csv --cutoff 50 -o x.json", "settings none.toml", "study none.toml --top 3"]
)
def test_a_verb_runs_with_its_old_spelling(line: str) -> None:
    shown = CliRunner().invoke(main, line.split())
    assert shown.exit_code == 2 and "No such option" not in shown.stderr and "none." in shown.stderr


@pytest.mark.parametrize(("words", "expected"), [
    (["force=Load 2"], ({"force": "Load 2"}, {}, ())), (["force=[lbf]"], ({}, {"force": "lbf"}, ())),
    (["force=-"], ({}, {}, ("force",))), (["force=+"], ({}, {}, ("none",))),
    (["force=-Load 2 [lbf]"], ({"force": "Load 2"}, {"force": "lbf"}, ("force",))),
    (["force=Damper [LF]"], ({"force": "Damper [LF]"}, {}, ())),
    (["time=1", "force=3"], ({"time": "1", "force": "3"}, {}, ())),
])  # fmt: skip
def test_a_channel_has_a_column_a_sign_and_a_unit(words: list[str], expected: tuple[object, ...]) -> None:
    found = channels(*words)
    columns = {name: pick.source for name, pick in found.channel_map.channels.items()} if found.channel_map else {}
    columns |= {"time": found.channel_map.time.source} if found.channel_map and found.channel_map.time else {}
    assert (columns, found.units, found.flip) == expected


def test_a_channel_of_one_file_is_reversed() -> None:
    found = channels("a.csv:force=-", "velocity=-")
    assert (found.flip, found.of_files) == (("velocity",), {"a.csv": ("force",)})


def test_columns_complete_a_channel_map(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text('[channels.force]\nsource = "F"\n')
    found = channels(str(tmp_path / "map.toml"), "velocity=V")
    assert {name: pick.source for name, pick in found.channel_map.channels.items()} == {"force": "F", "velocity": "V"}


@pytest.mark.parametrize("word", ["force", "force=", "=3"])
def test_a_channel_without_both_sides_is_refused(word: str) -> None:
    with pytest.raises(click.BadParameter, match="write CHANNEL=COLUMN"):
        channels(word)


def channels(*words: str) -> Channels:
    kind = CHANNELS.kind
    return kind.merged(None, None, [kind.convert(word, None, None) for word in words])


def test_settings_are_converted_and_have_defaults() -> None:
    @options.verb
    def verb(
        cutoff: float | None = options.setting("Text.", kind=options.Quantity("Hz")),
        rows: int = options.setting("Text.", default=3),
        again: bool = options.setting("Text.", default=True),
        names: tuple[str, ...] = options.setting("Text.", "name"),
        part: tuple[float, float] | None = options.setting("Text.", kind=options.Quantity("s"), nargs=2),
    ) -> None:
        """Print."""
        click.echo(repr((cutoff, rows, again, names, part)))

    def shown(*stated: str) -> Result:
        return CliRunner().invoke(verb, [word for one in stated for word in ("--set", one)])

    assert shown().stdout == "(None, 3, True, (), None)\n"
    stated = shown("cutoff=0.05 kHz", "rows=4", "again=no", "name=a", "name=b", "part=1 s, 20 ms")
    assert stated.stdout == "(50.0, 4, False, ('a', 'b'), (1.0, 0.02))\n"
    for wrong, message in (("row=4", "did you mean rows?"), ("part=1 s", "give 2 values"), ("rows=x", "--set rows=x")):
        assert message in str(shown(wrong).exception)
    assert "--set cutoff='50' has no unit" in str(shown("cutoff=50").exception)


@pytest.mark.parametrize(("present", "verb", "refused"), [
    (("results.parquet",), ("run", "--report"), "the report of a study"),
    (("results.parquet", "result.json"), ("run", "--report"), "the report of a study"),
    (("results.parquet",), ("run",), ""), (("result.json",), ("run", "--report"), ""),
    (("result.json",), ("study",), "the report of a run"),
    (("result.json",), ("study", "optimise"), "the report of a run"),
    (("results.parquet", "result.json"), ("study",), ""), (("results.parquet",), ("study", "optimise"), ""),
    ((), ("study",), ""),
])  # fmt: skip
def test_a_run_and_a_study_do_not_replace_each_others_report(
    tmp_path: Path, present: tuple[str, ...], verb: tuple[str, ...], refused: str
) -> None:
    for name in (*present, "report.html"):
        (tmp_path / name).touch()
    done = CliRunner().invoke(main, [*verb, str(tmp_path / "missing.toml"), "-o", str(tmp_path)])
    assert done.exit_code == 2
    expected = refused or "missing.toml"
    assert expected in " ".join(done.output.split())
    assert (refused == "") == ("would replace it" not in done.output)


def test_the_file_of_a_channel_map_is_an_input(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text('[channels]\nforce = { source = "F", unit = "N" }\n')

    @options.verb
    def verb(
        channels: Channels = CHANNELS,
        output: Path = options.option("Text.", "-o", kind=options.OutputFile(EXPORT)),
    ) -> None:
        """Print."""
        click.echo("computing")

    shown = CliRunner().invoke(verb, ["--channel", str(path), "-o", str(path)])
    assert isinstance(shown.exception, InputError) and "map.toml is an input of this command" in str(shown.exception)
    assert CliRunner().invoke(verb, ["--channel", str(path), "-o", str(tmp_path / "new")]).stdout == "computing\n"
