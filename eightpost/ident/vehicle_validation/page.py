"""Self-contained HTML page of one vehicle's validation, for the screen and for print."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eightpost import __version__
from eightpost.files import atomic_path
from eightpost.ident.validation.page import caption, cell, unit
from eightpost.ident.validation.tables import field_factor, field_unit
from eightpost.ident.vehicle_validation import tables
from eightpost.ident.vehicle_validation.figures import (
    correlation_figure,
    level_figure,
    order_figure,
    response_figures,
    sine_figure,
    spectrum_figure,
    static_figure,
    time_figure,
    trend_figure,
)
from eightpost.ident.vehicle_validation.findings import Limits, validation_verdict
from eightpost.ident.vehicle_validation.tables import certainty_table, port_table
from eightpost.page import compressed, insert, plotly, template

if TYPE_CHECKING:
    from eightpost.ident.validation.figures import Figure
    from eightpost.ident.validation.tables import ResultTable
    from eightpost.ident.vehicle import VehicleFit
    from eightpost.ident.vehicle_validation.study import VehicleValidation

    Section = tuple[str, str, str, list[ResultTable], list[Figure]]

_PACKAGE = "eightpost.ident.vehicle_validation"
#: Package with the style and script, shared with the validation of shocks.
_SHARED = "eightpost.ident.validation"

_UNITS = ("N", "m", "m/s")

#: Maximum number of records of a kind that are plotted; with a hundred the page would not open.
_MOST = 12


def write_vehicle_report(
    path: str | Path, study: VehicleValidation, *, limits: Limits | None = None, title: str = "Vehicle validation"
) -> Path:
    """Write a vehicle's validation as an interactive page; an existing file is replaced only when the page is complete.

    Args:
        path: File to write, such as out/car.html.
        study: Result of the validation.
        limits: Limits of the verdict.
        title: Heading of the page.

    Returns:
        Path of the file.
    """
    path = Path(path)
    content = page(study, limits=limits or Limits(), title=title)
    with atomic_path(path) as temporary:
        temporary.write_text(content, encoding="utf-8")
    return path


def page(study: VehicleValidation, *, limits: Limits, title: str) -> str:
    """Return the HTML of the page; names of vehicles, records and files are escaped."""
    figures: list[dict[str, Any]] = []
    sections = [_placed(section, figures) for section in _sections(study, limits)]
    content = {"figures": figures, "units": {name: [field_factor(name), field_unit(name)] for name in _UNITS}}
    return template(_PACKAGE, {"cell": cell, "unit": unit, "caption": caption}).render(
        title=title,
        verdict=validation_verdict(study, limits),
        limits=limits.summary(),
        sections=sections,
        study=study,
        version=__version__,
        written=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        figures=compressed(json.dumps(content, allow_nan=False, separators=(",", ":")).encode()),
        plotly=plotly(),
        style=insert(_SHARED, "page.css"),
        script=insert(_SHARED, "page.js"),
    )


def _sections(study: VehicleValidation, limits: Limits) -> Iterator[Section]:
    """Yield identifier, heading, text, tables and figures of each section that has content."""
    levels = [level_figure(study, limits)] if any(case.judged for case in study.cases) else []
    yield "records", "Records", "", [tables.overview(study)], levels
    if study.trends:
        figures = [trend_figure(study.trends), correlation_figure(study.trends)]
        yield "trends", "Setups: trends and levels", _TRENDS, [tables.trend_table(study)], figures
    yield from _time_sections(study)
    friction = tables.friction_table(study)
    if friction.rows:
        yield "friction", "Friction", _friction(study), [friction, port_table(study.fit)], []
    if study.of_kind("static"):
        drawn = [static_figure(case) for case in study.of_kind("static") if case.holds]
        yield "static", "Static records", _static(study), [tables.static_table(study)], drawn
    yield "responses", "Responses", "", [tables.path_table(study)], list(response_figures(study.paths))
    yield "modes", "Modes", _MODES, [tables.mode_table(study)], []
    if study.fit.trust is not None:
        yield "fit", "Self-assessment of the fit", _flags(study.fit), _fit_tables(study), list(_orders(study.fit))


def _time_sections(study: VehicleValidation) -> Iterator[Section]:
    random, sines, bumps = (study.of_kind(kind) for kind in ("random", "sine", "bump"))
    if random:
        figures = [time_figure(case) for case in random[:_MOST]]
        figures += [spectrum_figure(case) for case in random[:_MOST] if case.spectra]
        found = [tables.outputs_table(case) for case in random]
        yield "random", "Random and track records", _more(len(random)), found, figures
    if sines:
        figures = [sine_figure(sines), *(time_figure(case) for case in sines[:_MOST])]
        yield "sine", "Sine records", _more(len(sines)), [tables.sine_table(study)], figures
    if bumps:
        yield (
            "bump",
            "Bump records",
            _more(len(bumps)),
            [tables.outputs_table(c) for c in bumps],
            [time_figure(case) for case in bumps[:_MOST]],
        )


def _more(count: int) -> str:
    return f"The first {_MOST} of {count} records are plotted." if count > _MOST else ""


def _static(study: VehicleValidation) -> str:
    low = study.band[0]
    if low <= 0.0:
        return "The fit includes 0 Hz."
    return (
        f"The fit begins at {low:.3g} Hz, so the model's static gain is extrapolated. Friction also holds the car "
        "between two levels. Static records are therefore shown, but no criterion applies to them."
    )


def _friction(study: VehicleValidation) -> str:
    laws = study.fit.vehicle.friction
    forces = ", ".join(f"{port} {law.force:.1f} N".strip() for port, law in laws.items())
    return f"The identification found friction at the ports: {forces}. Errors of the model with and without it:"


def _flags(fit: VehicleFit) -> str:
    flags = {} if fit.trust is None else fit.trust.flags
    if not flags:
        return "The fit found no nonlinear effect in the car."
    return " ".join(flags.values())


def _fit_tables(study: VehicleValidation) -> list[ResultTable]:
    found = [certainty_table(study.fit)] if study.fit.trust is not None and study.fit.trust.outputs else []
    return found if tables.friction_table(study).rows else [*found, port_table(study.fit)]


def _orders(fit: VehicleFit) -> Iterator[Figure]:
    if fit.trust is not None and fit.trust.orders is not None:
        yield order_figure(fit.trust.orders)


def _placed(section: Section, figures: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a section for the template; its figures are added to the page's list and referred to by index."""
    identifier, heading, text, found, drawn = section
    places = [(len(figures) + k, figure.caption, figure.height) for k, figure in enumerate(drawn)]
    figures += [figure.content() for figure in drawn]
    return {"id": identifier, "heading": heading, "text": text, "tables": found, "figures": places}


_TRENDS = (
    "A setup study needs the order of setups and their differences more than their levels. A level error that is the "
    "same for all records leaves the rank correlation at 1. The error without the common level is the largest error of "
    "a record's RMS relative to the mean of all records. Records with different drives also differ by their roads."
)
_MODES = "Oscillating modes around the baseline damping. The MAC is computed over the outputs that both cars have."
