"""Tables of a validation of shocks, for the terminal and the page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from eightpost.ident.validation.bump import BumpValidation
from eightpost.ident.validation.evaluation import RandomValidation
from eightpost.ident.validation.shocks import ShockCase, ShockValidation, names_of
from eightpost.ident.validation.static import StaticValidation
from eightpost.report.tables import ResultTable

_Outcome = TypeVar("_Outcome", RandomValidation, StaticValidation, BumpValidation)


def random_table(study: ShockValidation) -> ResultTable:
    """Return the errors on the random records (Table 3.5, with percentages as in Table 3.4)."""
    columns = ("record", "shock", "RMS error [N]", "% of std", "% less than static", "offset [N] .2",
               "beyond fit, % .2", "coherent, % .2")  # fmt: skip
    rows = (
        (case.record.name, case.label, found.rms, found.percent, _reduction(case, study.of_record(case.record)),
         found.prediction.offset, 100.0 * found.beyond, 100.0 * found.residual.share if found.residual else None)
        for case, found in _outcomes(study, RandomValidation)
    )  # fmt: skip
    return ResultTable.of("Random records", columns, rows)


def terminal_tables(study: ShockValidation) -> tuple[ResultTable, ...]:
    """Return the tables for a terminal; tables of kinds that have no record are empty."""
    sines = (sine_table(rows) for rows in sine_groups(study))
    return random_table(study), *sines, static_table(study), bump_table(study)


def sine_groups(study: ShockValidation) -> tuple[list[tuple[ShockCase, ...]], ...]:
    """Return the cases of each sine record by its shocks; the largest first, then the slowest."""
    groups: dict[tuple[str, ...], list[tuple[ShockCase, ...]]] = {}
    for _, cases in study.of_kind("sine"):
        groups.setdefault(tuple(case.label for case in cases), []).append(cases)
    for rows in groups.values():
        rows.sort(key=lambda cases: (-round(cases[0].sine.amplitude, 4), cases[0].sine.speed))
    return tuple(groups.values())


def sine_table(rows: list[tuple[ShockCase, ...]]) -> ResultTable:
    """Return the error at each amplitude and velocity (Table 3.3, Fig 3.20), for each shock."""
    columns = ["record", "amplitude [m] .2", "peak speed [m/s]", "frequency, Hz"]
    columns += [head for name in names_of(rows[0]) for head in (f"{name}: RMS [N]", "% of std")]
    body = (
        (cases[0].record.name, first.amplitude, first.speed, first.frequency,
         *(figure for case in cases for figure in (case.outcome.rms, case.outcome.percent)))
        for cases in rows for first in [cases[0].sine]
    )  # fmt: skip
    return ResultTable.of(f"Sines of {_dampers(rows)}: error", columns, body)


def loop_tables(rows: list[tuple[ShockCase, ...]]) -> Iterator[ResultTable]:
    """Yield hysteresis and energy of each loop, and its peak forces, measured and by each shock."""
    hysteresis = {"hysteresis": ("hysteresis", "N"), "energy": ("energy per period", "J")}
    peaks = {"compression_peak": ("peak in compression", "N"), "rebound_peak": ("peak in rebound", "N")}
    for title, figures in (("hysteresis and energy", hysteresis), ("peak forces", peaks)):
        columns = ["record"]
        for name, unit in figures.values():
            columns += [f"{name}: measured [{unit}]", *(f"{law} [{unit}]" for law in names_of(rows[0]))]
        body = []
        for cases in rows:
            loops = [cases[0].sine.measured, *(case.sine.predicted for case in cases)]
            body.append((cases[0].record.name, *(getattr(loop, figure) for figure in figures for loop in loops)))
        yield ResultTable.of(f"Sines of {_dampers(rows)}: {title}", columns, body)


def static_table(study: ShockValidation) -> ResultTable:
    """Return rates and drag of the static records (3.4.3)."""
    columns = ("record", "holds .1", "rate in compression [N/m]", "in rebound [N/m]", "gas rate [N/m]",
               "hysteresis [N]", "seal drag [N]", "shock", "predicted gas rate [N/m]", "RMS error [N]")  # fmt: skip
    rows = (
        (case.record.name, len(found.holds), found.compression_rate, found.rebound_rate, found.gas_rate,
         found.hysteresis, found.seal_drag, case.label, found.predicted_rate, found.rms)
        for case, found in _outcomes(study, StaticValidation)
    )  # fmt: skip
    return ResultTable.of("Static records", columns, rows)


def bump_table(study: ShockValidation) -> ResultTable:
    """Return peak forces and errors of the bumps (3.4.4)."""
    columns = ("record", "at, s", "speed [m/s]", "measured peak [N]", "shock", "predicted peak [N]",
               "peak error, % .2", "RMS error [N]", "all events: % of std")  # fmt: skip
    rows = (
        (case.record.name, event.start, event.speed, event.measured_peak, case.label, event.predicted_peak,
         event.peak_error, event.rms, found.percent)
        for case, found in _outcomes(study, BumpValidation) for event in found.events
    )  # fmt: skip
    return ResultTable.of("Bump records", columns, rows)


def _outcomes(study: ShockValidation, kind: type[_Outcome]) -> Iterator[tuple[ShockCase, _Outcome]]:
    return ((case, case.outcome) for case in study.cases if isinstance(case.outcome, kind))


def _dampers(rows: list[tuple[ShockCase, ...]]) -> str:
    return ", ".join(dict.fromkeys(case.shock.name for case in rows[0]))


def _reduction(case: ShockCase, cases: tuple[ShockCase, ...]) -> float | None:
    """Return the reduction of a case's error from that of the static curve of the same shock [percent]."""
    static = [c for c in cases if c.shock.law_name == "polylinear" and c.shock.name == case.shock.name]
    if not static or case.shock.law_name == "polylinear":
        return None
    return 100.0 * (1.0 - case.outcome.rms / static[0].outcome.rms)
