"""Values of options: quantities with units, assignments, channel maps, and old spellings, which still work."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from eightpost.__main__ import main
from eightpost.app import options
from eightpost.errors import InputError, ParameterError
from eightpost.outputs import RECORD
from eightpost.signals import ChannelMap

RENAMED = {"--channel-map": "--map", "--plots": "--plot"}


def given(*words: str, **option: object) -> Result:
    """Return the result of a verb that prints its only option."""

    @click.command(cls=options.Verb, renamed=RENAMED)
    @click.option("--value", "--map", "--plot", "value", **option)
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


@pytest.mark.parametrize(
    ("text", "option", "error", "message"),
    [
        ("10", options.Quantity("m"), InputError, "--value '10' has no unit; add it: '10 m' if it is in m"),
        ("ten mm", options.Quantity("m", bare=True), InputError, "--value 'ten mm': 'ten mm' is not a value"),
        ("10 s", options.Quantity("m"), InputError, "--value '10 s': cannot convert"),
        ("0 s", options.Quantity("s", positive=True), ParameterError, "--value must be above 0, not '0 s'"),
    ],
)
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


@pytest.mark.parametrize(("old", "new"), RENAMED.items())
@pytest.mark.parametrize("form", ["{} x", "{}=x"])
def test_an_old_spelling_works_with_a_warning(old: str, new: str, form: str) -> None:
    shown = given(*form.format(old).split())
    assert shown.stdout == "'x'\n"
    assert shown.stderr == f"warning: {old} is now spelled {new}; the next version will not accept {old}\n"
    assert not given(*form.format(new).split()).stderr


def test_verbs_accept_their_old_spellings(tmp_path: Path) -> None:
    from eightpost.__main__ import main  # noqa: PLC0415 - only this test needs the verbs

    (tmp_path / "map.toml").write_text('[channels.force]\nsource = "F"\n')
    for line in (
        f"compare none --measured none --channel-map {tmp_path / 'map.toml'}",
        "identify none --plots none -o x.json",
        "fit none.csv --cutoff 50 --segment 1 10 -o x.json",
        "validate none.json none.csv --cutoff 50 --settling 4",
        "linearity none --width 0.5 --high 25",
        "vehicle none --high 25",
        "export none -o x.mat --high 25 --step 0.05",
        "run none --stop 1 --record-step 0.01 --step 0.001",
    ):
        words = line.split()
        shown = CliRunner().invoke(main, words)
        old = sum(word in {*RENAMED, "--cutoff", "--settling", "--width", "--high", "--step", "--stop", "--record-step"}
                  for word in words) + 2 * ("--segment" in words)  # fmt: skip
        assert shown.stderr.count("warning:") == old, shown.stderr
        assert shown.exit_code in (1, 2) and "No such option" not in shown.stderr  # there are no such files


def test_a_channel_map_is_read_once(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text('[channels.force]\nsource = "F"\n')
    kind = options.ChannelMapFile()
    read = kind.convert(str(tmp_path / "map.toml"), None, None)
    assert isinstance(read, ChannelMap) and kind.convert(read, None, None) is read


@pytest.mark.parametrize(
    ("present", "verb", "refused"),
    [
        (("results.parquet",), ("run", "--report"), "the report of a study"),
        (("results.parquet", "result.json"), ("run", "--report"), "the report of a study"),
        (("results.parquet",), ("run",), ""),
        (("result.json",), ("run", "--report"), ""),
        (("result.json",), ("study",), "the report of a run"),
        (("result.json",), ("optimise",), "the report of a run"),
        (("results.parquet", "result.json"), ("study",), ""),
        (("results.parquet",), ("optimise",), ""),
        ((), ("study",), ""),
    ],
)
def test_a_run_and_a_study_do_not_replace_each_others_report(
    tmp_path: Path, present: tuple[str, ...], verb: tuple[str, ...], refused: str
) -> None:
    for name in (*present, "report.html"):
        (tmp_path / name).touch()
    name, *options_given = verb
    done = CliRunner().invoke(main, [name, str(tmp_path / "missing.toml"), "-o", str(tmp_path), *options_given])
    assert done.exit_code == 2
    expected = refused or "missing.toml"
    assert expected in " ".join(done.output.split())
    assert (refused == "") == ("would replace it" not in done.output)


def test_the_file_of_a_channel_map_is_an_input(tmp_path: Path) -> None:
    path = tmp_path / "map.csv"
    path.write_text('[channels]\nforce = { source = "F", unit = "N" }\n')

    @click.command(cls=options.Verb)
    @options.map_option("a page")
    @click.option("-o", "output", type=options.OutputFile(RECORD))
    def verb(channel_map: ChannelMap, output: Path) -> None:
        click.echo("computing")

    shown = CliRunner().invoke(verb, ["--map", str(path), "-o", str(path)])
    assert isinstance(shown.exception, InputError) and "map.csv is an input of this command" in str(shown.exception)
    assert CliRunner().invoke(verb, ["--map", str(path), "-o", str(tmp_path / "new.csv")]).stdout == "computing\n"
