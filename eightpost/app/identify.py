"""`eightpost identify` and `validate`: a vehicle from rig tests; fitted shocks or a vehicle on held-out records."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from rich.console import Console
from rich.markup import escape

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
from eightpost.app.show import (
    bar,
    details,
    each,
    show_files,
    show_notes,
    show_summary,
    show_table,
    show_text,
    show_verdict,
)
from eightpost.errors import FileFormatError, InputError, missing_file
from eightpost.outputs import PAGE, VEHICLE
from eightpost.progress import advance, portion, reported_to
from eightpost.report.console import Table, console_table, right

if TYPE_CHECKING:
    from eightpost.ident.validation.records import Record
    from eightpost.ident.vehicle.experiment import Baseline
    from eightpost.ident.vehicle.static_rating import StaticRating
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.report.tables import ResultTable
    from eightpost.rig import RigTest
    from eightpost.verdict import Verdict


#: Names of `eightpost.ident.vehicle.plan.RECIPES`, whose import would delay every help text.
RECIPES = ("boggs", "common-poles", "grey-box")


@dataclass(frozen=True, slots=True)
class _IdentifyOptions:
    """Options of `eightpost identify`."""

    # fmt: off
    rig_files: tuple[Path, ...] = argument("RIG...", kind=FilePath())
    output: Path = option(
        "Output vehicle file; its frequency response and its summary are written to the same folder.",
        "-o", "--output", kind=OutputFile(VEHICLE), default=Path("vehicle.json"),
    )
    preparation: Path | None = option(
        "File with rate, settling, delays and geometry (docs/how_to/rig_data.md), which replaces those settings; "
        "default: none.",
        kind=FilePath(), metavar="TOML",
    )
    static_files: tuple[Path, ...] = option(
        "Test with held loads, for the car's static tire forces and ride heights (6.4.4); may be repeated.",
        "--static", kind=FilePath(), metavar="RIG",
    )
    channels: Channels = CHANNELS
    plots: Literal["none", "main", "all"] = option(
        "Outputs to draw. main: shock velocities, tire forces and ride heights.",
        "--plot", kind=("none", "main", "all"), default="none",
    )
    recipe_name: str = setting(
        "Identification method: docs/explanation/common_poles.md, docs/explanation/identification.md, "
        "docs/explanation/output_error.md.",
        "recipe", kind=RECIPES, default="common-poles",
    )
    baseline: Path | None = setting(
        "Baseline test among the RIG files; default: found from the damping of the shocks.", kind=FilePath()
    )
    damping: float | None = setting(
        "Damping about which the vehicle is identified, e.g. '20 lbf.s/in'; default: the slope of each baseline "
        "shock.",
        kind=Quantity("N.s/m"),
    )
    rate: float = setting("Sampling rate to which the records are decimated.", kind=Quantity("Hz"), default="125 Hz")
    settling: float = setting(
        "Settling time left out at the start of every record, e.g. '4 s'.", kind=Quantity("s"), default="0 s"
    )
    output_channels: str | None = setting("Outputs of the model, separated by commas; default: all possible outputs.")
    shocks: str | None = setting(
        "Files of the tests' shocks, separated by commas: measured forces are brought in step with their laws "
        "(docs/explanation/common_poles.md); default: none."
    )
    name: str | None = setting("Name of the vehicle; default: the name of the output file.")
    # fmt: on


@verb
def identify(ctx: click.Context, asked: _IdentifyOptions = group(_IdentifyOptions)) -> None:
    """Identify a vehicle from rig tests: one with baseline shocks, one with another shock at each corner.

    RIG is a .parquet, .csv, .mat or .mf4 file with the channels of docs/explanation/rig.md, or with a channel map. Use
    `eightpost build` to build an FMU of the vehicle. The exit code is 1 if the vehicle is not usable
    (docs/reference/verdict.md): e.g. it is not stable with other shocks, or the car changed between the tests.

    \b
    Examples:
      eightpost identify rig/*.parquet -o car.json
      eightpost identify base.parquet soft_lf.parquet soft_rf.parquet soft_lr.parquet soft_rr.parquet -o car.json
      eightpost identify rig/*.parquet --static static/heave.parquet --set shocks=base.json,soft.json -o car.json
      eightpost identify q1.csv q5.csv --set recipe=boggs --set damping='31.03 lbf.s/in' -o corner.json
    """
    from eightpost.ident.vehicle.vehicle_fit import write_fit

    console = Console()
    _check(asked.rig_files, asked.baseline)
    with bar(console, "identifying", 1.0) as show, reported_to(show):
        fit = _identified(details(console), asked)
    _show_fit(console, fit, fit.verdict)
    pictures = fit.write_plots(asked.output.with_name(f"{asked.output.stem}_plots"), asked.plots)
    show_files(console, [*write_fit(asked.output, fit), *pictures])
    ctx.exit(0 if fit.verdict.is_acceptable else 1)


def _identified(more: Console, asked: _IdentifyOptions) -> VehicleFit:
    """Read the tests, print what is known about them, and identify the vehicle."""
    from eightpost.ident.preparation import Decimation, Preparation, prepare, read_preparation
    from eightpost.ident.vehicle.plan import plan_identification
    from eightpost.rig.rig_test import read_rig_tests
    from eightpost.shock import read_shock

    def read(files: Sequence[Path]) -> Iterator[RigTest]:
        for done, test in enumerate(read_rig_tests(files, **asked.channels.options), start=1):
            yield test
            advance(done, len(files))

    stated = Preparation(Decimation(asked.rate), settling=asked.settling)
    how = read_preparation(asked.preparation) if asked.preparation else stated
    with portion(0.0, 0.15):
        prepared = prepare(read(asked.rig_files), how)
    for line in prepared.summary():
        more.print(escape(line), highlight=False, soft_wrap=True)
    plan = plan_identification(
        prepared,
        name=asked.name or asked.output.stem,
        baseline=asked.rig_files.index(asked.baseline) if asked.baseline else None,
        damping=asked.damping,
        outputs=asked.output_channels.replace(" ", "").split(",") if asked.output_channels else (),
        static=read(asked.static_files) if asked.static_files else (),
        shocks=[read_shock(path.strip()) for path in asked.shocks.split(",")] if asked.shocks else (),
    )
    _show_baseline(more, asked.rig_files, plan.baseline)
    if plan.rating is not None:
        _show_rating(more, plan.rating, plan.experiment.outputs)
    with portion(0.15, 1.0):
        return plan.identify(asked.recipe_name)


def _check(rig_files: tuple[Path, ...], baseline: Path | None) -> None:
    if baseline is not None and baseline not in rig_files:
        raise InputError(f"--set baseline={baseline} is not one of the RIG files: {', '.join(map(str, rig_files))}")
    for path in rig_files:
        if not path.exists():
            raise FileFormatError(missing_file(path), path=path)
    if len(rig_files) == 1 and rig_files[0].is_dir():
        raise InputError(f"{rig_files[0]} is a folder; name its files, such as {rig_files[0] / '*.parquet'}")
    if len(rig_files) < 2:
        raise InputError(
            f"{rig_files[0]}: one test cannot separate shock forces from their causes; give a baseline test, and a "
            "test with another shock at each corner"
        )


def _show_rating(console: Console, rating: StaticRating, outputs: Collection[str]) -> None:
    from eightpost.units import convert

    console.print(rating.summary(outputs), highlight=False, soft_wrap=True)
    if rating.modal is not None and rating.unexplained is not None:
        rows = [(mode, *(f"{value:.2f}" for value in row)) for mode, row in rating.modal_us.items()]
        title = "spring matrix, 1e3 lbf and lbf.ft per in and deg (Eq 6.11)"
        console.print(console_table(["", *right(*rating.modal_us)], rows, title=title))
        left = ", ".join(f"{part:.1f}" for part in convert(rating.unexplained, "1", "%"))
        console.print(f"unexplained part of each aeroloader's force: {left} %", highlight=False, soft_wrap=True)


def _show_baseline(console: Console, rig_files: Sequence[Path], reference: Baseline) -> None:
    slopes = ", ".join(f"{port} {rate:.0f}".strip() for port, rate in reference.damping.items())
    console.print(
        f"baseline {rig_files[reference.test].name}: dampings {slopes} N.s/m", highlight=False, soft_wrap=True
    )
    for note in reference.notes():
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False, soft_wrap=True)


def _trust_tables(fit: VehicleFit) -> Iterator[Table]:
    """Yield the tables of what a fit says about its own outputs, measures and friction."""
    from eightpost.ident.vehicle.vehicle_fit import friction_table, measure_table, trust_table

    if fit.trust is not None and fit.trust.outputs:
        yield trust_table(fit.trust)
    if fit.trust is not None and fit.trust.measures:
        yield measure_table(fit.trust)
    if fit.trust is not None and fit.trust.friction:
        yield friction_table(fit, fit.trust)


def _show_fit(console: Console, fit: VehicleFit, verdict: Verdict) -> None:
    """Print model, misfit and verdict; with -v, also the tables of all outputs and the notes."""
    from eightpost.ident.vehicle.vehicle_fit import damping_sentence, residual_table

    worst = max(fit.residual, key=lambda name: fit.residual[name])
    rows = [
        ("model", f"{fit.states} states, {len(fit.response.input_names)} inputs, {len(fit.residual)} outputs"),
        ("misfit", f"up to {100.0 * fit.residual[worst]:.2g} % ({worst})"),
        ("damping", damping_sentence(fit)),
        ("notes", f"{len(fit.notes)}; -v shows them" if fit.notes else ""),
    ]
    show_summary(console, f"{fit.vehicle.name}, recipe {fit.recipe}, {fit.seconds:.0f} s of processor time", rows)
    more = details(console)
    more.print(residual_table(fit))
    for table in _trust_tables(fit):
        more.print(table)
    for note in fit.notes:
        more.print(f"[yellow]note[/] {escape(note)}", highlight=False, soft_wrap=True)
    show_verdict(console, verdict)


# ---- Validation -----------------------------------------------------------------------------------------------------

#: Settling time at the start of a vehicle's records, which is left out [s].
SETTLING = 4.0


@dataclass(frozen=True, slots=True)
class _ValidateOptions:
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
def validate(ctx: click.Context, asked: _ValidateOptions = group(_ValidateOptions)) -> None:
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
    console: Console, paths: list[Path], files: Sequence[Path], asked: _ValidateOptions
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


def _validate_vehicle(console: Console, path: Path, files: Sequence[Path], asked: _ValidateOptions) -> Verdict:
    """Validate a vehicle, print the tables, write the report, and return the verdict."""
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
    for table in _trust_tables(fit):
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
