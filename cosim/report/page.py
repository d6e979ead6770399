"""Report page out/report.html: one run in one file that loads nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from markupsafe import Markup

from cosim.energy import LIMIT
from cosim.report.channels import Scale, panels, statistics
from cosim.report.figures import figure, listed, percent
from cosim.report.graph import graph
from cosim.report.groups import Group, groups
from cosim.report.packing import Store
from cosim.report.provenance import drive_digest, origins, versions
from cosim.report.spectra import Spectra, spectra
from cosim.report.status import bond_rows, facts, notes, tiles
from cosim.report.traces import Traces, traces
from cosim.report.wiring import arrows
from cosim.result import Result
from cosim.scenario import Scenario
from cosim.system import System
from eightpost.files import atomic_path
from eightpost.page import insert, plotly, template
from eightpost.signals import TimeSeries

_PACKAGE = "cosim.report"

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
    path = Path(path)
    content = page(result, system, scenario, title=title, files=files)
    with atomic_path(path) as temporary:
        temporary.write_text(content, encoding="utf-8")
    return path


def page(
    result: Result, system: System, scenario: Scenario, *, title: str, files: Mapping[str, Path] | None = None
) -> str:
    """Return the page's HTML; names of components, channels and files are escaped."""
    settled = _settled(result)
    kept, densities = traces(result.series), spectra(settled)
    manifest, numbers = _packed(result, kept, densities)
    return template(_PACKAGE, {"figure": figure, "percent": percent, "listed": listed}).render(
        _summary(result, scenario)
        | _signals(result, settled)
        | {
            "title": title,
            "result": result,
            "drawings": _drawings(result, system, scenario),
            "bonds": system.bonds,
            "connections": system.connections,
            "accounts": bond_rows(result),
            "origins": origins(result, files or {}),
            "traces": kept,
            "spectra": densities,
            "manifest": manifest,
            "numbers": numbers,
            "plotly": plotly(),
            "style": insert(_PACKAGE, "page.css"),
            "script": insert(_PACKAGE, "page.js"),
        }
    )


def _summary(result: Result, scenario: Scenario) -> dict[str, Any]:
    """Return the page's data about the run as a whole."""
    return {
        "verdict": result.verdict,
        "tiles": tiles(result),
        "notes": notes(result),
        "facts": facts(result),
        "drive": scenario.drive,
        "drive_start": scenario.drive_start,
        "digest": drive_digest(scenario.drive) if scenario.drive else "",
        "versions": versions(),
        "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "limit": 100.0 * LIMIT,
    }


def _signals(result: Result, settled: TimeSeries) -> dict[str, Any]:
    """Return the page's data about each channel."""
    rows = statistics(settled, result.stated_error)
    return {
        "panels": panels(result.series),
        "statistics": rows,
        "largest": max((row.error for row in rows if row.error is not None), default=None),
        "span": f"{settled.time[0]:g} to {settled.time[-1]:g} s",
        "velocity": Scale.of("m/s"),
        "force": Scale.of("N"),
    }


def _drawings(result: Result, system: System, scenario: Scenario) -> list[tuple[Group, Markup]]:
    found = groups(tuple(system.components), arrows(system, scenario), result.sources)
    return [(group, Markup(graph(group, result.sources))) for group in found[:_DRAWINGS]]


def _settled(result: Result) -> TimeSeries:
    """Return the series without the settling time; the whole series if the run ended before the settling time."""
    return result.settled() if result.series.time[-1] > result.settling else result.series


def _packed(result: Result, kept: Traces, densities: Spectra | None) -> tuple[dict[str, Any], str]:
    """Return the positions of the numbers for the page's script, and the numbers."""
    store, series = Store(), result.series
    channels = [
        {
            "name": name,
            "scale": asdict(Scale.of(unit)) | {"squared": Scale.of(unit).squared},
            "low": float(values.min()),
            "high": float(values.max()),
            "at": store.add_levels(values),
            "density": None if densities is None else store.add_single(densities.density[k]),
        }
        for k, (name, unit, values) in enumerate(zip(series.names, series.units, kept.values, strict=True))
    ]
    manifest = {
        "channels": channels,
        "time": {"at": store.add(kept.time), "count": kept.time.size},
        "frequency": densities and {"at": store.add(densities.frequency), "count": densities.frequency.size},
        "settling": result.settling,
    }
    return manifest, store.text
