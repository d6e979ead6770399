"""`eightpost report`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import COLUMNS, UNITS, Assignment, FilePath, Number, OutputFile, Quantity, Verb, map_option
from eightpost.errors import InputError
from eightpost.outputs import PAGE

if TYPE_CHECKING:
    from eightpost.array_types import Array
    from eightpost.ident.dyno_report.builds import CarCorner, Reading
    from eightpost.ident.dyno_report.entry import Entry
    from eightpost.signals import ChannelMap


@click.command(cls=Verb)
@click.argument("files", metavar="DYNO... SHOCK...", nargs=-1, required=True, type=FilePath())
@click.option("-o", "--output", type=OutputFile(PAGE), metavar="FILE.HTML", default="report.html",
              show_default=True, help="HTML file to write.")  # fmt: skip
@click.option("--title", metavar="TEXT", default="Dynamometer report", show_default=True,
              help="Heading of the page.")  # fmt: skip
@click.option("--build", "builds", type=Assignment("FILE=NAME"), metavar="FILE=NAME", multiple=True,
              help="Build of a file; may be repeated. Default: that in the file, else, for a shock, that of the record "
              "it was fitted to, else the name of the file.")  # fmt: skip
@click.option("--clicks", type=Assignment("FILE=TEXT"), metavar="FILE=TEXT", multiple=True,
              help="Settings of the adjusters of a file, e.g. run7.csv='14 from closed'; may be repeated. Default: "
              "those in the file.")  # fmt: skip
@click.option("--limits", type=FilePath(), metavar="MASTER",
              help="Master curve, for pass or fail: a table of speed, compression, rebound and tolerance, in N or %, "
              "or another dynamometer or shock file with --tolerance. Default: no limits.")  # fmt: skip
@click.option("--tolerance", "tolerances", metavar="'5 %'|'20 N'", multiple=True,
              help="Tolerance of a --limits file without one, in percent of its force or as a force; given twice, the "
              "larger one counts.")  # fmt: skip
@click.option("--cycle", metavar="last|mean|N", default="mean", show_default=True,
              help="Cycle of a steady sine to show: the last, the mean of all, or a number from 1.")  # fmt: skip
@click.option("--track", metavar="FILE[=COLUMN]", multiple=True,
              help="Record of a track with the velocity or displacement of the shaft, for a histogram of shaft speed "
              "beside the curve; may be repeated.")  # fmt: skip
@click.option("--speed", "speeds", type=Quantity("m/s"), metavar="SPEED", multiple=True,
              help="Speed of the tables, e.g. '5 in/s'; may be repeated. Default: 1, 2, 3, 5, 10, 15 and 20 in/s, as "
              "far as a curve goes.")  # fmt: skip
@click.option("--corner-mass", type=Quantity("kg", positive=True), metavar="MASS",
              help="Sprung mass on the corner of a car, e.g. '306 kg' or '675 lbm', for damping ratios; default: that "
              "of --car.")  # fmt: skip
@click.option("--wheel-rate", type=Quantity("N/m", positive=True), metavar="RATE",
              help="Rate of the suspension at the wheel, e.g. '40 N/mm', for damping ratios; default: that of "
              "--car.")  # fmt: skip
@click.option("--motion-ratio", type=Number(min=0.0, min_open=True), metavar="0.1..2", default=1.0,
              show_default=True, help="Damper travel per wheel travel, usually 0.1 to 2.")  # fmt: skip
@click.option("--car", type=FilePath(), metavar="CAR.TOML",
              help="Vehicle file (docs/reference/vehicle_file.md) with the masses and wheel rates of the corners; "
              "default: --corner-mass and --wheel-rate, else damping ratios are unknown.")  # fmt: skip
@click.option("--corner", "at", type=Assignment("CORNER=BUILD"), metavar="CORNER=BUILD", multiple=True,
              help="Build at a corner of the car (lf, rf, lr, rr), for the overview of a car's shocks; may be "
              "repeated.")  # fmt: skip
@UNITS
@COLUMNS
@map_option("docs/reference/signs_and_units.md")
@click.option("--flip", metavar="[FILE=]CHANNEL", multiple=True,
              help="Reverse the sign of a channel in a file, or in all of them, e.g. run7.csv=force; may be "
              "repeated.")  # fmt: skip
@click.option("--split", is_flag=True,
              help="Split each record at its pauses and where a sine changes; the parts are runs.")  # fmt: skip
@click.pass_context
def report(  # one parameter per option
    ctx: click.Context,
    files: tuple[Path, ...],
    output: Path,
    title: str,
    builds: tuple[tuple[str, str], ...],
    clicks: tuple[tuple[str, str], ...],
    limits: Path | None,
    tolerances: tuple[str, ...],
    cycle: str,
    track: tuple[str, ...],
    speeds: tuple[float, ...],
    corner_mass: float | None,
    wheel_rate: float | None,
    motion_ratio: float,
    car: Path | None,
    at: tuple[tuple[str, str], ...],
    units: tuple[tuple[str, str], ...],
    columns: tuple[tuple[str, str], ...],
    channel_map: ChannelMap | None,
    flip: tuple[str, ...],
    split: bool,
) -> None:
    """Write a page about shocks: their dynamometer records and fitted laws, by build.

    DYNO is a dynamometer record or a peak-velocity table in any format that `fit` reads (docs/reference/dyno_files.md).
    SHOCK is a shock file that `fit` wrote. The page shows force over velocity, displacement and time, knees and slopes,
    the ratio of rebound to compression, damping ratios, hysteresis, lag, gas force, friction, energy, warming,
    repeatability, and the differences from the build of the first file (docs/how_to/dyno_report.md). It is one file
    that needs no network and can be printed. The exit code is 1 if the verdict on a record or a shock is "not usable"
    (docs/reference/verdict.md), or if a run or table is outside the --limits, or none can be judged by them; the page
    is written nevertheless.

    \b
    Examples:
      eightpost report run1.csv run2.csv shock.json -o report.html
      eightpost report A.csv A.json B.csv B.json --corner-mass '306 kg' --wheel-rate '40 N/mm'
      eightpost report run1.csv --limits dyno.csv --tolerance '5 %' --tolerance '10 N' --cycle last
      eightpost report bank/*.json --car car.toml --corner lf=A --corner rf=A --corner lr=B --corner rr=B
      eightpost report day.csv --split --build day.csv='front 3' --speed '5 in/s' --speed '10 in/s'
    """
    from eightpost.app.show import show_verdict
    from eightpost.ident.dyno_report.builds import Reading, dyno_report, read_limits
    from eightpost.ident.dyno_report.page import report_verdict, write_report
    from eightpost.rig.columns import with_channels

    console = Console(soft_wrap=True, highlight=False)
    corners = _corners(car, corner_mass, wheel_rate, motion_ratio)
    flips: dict[str, tuple[str, ...]] = {}
    for word in flip:
        name, _, channel = word.rpartition("=")
        flips[name] = (*flips.get(name, ()), channel)
    options = {"channel_map": with_channels(channel_map, dict(columns)), "units": dict(units)}
    reading = Reading(options, flips, dict(builds), dict(clicks), split, _cycle(cycle))
    reading.check(files)
    wanted = _tolerances(tolerances, limits)
    master = None if limits is None else read_limits(limits, Reading(options, flips), wanted)
    entries = _read(console, files, reading)
    made = dyno_report(entries, speeds=speeds, corners=corners, fitted_to=dict(at), limits=master, track=_tracks(track))
    with console.status("drawing"):
        write_report(output, made, title=title)
    for variant in made.variants:
        names = ", ".join(f"{entry.name} ({entry.kind})" for entry in variant.entries)
        console.print(f"{escape(variant.label)}: {escape(names)}")
    verdict = report_verdict(made.entries)
    show_verdict(console, verdict)
    failed = [one for one in made.judgements if not one.passed]
    for one in failed:
        console.print(f"FAIL: {escape(one.entry.name)}, {one.stroke}: {one.text}")
    for name in made.unjudged:
        console.print(f"not judged: {escape(name)}, which has no measured curve at a speed of the limits (--speed)")
    if made.judgements and not failed:
        console.print(f"pass: all judged curves are within the limits of {escape(str(limits))}")
    console.print(f"wrote {escape(str(output))}")
    is_within = not failed and (limits is None or bool(made.judgements))
    ctx.exit(0 if verdict.is_acceptable and is_within else 1)


def _cycle(text: str) -> str | int:
    """Return the cycle to show: `last`, `mean`, or a number from 1."""
    if text in ("last", "mean"):
        return text
    if not (text.isdecimal() and int(text)):
        raise InputError(f"--cycle {text!r}: write last, mean, or the number of a cycle from 1")
    return int(text)


def _tolerances(texts: Sequence[str], limits: Path | None) -> list[tuple[float, str]]:
    """Return tolerances in percent or N."""
    from eightpost.units import convert, quantity

    if texts and limits is None:
        raise InputError("--tolerance is that of a master curve; add --limits FILE")
    if wrong := [text for text in texts if text.strip()[-1:].isdigit()]:
        raise InputError(f"--tolerance {wrong[0]!r} has no unit; write it as '5 %' or '20 N'")
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


def _corners(
    car: Path | None, mass: float | None, rate: float | None, motion_ratio: float
) -> tuple[CarCorner, ...]:  # fmt: skip
    from eightpost.ident.dyno_report.builds import CarCorner, corners_of_car

    if car is not None:
        if mass is not None or rate is not None:
            raise InputError("--car gives mass and wheel rate of every corner; omit --corner-mass and --wheel-rate")
        return corners_of_car(car, motion_ratio)
    if (mass is None) != (rate is None):
        raise InputError("a damping ratio needs both --corner-mass and --wheel-rate")
    return () if mass is None or rate is None else (CarCorner("corner", mass, rate, motion_ratio),)


def _read(console: Console, files: Sequence[Path], reading: Reading) -> tuple[Entry, ...]:
    from eightpost.app.progress import bar
    from eightpost.ident.dyno_report.builds import read_entries

    with bar(console, "reading", len(files)) as advance:
        return read_entries(files, reading, advance=advance)
