"""Validation of fitted shocks on other dynamometer records, for `eightpost validate`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, get_args

import click
from rich.markup import escape

from eightpost.app.progress import each
from eightpost.app.show import show_verdict
from eightpost.app.validate_paths import RecordChoices, show_table
from eightpost.ident.validation.dyno_record import dyno_record
from eightpost.ident.validation.record import Kind
from eightpost.ident.validation.shock_tables import (
    beside_printed,
    bump_table,
    random_table,
    sine_groups,
    sine_table,
    static_table,
)
from eightpost.ident.validation.shock_verdict import notes_on, shock_verdict
from eightpost.ident.validation.shocks import ShockValidation, validate_shocks
from eightpost.rig import read_dyno_test
from eightpost.shock import read_shock, write_shock
from eightpost.validity import Validity

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from rich.console import Console

    from eightpost.signals import ChannelMap
    from eightpost.verdict import Verdict

_KINDS = get_args(Kind)


@dataclass(frozen=True, slots=True)
class ShockOptions:
    """Options of `eightpost validate` for shocks.

    Attributes:
        kinds: Kinds of records, each `KIND` or `FILE=KIND`.
        configurations: Configurations of Table 3.1, each `N` or `FILE=N`.
        limit: Maximum error [% of the standard deviation].
        cutoff: Cut-off frequency of the low-pass [Hz].
        units: Units by channel.
        channel_map: Channel map of all records.
        flip: Channels whose sign is reversed.
        keep: Whether to write the verdict into the shock files.
    """

    kinds: tuple[str, ...]
    configurations: tuple[str, ...]
    limit: float | None
    cutoff: float | None
    units: dict[str, str]
    channel_map: ChannelMap | None
    flip: tuple[str, ...]
    keep: bool = False


def validate_all(
    console: Console, shocks: list[Path], records: list[Path], options: ShockOptions, report: Path | None
) -> Verdict:
    """Validate shocks, print the tables, write the report, and return the verdict."""
    chosen = RecordChoices(records)
    kind_of, number_of = chosen.of(options.kinds, "--kind"), chosen.of(options.configurations, "--configuration")
    laws = [read_shock(path) for path in shocks]
    held_out = []
    for path in each(console, records, "reading", len(records)):
        test = read_dyno_test(
            path, channel_map=options.channel_map, units=options.units, flip=options.flip, cutoff=options.cutoff
        )
        held_out.append(dyno_record(test, kind=_kind(kind_of.get(path)), configuration=_number(number_of.get(path))))
    study = validate_shocks(laws, held_out, cutoff=options.cutoff)
    show_study(console, study, options.limit)
    if report:
        from eightpost.ident.validation.shock_page import write_shock_page

        title = f"Validation of {', '.join(dict.fromkeys(shock.name for shock in laws))}"
        written = write_shock_page(report, study, limit=options.limit, title=title)
        console.print(f"wrote {written}", soft_wrap=True, highlight=False)
    if options.keep:
        _keep(console, dict(zip(study.shocks, shocks, strict=True)), study, options.limit)
    return shock_verdict(study, options.limit)


def _keep(console: Console, paths: Mapping[str, Path], study: ShockValidation, limit: float | None) -> None:
    """Write the verdict into each shock file; a shock that was compared with no record keeps its file."""
    for label, path in paths.items():
        shock, part = study.shocks[label], study.of_shock(label)
        if part.cases:
            validity = Validity.with_verdict(shock.validity, shock_verdict(part, limit))
            write_shock(replace(shock, validity=validity), path)
            console.print(f"wrote the verdict into {path}", soft_wrap=True, highlight=False)


def show_study(console: Console, study: ShockValidation, limit: float | None) -> None:
    """Print the tables, the notes and the verdict of a study."""
    for record in study.records:
        console.print(f"{escape(record.name)}: {record.kind}, {escape(record.reason)}", soft_wrap=True, highlight=False)
    tables = [random_table(study), *(sine_table(rows) for rows in sine_groups(study))]
    tables += [static_table(study), bump_table(study), beside_printed(study)]
    for table in tables:
        show_table(console, table)
    for note in notes_on(study):
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False)
    show_verdict(console, shock_verdict(study, limit))


def _kind(word: str | None) -> Kind | None:
    if word is not None and word not in _KINDS:
        raise click.BadParameter(f"{word!r}: the kind must be one of {', '.join(_KINDS)}", param_hint="--kind")
    return word  # type: ignore[return-value]


def _number(word: str | None) -> int | None:
    if word is not None and not word.isdigit():
        raise click.BadParameter(f"{word!r}: write it as a number from 1 to 12", param_hint="--configuration")
    return None if word is None else int(word)
