"""`eightpost drivefile`: commands that reproduce measured track channels on the rig."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import (
    UNITS,
    Assignment,
    FilePath,
    OutputFolder,
    Quantity,
    VerbGroup,
    car_seed_option,
    flip_option,
    map_option,
    seed_option,
)
from eightpost.errors import InputError

if TYPE_CHECKING:
    from eightpost.drivefile import IterationFolder, Outcome
    from eightpost.ident.vehicle.frequency_response import FrequencyResponse
    from eightpost.signals import ChannelMap
    from eightpost.vehicle import Vehicle

CARS = ("quarter_car", "seven_dof", "eight_post", "flexible")


@click.group(cls=VerbGroup)
def drivefile() -> None:
    """Iterate the commands of the rig until it reproduces channels measured on the track.

    Drive file iteration (Eq 2.7): `start` computes the first drive file from a track record and an identified car, and
    `next` computes each following one from the rig's record of the last one. `simulate` plays them on the virtual rig.
    An iteration is a folder with all passes, and can resume at any point (docs/how_to/drivefile.md).

    \b
    Examples:
      eightpost drivefile start track.csv --car car.json -o richmond/
      eightpost drivefile next richmond/ --record monday_1.csv
      eightpost drivefile simulate richmond/ --passes 8
    """


@drivefile.command()
@click.argument("track", metavar="TRACK", type=FilePath())
@click.option("--car", "car_file", required=True, metavar="CAR", type=FilePath(),
              help="Identified car (.json, from eightpost identify), or its parameters (.toml).")  # fmt: skip
@click.option("-o", "--output", required=True, metavar="FOLDER", type=OutputFolder(),
              help="Folder of the iteration.")  # fmt: skip
@click.option("--channels", metavar="NAMES",
              help="Channels to reproduce, separated by commas. Default: hub acceleration and shock displacement of "
              "each corner.")  # fmt: skip
@click.option("--shock", "shocks", type=Assignment("CORNER=SHOCK.json"), metavar="CORNER=SHOCK.JSON", multiple=True,
              help="Shock of a corner in the track record, if it is not the baseline of the identification; may be "
              "repeated.")  # fmt: skip
@click.option("--window", nargs=2, type=Quantity("s"), metavar="START STOP",
              help="Start and end of the lap in the record, e.g. '12 s' '45 s'; default: the whole "
              "record.")  # fmt: skip
@click.option("--high", type=Quantity("Hz", positive=True), default="30 Hz", show_default=True, metavar="FREQUENCY",
              help="Highest frequency to reproduce.")  # fmt: skip
@click.option("--gain", default=0.9, show_default=True, metavar="0..1",
              help="Maximum gain of an update, 0 to 1; the coherence of the last step reduces it by channel and "
              "band.")  # fmt: skip
@click.option("--regularisation", default=0.02, show_default=True, metavar="0..1",
              help="Regularisation of the inverse, 0 to 1, relative to the largest singular value of each "
              "line.")  # fmt: skip
@click.option("--acceleration", default=2.5, show_default=True, metavar="PERCENT",
              help="Accepted error of the accelerations [% of their RMS].")  # fmt: skip
@click.option("--displacement", default=1.0, show_default=True, metavar="PERCENT",
              help="Accepted error of the displacements and all other channels [% of their RMS].")  # fmt: skip
@click.option("--stroke", type=Quantity("m", positive=True), default="6.2 in", show_default=True, metavar="LENGTH",
              help="Maximum distance of a wheelloader from the middle of its stroke.")  # fmt: skip
@click.option("--velocity", type=Quantity("m/s", positive=True), default="180 in/s", show_default=True, metavar="SPEED",
              help="Maximum velocity of a wheelloader.")  # fmt: skip
@click.option("--force", type=Quantity("N", positive=True), default="4300 lbf", show_default=True, metavar="FORCE",
              help="Maximum force of an aeroloader.")  # fmt: skip
@click.option("--wheelloader", type=Quantity("Hz", positive=True), default="125 Hz", show_default=True,
              metavar="FREQUENCY", help="Control bandwidth of the wheelloaders.")  # fmt: skip
@click.option("--aeroloader", type=Quantity("Hz", positive=True), default="9 Hz", show_default=True,
              metavar="FREQUENCY", help="Control bandwidth of the aeroloaders.")  # fmt: skip
@click.option("--means/--no-means", default=True, show_default=True,
              help="Reproduce the mean displacements by steady loads.")  # fmt: skip
@click.option("--format", "suffix", type=click.Choice(["parquet", "csv", "mat", "drv"]), default="parquet",
              show_default=True, help="File format of the drive files for the rig.")  # fmt: skip
@UNITS
@map_option("docs/explanation/rig.md")
@flip_option("lf.displacement")
def start(  # one parameter per option
    track: Path,
    car_file: Path,
    output: Path,
    channels: str | None,
    shocks: tuple[tuple[str, str], ...],
    window: tuple[float, float] | None,
    high: float,
    gain: float,
    regularisation: float,
    acceleration: float,
    displacement: float,
    stroke: float,
    velocity: float,
    force: float,
    wheelloader: float,
    aeroloader: float,
    means: bool,
    suffix: str,
    units: tuple[tuple[str, str], ...],
    channel_map: ChannelMap | None,
    flip: tuple[str, ...],
) -> None:
    """Compute the first drive file from a track record.

    TRACK is a record with the channels of docs/explanation/rig.md, or with a channel map.

    \b
    Examples:
      eightpost drivefile start track.csv --car car.json -o richmond/
      eightpost drivefile start lap.csv --map car.toml --window '12 s' '45 s' --format csv --car car.json -o lap/
    """
    from eightpost.drivefile import (
        ActuatorBands,
        IterationFolder,
        Limits,
        Problem,
        Settings,
        Target,
        read_channels,
        start_response,
    )
    from eightpost.files import sha256_of
    from eightpost.shock import read_shock
    from eightpost.units import convert

    vehicle, measured = _car(car_file)
    names = channels.replace(" ", "").split(",") if channels else None
    series = read_channels(track, names, channel_map=channel_map, units=dict(units), flip=flip)
    target = Target(series.window(*window) if window else series, high)
    laws = {corner: read_shock(file).law for corner, file in shocks}
    begin = start_response(
        vehicle, target, shocks=laws, actuators=ActuatorBands(wheelloader, aeroloader), measured=measured
    )
    settings = Settings(
        gain=gain,
        regularisation=regularisation,
        acceleration=convert(acceleration, "%", "1"),
        displacement=convert(displacement, "%", "1"),
        has_means=means,
        limits=Limits(stroke, velocity, force),
    )
    sources = {path.name: sha256_of(path) for path in (track, car_file)}
    folder = IterationFolder.start(output, Problem(target, begin, settings), sources=sources, suffix=suffix)
    console = Console(soft_wrap=True, highlight=False)
    _show_notes(console, begin.notes)
    _show_state(console, folder)


@drivefile.command("next")
@click.argument("folder", metavar="FOLDER", type=FilePath())
@click.option("--record", metavar="RECORD", type=FilePath(),
              help="Record of the last drive file from the rig; default: none, which repeats an interrupted "
              "call.")  # fmt: skip
@UNITS
@map_option("docs/explanation/rig.md")
@flip_option("lf.displacement")
@click.pass_context
def next_drive(
    ctx: click.Context,
    folder: Path,
    record: Path | None,
    units: tuple[tuple[str, str], ...],
    channel_map: ChannelMap | None,
    flip: tuple[str, ...],
) -> None:
    """Compute the next drive file from the rig's record of the last one.

    FOLDER is the iteration that `start` wrote. The record is synchronised with the drive file by its commands or its
    wheelloader positions. The exit code is 1 if the iteration diverged or no longer makes progress.

    \b
    Example:
      eightpost drivefile next richmond/ --record monday_1.csv
    """
    from eightpost.drivefile import IterationFolder

    console = Console(soft_wrap=True, highlight=False)
    iteration = IterationFolder.read(folder)
    if record is not None:
        _show_notes(console, iteration.add_record(record, channel_map=channel_map, units=dict(units), flip=flip))
    iteration.write_next()
    ctx.exit(0 if _show_state(console, iteration) else 1)


@drivefile.command()
@click.argument("folder", metavar="FOLDER", type=FilePath())
@click.option("--passes", type=click.IntRange(min=1), default=8, show_default=True, metavar="N",
              help="Number of passes at the end, including those before.")  # fmt: skip
@click.option("--car", "truth", type=click.Choice(CARS), default="eight_post", show_default=True,
              help="Model of the car on the virtual rig (docs/explanation/rig.md).")  # fmt: skip
@car_seed_option
@click.option("--shock", "shocks", multiple=True, metavar="SHOCK",
              help="Shock of all corners, or four shocks in the order lf, rf, lr, rr, as in eightpost rig. Default "
              "demo:A.")  # fmt: skip
@seed_option(100, "Seed of the sensor noise and of the run-to-run drift; each pass adds its number.")
@click.option("--noise", type=click.Choice(["rig", "none"]), default="rig", show_default=True,
              help="Sensors of the rig. none: perfect sensors and no drift.")  # fmt: skip
@click.option("--friction", type=click.Choice(["on", "off"]), default="on", show_default=True,
              help="Friction of the car along its shocks.")  # fmt: skip
@click.pass_context
def simulate(
    ctx: click.Context,
    folder: Path,
    passes: int,
    truth: str,
    car_seed: int | None,
    shocks: tuple[str, ...],
    seed: int,
    noise: str,
    friction: str,
) -> None:
    """Play the drive files on the virtual rig, as `next` would with a rig.

    FOLDER is the iteration that `start` wrote. The exit code is 1 unless the errors of the best pass are accepted.

    \b
    Example:
      eightpost rig --test track --seed 5 -o track.parquet
      eightpost drivefile start track.parquet --car car.json -o lap/
      eightpost drivefile simulate lap/ --passes 8
    """
    from eightpost.app.progress import bar
    from eightpost.drivefile import IterationFolder, Status
    from eightpost.drivefile.folder import iterate
    from eightpost.virtual.program import Bench

    console = Console(soft_wrap=True, highlight=False)
    iteration = IterationFolder.read(folder)
    bench = Bench.of(truth, car_seed=car_seed, friction=friction == "on", noise=noise == "rig", run=seed)
    with bar(console, "passes", passes) as proceed:
        outcome = iterate(
            iteration, bench, bench.shocks(shocks or ("demo:A",)), passes, lambda state: proceed(len(state.errors))
        )
    accepted = _show_state(console, iteration)
    ctx.exit(0 if accepted and outcome.status is Status.CONVERGED else 1)


def _car(path: Path) -> tuple[Vehicle, FrequencyResponse | None]:
    """Return a car, and the response of its identification if there is one next to it."""
    from eightpost.ident.vehicle.vehicle_fit import fit_path, read_fit
    from eightpost.vehicle import read_vehicle

    if path.suffix.lower() == ".json" and fit_path(path).is_file():
        fit = read_fit(path)
        return fit.vehicle, fit.response
    if not path.is_file():
        raise InputError(f"{path}: there is no such car; identify one with eightpost identify")
    return read_vehicle(path), None


def _show_notes(console: Console, notes: tuple[str, ...]) -> None:
    for note in notes:
        console.print(f"[yellow]note[/] {escape(note)}")


def _show_state(console: Console, folder: IterationFolder) -> bool:
    """Print errors, verdict and files, write the page, and return whether the verdict is acceptable."""
    from eightpost.app.show import show_verdict
    from eightpost.drivefile.page import error_table, verdict_of, write_iteration_page
    from eightpost.report.tables import result_table

    outcome: Outcome = folder.outcome()
    verdict = verdict_of(folder)
    if outcome.errors:
        console.print(result_table(error_table(folder.problem, outcome)))
        show_verdict(console, verdict)
    else:
        for hit in outcome.hits:
            console.print(f"[yellow]note[/] {escape(str(hit))}")
    written = [write_iteration_page(folder)]
    if folder.waiting is not None:
        written.insert(0, folder.drive_path(folder.waiting))
    if outcome.best >= 0:
        written.append(folder.path / f"best_drive.{folder.suffix}")
    console.print(f"wrote {', '.join(escape(str(path)) for path in written)}")
    return verdict.is_acceptable
