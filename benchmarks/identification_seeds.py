"""Worst value and median of every figure of a method over noise seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

Row = dict[str, Any]

#: Figures for which a smaller value is worse.
_MORE_IS_BETTER = ("spearman_min", "kendall_min")


def over_seeds(rows: Sequence[Row]) -> tuple[Row, Row]:
    """Return the worst and the median row; figures that are missing for one seed, which failed, are omitted.

    Args:
        rows: Rows of one case and method, one per seed.
    """
    return _over(rows, "worst", _worst), _over(rows, "median", lambda _, values: median(values))


def _over(rows: Sequence[Row], word: str, reduce: Callable[[str, list[float]], float]) -> Row:
    found: Row = {key: rows[0][key] for key in ("case", "method", "setups")} | {"seeds": f"{len(rows)}, {word}"}
    for key in dict.fromkeys(key for row in rows for key in row if key not in found):
        values = [float(row[key]) for row in rows if row.get(key) is not None]
        found[key] = reduce(key, values) if len(values) == len(rows) else None
    return found


def _worst(key: str, values: list[float]) -> float:
    return min(values) if key in _MORE_IS_BETTER else max(values)
