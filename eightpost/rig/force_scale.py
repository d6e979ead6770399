"""Whether a force can have the size that its unit gives it, from quantities that do not depend on the valving.

Pounds labelled N make every force 4.4 times too small, and a soft shock looks like that too. Two quantities of a
shock vary less than its damping: the diameter of its rod (from gas force and gas pressure), and its heat capacity (from
work and warming). Where a file has neither, only the user knows; `scale_statement` then says what to compare.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import pi, sqrt

import numpy as np

from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.plausibility_rules import UNLIKELY_UNITS
from eightpost.rig.rest_force import rest_force
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.verdict import Reason

#: One pound-force [N].
_LBF = convert(1.0, "lbf", "N")
#: Diameters [m] that a rod does not have although it carries a gas force: those of car and motorcycle shocks are 10 mm
#: to 25 mm. Below the first, gas force is not in the record (zeroed load cell, or a rod on both sides).
NO_ROD, THIN_ROD, THICK_ROD = 0.004, 0.008, 0.035
#: Relative difference from 4.45 of the ratio of the stated and the measured gas force.
GAS_TOLERANCE = 0.15
#: Number of standard errors of the force at standstill from which a gas force is used.
CLEAR = 6.0
#: Heat capacity [J/K] below which no damper of a car is: 0.4 kg of aluminium, without oil. A small one measured 530.
LOWEST_CAPACITY = 350.0
#: Minimum warming [K] that is compared with the work.
LOWEST_WARMING = 1.0
#: Share of a record at each end over which its temperature is averaged.
_END = 0.1


def force_scale_reasons(series: TimeSeries, conditions: DynoConditions, origin: str) -> Iterator[Reason]:
    """Yield a reason for each quantity that contradicts the unit of the force.

    Args:
        series: Record with `velocity` [m/s], `force` [N] and optionally `temperature` [K].
        conditions: Stated conditions; gas pressure and gas force are used.
        origin: Name of the record.
    """
    for figure in (_stated_gas_force(series, conditions), _rod(series, conditions), _heat(series)):
        if figure:
            yield UNLIKELY_UNITS.reason("the unit of the force is probably wrong", figure=figure, origin=origin)


def _gas_force(series: TimeSeries) -> float | None:
    """Return the force at standstill [N], if it is clearly above zero."""
    found = rest_force(series["velocity"], series["force"])
    return found[0] if found is not None and found[0] > CLEAR * found[1] else None


def _stated_gas_force(series: TimeSeries, conditions: DynoConditions) -> str:
    rest = _gas_force(series)
    if rest is None or not conditions.gas_force or conditions.gas_force <= 0.0:
        return ""
    ratio = conditions.gas_force / rest
    for factor, hint in ((_LBF, "lbf labelled N"), (1.0 / _LBF, "N labelled lbf")):
        if abs(ratio / factor - 1.0) < GAS_TOLERANCE:
            return (
                f"{rest:.4g} N at standstill, but the stated gas force is {conditions.gas_force:.4g} N, {ratio:.3g} "
                f"times as much: {hint}"
            )
    return ""


def _rod(series: TimeSeries, conditions: DynoConditions) -> str:
    rest = _gas_force(series)
    if rest is None or not conditions.gas_pressure or conditions.gas_pressure <= 0.0:
        return ""
    diameter = sqrt(4.0 * rest / (pi * conditions.gas_pressure))
    if NO_ROD < diameter < THIN_ROD:
        factor, hint = _LBF, "lbf labelled N"
    elif diameter > THICK_ROD:
        factor, hint = 1.0 / _LBF, "N labelled lbf"
    else:
        return ""
    return (
        f"{rest:.4g} N at standstill under the stated {1e-5 * conditions.gas_pressure:.3g} bar is a rod of "
        f"{1e3 * diameter:.3g} mm; usual are 10 to 25 mm, and {hint} would be {1e3 * diameter * sqrt(factor):.3g} mm"
    )


def _heat(series: TimeSeries) -> str:
    if "temperature" not in series:
        return ""
    temperature = series["temperature"]
    count = max(1, round(_END * temperature.size))
    warming = float(temperature[-count:].mean() - temperature[:count].mean()) / (1.0 - _END)
    if warming < LOWEST_WARMING:
        return ""
    work = float(np.trapezoid(series["force"] * series["velocity"], series.time))
    capacity = work / warming
    if not 0.0 < capacity < LOWEST_CAPACITY:
        return ""
    return (
        f"{work:.4g} J of work warmed the shock by {warming:.3g} K, a heat capacity of {capacity:.3g} J/K; usual are "
        f"500 to 3000 J/K, and lbf labelled N would be {_LBF * capacity:.3g} J/K"
    )


# ---- What only the user knows ---------------------------------------------------------------------------------------


def scale_statement(series: TimeSeries) -> str:
    """Return the largest force, its velocity and the stroke, to compare with the test sheet."""
    force, velocity = series["force"], series["velocity"]
    peak = int(np.abs(force).argmax())
    stroke = f", stroke {1e3 * np.ptp(series['displacement']):.3g} mm" if "displacement" in series else ""
    return (
        f"peak force {force[peak]:.4g} N at {velocity[peak]:.3g} m/s{stroke}: the file does not show whether its units "
        "are right. If this is not your shock, set them in a channel map, such as unit = 'lbf' "
        "(docs/reference/signs_and_units.md)"
    )
