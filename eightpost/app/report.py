"""`eightpost report`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from eightpost.errors import InputError
from eightpost.outputs import PAGE

if TYPE_CHECKING:
    from eightpost.array_types import Array
    from eightpost.ident.dyno_report.builds import CarCorner, Reading
    from eightpost.ident.dyno_report.entry import Entry
    from eightpost.verdict import Verdict


def _default_page(given: Mapping[str, Any]) -> Path:
    return Path(f"{given['files'][0].stem}.html" if given["live"] else "report.html")


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """Options of `eightpost report`."""

    # fmt: off
    files: tuple[Path, ...] = argument("FILE...", kind=FilePath())
    output: Path = option(
        "HTML file to write; default: report.html, with --live the name of FILE with the suffix .html.",
        "-o", "--output", kind=OutputFile(PAGE, default=_default_page), metavar="FILE.HTML",
    )
    live: bool = option("Write a page on which the shock and a quarter car run live, instead of its report.")
    builds: tuple[tuple[str, str], ...] = option(
        "Build of a file; may be repeated. Default: that in the file, else, for a shock, that of the record it was "
        "fitted to, else the name of the file.",
        "--build", kind=Assignment("FILE=NAME"), metavar="FILE=NAME",
    )
    limits: Path | None = option(
        "Master curve, for pass or fail: a table of speed, compression, rebound and tolerance, in N or %, or another "
        "dynamometer or shock file with --set tolerance. Default: no limits.",
        kind=FilePath(), metavar="MASTER",
    )
    car: Path | None = option(
        "Vehicle file (docs/reference/vehicle_file.md) with the masses and wheel rates of the corners, for damping "
        "ratios; with --live, file or FMU of the quarter car. Default: damping ratios are unknown; with --live, the "
        "car of examples/corner.toml.",
        kind=FilePath(), metavar="CAR.TOML",
    )
    at: tuple[tuple[str, str], ...] = option(
        "Build at a corner of the car (lf, rf, lr, rr), for the overview of a car's shocks; may be repeated.",
        "--corner", kind=Assignment("CORNER=BUILD"), metavar="CORNER=BUILD",
    )
    channels: Channels = CHANNELS
    split: bool = option("Split each record at its pauses and where a sine changes; the parts are runs.")
    title: str = setting("Heading of the page.", default="Dynamometer report")
    clicks: tuple[tuple[str, str], ...] = setting(
        "Settings of the adjusters of a file, e.g. clicks=run7.csv='14 from closed'; may be repeated. Default: those "
        "in the file.",
        kind=Assignment("FILE=TEXT"),
    )
    tolerances: tuple[str, ...] = setting(
        "Tolerance of a --limits file without one, in percent of its force or as a force: '5 %' or '20 N'; given "
        "twice, the larger one counts.",
        "tolerance",
    )
    cycle: str = setting(
        "Cycle of a steady sine to show: the last, the mean of all, or a number from 1.", default="mean"
    )
    track: tuple[str, ...] = setting(
        "Record of a track with the velocity or displacement of the shaft (FILE or FILE=COLUMN), for a histogram of "
        "shaft speed beside the curve; may be repeated.",
    )
    speeds: tuple[float, ...] = setting(
        "Speed of the tables, e.g. '5 in/s'; may be repeated. Default: 1, 2, 3, 5, 10, 15 and 20 in/s, as far as a "
        "curve goes.",
        "speed", kind=Quantity("m/s"),
    )
    corner_mass: float | None = setting(
        "Sprung mass on the corner of a car, e.g. '306 kg' or '675 lbm', for damping ratios; default: that of --car.",
        kind=Quantity("kg", positive=True),
    )
    wheel_rate: float | None = setting(
        "Rate of the suspension at the wheel, e.g. '40 N/mm', for damping ratios; default: that of --car.",
        kind=Quantity("N/m", positive=True),
    )
    motion_ratio: float = setting(
        "Damper travel per wheel travel, usually 0.1 to 2.", kind=Number(min=0.0, min_open=True), default=1.0
    )
    # fmt: on


@verb
def report(ctx: click.Context, asked: ReportOptions = group(ReportOptions)) -> None:
    """Write a page about shocks: their dynamometer records and fitted laws, by build; or about a study.

    FILE is a dynamometer record or a peak-velocity table in any format that `fit` reads (docs/reference/dyno_files.md),
    or a shock file that `fit` wrote. The page shows force over velocity, displacement and time, knees and slopes,
    the ratio of rebound to compression, damping ratios, hysteresis, lag, gas force, friction, energy, warming,
    repeatability, and the differences from the build of the first file (docs/how_to/dyno_report.md). It is one file
    that needs no network and can be printed. The exit code is 1 if the verdict on a record or a shock is "not usable"
    (docs/reference/verdict.md), or if a run or table is outside the --limits, or none can be judged by them; the page
    is written nevertheless.

    With --live, FILE is a shock file or the native FMU of a shock. On the page, a reader turns its parameters, drives
    it on a dynamometer or by hand, and drives a quarter car over a bump; the C code of the FMUs runs in it as
    WebAssembly (docs/how_to/page.md). FILE may also be the folder of a study, whose page is written again.

    \b
    Examples:
      eightpost report run1.csv run2.csv shock.json -o report.html
      eightpost report A.csv A.json B.csv B.json --set corner-mass='306 kg' --set wheel-rate='40 N/mm'
      eightpost report run1.csv --limits dyno.csv --set tolerance='5 %' --set tolerance='10 N' --set cycle=last
      eightpost report bank/*.json --car car.toml --corner lf=A --corner rf=A --corner lr=B --corner rr=B
      eightpost report day.csv --split --build day.csv='front 3' --set speed='5 in/s' --set speed='10 in/s'
      eightpost report shock.json --live
      eightpost report out/
    """
    console = Console(soft_wrap=True, highlight=False)
    if asked.live:
        ctx.exit(0 if _live_page(console, asked.files, asked.output, asked.car).is_acceptable else 1)
    if is_study(asked.files[0]):
        _study_page(console, asked.files[0])
        return
    ctx.exit(0 if _dyno_page(console, asked) else 1)


def _dyno_page(console: Console, asked: ReportOptions) -> bool:
    """Write the page about shocks; return whether all are acceptable and within the limits."""
    from eightpost.app.show import show_files, show_notes, show_text, show_verdict
    from eightpost.ident.dyno_report.builds import Reading, dyno_report, read_limits
    from eightpost.ident.dyno_report.page import report_verdict, write_report

    corners, channels = _corners(asked), asked.channels
    options = {"channel_map": channels.channel_map, "units": dict(channels.units)}
    builds, clicks = dict(asked.builds), dict(asked.clicks)
    reading = Reading(options, channels.flips, builds, clicks, asked.split, _cycle(asked.cycle))
    reading.check(asked.files)
    wanted = _tolerances(asked.tolerances, asked.limits)
    master = None if asked.limits is None else read_limits(asked.limits, Reading(options, channels.flips), wanted)
    entries, track = _read(console, asked.files, reading), _tracks(asked.track)
    made = dyno_report(
        entries, speeds=asked.speeds, corners=corners, fitted_to=dict(asked.at), limits=master, track=track
    )  # fmt: skip
    with console.status("drawing"):
        write_report(asked.output, made, title=asked.title)
    variants = [f"{variant.label}: {', '.join(f'{entry.name} ({entry.kind})' for entry in variant.entries)}"
                for variant in made.variants]  # fmt: skip
    show_notes(console, variants, "build")
    verdict = report_verdict(made.entries)
    show_verdict(console, verdict)
    failed = [one for one in made.judgements if not one.passed]
    show_notes(console, (f"{one.entry.name}, {one.stroke}: {one.text}" for one in failed), "FAIL:")
    unjudged = (f"{name}, which has no measured curve at a speed of the limits (--set speed)" for name in made.unjudged)
    show_notes(console, unjudged, "not judged:", most=1)
    if made.judgements and not failed:
        show_text(console, f"pass: all judged curves are within the limits of {asked.limits}")
    show_files(console, [asked.output])
    is_within = not failed and (asked.limits is None or bool(made.judgements))
    return verdict.is_acceptable and is_within


def _live_page(console: Console, files: Sequence[Path], output: Path, car: Path | None) -> Verdict:
    """Write the page on which a shock runs live; return the verdict on the shock."""
    from builder.live_page import write_live_page
    from eightpost.app.show import show_files, show_verdict
    from eightpost.examples_folder import examples_folder

    if len(files) > 1:
        raise InputError(f"--live shows one shock, not {len(files)} files")
    with console.status("compiling"):
        written = write_live_page(files[0], output, vehicle=car or examples_folder() / "corner.toml")
    show_verdict(console, written.verdict)
    size = written.path.stat().st_size
    show_files(console, [written.path], f": {len(written.controls)} parameters to turn, {size / 1e6:.1f} MB")
    return written.verdict


def is_study(path: Path) -> bool:
    """Return whether a folder is that of a study."""
    return (path / "results.parquet").is_file()


def _study_page(console: Console, folder: Path) -> None:
    from eightpost.app.show import show_files
    from eightpost.app.study import saved

    show_files(console, [saved(console, folder).write_page()])


def _cycle(text: str) -> str | int:
    """Return the cycle to show: `last`, `mean`, or a number from 1."""
    if text in ("last", "mean"):
        return text
    if not (text.isdecimal() and int(text)):
        raise InputError(f"--set cycle={text}: write last, mean, or the number of a cycle from 1")
    return int(text)


def _tolerances(texts: Sequence[str], limits: Path | None) -> list[tuple[float, str]]:
    """Return tolerances in percent or N."""
    from eightpost.units import convert, quantity

    if texts and limits is None:
        raise InputError("the tolerance is that of a master curve; add --limits FILE")
    if wrong := [text for text in texts if text.strip()[-1:].isdigit()]:
        raise InputError(f"tolerance {wrong[0]!r} has no unit; write it as '5 %' or '20 N'")
    found = [quantity(text) for text in texts]
    return [(value, "%") if unit == "%" else (float(convert(value, unit, "N")), "N") for value, unit in found]


def _tracks(words: Sequence[str]) -> dict[str, Array]:
    """Return the velocities of the shaft [m/s] of track files, by name."""
    from eightpost.ident.dyno_report.builds import read_track

    found = {}
    for word in words:
        name, _, column = word.partition("=")
        found[f"{Path(name).stem} {column}".strip()] = read_track(Path(name), column or None)
    return found


def _corners(asked: ReportOptions) -> tuple[CarCorner, ...]:
    from eightpost.ident.dyno_report.builds import CarCorner, corners_of_car

    mass, rate = asked.corner_mass, asked.wheel_rate
    if asked.car is not None:
        if mass is not None or rate is not None:
            raise InputError("--car gives mass and wheel rate of every corner; omit corner-mass and wheel-rate")
        return corners_of_car(asked.car, asked.motion_ratio)
    if (mass is None) != (rate is None):
        raise InputError("a damping ratio needs both corner-mass and wheel-rate")
    return () if mass is None or rate is None else (CarCorner("corner", mass, rate, asked.motion_ratio),)


def _read(console: Console, files: Sequence[Path], reading: Reading) -> tuple[Entry, ...]:
    from eightpost.app.show import bar
    from eightpost.ident.dyno_report.builds import read_entries

    with bar(console, "reading", len(files)) as advance:
        return read_entries(files, reading, advance=advance)
