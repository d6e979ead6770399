"""Which test is the baseline, and the linear damping around which a vehicle is identified (6.3.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.errors import InputError
from eightpost.ident.vehicle.experiment import channel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]

#: A shock whose force strays from `c v` by more than this part of it is not near-linear [1].
_NEAR_LINEAR = 0.3
#: An alternate shock has at least this part more or less damping than the baseline's [1].
_OTHER = 0.1


class Baseline(NamedTuple):
    """The baseline test and what its shocks are.

    Attributes:
        test: Its position among the records.
        damping: Slope of the best line through force over velocity [N.s/m], by port (C-bar).
        strays: How far each shock's force strays from that line, RMS over RMS [1], by port.
        order: Positions of all records, the baseline first, then alternate tests in the order of the ports.
    """

    test: int
    damping: Mapping[str, float]
    strays: Mapping[str, float]
    order: tuple[int, ...]

    def notes(self) -> tuple[str, ...]:
        """Return what a person should know of it."""
        far = [f"{port or 'the port'} ({100.0 * part:.0f} %)" for port, part in self.strays.items()
               if part > _NEAR_LINEAR]  # fmt: skip
        return (f"baseline shocks far from a straight line: {', '.join(far)}",) if far else ()


def find_baseline(records: Sequence[TimeSeries], ports: Sequence[str], *, test: int | None = None) -> Baseline:
    """Find the baseline test: the one whose shocks are those that most tests have at each corner.

    Args:
        records: With `force` and `velocity` of every port.
        ports: "lf", ...; "" for a quarter car.
        test: Which it is, where that is known.

    Raises:
        InputError: All tests have the same shocks, so that no force can be told from what causes it.
    """
    slopes = np.array([[_slope(record, port) for port in ports] for record in records])
    usual = np.sort(slopes, axis=0)[len(slopes) // 2]  # of two tests, the one with more damping
    chosen = int(np.argmin(np.abs(slopes / usual - 1.0).max(axis=1))) if test is None else test
    changes = np.abs(slopes / slopes[chosen] - 1.0)
    for place, port in enumerate(ports):
        if len(records) > 1 and changes[:, place].max() < _OTHER:
            raise InputError(
                f"no test has another shock at {port or 'the port'}: its damping is {slopes[chosen, place]:.0f} N.s/m "
                f"within {100.0 * _OTHER:.0f} % in all {len(records)}; add a test with about half of it (6.1.4)"
            )
    strays = {port: _stray(records[chosen], port, slopes[chosen, i]) for i, port in enumerate(ports)}
    others = sorted((k for k in range(len(records)) if k != chosen), key=lambda k: (int(np.argmax(changes[k])), k))
    damping = {port: float(slopes[chosen, i]) for i, port in enumerate(ports)}
    return Baseline(chosen, damping, strays, (chosen, *others))


def _slope(record: TimeSeries, port: str) -> float:
    v, force = _moving(record, port)
    return float(v @ force / (v @ v))


def _stray(record: TimeSeries, port: str, slope: float) -> float:
    v, force = _moving(record, port)
    return float(np.std(force - slope * v) / np.std(slope * v))


def _moving(record: TimeSeries, port: str) -> tuple[Array, Array]:
    v, force = (record[channel(port, quantity)] for quantity in ("velocity", "force"))
    return v - v.mean(), force - force.mean()
