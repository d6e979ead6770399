"""Table of sensitivities, with one row per term and builds, for other programs and for plots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from cosim.study.choice.sensitivity import Sensitivity
from eightpost.files import atomic_path

_COLUMNS = pa.schema(
    [
        ("measure", pa.string()),
        ("unit", pa.string()),
        ("first", pa.string()),
        ("second", pa.string()),
        ("first_build", pa.string()),
        ("second_build", pa.string()),
        ("effect", pa.float64()),
        ("share", pa.float64()),
        ("method", pa.string()),
    ]
)


def terms_table(sensitivities: Sequence[Sensitivity], units: Mapping[str, str]) -> pa.Table:
    """Return a table of all terms of all measures.

    Columns: `measure`, its SI `unit`, the factors `first` and `second` (empty for a main effect) and their builds, the
    `effect` [unit] of these builds, the `share` of the variance [1] of the term, and the `method`.

    Args:
        sensitivities: Sensitivities of the measures.
        units: SI units by measure.
    """
    rows = [row for one in sensitivities for row in _rows(one, units[one.measure])]
    return pa.Table.from_pylist(rows, schema=_COLUMNS)


def write_terms(sensitivities: Sequence[Sensitivity], units: Mapping[str, str], path: str | Path) -> None:
    """Write `terms_table` as a Parquet file."""
    with atomic_path(path) as temporary:
        pyarrow.parquet.write_table(terms_table(sensitivities, units), temporary, compression="zstd")


def _rows(sensitivity: Sensitivity, unit: str) -> Iterator[dict[str, Any]]:
    builds = {factor.name: factor.builds for factor in sensitivity.factors}
    common = {"measure": sensitivity.measure, "unit": unit, "method": sensitivity.method}
    for name, effects in sensitivity.main.items():
        term = common | {"first": name, "second": "", "second_build": "", "share": sensitivity.share(name)}
        for build, effect in zip(builds[name], effects.tolist(), strict=True):
            yield term | {"first_build": build, "effect": effect}
    for (first, second), effects in sensitivity.pairs.items():
        term = common | {"first": first, "second": second, "share": sensitivity.share(first, second)}
        for build, row in zip(builds[first], effects.tolist(), strict=True):
            for other, effect in zip(builds[second], row, strict=True):
                yield term | {"first_build": build, "second_build": other, "effect": effect}
