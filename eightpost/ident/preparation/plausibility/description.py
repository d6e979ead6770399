"""Descriptions of faults: what a gain or a delay of a channel means, and what to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eightpost.ident.preparation.plausibility.attribution import Attribution, Fault
from eightpost.ident.preparation.plausibility.comparison import Comparison, Kind
from eightpost.ident.preparation.plausibility.finding import Finding
from eightpost.ident.preparation.plausibility.rules import CONTRADICTION, WRONG_DELAY, WRONG_SCALE
from eightpost.units import convert

#: Relative tolerance of a gain that is a ratio of two units.
UNIT_TOLERANCE = 0.08

_POUND, _INCH, _GRAVITY = convert(1.0, "lbf", "N"), convert(1.0, "in", "mm"), convert(1.0, "g_0", "m/s2")

#: Unit of a column and unit in which it is read, by kind of quantity and gain.
_UNITS = {
    "force": {_POUND: ("N", "lbf"), 1.0 / _POUND: ("lbf", "N"), 1000.0: ("N", "kN"), 1e-3: ("kN", "N")},
    "acceleration": {_GRAVITY: ("m/s2", "g_0"), 1.0 / _GRAVITY: ("g_0", "m/s2")},
    "length": {_INCH: ("mm", "in"), 1.0 / _INCH: ("in", "mm"), 1000.0: ("mm", "m"), 1e-3: ("m", "mm")},
    "velocity": {
        _INCH: ("mm/s", "in/s"),
        1.0 / _INCH: ("in/s", "mm/s"),
        1000.0: ("mm/s", "m/s"),
        1e-3: ("m/s", "mm/s"),
    },
}


def findings_of(attribution: Attribution) -> tuple[Finding, ...]:
    """Return the findings of an attribution."""
    faults = tuple(_of_gain(f) if f.kind is Kind.GAIN else _of_delay(f) for f in attribution.faults)
    return (*faults, *_contradictions(attribution.unexplained))


def _of_gain(fault: Fault) -> Finding:
    gain = float(np.exp(fault.value))
    spread = gain * 2.0 * fault.deviation
    text = (
        f"{_subject(fault)} {_verb(fault)} {gain:.3g} times (+-{spread:.2g}) what {fault.law} expects{_rivals(fault)}"
    )
    return Finding(WRONG_SCALE, fault.channels, text, _unit_remedy(fault, gain))


def _of_delay(fault: Fault) -> Finding:
    late = "late" if fault.value > 0.0 else "early"
    size, spread = 1e3 * abs(fault.value), 2e3 * fault.deviation
    text = f"{_subject(fault)} {_verb(fault)} {size:.1f} ms (+-{spread:.1f} ms) {late} by {fault.law}{_rivals(fault)}"
    remedy = (
        f"if its logger or filter explains that, give a delay of {fault.value:.5f} s in [delays] "
        "(docs/how_to/rig_data.md)"
    )
    return Finding(WRONG_DELAY, fault.channels, text, remedy)


def _subject(fault: Fault) -> str:
    return fault.name if not fault.name.startswith("*.") else f"{fault.name[2:]} of all corners"


def _verb(fault: Fault) -> str:
    return "are" if fault.name.startswith("all ") else "is"


def _rivals(fault: Fault) -> str:
    return f" (unless {' or '.join(fault.others)} is wrong, which explains it as well)" if fault.others else ""


def _unit_remedy(fault: Fault, gain: float) -> str:
    units = _UNITS.get(_dimension(fault.channels), {})
    for known, (own, read) in units.items():
        if abs(gain / known - 1.0) < UNIT_TOLERANCE:
            return f"its unit is probably {own}, but it is read as {read}; give unit = '{own}' in the channel map"
    return "check its calibration and its unit"


def _dimension(channels: Sequence[str]) -> str:
    quantity = channels[0].rpartition(".")[2].removesuffix("_command")
    if quantity in ("tire_force", "force", "aero", "aero_force", "heave_force"):
        return "force"
    if quantity.endswith("acceleration"):
        return "acceleration"
    return "velocity" if quantity == "velocity" else "length"


def _contradictions(comparisons: Sequence[Comparison]) -> tuple[Finding, ...]:
    """Return one finding for each law that remains violated."""
    worst: dict[str, Comparison] = {}
    for one in comparisons:
        if one.law not in worst or abs(one.score) > abs(worst[one.law].score):
            worst[one.law] = one
    return tuple(_contradiction(one) for one in worst.values())


def _contradiction(one: Comparison) -> Finding:
    names = tuple(one.effect)
    if one.kind is Kind.GAIN:
        figure = f"a ratio is {np.exp(one.value):.3g} of its expected value (limit {np.exp(one.tolerance):.3g})"
    else:
        figure = f"a delay is {1e3 * one.value:.2g} ms (limit {1e3 * one.tolerance:.2g} ms)"
    text = f"{', '.join(names)} contradict {one.law}: {figure}, and no single channel explains it"
    return Finding(CONTRADICTION, names, text, CONTRADICTION.remedy)
