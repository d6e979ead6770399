"""A run as one HTML page, and its plots: time traces and spectra, each one figure in one file."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from math import inf, isfinite
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from markupsafe import Markup

from cosim.report.drawing import arrows, graph, groups
from cosim.session.result import Result
from cosim.session.verdict import LARGEST_RESIDUAL
from cosim.systems.coupling import Scenario
from cosim.systems.system import System
from eightpost import __version__
from eightpost.archive import open_archive
from eightpost.errors import FmuError
from eightpost.files import sha256_of
from eightpost.report import page as html
from eightpost.report.charts import COLORS
from eightpost.report.page import Spectra, Store, Traces, spectra, traces, welch
from eightpost.report.tables import Display, Tile, figure, listed, percent
from eightpost.signals import Drivefile, TimeSeries

# ==== Origin: files with their digests, versions and the machine =====================================================

_PACKAGES = ("numpy", "scipy", "numba", "fmpy")


@dataclass(frozen=True, slots=True)
class Origin:
    """Origin of a component."""

    name: str  #: Name of the component.
    file: str  #: Name of its file.
    identity: str  #: GUID.
    made_by: str  #: Tool and model version stated in its description; empty if not known.
    digest: str  #: SHA-256 of the file; empty if not known.
    parameters: tuple[str, ...]  #: Values that differ from its defaults, in its own units.


def origins(result: Result, files: Mapping[str, Path]) -> tuple[Origin, ...]:
    """Return the origin of every component.

    Args:
        result: Result of the run.
        files: FMU files by component, if known; each is read once.
    """
    made = {path: (_made_by(path), sha256_of(path) if path.is_file() else "") for path in set(files.values())}
    return tuple(
        Origin(
            name,
            result.sources.get(name, ""),
            identity,
            *(made[files[name]] if name in files else ("", "")),
            parameters=tuple(f"{p} = {value}" for p, value in result.parameters.get(name, {}).items()),
        )
        for name, identity in result.identities.items()
    )


def _drive_digest(drive: Drivefile) -> str:
    """Return the SHA-256 of the contents of a drive, independent of its file format.

    It is computed from one line `name [unit]` per channel in UTF-8, then the times and the values, channel
    after channel, in SI as little-endian 64-bit numbers.
    """
    digest = hashlib.sha256()
    for name, unit in zip(drive.names, drive.units, strict=True):
        digest.update(f"{name} [{unit}]\n".encode())
    digest.update(drive.series.time.astype("<f8").tobytes())
    digest.update(drive.series.values.astype("<f8").tobytes())
    return digest.hexdigest()


def versions() -> str:
    """Return the versions of the current installation."""
    parts = [f"eightpost {__version__}", f"Python {platform.python_version()}"]
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            parts.append(f"{name} {version(name)}")
    return ", ".join((*parts, f"{platform.system()} {platform.machine()}"))


def _made_by(path: Path) -> str:
    """Return the tool and the model's version from modelDescription.xml; empty if the file cannot be read."""
    try:
        with open_archive(path) as archive:
            content = archive.read("modelDescription.xml")
        root = ElementTree.fromstring(content)
    except (FmuError, ElementTree.ParseError, ValueError, LookupError):
        return ""
    model = f"version {root.get('version')}" if root.get("version") else ""
    return ", ".join(filter(None, (root.get("generationTool"), model, f"FMI {root.get('fmiVersion', '')}")))


# ---- Recorded channels for display ----------------------------------------------------------------------------------

#: Dash styles, which distinguish lines of the same colour.
DASHES = ("solid", "dash", "dot", "dashdot")

#: Number of panels that are open at first, and of lines that each of them draws at first: one per colour.
_OPEN, _DRAWN = 5, len(COLORS)


@dataclass(frozen=True, slots=True)
class Statistics:
    """Statistics of a channel after settling, in its SI unit."""

    name: str  #: Name of the channel.
    scale: Display  #: Conversion to the display unit.
    mean: float  #: Mean.
    rms: float  #: Root mean square about the mean.
    least: float  #: Minimum.
    greatest: float  #: Maximum.
    error: float | None  #: Stated coupling error in percent of `rms`; None if it is not known.

    @property
    def deviation(self) -> float:
        """Stated error in the SI unit, root mean square; 0 if it is not known."""
        return 0.01 * (self.error or 0.0) * self.rms


@dataclass(frozen=True, slots=True)
class Line:
    """One channel: its row in the series, its colour and dashes, and whether it is drawn at first."""

    row: int
    name: str
    color: str
    dash: str
    drawn: bool


@dataclass(frozen=True, slots=True)
class Panel:
    """Channels of one quantity and unit on common axes."""

    quantity: str
    scale: Display
    lines: tuple[Line, ...]
    opened: bool


