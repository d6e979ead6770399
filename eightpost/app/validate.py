"""`eightpost validate`: fitted shocks or an identified vehicle on held-out records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import (
    Assignment,
    FilePath,
    Number,
    OutputFile,
    Quantity,
    argument,
    group,
    option,
    setting,
    verb,
)
from eightpost.app.show import details, each, show_files, show_notes, show_table, show_text, show_verdict
from eightpost.errors import InputError
from eightpost.outputs import PAGE

if TYPE_CHECKING:
    from eightpost.ident.validation.records import Record
    from eightpost.report.tables import ResultTable
    from eightpost.verdict import Verdict

#: Settling time at the start of a vehicle's records, which is left out [s].
SETTLING = 4.0


@dataclass(frozen=True, slots=True)
class ValidateOptions:
    """Options of `eightpost validate`."""

    # fmt: off
    paths: tuple[Path, ...] = argument("JSON... RECORD...", kind=FilePath())
    limit: float | None = option(
        "Maximum error [% of the measured standard deviation]; the exit code is 1 above it. Default: vehicles 25, "
        "shocks 15.",
        kind=Number(min=0.0, min_open=True), metavar="PERCENT",
    )
    shocks: tuple[tuple[str, str], ...] = option(
        "Vehicles: law at a corner (lf, rf, lr, rr), or of the shock that has this name in the records. Default: the "
        "measured shock forces.",
        "--shock", kind=Assignment("NAME=SHOCK.json"), metavar="CORNER|NAME=SHOCK.JSON",
    )
    report: Path | None = option(
        "Interactive, printable page to write (docs/how_to/validation.md); default: none.",
        "-o", "--output", kind=OutputFile(PAGE), metavar="FILE.HTML",
    )
    keep: bool = option(
        "Write the verdict into the shock or vehicle files and replace an earlier one, and the level errors of "
        "independent random records, such as laps, into the vehicle file. FMUs built from these files carry both into "
        "every run and study.",
    )
    channels: Channels = CHANNELS
    kinds: tuple[str, ...] = setting(
        "Kind of all records, or of one (FILE=KIND): random, sine, static or bump; may be repeated. Default: "
        "recognized from the motion.",
        "kind",
    )
    level: float | None = setting(
        "Vehicles: maximum error of an RMS on random records [%]; the exit code is 1 above it. Default 5.",
        kind=Number(min=0.0, min_open=True),
    )
    against: Path | None = setting(
        "Vehicles: another fit (.json) or parameters (.toml) whose modes are listed for comparison; default: none.",
        kind=FilePath(exists=True, dir_okay=False),
    )
    settling: float | None = setting(
        "Vehicles: settling time left out at the start of each record, at most 1/4 of the record; default "
        f"'{SETTLING:g} s'.",
        kind=Quantity("s", bare=True),
    )
    cutoff: float | None = setting(
        "Shocks: cut-off frequency of the low-pass; default '50 Hz', for bumps '200 Hz'.",
        kind=Quantity("Hz", bare=True),
    )
    segment: tuple[float, float] | None = setting(
        "Shocks: start and end of the part of each record to judge, e.g. segment='20 s, 60 s'; default: of random "
        "records '1 s' to '10 s', else all.",
        kind=Quantity("s", bare=True), nargs=2,
    )
    # fmt: on


@verb
def validate(ctx: click.Context, asked: ValidateOptions = group(ValidateOptions)) -> None:
    """Validate fitted shocks or an identified vehicle on held-out records.

    JSON files are shocks, or one vehicle. A RECORD is a dynamometer or rig record, or a folder of records.

    Each shock is compared with each record, unless both state a condition and the conditions differ. The exit code is 1
    if the verdict is "not usable" (docs/reference/verdict.md): more than a fifth of a record is outside the fitted
    velocities, a record has no shock, or an error is above --limit.

    A vehicle is driven by each record's roads and loads. The exit code is 1 if an RMS differs by more than level, an
    error is above --limit, the ranking of setups differs from that of the rig, or all records were used in the fit.

    \b
    Examples:
      eightpost validate shock.json data/ -o out.html
      eightpost validate static.json lpnl2.json run7.csv --set kind=run7.csv=sine --limit 5
      eightpost validate shock.json track.csv --set segment='20 s, 60 s'
      eightpost validate vehicle.json rig/*.parquet -o car.html
      eightpost validate vehicle.json rig/ --shock A=A.json --shock B=B.json -o car.html
    """
    from eightpost.ident.validation.records import is_vehicle, models_and_records

    console = Console()
    models, records = models_and_records(asked.paths)
    if asked.settling is not None and asked.settling < 0.0:
        raise InputError(f"--set settling must be 0 or more, not {asked.settling:g} s")
    if is_vehicle(models):
        _refuse("vehicle", {"cutoff": asked.cutoff, "segment": asked.segment})
        verdict = _validate_vehicle(console, models[0], records, asked)
    else:
        others = {"level": asked.level, "--shock": asked.shocks, "against": asked.against, "settling": asked.settling}
        _refuse("shock", others)
        verdict = _validate_shocks(console, models, records, asked)
    ctx.exit(0 if verdict.is_acceptable else 1)


def _refuse(kind: str, given: Mapping[str, object]) -> None:
    """Refuse options that do not apply to the kind of model."""
    for name, value in given.items():
        if value not in (None, ()):
            raise click.BadParameter(f"it does not apply to a {kind}; omit it", param_hint=name)


def _kinds_of(records: Sequence[Path], words: Sequence[str], known: Sequence[str]) -> dict[Path, Any]:
    """Return the kind of each record for which `KIND` (for all) or `FILE=KIND`, which has priority, is given."""
    chosen: dict[Path, str] = {}
    for word in sorted(words, key=lambda word: "=" in word):
        name, equals, kind = word.rpartition("=")
        matching = [path for path in records if not equals or name in (str(path), path.name, path.stem)]
        if not matching:
            names = ", ".join(path.name for path in records)
            raise click.BadParameter(f"{name!r} is not one of the records: {names}", param_hint="--set kind")
        chosen |= dict.fromkeys(matching, kind)
    if wrong := [kind for kind in chosen.values() if kind not in known]:
        what = f"{wrong[0]!r}: the kind must be one of {', '.join(known)}"
        raise click.BadParameter(what, param_hint="--set kind")
    return chosen


def _show(console: Console, records: Iterable[Record], tables: Iterable[ResultTable]) -> None:
    """Print the first table that has rows; with -v, also the kind of each record and the other tables."""
    from eightpost.report.tables import result_table

    more = details(console)
    for record in records:
        show_text(more, f"{record.name}: {record.kind}, {record.reason}")
    for number, table in enumerate(table for table in tables if table.rows):
        show_table(more if number else console, result_table(table), most=3)


def _validate_shocks(
    console: Console, paths: list[Path], files: Sequence[Path], asked: ValidateOptions
) -> Verdict:  # fmt: skip
    """Validate shocks, print the tables, write the report, and return the verdict."""
    from eightpost.ident.validation import shocks as validation
    from eightpost.ident.validation.records import KINDS, dyno_record
    from eightpost.rig import read_dyno_test
    from eightpost.shock import read_shock

    kind_of, cutoff = _kinds_of(files, asked.kinds, KINDS), asked.cutoff
    shocks = [read_shock(path) for path in paths]
    records = [
        dyno_record(read_dyno_test(path, cutoff=cutoff, **asked.channels.of(path)), kind=kind_of.get(path))
        for path in each(console, files, "reading", len(files))
    ]
    study = validation.validate_shocks(shocks, records, cutoff=cutoff, segment=asked.segment)
    verdict = validation.shock_verdict(study, asked.limit)
    _show(console, study.records, validation.terminal_tables(study))
    show_notes(details(console), validation.notes_on(study))
    show_verdict(console, verdict)
    if asked.report:
        from eightpost.ident.validation.shock_page import write_shock_page

        title = f"Validation of {', '.join(dict.fromkeys(shock.name for shock in shocks))}"
        show_files(console, [write_shock_page(asked.report, study, limit=asked.limit, title=title)])
    if asked.keep:
        show_files(console, validation.keep_verdicts(study, paths, asked.limit), " with the verdict")
    return verdict


def _validate_vehicle(console: Console, path: Path, files: Sequence[Path], asked: ValidateOptions) -> Verdict:
    """Validate a vehicle, print the tables, write the report, and return the verdict."""
    from eightpost.app.identify import trust_tables
    from eightpost.ident.validation.comparison import rig_record
    from eightpost.ident.validation.vehicle_page import terminal_tables
    from eightpost.ident.validation.vehicles import Limits, keep_verdict, validate_vehicle, vehicle_verdict
    from eightpost.ident.vehicle.vehicle_fit import read_fit
    from eightpost.rig import read_rig_test
    from eightpost.shock import read_shock
    from eightpost.vehicle import read_vehicle

    fit, kind_of = read_fit(path), _kinds_of(files, asked.kinds, ("random", "sine", "bump", "static"))
    limits = Limits.of_percent(asked.level, asked.limit)
    laws = {name: read_shock(file).law for name, file in asked.shocks}
    other = read_vehicle(asked.against) if asked.against else None
    records = [
        rig_record(read_rig_test(one, **asked.channels.of(one)), fit.vehicle.state_space, kind=kind_of.get(one))
        for one in each(console, files, "reading", len(files))
    ]
    settling = SETTLING if asked.settling is None else asked.settling
    with console.status("predicting"):
        study = validate_vehicle(fit, records, shocks=laws, against=other, settling=settling)
    verdict = vehicle_verdict(study, limits)
    _show(console, records, terminal_tables(study))
    more = details(console)
    for table in trust_tables(fit):
        more.print(table)
    show_notes(more, study.notes)
    show_verdict(console, verdict)
    show_text(console, limits.summary())
    if asked.report:
        from eightpost.ident.validation.vehicle_page import write_vehicle_page

        title = f"Validation of {fit.vehicle.name}"
        show_files(console, [write_vehicle_page(asked.report, study, limits=limits, title=title)])
    if asked.keep:
        keep_verdict(path, study, verdict)
        show_files(console, [path], " with the verdict, and how far levels of independent records are off")
    return verdict
