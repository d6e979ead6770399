"""`eightpost validate`: fitted shocks against other dynamometer records."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table

from eightpost.errors import InputError
from eightpost.ident.validation import Kind, notes_on, record_of
from eightpost.ident.validation import validate as validate_all
from eightpost.ident.validation.field_units import field_factor, field_unit, shown
from eightpost.ident.validation.tables import (
    Amount,
    beside_printed,
    bump_table,
    random_table,
    sine_groups,
    sine_table,
    static_table,
)
from eightpost.rig import read_dyno_test
from eightpost.shock import read_shock
from eightpost.signals import ChannelMap

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eightpost.ident.validation import ValidationStudy
    from eightpost.ident.validation.tables import Cell, ResultTable

_KINDS = get_args(Kind)

#: What a folder is searched for.
_RECORDS = {".csv", ".txt", ".parquet", ".mat", ".mf4", ".mdf"}


@click.command()
@click.argument("paths", metavar="SHOCK.JSON... DYNO...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--kind", "kinds", metavar="[FILE=]KIND", multiple=True,
              help="random, sine, static or bump, of one file or of all; default: seen from the motion.")  # fmt: skip
@click.option("--configuration", "configurations", metavar="[FILE=]N", multiple=True,
              help="Configuration 1 to 12 of Table 3.1, of one file or of all; default: as the file says.")  # fmt: skip
@click.option("--limit", metavar="PERCENT", type=click.FloatRange(min=0.0, min_open=True),
              help="Highest error, in percent of the record's standard deviation of force; more exits 1.")  # fmt: skip
@click.option("--report", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.HTML",
              help="Write one interactive, printable page (docs/validation.md).")  # fmt: skip
@click.option("--cutoff", type=float, metavar="HZ", help="Low-pass [Hz]; default 50, of bumps 200.")
@click.option("--units", "unit_words", metavar="CHANNEL=UNIT", multiple=True, help="Unit of a channel without one.")
@click.option("--map", "map_file", type=click.Path(path_type=Path), help="Channel map (.toml) of all records.")
@click.option("--flip", multiple=True, metavar="CHANNEL", help="Turn the sign of a channel of all records.")
@click.pass_context
def validate(  # one parameter per option
    ctx: click.Context,
    paths: tuple[Path, ...],
    kinds: tuple[str, ...],
    configurations: tuple[str, ...],
    limit: float | None,
    report: Path | None,
    cutoff: float | None,
    unit_words: tuple[str, ...],
    map_file: Path | None,
    flip: tuple[str, ...],
) -> None:
    """Validate fitted shocks on dynamometer records that they were not fitted to.

    Files that end in .json are shocks, all others records; a folder stands for the records in it. Each shock is held
    against each record, unless both say a condition and they differ. Exits 1 if more than half of a record is outside
    the fitted velocities, if a record has no shock, or if an error is over --limit.

    \b
    Examples:
      eightpost validate shock.json data/ --report out.html
      eightpost validate static.json lpnl2.json run7.csv --kind run7.csv=sine --limit 5
    """
    console = Console()
    shocks, records = _sorted(paths)
    if report and report.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{report}: a report ends in .html; write --report {report.with_suffix('.html')}")
    channel_map = ChannelMap.read(map_file) if map_file else None
    units = dict(_pair(word, "--units") for word in unit_words)
    kind_of, number_of = _chosen(kinds, records, "--kind"), _chosen(configurations, records, "--configuration")
    laws = [read_shock(path) for path in shocks]
    found = []
    for path in track(records, "reading", console=console, transient=True):
        test = read_dyno_test(path, channel_map=channel_map, units=units, flip=flip, cutoff=cutoff)
        found.append(record_of(test, kind=_kind(kind_of.get(path)), configuration=_number(number_of.get(path))))
    study = validate_all(laws, found, cutoff=cutoff)
    show_study(console, study, limit)
    if report:
        from eightpost.ident.validation.report import write_validation_report  # noqa: PLC0415 - loads plotly

        title = f"Validation of {', '.join(dict.fromkeys(shock.name for shock in laws))}"
        written = write_validation_report(report, study, limit=limit, title=title)
        console.print(f"wrote {written}", soft_wrap=True, highlight=False)
    ctx.exit(0 if study.is_acceptable(limit) else 1)


def show_study(console: Console, study: ValidationStudy, limit: float | None) -> None:
    """Print the tables of a study and its notes."""
    for record in study.records:
        console.print(f"{escape(record.name)}: {record.kind}, {escape(record.reason)}", soft_wrap=True, highlight=False)
    tables = [random_table(study), *(sine_table(rows) for rows in sine_groups(study).values())]
    tables += [static_table(study), bump_table(study), beside_printed(study)]
    for table in tables:
        if table.rows:
            console.print(_rich(table))
    for note in notes_on(study, limit):
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False)


def _sorted(paths: Iterable[Path]) -> tuple[list[Path], list[Path]]:
    """Return the shock files and the records among paths, folders opened."""
    shocks: list[Path] = []
    records: list[Path] = []
    for path in paths:
        if path.is_dir():
            records += sorted(file for file in path.iterdir() if file.suffix.lower() in _RECORDS)
        elif path.suffix.lower() == ".json":
            shocks.append(path)
        else:
            records.append(path)
    if not shocks:
        raise InputError("no shock file among the arguments; make one: eightpost fit DYNO -o shock.json")
    if not records:
        raise InputError("no record among the arguments; name dynamometer files, or a folder that has some")
    return shocks, records


def _chosen(words: Iterable[str], records: list[Path], option: str) -> dict[Path, str]:
    """Return a value by record from `VALUE` (of all) and `FILE=VALUE` words; a file's own goes first."""
    chosen: dict[Path, str] = {}
    for word in sorted(words, key=lambda word: "=" in word):
        name, equals, value = word.rpartition("=")
        meant = [path for path in records if not equals or name in (str(path), path.name, path.stem)]
        if not meant:
            known = ", ".join(path.name for path in records)
            raise click.BadParameter(f"{name!r} is none of the records: {known}", param_hint=option)
        chosen |= dict.fromkeys(meant, value)
    return chosen


def _kind(word: str | None) -> Kind | None:
    if word is not None and word not in _KINDS:
        raise click.BadParameter(f"{word!r}: it must be one of {', '.join(_KINDS)}", param_hint="--kind")
    return word  # type: ignore[return-value]


def _number(word: str | None) -> int | None:
    if word is not None and not word.isdigit():
        raise click.BadParameter(f"{word!r}: write it as a number from 1 to 12", param_hint="--configuration")
    return None if word is None else int(word)


def _pair(word: str, option: str) -> tuple[str, str]:
    channel, equals, unit = word.partition("=")
    if not (channel and equals and unit):
        raise click.BadParameter(f"{word!r}: write it as CHANNEL=UNIT", param_hint=option)
    return channel, unit


def _rich(table: ResultTable) -> Table:
    """Return a table for the terminal, in the field's units."""
    drawn = Table(title=table.title)
    for (text, unit), is_numeric in zip(table.heads, table.numeric, strict=True):
        head = f"{text}, {field_unit(unit)}" if unit else text
        drawn.add_column(escape(head), justify="right" if is_numeric else "left", overflow="fold")
    for row in table.rows:
        drawn.add_row(*(escape(_text(cell)) for cell in row))
    return drawn


def _text(cell: Cell) -> str:
    return shown(field_factor(cell.unit) * cell.value, cell.digits) if isinstance(cell, Amount) else cell
