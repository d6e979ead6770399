"""Data of a study's page, packed for its script."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from cosim.study.choice.sensitivity import Sensitivity
from cosim.study.report.answer import chance, tied
from cosim.study.report.sheet import Column, Extras, Scale, Sheet, Uncertainty, build_colors, shown_columns
from cosim.study.report.shock_pages import ShockCurve
from eightpost.array_types import Array
from eightpost.report.packing import TRACES_CAPACITY, Store, spectra, traces
from eightpost.signals import TimeSeries

#: Highest frequency of the spectra of the page [Hz].
_HIGHEST = 60.0


def packed(sheet: Sheet, extras: Extras, picked: Sequence[int]) -> tuple[dict[str, Any], str]:
    """Return the manifest, which states where each number is stored, and the numbers.

    Args:
        sheet: Report data.
        extras: Optional content.
        picked: Rows that are picked when the page opens.
    """
    store = Store()
    order, done = sheet.order, int(sheet.done.sum())
    place = {column.name: k for k, column in enumerate(shown_columns(sheet))}
    manifest = {
        "setups": sheet.numbers.size,
        "done": done,
        "corners": sheet.corners,
        "builds": sheet.builds,
        "colors": build_colors(len(sheet.builds)),
        "numbers": store.add(sheet.numbers.astype(float)),
        "placed": [store.add(column) for column in sheet.placed.T.astype(float)],
        "rank": store.add(np.argsort(order).astype(float) + 1.0),
        "allowed": store.add(sheet.allowed.astype(float)),
        "error": store.add(sheet.coupling_error),
        "chance": _chance(store, sheet),
        "ties": tied(sheet),
        "columns": [_column(store, column) for column in shown_columns(sheet)],
        "objective": sheet.objective.name if sheet.objective else None,
        "terms": [{"column": place[one.measure], "weight": one.weight} | asdict(one.display) for one in sheet.terms],
        "bounds": [{"column": place[name]} | ends for name, ends in _limits(sheet).items()],
        "failures": sheet.failures,
        "marks": sheet.marks,
        "baseline": sheet.baseline,
        "best": int(order[0]) if done else None,
        "picked": list(picked),
        "traces": dict(_traces(store, extras.traces)),
        "trace_command": sheet.background.trace_command,
        "sensitivities": list(_sensitivities(sheet, extras.sensitivities)),
        "spectra": dict(_spectra(store, extras.traces)),
        "curves": {name: _curve(store, curve) for name, curve in extras.curves.items()},
        "force": _scale(Scale.of("N")),
        "velocity": _scale(Scale.of("m/s")),
        "pages": extras.shock_pages,
    }
    return manifest, store.text


def _chance(store: Store, sheet: Sheet) -> dict[str, Any] | None:
    """Return the probability of each setup of being the best, and its heading; None if it was not computed."""
    known = sheet.certainty
    if known is None or known.leader is None:
        return None
    return {"name": chance(known), "at": store.add(known.best)}


def _limits(sheet: Sheet) -> dict[str, dict[str, float | None]]:
    """Return the limits of the constraints by measure [SI]; None where there is no limit."""
    limits: dict[str, dict[str, float | None]] = {}
    for bound in sheet.background.constraints:
        ends = limits.setdefault(bound.measure, {"low": None, "high": None})
        ends["low" if bound.word == "at least" else "high"] = bound.value
    return limits


def _scale(scale: Scale) -> dict[str, Any]:
    return {"us": asdict(scale.us), "metric": asdict(scale.metric)}


def _column(store: Store, column: Column) -> dict[str, Any]:
    low, high = column.extremes
    return {
        "name": column.name,
        **_scale(column.scale),
        "low": low,
        "high": high,
        "better": column.better,
        "at": store.add(column.values),
        "uncertainty": column.uncertainty and _uncertainty(store, column.uncertainty),
    }


def _uncertainty(store: Store, uncertainty: Uncertainty) -> dict[str, Any]:
    return {
        "low": store.add(uncertainty.low),
        "high": store.add(uncertainty.high),
        "best": store.add(uncertainty.best),
        "tied": store.add(uncertainty.tied.astype(float)),
        "ties": int(uncertainty.tied.sum()),
    }


def _traces(store: Store, recorded: Mapping[int, TimeSeries]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield traces by setup number; each setup gets an equal share of the page's capacity."""
    for number, series in recorded.items():
        kept = traces(series, capacity=TRACES_CAPACITY // len(recorded))
        channels = [
            _channel(store, name, unit, values)
            for name, unit, values in zip(series.names, series.units, kept.values, strict=True)
        ]
        yield (
            number,
            {
                "at": store.add(kept.time),
                "count": kept.time.size,
                "from": float(kept.time[0]),
                "to": float(kept.time[-1]),
                "samples": kept.samples,
                "interval": kept.interval,
                "channels": channels,
            },
        )


def _spectra(store: Store, recorded: Mapping[int, TimeSeries]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the amplitude spectral densities of the traces by setup number, up to the highest frequency of interest."""
    for number, series in recorded.items():
        found = spectra(series)
        if found is None:
            continue
        kept = found.frequency <= _HIGHEST
        channels = [
            {"name": name, **_scale(Scale.of(unit)), "at": store.add_single(np.sqrt(density[kept]))}
            for name, unit, density in zip(series.names, series.units, found.density, strict=True)
        ]
        yield number, {"at": store.add_single(found.frequency[kept]), "count": int(kept.sum()), "channels": channels}


def _curve(store: Store, curve: ShockCurve) -> dict[str, Any]:
    return {"velocity": store.add(curve.velocity), "force": store.add(curve.force), "count": curve.velocity.size}


def _channel(store: Store, name: str, unit: str, values: Array) -> dict[str, Any]:
    return {
        "name": name,
        "quantity": name.rpartition(".")[2].replace("_", " "),
        **_scale(Scale.of(unit)),
        "low": float(values.min()),
        "high": float(values.max()),
        "at": store.add_levels(values),
    }


def _sensitivities(sheet: Sheet, terms: Sequence[Sensitivity]) -> Iterator[dict[str, Any]]:
    places = {column.name: k for k, column in enumerate(shown_columns(sheet))}
    for one in terms:
        if one.measure not in places:
            continue
        yield {
            "column": places[one.measure],
            "factors": [
                {"name": factor.name, "builds": factor.builds, "effect": one.main[factor.name].tolist()}
                for factor in one.factors
            ],
            "pairs": [
                {"names": pair, "effect": effect.tolist(), "share": one.share(*pair)}
                for pair, effect in one.pairs.items()
            ],
        }
