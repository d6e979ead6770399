"""`eightpost validate`: fitted shocks or an identified vehicle on held-out records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import Assignment, FilePath, Number, OutputFile, Quantity, argument, option, setting, verb
from eightpost.app.show import details, show_files, show_notes, show_table, show_text, show_verdict
from eightpost.errors import InputError
from eightpost.outputs import PAGE

if TYPE_CHECKING:
    from eightpost.ident.validation.records import Record
    from eightpost.report.tables import ResultTable
    from eightpost.verdict import Verdict

#: Settling time at the start of a vehicle's records, which is left out [s].
SETTLING = 4.0


@verb
def validate(
    ctx: click.Context,
    paths: tuple[Path, ...] = argument("JSON... RECORD...", kind=FilePath()),
    limit: float | None = option(
        "Maximum error [% of the measured standard deviation]; the exit code is 1 above it. Default: vehicles 25, "
        "shocks 30.",
        kind=Number(min=0.0, min_open=True), metavar="PERCENT",
    ),
    shocks: tuple[tuple[str, str], ...] = option(
        "Vehicles: law at a corner (lf, rf, lr, rr), or of the shock that has this name in the records. Default: the "
        "measured shock forces.",
        "--shock", kind=Assignment("NAME=SHOCK.json"), metavar="CORNER|NAME=SHOCK.JSON",
    ),
    report: Path | None = option(
        "Interactive, printable page to write (docs/how_to/validation.md); default: none.",
        "-o", "--output", kind=OutputFile(PAGE), metavar="FILE.HTML",
    ),
    keep: bool = option(
        "Write the verdict into the shock or vehicle files and replace an earlier one, and the level errors of "
        "independent random records, such as laps, into the vehicle file. FMUs built from these files carry both into "
        "every run and study.",
    ),
    channels: Channels = CHANNELS,
    kinds: tuple[str, ...] = setting(
        "Kind of all records, or of one (FILE=KIND): random, sine, static or bump; may be repeated. Default: "
        "recognized from the motion.",
        "kind",
    ),
    level: float | None = setting(
        "Vehicles: maximum error of an RMS on random records [%]; the exit code is 1 above it. Default 5.",
        kind=Number(min=0.0, min_open=True),
    ),
    against: Path | None = setting(
        "Vehicles: another fit (.json) or parameters (.toml) whose modes are listed for comparison; default: none.",
        kind=FilePath(exists=True, dir_okay=False),
    ),
    settling: float | None = setting(
        "Vehicles: settling time left out at the start of each record, at most 1/4 of the record; default "
        f"'{SETTLING:g} s'.",
        kind=Quantity("s", bare=True),
    ),
    cutoff: float | None = setting(
        "Shocks: cut-off frequency of the low-pass; default '50 Hz', for bumps '200 Hz'.",
        kind=Quantity("Hz", bare=True),
    ),
    segment: tuple[float, float] | None = setting(
        "Shocks: start and end of the part of each record to judge, e.g. segment='20 s, 60 s'; default: of random "
        "records '1 s' to '10 s', else all.",
        kind=Quantity("s", bare=True), nargs=2,
    ),
) -> None:  # fmt: skip
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
    models, records = models_and_records(paths)
    if settling is not None and settling < 0.0:
        raise InputError(f"--set settling must be 0 or more, not {settling:g} s")
    given = _Given(console, records, kinds, channels.of, report, keep)
    if is_vehicle(models):
        _refuse("vehicle", {"cutoff": cutoff, "segment": segment})
        settled = SETTLING if settling is None else settling
        verdict = _validate_vehicle(given, models[0], dict(shocks), against, level, limit, settled)
    else:
        _refuse("shock", {"level": level, "--shock": shocks, "against": against, "settling": settling})
        verdict = _validate_shocks(given, models, limit, cutoff, segment)
    ctx.exit(0 if verdict.is_acceptable else 1)


def _refuse(kind: str, given: Mapping[str, object]) -> None:
    """Refuse options that do not apply to the kind of model."""
    for name, value in given.items():
        if value not in (None, ()):
            raise click.BadParameter(f"it does not apply to a {kind}; omit it", param_hint=name)


@dataclass(frozen=True, slots=True)
class _Given:
    """Records and options that apply to shocks and to vehicles."""

    console: Console  #: Console of the output.
    records: list[Path]  #: Files of the records.
    kinds: tuple[str, ...]  #: Kinds of records, each `KIND` or `FILE=KIND`.
    reading: Callable[[Path], dict[str, Any]]  #: Options of reading a file: channel map, units, reversed channels.
    report: Path | None  #: Page to write.
    keep: bool  #: Whether to write the verdict into the files of the models.

    def kind_of(self, kinds: Sequence[str]) -> dict[Path, Any]:
        """Return the kind of each record for which `KIND` (for all) or `FILE=KIND`, which has priority, is given."""
        chosen: dict[Path, str] = {}
        for word in sorted(self.kinds, key=lambda word: "=" in word):
            name, equals, kind = word.rpartition("=")
            matching = [path for path in self.records if not equals or name in (str(path), path.name, path.stem)]
            if not matching:
                known = ", ".join(path.name for path in self.records)
                raise click.BadParameter(f"{name!r} is not one of the records: {known}", param_hint="--set kind")
            chosen |= dict.fromkeys(matching, kind)
        for kind in chosen.values():
            if kind not in kinds:
                raise click.BadParameter(
                    f"{kind!r}: the kind must be one of {', '.join(kinds)}", param_hint="--set kind"
                )
        return chosen

    def each_record(self) -> Iterable[Path]:
        """Yield the records with a progress bar."""
        from eightpost.app.show import each

        return each(self.console, self.records, "reading", len(self.records))

    def show(self, records: Iterable[Record], tables: Iterable[ResultTable]) -> None:
        """Print the first table that has rows; with -v, also the kind of each record and the other tables."""
        from eightpost.report.tables import result_table

        more = details(self.console)
        for record in records:
            show_text(more, f"{record.name}: {record.kind}, {record.reason}")
        for number, table in enumerate(table for table in tables if table.rows):
            show_table(more if number else self.console, result_table(table), most=3)

    def show_verdict(self, notes: Iterable[str], verdict: Verdict) -> None:
        """Print the verdict; with -v, also the notes."""
        show_notes(details(self.console), notes)
        show_verdict(self.console, verdict)


def _validate_shocks(
    given: _Given,
    paths: list[Path],
    limit: float | None,
    cutoff: float | None,
    segment: tuple[float, float] | None,
) -> Verdict:
    """Validate shocks, print the tables, write the report, and return the verdict."""
    from eightpost.ident.validation.records import KINDS, dyno_record
    from eightpost.ident.validation.shocks import (
        keep_verdicts,
        notes_on,
        shock_verdict,
        terminal_tables,
        validate_shocks,
    )
    from eightpost.rig import read_dyno_test
    from eightpost.shock import read_shock

    kind_of = given.kind_of(KINDS)
    shocks = [read_shock(path) for path in paths]
    records = [
        dyno_record(read_dyno_test(path, cutoff=cutoff, **given.reading(path)), kind=kind_of.get(path))
        for path in given.each_record()
    ]
    study = validate_shocks(shocks, records, cutoff=cutoff, segment=segment)
    verdict = shock_verdict(study, limit)
    given.show(study.records, terminal_tables(study))
    given.show_verdict(notes_on(study), verdict)
    if given.report:
        from eightpost.ident.validation.shock_page import write_shock_page

        title = f"Validation of {', '.join(dict.fromkeys(shock.name for shock in shocks))}"
        show_files(given.console, [write_shock_page(given.report, study, limit=limit, title=title)])
    if given.keep:
        show_files(given.console, keep_verdicts(study, paths, limit), " with the verdict")
    return verdict


def _validate_vehicle(
    given: _Given, path: Path, shocks: dict[str, str], against: Path | None, level: float | None, limit: float | None,
    settling: float,
) -> Verdict:  # fmt: skip
    """Validate a vehicle, print the tables, write the report, and return the verdict."""
    from eightpost.ident.validation.comparison import rig_record
    from eightpost.ident.validation.vehicle_page import terminal_tables
    from eightpost.ident.validation.vehicles import Limits, keep_verdict, validate_vehicle, vehicle_verdict
    from eightpost.ident.vehicle.vehicle_fit import friction_table, measure_table, read_fit, trust_table
    from eightpost.rig import read_rig_test
    from eightpost.shock import read_shock
    from eightpost.vehicle import read_vehicle

    fit, kind_of = read_fit(path), given.kind_of(("random", "sine", "bump", "static"))
    limits = Limits.of_percent(level, limit)
    laws = {name: read_shock(file).law for name, file in shocks.items()}
    other = read_vehicle(against) if against else None
    model = fit.vehicle.state_space
    records = [
        rig_record(read_rig_test(one, **given.reading(one)), model, kind=kind_of.get(one))
        for one in given.each_record()
    ]
    with given.console.status("predicting"):
        study = validate_vehicle(fit, records, shocks=laws, against=other, settling=settling)
    verdict = vehicle_verdict(study, limits)
    given.show(records, terminal_tables(study))
    more = details(given.console)
    if fit.trust is not None and fit.trust.outputs:
        more.print(trust_table(fit.trust))
    if fit.trust is not None and fit.trust.measures:
        more.print(measure_table(fit.trust))
    if fit.trust is not None and fit.trust.friction:
        more.print(friction_table(fit, fit.trust))
    given.show_verdict(study.notes, verdict)
    show_text(given.console, limits.summary())
    if given.report:
        from eightpost.ident.validation.vehicle_page import write_vehicle_page

        title = f"Validation of {fit.vehicle.name}"
        show_files(given.console, [write_vehicle_page(given.report, study, limits=limits, title=title)])
    if given.keep:
        keep_verdict(path, study, verdict)
        show_files(given.console, [path], " with the verdict, and how far levels of independent records are off")
    return verdict
