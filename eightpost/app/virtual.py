"""`eightpost virtual` and `drivefile`: tests of models, whose data are SYNTHETIC, and drive files from track data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost import completion
from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import (
    Assignment,
    FilePath,
    OutputFile,
    OutputFolder,
    Quantity,
    argument,
    group,
    option,
    setting,
    verb,
)
from eightpost.app.show import bar, each, show_files, show_notes, show_table, show_text, show_verdict
from eightpost.errors import InputError
from eightpost.outputs import RECORD

if TYPE_CHECKING:
    from eightpost.drivefile import IterationFolder, Outcome
    from eightpost.ident.vehicle.frequency_response import FrequencyResponse
    from eightpost.rig import RigTest
    from eightpost.vehicle import Vehicle
    from eightpost.virtual.dynamometer import Specimen
    from eightpost.virtual.program import Draws


#: Motions of the dynamometer, tests and programs of the rig, and cars on it.
MOTIONS = ("random", "sine", "static", "bump", "all")
TESTS = ("random", "single", "sine", "bump", "static", "track")
PROGRAMS = ("identification", "single", "sine", "bump", "static", "track", "all")
CARS = ("quarter_car", "seven_dof", "eight_post", "flexible")

#: Settings of the car on the virtual rig.
CAR_SEED = setting(
    "Seed of the parameters of the flexible car; another number is another car. Default: its base parameters.",
    kind=click.IntRange(min=0),
)
NOISE = setting("Sensors of the rig. none: perfect sensors and no drift.", kind=("rig", "none"), default="rig")
FRICTION = setting("Friction of the car along its shocks.", kind=("on", "off"), default="on")

# ---- The dynamometer ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _DynoOptions:
    """Options of `eightpost virtual dyno`."""

    # fmt: off
    number: int | None = option(
        "Row of Table 3.1 that names the shock, e.g. 5. Default: the shock of --build.",
        "--configuration", metavar="1..12",
    )
    build: str | None = option(
        "Shim codes of Table 7.2 for a shock on a linear piston, as in Table 7.3, e.g. C/B. Default: the shock of "
        "--configuration.",
        metavar="COMPRESSION/REBOUND",
    )
    test_name: str = option(
        "Motion of the dynamometer. all: every test of 3.2.3, each in a file of its own.",
        "--test", kind=MOTIONS, default="random",
    )
    output: Path = option(
        "Output file (.csv or .parquet); with --test all, the output folder.",
        "-o", "--output", kind=OutputFile(RECORD, is_folder=lambda given: given["test_name"] == "all"), default=...,
    )
    gas: float | None = setting("Gauge gas pressure of a --build; default '150 psi'.", kind=Quantity("Pa"))
    clicks: int | None = setting(
        "Rebound bleed of a --build in clicks from fully open, 0 to 28: more clicks close it. Default 1.",
    )
    amplitude: float | None = setting(
        "Amplitude of the sine, e.g. '1 in', which --test sine needs; or peak displacement of the random test, "
        "default '1 in'.",
        kind=Quantity("m"),
    )
    speed: float | None = setting(
        "Peak velocity of the sine, e.g. '10 in/s'; no default: --test sine needs it.", kind=Quantity("m/s")
    )
    duration: float | None = setting(
        "Length of the random test; default '30 s'. The signal repeats every 10 s.", kind=Quantity("s")
    )
    seed: int = setting("Seed of the random phases and of the sensor noise.", kind=click.IntRange(min=0), default=1)
    # fmt: on


@verb
def dyno(asked: _DynoOptions = group(_DynoOptions)) -> None:
    """Test a physical shock on the virtual dynamometer; the data are SYNTHETIC.

    The shock model differs from all laws that can be fitted: it has two compressible chambers, shim valves, a head
    valve, gas and friction (docs/explanation/dynamometer.md). Position is measured from the 3 in offset; force is
    positive in compression.

    \b
    Examples:
      eightpost virtual dyno --configuration 1 --test random --set seed=1 -o dyno.parquet
      eightpost virtual dyno --build C/B --set gas='150 psi' --set clicks=14 -o c_b.csv
      eightpost virtual dyno --configuration 5 --test sine --set amplitude='1 in' --set speed='10 in/s' -o sine.parquet
      eightpost virtual dyno --build C/B --set amplitude='0.5 in' --set seed=7 -o as_on_the_lap.parquet
      eightpost virtual dyno --configuration 1 --test all -o tests/
    """
    from eightpost.virtual.dynamometer import drivefile_of, program

    console = Console()
    motion = {"amplitude": asked.amplitude, "speed": asked.speed, "duration": asked.duration}
    _check_options(asked.test_name, **motion)
    specimen = _specimen(asked)
    show_text(console, f"shock: {specimen.title}")
    if asked.test_name == "all":
        completion.begin(asked.output)
        tests = {name: (drive, asked.output / f"{name}.parquet") for name, drive in program(seed=asked.seed).items()}
    else:
        tests = {asked.test_name: (drivefile_of(asked.test_name, asked.seed, **motion), asked.output)}
    written = (specimen.test(drive, name, asked.seed, path) for name, (drive, path) in tests.items())
    show_notes(console, written, "wrote")


def _specimen(asked: _DynoOptions) -> Specimen:
    """Return the shock of the options."""
    from eightpost.virtual.dynamometer import Specimen

    if asked.number is None and asked.build is not None:
        return Specimen.built(asked.build, clicks=asked.clicks, gas=asked.gas)
    if asked.number is None or asked.build is not None:
        raise InputError("give one shock: --configuration 1 to 12 (Table 3.1), or --build, e.g. C/B")
    if asked.gas is not None or asked.clicks is not None:
        raise InputError("omit gas and clicks: Table 3.1 sets them for a --configuration")
    return Specimen.configured(asked.number)


def _check_options(test_name: str, *, amplitude: float | None, speed: float | None, duration: float | None) -> None:
    """Refuse options that do not apply to the test, and a sine without amplitude and speed."""
    if test_name == "sine" and (amplitude is None or speed is None):
        raise InputError(
            "--test sine needs --set amplitude='1 in' and --set speed='10 in/s'; --test all runs the sines of Table 3.3"
        )
    if test_name != "sine" and speed is not None:
        raise InputError(f"speed is a setting of --test sine; omit it with --test {test_name}")
    if test_name not in ("sine", "random") and amplitude is not None:
        raise InputError(f"amplitude is a setting of --test sine and random; omit it with --test {test_name}")
    if test_name != "random" and duration is not None:
        raise InputError(f"duration is a setting of --test random; omit it with --test {test_name}")


# ---- The rig --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _RigOptions:
    """Options of `eightpost virtual rig`."""

    # fmt: off
    truth: str = option(
        "Model of the car under test (docs/explanation/rig.md).", "--car", kind=CARS, default="eight_post"
    )
    test_name: str = option("Drive file of a single test (4.5.1, 6.1.3).", "--test", kind=TESTS, default="random")
    program_name: str | None = option(
        "Series of tests, written into a folder. identification: the baseline, and an alternate shock at each corner "
        "(6.1.5). sine: Table 6.2. all: every test. Default: the one test of --test.",
        "--program", kind=PROGRAMS,
    )
    shocks: tuple[str, ...] = option(
        "Shock of all corners, or four shocks in the order lf, rf, lr, rr: demo:A to C, configuration:1 to 12, "
        "build:C/B, a linear damper such as '20 lbf.s/in', or a shock.json. Default demo:A.",
        "--shock", metavar="SHOCK",
    )
    output: Path = option(
        "Output file (.parquet or .csv); with --program, the output folder.",
        "-o", "--output", kind=OutputFile(RECORD, is_folder=lambda given: given["program_name"] is not None),
        default=...,
    )
    car_seed: int | None = CAR_SEED
    alternate: str = setting("Shock that a program mounts at one corner after the other.", default="demo:C")
    draws: Draws = setting(
        "Drive files of a program's alternate tests: the baseline's (same), or other random phases (other).",
        kind=("same", "other"), default="same",
    )
    duration: float | None = setting(
        "Length of the test, or of the random tests of a program, e.g. '100 s', at most two hours. Default: random "
        "800 s (quarter car 120 s), single 100 s, bump 50 s (quarter car 60 s), track 33 s, sine 20 s.",
        kind=Quantity("s", positive=True, most=7200.0),
    )
    only: str | None = setting(
        "Actuator of a single or static test, e.g. lf.road; no default for single, the mode for static.",
    )
    mode: str = setting("Mode of a sine or static test: heave, pitch, roll or warp.", default="heave")
    frequency: float = setting("Sine frequency [Hz].", kind=Quantity("Hz", positive=True), default="2 Hz")
    amplitude: float = setting("Sine amplitude, e.g. '10 mm'.", kind=Quantity("m", positive=True), default="0.5 in")
    seed: int = setting("Seed of the drive file.", kind=click.IntRange(min=0), default=1)
    run_seed: int = setting(
        "Seed of the sensor noise and of the run-to-run drift; another number is another run.",
        "run", kind=click.IntRange(min=0), default=0,
    )
    noise: str = NOISE
    friction: str = FRICTION
    suffix: str = setting("File format of a program's records.", "format", kind=("parquet", "csv"), default="parquet")
    # fmt: on


@verb
def rig(asked: _RigOptions = group(_RigOptions)) -> None:
    """Test a car on the virtual rig; the data are SYNTHETIC.

    The model of the car differs from all models that can be identified (docs/explanation/rig.md). The records have the
    channels of Table 6.1 at 1250 Hz.

    \b
    Examples:
      eightpost virtual rig --program identification -o rig/
      eightpost virtual rig --program all --set duration='100 s' --shock build:B/B --set alternate=build:C/C -o rig/
      eightpost virtual rig --test random --set duration='100 s' -o baseline.parquet
      eightpost virtual rig --test single --set only=lf.road -o lf_road.parquet
      eightpost virtual rig --car quarter_car --test random --shock configuration:1 -o quarter.parquet
      eightpost virtual rig --test static --set mode=warp -o warp.csv
    """
    from eightpost.virtual import program
    from eightpost.virtual.program import Bench
    from eightpost.virtual.shocks import shocks_named

    bench = Bench.of(
        asked.truth, car_seed=asked.car_seed, friction=asked.friction == "on", noise=asked.noise == "rig",
        run=asked.run_seed, seed=asked.seed,
    )  # fmt: skip
    names = bench.shocks(asked.shocks or ("demo:A",))
    shocks_named((*names, asked.alternate))  # an unknown shock is an error before the first test
    console = Console()

    def finish(test: RigTest, path: Path) -> str:
        test.write(path)
        return f"{path}: {bench.summary(test)}"

    if asked.program_name is None:
        drivefile = bench.drivefile(
            asked.test_name, asked.seed, duration=asked.duration, only=asked.only or "", mode=asked.mode,
            frequency=asked.frequency, amplitude=asked.amplitude,
        )  # fmt: skip
        show_notes(console, [finish(bench.record(drivefile, names, asked.test_name), asked.output)], "wrote")
        return
    planned = program(asked.program_name, bench.car, asked.seed, duration=asked.duration, draws=asked.draws)
    completion.begin(asked.output)
    # Each record is written when it is done and freed before the next test, because 800 s are large.
    written = [
        finish(bench.record_planned(test, number, names, asked.alternate), asked.output / f"{test.name}.{asked.suffix}")
        for number, test in each(console, enumerate(planned), "tests", len(planned))
    ]
    show_notes(console, written, "wrote", most=3)


# ---- Drive files ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _StartOptions:
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
def start(asked: _StartOptions = group(_StartOptions)) -> None:
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
    show_notes(console, begin.notes, most=1)
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
    wheelloader positions. A call that was interrupted may be repeated as it was. The exit code is 1 if the iteration
    diverged or no longer makes progress.

    \b
    Example:
      eightpost drivefile next richmond/ --record monday_1.csv
    """
    from eightpost.drivefile import IterationFolder

    console = Console(highlight=False)
    iteration = IterationFolder.read(folder)
    if record is not None and iteration.is_added(record):  # an interrupted call is repeated
        show_notes(console, (f"{record} is the record of pass {iteration.played} already",), most=1)
    elif record is not None:
        show_notes(console, iteration.add_record(record, **channels.options), most=1)
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


def _show_state(console: Console, folder: IterationFolder) -> bool:
    """Print errors, verdict and files, write the page, and return whether the verdict is acceptable."""
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
