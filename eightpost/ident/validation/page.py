"""report.html: one validation as a self-contained file, for the screen and for printing."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

from eightpost import __version__
from eightpost.files import atomic_path
from eightpost.ident.validation.figures import bump_figure, overlay, random_figure, sine_figures, static_figure
from eightpost.ident.validation.record import SOURCE
from eightpost.ident.validation.tables import (
    Amount,
    bump_table,
    field_factor,
    field_unit,
    loop_table,
    peak_table,
    random_table,
    shown,
    sine_groups,
    sine_table,
    static_table,
    table_3_4,
    table_3_5,
)
from eightpost.ident.validation.verdict import notes_on, validation_verdict
from eightpost.page import compressed, insert, plotly, template

if TYPE_CHECKING:
    from eightpost.ident.validation.figures import Figure
    from eightpost.ident.validation.study import ValidationStudy
    from eightpost.ident.validation.tables import Cell, ResultTable

_PACKAGE = "eightpost.ident.validation"

_UNITS = ("N", "m", "m/s", "N/m", "J", "N2/Hz")


def write_validation_report(
    path: str | Path, study: ValidationStudy, *, limit: float | None = None, title: str = "Shock validation"
) -> Path:
    """Write a validation as an interactive page; an existing file is replaced only when the new one is complete.

    Args:
        path: File to write, such as out/report.html.
        study: Validation to show.
        limit: Maximum error [percent of standard deviation], for the verdict.
        title: Heading of the page.

    Returns:
        Path of the written file.
    """
    path = Path(path)
    content = page(study, limit=limit, title=title)
    with atomic_path(path) as temporary:
        temporary.write_text(content, encoding="utf-8")
    return path


def page(study: ValidationStudy, *, limit: float | None, title: str) -> str:
    """Return the page's HTML; names of shocks, records and files are escaped."""
    figures: list[dict[str, Any]] = []
    sections = [_placed(section, figures) for section in _sections(study)]
    content = {"figures": figures, "units": {unit: [field_factor(unit), field_unit(unit)] for unit in _UNITS}}
    return template(_PACKAGE, {"cell": cell, "unit": unit, "caption": caption}).render(
        title=title,
        verdict=validation_verdict(study, limit),
        notes=notes_on(study),
        sections=sections,
        tables=(table_3_5(study), table_3_4(study)),
        named=any(record.configuration for record in study.records),
        study=study,
        source=SOURCE,
        version=__version__,
        written=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        figures=compressed(json.dumps(content, allow_nan=False, separators=(",", ":")).encode()),
        plotly=plotly(),
        style=insert(_PACKAGE, "page.css"),
        script=insert(_PACKAGE, "page.js"),
    )


def _sections(study: ValidationStudy) -> Iterator[tuple[str, str, list[ResultTable], list[Figure]]]:
    """Yield identifier, heading, tables and figures of each kind of record in the study."""
    random, static, bump = (study.of_kind(kind) for kind in ("random", "static", "bump"))
    if random:
        yield "random", "Random records", [random_table(study)], [random_figure(*found) for found in random]
    groups = sine_groups(study)
    if groups:
        tables, figures = [], []
        for rows in groups.values():
            tables += [sine_table(rows), loop_table(rows), peak_table(rows)]
            figures += list(sine_figures(rows))
        yield "sine", "Sine records", tables, figures
    if static:
        drawn = [static_figure(*found) for found in static]
        yield (
            "static",
            "Static records",
            [static_table(study)],
            [*([overlay(static)] if len(static) > 1 else []), *drawn],
        )
    if bump:
        yield "bump", "Bump records", [bump_table(study)], [bump_figure(*found) for found in bump]


def _placed(section: tuple[str, str, list[ResultTable], list[Figure]], figures: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a section for the template; its figures are appended to those of the page and referenced by index."""
    identifier, heading, tables, drawn = section
    places = [(len(figures) + k, figure.caption, figure.height) for k, figure in enumerate(drawn)]
    figures += [figure.content() for figure in drawn]
    return {"id": identifier, "heading": heading, "tables": tables, "figures": places}


def cell(value: Cell) -> Markup:
    """Return a cell's content: text, or an amount in both unit systems."""
    if not isinstance(value, Amount):
        return escape(value)
    field, si = (_minus(shown(v, value.digits)) for v in (field_factor(value.unit) * value.value, value.value))
    return Markup(field) if field == si else _both(field, si)


def unit(si: str) -> Markup:
    """Return a unit in both systems."""
    return _both(field_unit(si), si) if field_unit(si) != si else escape(si)


def caption(text: str) -> Markup:
    """Return a caption with the units in braces shown in both systems."""
    return Markup(escape(text).replace("{N}", unit("N")))


def _both(field: str, si: str) -> Markup:
    return Markup('<span class="us">{}</span><span class="si">{}</span>').format(field, si)


def _minus(text: str) -> str:
    return text.replace("-", "−")
