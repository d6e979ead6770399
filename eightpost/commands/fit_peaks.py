"""`eightpost fit` of a peak-velocity table: forces over speeds, a shock for each setting of the adjusters."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from eightpost.commands.show_verdict import show_verdict
from eightpost.errors import InputError
from eightpost.ident import fit_peak_velocity, plot_peak_velocity
from eightpost.rig import PeakVelocityTable, read_peak_velocity
from eightpost.rig.peak_velocity_file import is_peak_velocity
from eightpost.shock import Shock, write_shock
from eightpost.signals import read_records
from eightpost.verdict import Verdict

_TEXT = (".csv", ".txt", ".tsv")


def peak_tables(files: Sequence[Path], units: Mapping[str, str]) -> tuple[PeakVelocityTable, ...]:
    """Return the tables of a peak-velocity file; empty if the files are records over time.

    Raises:
        InputError: A peak-velocity file is given together with other files.
    """
    tables = [path for path in files if path.suffix.lower() in _TEXT and is_peak_velocity(read_records(path)[0])]
    if tables and len(files) > 1:
        raise InputError(f"{tables[0]} is a peak-velocity table: fit it alone")
    return read_peak_velocity(tables[0], units=units) if tables else ()


def fit_peak_tables(
    console: Console, tables: Sequence[PeakVelocityTable], output: Path, *, name: str | None, build: str | None
) -> Verdict:
    """Fit and write a shock for each table, print the deviation of each curve from its points, and draw them.

    Returns:
        The verdict on all shocks.
    """
    shocks, paths = list[tuple[PeakVelocityTable, Shock]](), list[Path]()
    for table in tables:
        several = len(tables) > 1
        shock = _named(fit_peak_velocity(table, name=name), table.clicks if several else None, build)
        path = output.with_stem(f"{output.stem}_{_slug(table.clicks)}") if several else output
        _show(console, table, shock)
        write_shock(shock, path)
        shocks.append((table, shock))
        paths.append(path)
    picture = output.with_suffix(".png")
    plot_peak_velocity(shocks, picture)
    console.print(f"wrote {', '.join(map(str, [*paths, picture]))}", soft_wrap=True, highlight=False)
    return Verdict.combined(shock.validity.verdict for _, shock in shocks if shock.validity)


def refuse_dynamics(ctx: click.Context, law: str) -> None:
    """Refuse a law with dynamics if --law names one: such a table has no information on them."""
    is_given = ctx.get_parameter_source("law") != click.core.ParameterSource.DEFAULT
    if is_given and law != "polylinear":
        raise InputError(
            f"a peak-velocity table has forces over speeds and no information on lag, which {law} has: omit --law, "
            "or use --law polylinear"
        )


def _named(shock: Shock, clicks: str | None, build: str | None) -> Shock:
    conditions = dict(shock.conditions) | ({"build": build} if build else {})
    return replace(shock, name=f"{shock.name} {clicks}" if clicks else shock.name, conditions=conditions)


def _slug(clicks: str | None) -> str:
    return re.sub(r"[^A-Za-z0-9.+-]+", "_", clicks or "").strip("_") or "setting"


def _show(console: Console, table: PeakVelocityTable, shock: Shock) -> None:
    fit = shock.fit or {}
    console.print(
        f"{escape(shock.name)}: {len(table)} speeds on each side, up to {table.speed[-1]:.4g} m/s; the curve deviates "
        f"from its points by at most {fit['greatest_error_at_points [N]']:.3g} N, {fit['rms [N]']:.3g} N RMS",
        soft_wrap=True,
        highlight=False,
    )
    for change in fit["changes"]:
        console.print(f"[yellow]changed[/] {escape(change)}", highlight=False)
    if shock.validity is not None:
        show_verdict(console, shock.validity.verdict)