def panels(series: TimeSeries) -> tuple[Panel, ...]:
    """Sort channels into panels by the last part of their name and their unit, in the order of the series."""
    members: dict[tuple[str, str], list[int]] = {}
    for row, (name, unit) in enumerate(zip(series.names, series.units, strict=True)):
        members.setdefault((name.rpartition(".")[2], unit), []).append(row)
    found = []
    for k, ((quantity, unit), rows) in enumerate(members.items()):
        styles = [(COLORS[n % len(COLORS)], DASHES[n // len(COLORS) % len(DASHES)]) for n in range(len(rows))]
        lines = (Line(row, series.names[row], *styles[n], drawn=n < _DRAWN) for n, row in enumerate(rows))
        found.append(Panel(quantity, Display.us(unit), tuple(lines), opened=k < _OPEN))
    return tuple(found)


def statistics(series: TimeSeries, stated: Mapping[str, float]) -> tuple[Statistics, ...]:
    """Return the statistics of each channel, with the error that the run states for it [%]."""
    return tuple(
        Statistics(
            name,
            Display.us(unit),
            *(float(row.mean()), float(row.std()), float(row.min()), float(row.max())),
            error=stated[name] if isfinite(stated.get(name, inf)) else None,
        )
        for name, unit, row in zip(series.names, series.units, series.values, strict=True)
    )


# ---- Information about a run other than its verdict -----------------------------------------------------------------


def tiles(result: Result) -> Iterator[Tile]:
    """Yield the figures of the page's head; of the stated errors, the largest that is known."""
    errors = [(error, name) for name, error in result.stated_error.items() if isfinite(error)]
    largest = max(errors, default=None)
    at_ports = max(((error, name) for error, name in errors if name in result.decisive), default=None)
    if at_ports and at_ports != largest:
        yield Tile("Coupling error (bonds, tires)", percent(at_ports[0]), at_ports[1])
    if largest:
        yield Tile("Coupling error (all channels)", percent(largest[0]), largest[1])
    else:
        yield Tile("Coupling error", "not stated", "one run at one step")
    if result.energy:
        name = max(result.energy, key=lambda bond: abs(result.energy[bond].relative))
        share = percent(100.0 * result.energy[name].relative)
        yield Tile("Energy residual, worst bond", share, f"{name}; limit {100.0 * LARGEST_RESIDUAL:g} %")
    yield Tile("Coupling step", _step(result), f"{result.scheme or result.algorithm}, steps: {result.steps}")
    yield Tile("Simulated", f"{float(result.series.time[-1]):g} s", f"in {figure(result.seconds, 3)} s")


def notes(result: Result) -> tuple[str, ...]:
    """Return all notes for the reader; the run's own notes first."""
    texts = list(result.notes)
    if result.settling and result.series.time[-1] <= result.settling:
        texts.append(
            f"the run ended within its settling time ({result.settling:g} s): statistics and spectra use all of it"
        )
    if result.held_direct:
        texts.append(
            "outputs that follow, without delay, an input that was held over each step: "
            f"{listed(result.held_direct)}; their error is proportional to the step"
        )
    return tuple(text.replace(" %", "\N{NO-BREAK SPACE}%") for text in texts)


def facts(result: Result, scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield facts about the run, as pairs of name and value."""
    first, last = float(result.series.time[0]), float(result.series.time[-1])
    yield "Time", f"{first:g} to {last:g} s{', ended early (partial)' if result.partial else ''}"
    yield "Settling, excluded from statistics and spectra", f"{result.settling:g} s"
    yield "Algorithm", f"{result.algorithm}, which used {result.scheme}" if result.scheme else result.algorithm
    yield "Order of the components", listed(result.order)
    yield "Converged", "yes" if result.converged else "no"
    yield "Coupling step", f"{_step(result)}; the largest was {1e3 * (result.largest_step or result.step):g} ms"
    yield "Steps", f"{result.steps}, {result.rejected_steps} more rejected"
    yield "Iterations of implicit steps", f"{result.iterations}"
    yield "Evaluations until the equilibrium start converged", f"{result.equilibrium_sweeps}"
    yield "Recorded", f"{len(result.series.names)} channels, {len(result.series)} samples each"
    yield "Computed in", f"{figure(result.seconds, 3)} s, of which {figure(result.stepping_seconds, 3)} s in steps"
    if scenario.drive is None:
        yield "Drive", "none"
    else:
        names, digest = listed(scenario.drive.names), _drive_digest(scenario.drive)
        text = '{}; from {:g} s of the drive file; <span class="digest">SHA-256 {}</span>'
        yield "Drive", Markup(text).format(names, scenario.drive_start, digest)
    yield "Versions", versions()


def _step(result: Result) -> str:
    return f"{1e3 * result.step:.4g} ms"


# ---- Report page out/report.html ------------------------------------------------------------------------------------

_PLACES = (
    ("notes", "Notes"), ("system", "System"), ("signals", "Signals"), ("bonds", "Bonds"), ("channels", "Channels"),
    ("run", "What was run"),
)  # fmt: skip

#: Maximum number of drawings on a page; further unconnected parts of a system are listed in the tables only.
_DRAWINGS = 12


def write_report(
    path: str | Path,
    result: Result,
    system: System,
    scenario: Scenario,
    *,
    title: str = "Co-simulation run",
    files: Mapping[str, Path] | None = None,
) -> Path:
    """Write a run as an interactive page; an old file is replaced only by a complete one.

    Args:
        path: Output file, such as out/report.html.
        result: Result of the run.
        system: System of the run.
        scenario: Scenario of the run.
        title: Heading of the page.
        files: FMU files by component, for their digests and the tools that made them; omitted if not given.

    Returns:
        Path of the file.
    """
    return html.write_page(path, page(result, system, scenario, title=title, files=files))


def page(
    result: Result, system: System, scenario: Scenario, *, title: str, files: Mapping[str, Path] | None = None
) -> str:
    """Return the page's HTML; names of components, channels and files are escaped."""
    settled = result.settled()
    shown, densities = traces(result.series), spectra(settled)
    manifest, numbers = _packed(result, shown, densities)
    rows = statistics(settled, result.stated_error)
    drawn = groups(tuple(system.components), arrows(system, scenario), result.sources)[:_DRAWINGS]
    return html.page(
        "cosim.report",
        ["page.js"],
        title=title,
        places=_PLACES,
        result=result,
        verdict=result.verdict,
        tiles=tuple(tiles(result)),
        notes=notes(result),
        facts=tuple(facts(result, scenario)),
        limit=100.0 * LARGEST_RESIDUAL,
        drawings=[(group, Markup(graph(group, result.sources))) for group in drawn],
        bonds=system.bonds,
        connections=system.connections,
        origins=origins(result, files or {}),
        traces=shown,
        spectra=densities,
        panels=panels(result.series),
        statistics=rows,
        largest=max((row.error for row in rows if row.error is not None), default=None),
        span=f"{settled.time[0]:g} to {settled.time[-1]:g} s",
        velocity=Display.us("m/s"),
        force=Display.us("N"),
        data={"manifest": manifest, "numbers": numbers},
    )


def _packed(result: Result, shown: Traces, densities: Spectra | None) -> tuple[dict[str, Any], str]:
    store, series = Store(), result.series
    channels = [
        {
            "name": name,
            "scale": asdict(Display.us(unit)) | {"squared": Display.us(unit).squared},
            "low": float(values.min()),
            "high": float(values.max()),
            "at": store.add_levels(values),
            "density": None if densities is None else store.add_single(densities.density[k]),
        }
        for k, (name, unit, values) in enumerate(zip(series.names, series.units, shown.values, strict=True))
    ]
    manifest = {
        "channels": channels,
        "time": {"at": store.add(shown.time), "count": shown.time.size},
        "frequency": densities and {"at": store.add(densities.frequency), "count": densities.frequency.size},
        "settling": result.settling,
    }
    return manifest, store.text


# ==== Picture of a run ===============================================================================================


def plot_spectra(
    runs: Mapping[str, TimeSeries],
    channels: Sequence[str],
    path: str | Path,
    title: str,
) -> None:
    """Plot power spectral densities (Welch, Hann, 4 s blocks) up to 30 Hz, one panel per channel."""
    from eightpost.report import pictures  # noqa: PLC0415 -- matplotlib takes long to load

    figure = pictures.new_figure(11, 2.4 * ((len(channels) + 1) // 2) + 0.8)
    panels = pictures.panels_of(figure, len(channels), 2, sharex=True)
    for panel, channel in zip(panels, channels, strict=True):
        for (label, series), color in zip(runs.items(), pictures.COLORS, strict=False):
            values = pictures.displayed(series, channel)
            block = min(values.size, int(4.0 * series.sample_rate))
            frequency, density = welch(values, series.sample_rate, block)
            within = (frequency > 0.0) & (frequency <= 30.0)
            panel.semilogy(frequency[within], density[within], lw=1.2, color=color, label=label)
        unit = pictures.display_unit(next(iter(runs.values())), channel)
        panel.set_title(channel, fontsize=9)
        panel.set_ylabel(f"({unit})²/Hz")
        panel.grid(alpha=0.3)
    for panel in panels[-2:]:
        panel.set_xlabel("frequency [Hz]")
        panel.tick_params(labelbottom=True)
    panels[0].legend(frameon=False)
    figure.suptitle(title)
    pictures.save(figure, path)
