"""Errors of the shock laws as Markdown: Tables 3.4 and 3.5 next to the printed values, and measured records."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.printed_shocks import CONFIGURATIONS, TABLE_3_4, TABLE_3_4_CONFIGURATION, printed_configuration
from benchmarks.shock_records import LAWS
from benchmarks.shock_rows import FailedFit, FitErrors, Result
from benchmarks.table import number
from eightpost.shock import law_title
from eightpost.units import convert

#: Required gains over the static law [%], and required ratio of the errors of LPNL2 and LPF1.
LEAST_GAIN, MEAN_GAIN, MOST_RATIO = 35.0, 50.0, 1.005


def markdown(found: Sequence[Result]) -> str:
    """Return everything as Markdown."""
    parts = [rows_table(found)]
    if errors := virtual(found):
        parts += [table_3_4(found), table_3_5(errors), "\n".join(summary(errors))]
    return "\n\n".join(part for part in parts if part)


def rows_table(found: Sequence[Result]) -> str:
    """Return a line for each row, with additional columns that are not in the JSON."""
    heads = ("record", "law", "fit [%]", "held out [%]", "mean of the error [%]", "fit [s]")
    lines = []
    for one in found:
        if isinstance(one, FailedFit):
            lines.append([one.case.record, one.law, f"not fitted: {one.reason.partition(', and')[0]}", "-", "-", "-"])
            continue
        figures = (one.fit_percent, one.validation_percent, 100.0 * one.offset / one.deviation, one.seconds)
        lines.append([one.case.record, one.law, *(number(figure) for figure in figures)])
    return grid(heads, lines)


@dataclass(frozen=True, slots=True)
class Errors:
    """The errors of a configuration on the held-out draws."""

    configuration: int  #: Configuration number, 1 to 12.
    rms: dict[str, float]  #: RMS error by law over all draws [lbf].
    deviation: float  #: Standard deviation of the force [lbf].
    cavitates: bool  #: Whether the damper cavitates.

    def gain(self, law: str) -> float | None:
        """Return the reduction of a law's error relative to that of the static law [%]."""
        return less(self.rms, law)


def virtual(found: Sequence[Result]) -> list[Errors]:
    """Return the errors for the virtual dynamometer's configurations, combined over the draws."""
    kept = [one for one in found if isinstance(one, FitErrors) and one.case.configuration]
    errors = []
    for configuration in sorted({one.case.configuration for one in kept}):
        here = [one for one in kept if one.case.configuration == configuration]
        by_law = {law: [one for one in here if one.law == law] for law in dict.fromkeys(one.law for one in here)}
        rms = {law: _pounds([one.error for one in ones]) for law, ones in by_law.items()}
        deviation, cavitates = _pounds([one.deviation for one in here]), any(one.case.cavitates for one in here)
        errors.append(Errors(configuration, rms, deviation, cavitates))
    return errors


def table_3_4(found: Sequence[Result]) -> str:
    """Return the fits of the configuration of Table 3.4, next to the printed values."""
    heads = ("law", "fit, ours [lbf]", "printed", "% of std, ours", "printed", "less than static, ours [%]", "printed",
             "fit [s], ours", "printed")  # fmt: skip
    fits: dict[str, FitErrors] = {}
    for one in found:
        if isinstance(one, FitErrors) and one.case.configuration == TABLE_3_4_CONFIGURATION:
            fits.setdefault(one.law, one)
    rms = {law: _pounds([one.fit_rms]) for law, one in fits.items()}
    lines = []
    for law, one in fits.items():
        printed = TABLE_3_4.get(law)
        printed_values = (
            (printed.rms_lbf, printed.percent_of_deviation, printed.percent_less_than_static, printed.fit_seconds)
            if printed
            else (None,) * 4
        )
        ours = (rms[law], one.fit_percent, less(rms, law), one.seconds)
        pairs = [
            (number(mine), "-" if other is None else f"{other:g}")
            for mine, other in zip(ours, printed_values, strict=True)
        ]
        lines.append([law_title(law), *(cell for pair in pairs for cell in pair)])
    return grid(heads, lines) if lines else ""


