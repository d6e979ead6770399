"""Controls of a page: a slider for each quantity that its reader can change."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from builder.documents.reference import SECRET
from builder.fmu.interface import Interface, Variable
from eightpost import units

#: Range of the slider of a parameter that is not 0: this factor below and above its value, on a logarithmic scale.
_FACTOR = 5.0

#: Highest value of the slider of a parameter that is 0, by its unit: about a stock car's shock.
_FROM_ZERO = {"N": 500.0, "N/m": 20_000.0}


@dataclass(frozen=True)
class Control:
    """A slider."""

    name: str  #: Name of the quantity, which is a variable of the shock's FMU if it is a parameter of it.
    text: str  #: Description.
    unit: str  #: SI unit.
    us: tuple[str, float]  #: US customary unit, and the factor from SI.
    si: tuple[str, float]  #: Metric unit, and the factor from SI.
    low: float  #: Lowest value, SI.
    high: float  #: Highest value, SI.
    start: float  #: Value at the start, SI.
    is_logarithmic: bool  #: Whether equal distances on the slider are equal ratios.

    @classmethod
    def of(
        cls,
        name: str,
        text: str,
        unit: str,
        limits: tuple[float, float],
        start: float,
        *,
        shown: tuple[str, str] | None = None,
    ) -> Control:
        """Return a control.

        Args:
            name: Name of the quantity.
            text: Description.
            unit: SI unit.
            limits: Lowest and highest value, SI; the slider is logarithmic if the lowest is above 0.
            start: Value at the start, SI.
            shown: US customary and metric unit; by default, those of the project's display units.
        """
        us, si = shown or (units.us_customary(unit), units.metric(unit))
        return cls(name, text, unit, (us, _factor(unit, us)), (si, _factor(unit, si)), *limits, start, limits[0] > 0.0)


def _factor(unit: str, shown: str) -> float:
    return 1.0 if unit == shown else units.conversion(unit, shown)[0]


#: The motion of the dynamometer: a sine with a peak velocity.
DYNAMOMETER = (
    Control.of("peak velocity", "Peak velocity of the sine", "m/s", (0.01, 2.0), 0.25),
    Control.of("frequency", "Frequency of the sine", "Hz", (0.2, 30.0), 4.0),
)

#: The bump: a raised cosine that the quarter car drives over.
BUMP = (
    Control.of("height", "Height of the bump", "m", (0.0, 0.1), 0.025),
    Control.of("length", "Length of the bump", "m", (0.2, 10.0), 1.5, shown=("ft", "m")),
    Control.of("speed", "Speed of the car", "m/s", (3.0, 90.0), 30.0, shown=("mph", "km/h")),
)


def shock_controls(interface: Interface) -> tuple[Control, ...]:
    """Return a control for each parameter of a shock that may be changed at any time, except those of its curve."""
    return tuple(_controls(interface))


def to_json(controls: tuple[Control, ...]) -> list[dict[str, Any]]:
    """Return controls as JSON objects."""
    return [asdict(control) for control in controls]


def _controls(interface: Interface) -> Iterator[Control]:
    for variable in interface.variables:
        is_tunable = variable.causality == "parameter" and variable.variability == "tunable"
        if is_tunable and variable.type == "Real" and not variable.name.startswith(SECRET):
            start = float(variable.start or 0.0)
            yield Control.of(variable.name, variable.description, variable.unit or "1", _limits(variable, start), start)


def _limits(variable: Variable, start: float) -> tuple[float, float]:
    """Return the range of a parameter's slider, within the range that the FMU accepts."""
    if start > 0.0:
        low, high = start / _FACTOR, start * _FACTOR
    else:
        high = _FROM_ZERO.get(variable.unit or "1", 1.0)
        low = start if start == 0.0 else -high
    least = low if variable.minimum is None else variable.minimum
    most = high if variable.maximum is None else variable.maximum
    return max(low, least), min(high, most)
