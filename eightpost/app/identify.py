"""`eightpost identify`."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import FilePath, OutputFile, Quantity, argument, group, option, setting, verb
from eightpost.app.show import bar, details, show_files, show_summary, show_verdict
from eightpost.errors import FileFormatError, InputError, missing_file
from eightpost.outputs import VEHICLE
from eightpost.progress import advance, portion, reported_to
from eightpost.report.console import Table, console_table, right

if TYPE_CHECKING:
    from eightpost.ident.vehicle.experiment import Baseline
    from eightpost.ident.vehicle.static_rating import StaticRating
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.rig import RigTest
    from eightpost.verdict import Verdict

#: Names of `eightpost.ident.vehicle.plan.RECIPES`, whose import would delay every help text.
RECIPES = ("boggs", "common-poles", "grey-box")


@dataclass(frozen=True, slots=True)
class IdentifyOptions:
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
def identify(ctx: click.Context, asked: IdentifyOptions = group(IdentifyOptions)) -> None:
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


def _identified(more: Console, asked: IdentifyOptions) -> VehicleFit:
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


def trust_tables(fit: VehicleFit) -> Iterator[Table]:
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
    for table in trust_tables(fit):
        more.print(table)
    for note in fit.notes:
        more.print(f"[yellow]note[/] {escape(note)}", highlight=False, soft_wrap=True)
    show_verdict(console, verdict)
