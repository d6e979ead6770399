"""Summary of the comparison of engines: cost for the same scheme, and cost at the same accuracy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from math import exp, log
from typing import Any

from benchmarks.table import number

Row = dict[str, Any]

OURS = "eightpost"
SCHEME, RATE = "jacobi, held", 1000.0
#: Error of the tire force at which costs are compared [%].
TARGET = 0.2


@dataclass(frozen=True)
class Reach:
    """Rate [Hz] and cost of a second of simulation [ms] at which an engine reaches the target error."""

    engine: str
    scheme: str
    rate: float
    cost: float
    extrapolated: bool


def summary(rows: Sequence[Row]) -> str:
    """Return the comparisons as Markdown, with all damping in the shocks."""
    full = [row for row in rows if row["damping"] == "full"]
    return "\n".join([*_equal_scheme(full), "", *_equal_accuracy(full)])


def _equal_scheme(rows: Sequence[Row]) -> Iterator[str]:
    costs = {
        row["engine"]: row["us_per_step"]
        for row in rows
        if (row["scheme"], row["rate_hz"]) == (SCHEME, RATE) and row["us_per_step"] is not None
    }
    if OURS not in costs:
        return
    yield f"With the same scheme ({SCHEME}, {RATE:g} Hz, full damping), us per coupling step:"
    yield ""
    yield "| engine | us per step | times ours |"
    yield "|---|---|---|"
    for engine, cost in costs.items():
        yield f"| {engine} | {number(cost)} | {number(cost / costs[OURS])} |"


def _equal_accuracy(rows: Sequence[Row]) -> Iterator[str]:
    found = sorted(reaches(rows), key=lambda one: one.cost)
    if not found:
        return
    own = [one for one in found if one.engine == OURS]
    least = (own or found)[0].cost
    yield f"At the same accuracy ({TARGET:g} % of tire force, full damping), ms of computing per second of simulation:"
    yield ""
    yield (
        "| engine | scheme | rate [Hz] | ms per second | times eightpost's minimum |"
        if own
        else "| engine | scheme | rate [Hz] | ms per second | times the minimum |"
    )
    yield "|---|---|---|---|---|"
    for one in found:
        mark = " (extrapolated with its measured order)" if one.extrapolated else ""
        sign = "about " if one.extrapolated else ""
        costs = [f"{sign}{number(cost)}" for cost in (one.cost, one.cost / least)]
        cells = [one.engine, one.scheme, f"{one.rate:.0f}{mark}", *costs]
        yield f"| {' | '.join(cells)} |"


def reaches(rows: Sequence[Row]) -> Iterator[Reach]:
    """Yield the rate and cost at which each engine and scheme reaches the target, if its error falls with the rate."""
    usable = [row for row in rows if None not in (row["error_tire_force_percent"], row["us_per_step"])]
    key = _engine_and_scheme
    for (engine, scheme), group in groupby(sorted(usable, key=key), key=key):
        points = sorted((row["rate_hz"], row["error_tire_force_percent"], row["us_per_step"]) for row in group)
        if found := _reach(points):
            yield Reach(engine, scheme, *found)


def _engine_and_scheme(row: Row) -> tuple[str, str]:
    # Each tolerance of the adaptive scheme gives one point.
    scheme = row["scheme"]
    return row["engine"], "adaptive" if scheme.startswith("adaptive") else scheme


def _reach(points: Sequence[tuple[float, float, float]]) -> tuple[float, float, bool] | None:
    """Return rate, cost of a second and whether extrapolated, by linear interpolation of logarithms."""
    if points[0][1] <= TARGET:
        rate, _, cost = points[0]
        return rate, 1e-3 * rate * cost, False
    if len(points) < 2:
        return None
    pairs = list(pairwise(points))
    inside = [pair for pair in pairs if pair[0][1] > TARGET >= pair[1][1]]
    low, high = (inside or pairs[-1:])[0]
    if high[1] >= low[1]:
        return None
    share = log(low[1] / TARGET) / log(low[1] / high[1])
    rate = low[0] * exp(share * log(high[0] / low[0]))
    cost = low[2] * exp(min(share, 1.0) * log(high[2] / low[2]))
    return rate, 1e-3 * rate * cost, not inside
