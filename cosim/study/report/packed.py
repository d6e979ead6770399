"""Data of the page's script: a manifest, and the numbers as compressed bytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from cosim.report.packing import Store
from cosim.report.traces import CAPACITY, traces
from cosim.study.choice.sensitivity import Sensitivity
from cosim.study.report.colors import build_colors
from cosim.study.report.scale import Scale
from cosim.study.report.sheet import Array, Column, Sheet, Uncertainty
from eightpost.signals import TimeSeries


def packed(
    sheet: Sheet, recorded: Mapping[int, TimeSeries], terms: Sequence[Sensitivity], picked: Sequence[int]
) -> tuple[dict[str, Any], str]:
    """Return the manifest, which states where each number is stored, and the numbers.

    Args:
        sheet: Report data.
        recorded: Time traces by setup number.
        terms: Sensitivities of some measures.
        picked: Rows that are picked when the page opens.
    """
    store = Store()
    order, done = sheet.order, int(sheet.done.sum())
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
        "columns": [_column(store, column) for column in shown_columns(sheet)],
        "failures": sheet.failures,
        "marks": sheet.marks,
        "baseline": sheet.baseline,
        "best": int(order[0]) if done else None,
        "picked": list(picked),
        "traces": dict(_traces(store, recorded)),
        "trace_command": sheet.background.trace_command,
        "sensitivities": list(_sensitivities(sheet, terms)),
    }
    return manifest, store.text


def shown_columns(sheet: Sheet) -> tuple[Column, ...]:
    """Return the objective, if there is one, and the measures."""
    return (*((sheet.objective,) if sheet.objective else ()), *sheet.measures)


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
        "spread": store.add(uncertainty.spread),
        "best": store.add(uncertainty.from_best),
        "baseline": store.add(uncertainty.from_baseline),
        "tied": store.add(uncertainty.tied.astype(float)),
        "ties": int(uncertainty.tied.sum()),
    }


def _traces(store: Store, recorded: Mapping[int, TimeSeries]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield traces by setup number; each setup gets an equal share of the page's capacity."""
    for number, series in recorded.items():
        kept = traces(series, capacity=CAPACITY // len(recorded))
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
