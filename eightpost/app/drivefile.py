"""`eightpost drivefile`: commands that reproduce measured track channels on the rig."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import Assignment, FilePath, OutputFolder, Quantity, argument, group, option, setting, verb
from eightpost.app.virtual import CAR_SEED, CARS, FRICTION, NOISE
from eightpost.errors import InputError

if TYPE_CHECKING:
    from eightpost.drivefile import IterationFolder, Outcome
    from eightpost.ident.vehicle.frequency_response import FrequencyResponse
    from eightpost.vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class StartOptions:
    """Options of `eightpost drivefile start`."""

    # fmt: off
    track: Path = argument("TRACK", kind=FilePath())
    car_file: Path = option(
        "Identified car (.json, from eightpost identify), or its parameters (.toml).",
        "--car", kind=FilePath(), default=..., metavar="CAR",
    )
    output: Path = option(
        "Folder of the iteration.", "-o", "--output", kind=OutputFolder(), default=..., metavar="FOLDER"
    )
    shocks: tuple[tuple[str, str], ...] = option(
        "Shock of a corner in the track record, if it is not the baseline of the identification; may be repeated.",
        "--shock", kind=Assignment("CORNER=SHOCK.json"), metavar="CORNER=SHOCK.JSON",
    )
    channels: Channels = CHANNELS
    reproduced: str | None = setting(
        "Channels to reproduce, separated by commas. Default: hub acceleration and shock displacement of each corner.",
        "channels",
    )
    window: tuple[float, float] | None = setting(
        "Start and end of the lap in the record, e.g. window='12 s, 45 s'; default: the whole record.",
        kind=Quantity("s"), nargs=2,
    )
    high: float = setting("Highest frequency to reproduce.", kind=Quantity("Hz", positive=True), default="30 Hz")
    gain: float = setting(
        "Maximum gain of an update, 0 to 1; the coherence of the last step reduces it by channel and band.",
        kind=click.FLOAT, default=0.9,
    )
    regularisation: float = setting(
        "Regularisation of the inverse, 0 to 1, relative to the largest singular value of each line.",
        kind=click.FLOAT, default=0.02,
    )
    acceleration: float = setting(
        "Accepted error of the accelerations [% of their RMS].", kind=click.FLOAT, default=2.5
    )
    displacement: float = setting(
        "Accepted error of the displacements and all other channels [% of their RMS].", kind=click.FLOAT, default=1.0
    )
    stroke: float = setting(
        "Maximum distance of a wheelloader from the middle of its stroke.",
        kind=Quantity("m", positive=True), default="6.2 in",
    )
    velocity: float = setting(
        "Maximum velocity of a wheelloader.", kind=Quantity("m/s", positive=True), default="180 in/s"
    )
    force: float = setting("Maximum force of an aeroloader.", kind=Quantity("N", positive=True), default="4300 lbf")
    wheelloader: float = setting(
        "Control bandwidth of the wheelloaders.", kind=Quantity("Hz", positive=True), default="125 Hz"
    )
    aeroloader: float = setting(
        "Control bandwidth of the aeroloaders.", kind=Quantity("Hz", positive=True), default="9 Hz"
    )
    means: bool = setting("Reproduce the mean displacements by steady loads.", default=True)
    suffix: str = setting(
        "File format of the drive files for the rig.",
        "format", kind=("parquet", "csv", "mat", "drv"), default="parquet",
    )
    # fmt: on


@verb
def start(asked: StartOptions = group(StartOptions)) -> None:
    """Compute the first drive file from a track record.

    TRACK is a record with the channels of docs/explanation/rig.md, or with a channel map.

    \b
    Examples:
      eightpost drivefile start track.csv --car car.json -o richmond/
      eightpost drivefile start lap.csv --channel map.toml --set window='12 s, 45 s' --car car.json -o lap/
    """
    from eightpost import drivefile
    from eightpost.files import sha256_of
    from eightpost.shock import read_shock
    from eightpost.units import convert

    vehicle, measured = _car(asked.car_file)
    names = asked.reproduced.replace(" ", "").split(",") if asked.reproduced else None
    series = drivefile.read_channels(asked.track, names, **asked.channels.options)
    target = drivefile.Target(series.window(*asked.window) if asked.window else series, asked.high)
    laws = {corner: read_shock(file).law for corner, file in asked.shocks}
    bands = drivefile.ActuatorBands(asked.wheelloader, asked.aeroloader)
    begin = drivefile.start_response(vehicle, target, shocks=laws, actuators=bands, measured=measured)
    settings = drivefile.Settings(
        gain=asked.gain,
        regularisation=asked.regularisation,
        acceleration=convert(asked.acceleration, "%", "1"),
        displacement=convert(asked.displacement, "%", "1"),
        has_means=asked.means,
        limits=drivefile.Limits(asked.stroke, asked.velocity, asked.force),
    )
    sources = {path.name: sha256_of(path) for path in (asked.track, asked.car_file)}
    problem = drivefile.Problem(target, begin, settings)
    folder = drivefile.IterationFolder.start(asked.output, problem, sources=sources, suffix=asked.suffix)
    console = Console(highlight=False)
    _show_notes(console, begin.notes)
    _show_state(console, folder)


@verb
def next_drive(
    ctx: click.Context,
    folder: Path = argument("FOLDER", kind=FilePath()),
    record: Path | None = option(
        "Record of the last drive file from the rig; default: none, which repeats an interrupted call.",
        kind=FilePath(), metavar="RECORD",
    ),
    channels: Channels = CHANNELS,
) -> None:  # fmt: skip
    """Compute the next drive file from the rig's record of the last one.

    FOLDER is the iteration that `start` wrote. The record is synchronised with the drive file by its commands or its
    wheelloader positions. The exit code is 1 if the iteration diverged or no longer makes progress.

    \b
    Example:
      eightpost drivefile next richmond/ --record monday_1.csv
    """
    from eightpost.drivefile import IterationFolder

    console = Console(highlight=False)
    iteration = IterationFolder.read(folder)
    if record is not None:
        _show_notes(console, iteration.add_record(record, **channels.options))
    iteration.write_next()
    ctx.exit(0 if _show_state(console, iteration) else 1)


@verb
def simulate(
    ctx: click.Context,
    folder: Path = argument("FOLDER", kind=FilePath()),
    passes: int = option(
        "Number of passes at the end, including those before.", kind=click.IntRange(min=1), default=8, metavar="N"
    ),
    truth: str = option(
        "Model of the car on the virtual rig (docs/explanation/rig.md).", "--car", kind=CARS, default="eight_post"
    ),
    shocks: tuple[str, ...] = option(
        "Shock of all corners, or four shocks in the order lf, rf, lr, rr, as in eightpost virtual rig. Default "
        "demo:A.",
        "--shock", metavar="SHOCK",
    ),
    car_seed: int | None = CAR_SEED,
    seed: int = setting(
        "Seed of the sensor noise and of the run-to-run drift; each pass adds its number.",
        kind=click.IntRange(min=0), default=100,
    ),
    noise: str = NOISE,
    friction: str = FRICTION,
) -> None:  # fmt: skip
    """Play the drive files on the virtual rig, as `next` would with a rig.

    FOLDER is the iteration that `start` wrote. The exit code is 1 unless the errors of the best pass are accepted.

    \b
    Example:
      eightpost virtual rig --test track --set seed=5 -o track.parquet
      eightpost drivefile start track.parquet --car car.json -o lap/
      eightpost drivefile simulate lap/ --passes 8
    """
    from eightpost.app.show import bar
    from eightpost.drivefile import IterationFolder, Status
    from eightpost.drivefile.folder import iterate
    from eightpost.virtual.program import Bench

    console = Console(highlight=False)
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
    from eightpost.app.show import show_notes

    show_notes(console, notes, most=1)


def _show_state(console: Console, folder: IterationFolder) -> bool:
    """Print errors, verdict and files, write the page, and return whether the verdict is acceptable."""
    from eightpost.app.show import show_files, show_notes, show_table, show_verdict
    from eightpost.drivefile.page import error_table, verdict_of, write_iteration_page
    from eightpost.report.tables import result_table

    outcome: Outcome = folder.outcome()
    verdict = verdict_of(folder)
    if outcome.errors:
        show_table(console, result_table(error_table(folder.problem, outcome)), most=3)
        show_verdict(console, verdict)
    else:
        show_notes(console, map(str, outcome.hits))
    written = [write_iteration_page(folder)]
    if folder.waiting is not None:
        written.insert(0, folder.drive_path(folder.waiting))
    if outcome.best >= 0:
        written.append(folder.path / f"best_drive.{folder.suffix}")
    show_files(console, written)
    return verdict.is_acceptable
