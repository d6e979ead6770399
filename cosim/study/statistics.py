"""Statistics that measures compute from their channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from eightpost.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Channels of a run as input to a statistic: filtered, restricted to the measure's window, weighted.

    Args:
        rows: Channels (C, N), each in its SI unit.
        step: Time between samples [s].
        options: Options of the statistic, in SI.
    """

    rows: Array
    step: float
    options: Mapping[str, float] = field(default_factory=dict)

    @property
    def total(self) -> Array:
        """Sum of the channels, sample by sample (N,)."""
        values: Array = self.rows[0] if len(self.rows) == 1 else self.rows.sum(axis=0)
        return values


class Statistic(NamedTuple):
    """Function and properties of a statistic.

    Args:
        of: Function that computes the statistic of a response.
        unit: SI unit of the statistic; empty: that of the channels.
        absolute: Whether the statistic depends on the mean, which is unreliable without a trusted gain at 0 Hz.
        options: Options of the statistic with their defaults; None if there is no default.
    """

    of: Callable[[Response], float]
    unit: str = ""
    absolute: bool = False
    options: Mapping[str, float | None] = {}


def rms(values: Array) -> float:
    """Return the root mean square of the values after removing their mean."""
    return float(np.std(values))


def _joint_rms(response: Response) -> float:
    """Return the root mean square of the channels' RMS values."""
    return float(np.sqrt(np.mean(np.var(response.rows, axis=1))))


def _peak(response: Response) -> float:
    total = response.total
    return float(np.max(np.abs(total - total.mean())))


def _variation(response: Response) -> float:
    """Return the coefficient of variation: RMS divided by the mean."""
    total = response.total
    mean = float(total.mean())
    if mean == 0.0:
        raise InputError(
            "variation: the mean is zero, so the ratio is not defined; give the vehicle its static load, or use rms"
        )
    return rms(total) / abs(mean)


def _work(response: Response) -> float:
    """Return the integral of force times velocity by the trapezoidal rule."""
    power = response.rows[0] * response.rows[1]
    return float(scipy.integrate.trapezoid(power, dx=response.step))


def _share(response: Response) -> float:
    low, high = response.options["from"], response.options["to"]
    total = response.total
    return float(np.mean((total >= low) & (total < high)))


#: Statistics by their name in study files.
STATISTICS: Mapping[str, Statistic] = {
    "rms": Statistic(lambda r: rms(r.total)),
    "rms_with_mean": Statistic(lambda r: float(np.sqrt(np.mean(r.total**2))), absolute=True),
    "joint_rms": Statistic(_joint_rms),
    "mean": Statistic(lambda r: float(np.mean(r.total)), absolute=True),
    "peak": Statistic(_peak),
    "range": Statistic(lambda r: float(np.ptp(r.total))),
    "maximum": Statistic(lambda r: float(np.max(r.total)), absolute=True),
    "minimum": Statistic(lambda r: float(np.min(r.total)), absolute=True),
    "percentile": Statistic(
        lambda r: float(np.percentile(r.total, r.options["percent"])), absolute=True, options={"percent": None}
    ),
    "variation": Statistic(_variation, unit="1", absolute=True),
    "work": Statistic(_work, unit="J"),
    "share": Statistic(_share, unit="1", options={"from": -np.inf, "to": np.inf}),
}


def statistic(name: str) -> Statistic:
    """Return a statistic by its name.

    Raises:
        InputError: There is no statistic of that name.
    """
    if name not in STATISTICS:
        raise InputError(f"there is no statistic {name!r}; the statistics are {', '.join(STATISTICS)}")
    return STATISTICS[name]


def options_for(name: str, given: Mapping[str, float]) -> dict[str, float]:
    """Return the options of a statistic, completed by defaults.

    Raises:
        InputError: An option is missing, or the statistic has no such option.
    """
    known = statistic(name).options
    if unknown := sorted(set(given) - set(known)):
        raise InputError(f"{name} has no option {unknown[0]!r}; its options: {', '.join(known) or 'none'}")
    filled = {key: given.get(key, default) for key, default in known.items()}
    if missing := [key for key, value in filled.items() if value is None]:
        raise InputError(f"{name} needs the option {missing[0]!r}")
    return {key: float(value) for key, value in filled.items() if value is not None}
