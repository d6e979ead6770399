"""The comparison of engines as a Markdown table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Row = dict[str, Any]

HEAD = (
    "engine", "scheme", "damping", "rate [Hz]", "us per step", "ms per second", "shock velocity [%]", "tire force [%]",
)  # fmt: skip


def markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a table; errors are of the worst corner."""
    lines = [f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}"]
    return "\n".join([*lines, *(f"| {' | '.join(_cells(row))} |" for row in rows)])


def _cells(row: Row) -> list[str]:
    rate, cost = row["rate_hz"], row["us_per_step"]
    second = None if None in (rate, cost) else 1e-3 * rate * cost
    errors = [row["error_velocity_percent"], row["error_tire_force_percent"]]
    said = ["diverges"] * 2 if None in errors else [number(error) for error in errors]
    return [row["engine"], row["scheme"], row["damping"], number(rate, 4), number(cost), number(second), *said]


def number(value: float | None, digits: int = 3) -> str:
    """Return a number as text with a few significant digits."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"