def table_3_5(errors: Sequence[Errors]) -> str:
    """Return the errors on held-out draws [lbf], next to the values of Table 3.5."""
    laws = [law for law in LAWS if any(law in one.rms for one in errors)]
    heads = ["no.", "build, clicks, gas"]
    for law in laws:
        heads += [law_title(law), *(["printed"] if law in TABLE_3_4 else [])]
    lines = [[str(one.configuration), printed_configuration(one.configuration).title, *_cells(one, laws)]
             for one in errors]  # fmt: skip
    return grid(heads, lines)


def _cells(one: Errors, laws: Sequence[str]) -> Iterator[str]:
    printed = printed_configuration(one.configuration).rms_lbf
    for law in laws:
        yield number(one.rms.get(law))
        if law in TABLE_3_4:
            yield _as_printed(printed[law])


def gains_table(errors: Sequence[Errors]) -> str:
    """Return the gain of each dynamic law over the static law, and LPNL2 over LPF1, next to the printed values."""
    laws = [law for law in LAWS[1:] if any(law in one.rms for one in errors)]
    heads = ["no.", "force std [lbf]", "cavitates"]
    for law in laws:
        heads += [f"{law_title(law)} [%]", *(["printed"] if law in TABLE_3_4 else [])]
    heads += ["LPNL2 / LPF1", "printed"]
    lines = []
    for one in errors:
        printed = printed_configuration(one.configuration).rms_lbf
        line = [str(one.configuration), number(one.deviation), "yes" if one.cavitates else "no"]
        for law in laws:
            line += [number(one.gain(law)), *([number(less(printed, law))] if law in TABLE_3_4 else [])]
        ratio = one.rms["lpnl2"] / one.rms["lpf1"] if {"lpf1", "lpnl2"} <= set(one.rms) else None
        lines.append([*line, number(ratio), number(printed["lpnl2"] / printed["lpf1"])])
    return grid(heads, lines)


def summary(errors: Sequence[Errors]) -> Iterator[str]:
    """Yield a line for each requirement and the result."""
    for law in LAWS[1:]:
        gains = {one.configuration: gain for one in errors if (gain := one.gain(law)) is not None}
        if not gains:
            continue
        whole = [one.configuration for one in errors if not one.cavitates and one.configuration in gains]
        others = [value for c in CONFIGURATIONS if (value := less(c.rms_lbf, law)) is not None]
        printed = f"; printed: {min(others):.0f} to {max(others):.0f} %, mean {np.mean(others):.0f} %" if others else ""
        least = min((gains[c] for c in whole), default=float("nan"))
        yield (
            f"- {law_title(law)} is {min(gains.values()):.0f} to {max(gains.values()):.0f} % better than Polylinear, "
            f"mean {np.mean(list(gains.values())):.0f} % (required: {MEAN_GAIN:.0f} %); without the cavitating ones "
            f"at least {least:.0f} % (required: {LEAST_GAIN:.0f} %){printed}."
        )
    ratios = {
        one.configuration: one.rms["lpnl2"] / one.rms["lpf1"] for one in errors if {"lpf1", "lpnl2"} <= set(one.rms)
    }
    if ratios:
        worst = max(ratios, key=lambda c: ratios[c])
        yield (
            f"- LPNL2 over LPF1: {min(ratios.values()):.3f} to {ratios[worst]:.3f} (configuration {worst}); required: "
            f"at most {MOST_RATIO}."
        )


def less(errors: Mapping[str, float], law: str) -> float | None:
    """Return the reduction of a law's error relative to the static law [%]; None for the static law itself."""
    if law == "polylinear" or not {law, "polylinear"} <= set(errors):
        return None
    return 100.0 * (1.0 - errors[law] / errors["polylinear"])


def grid(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a table as Markdown."""
    rows = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}", *(f"| {' | '.join(line)} |" for line in lines)]
    return "\n".join(rows)


def _as_printed(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def _pounds(forces: Sequence[float]) -> float:
    return convert(float(np.sqrt(np.mean(np.square(forces)))), "N", "lbf")
