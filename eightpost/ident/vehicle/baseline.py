"""Choice of the baseline test, and the linear damping around which a vehicle is identified (6.3.1)."""

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

#: RMS deviation of a shock's force from `c v`, relative to `c v`, above which the shock is reported as nonlinear [1].
_NEAR_LINEAR = 0.3
#: Minimum relative difference in damping between an alternate shock and the baseline shock [1].
_OTHER = 0.1


class Baseline(NamedTuple):
    """The baseline test and the damping of its shocks.

    Attributes:
        test: Index of the baseline test among the records.
        damping: Least-squares slope of force over velocity (C-bar) [N.s/m], by port.
        deviations: RMS deviation of the shock's force from that line, relative to the line's RMS [1], by port.
        order: Indices of all records: the baseline first, then alternate tests in the order of the ports.
    """

    test: int
    damping: Mapping[str, float]
    deviations: Mapping[str, float]
    order: tuple[int, ...]

    def notes(self) -> tuple[str, ...]:
        """Return notes on the baseline for the user."""
        far = [f"{port or 'the port'} ({100.0 * part:.0f} %)" for port, part in self.deviations.items()
               if part > _NEAR_LINEAR]  # fmt: skip
        return (f"baseline shocks deviate from a straight line: {', '.join(far)}",) if far else ()


def find_baseline(records: Sequence[TimeSeries], ports: Sequence[str], *, test: int | None = None) -> Baseline:
    """Find the baseline test: at each corner it has the shock that most tests have.

    Args:
        records: Records with `force` and `velocity` of every port.
        ports: Ports: "lf", ...; "" for a quarter car.
        test: Index of the baseline test, if known.

    Raises:
        InputError: All tests have the same shock at a port, so the effect of its force cannot be separated.
    """
    slopes = np.array([[_slope(record, port) for port in ports] for record in records])
    usual = np.sort(slopes, axis=0)[len(slopes) // 2]  # with two tests, the larger damping
    chosen = int(np.argmin(np.abs(slopes / usual - 1.0).max(axis=1))) if test is None else test
    changes = np.abs(slopes / slopes[chosen] - 1.0)
    for place, port in enumerate(ports):
        if len(records) > 1 and changes[:, place].max() < _OTHER:
            raise InputError(
                f"no test has another shock at {port or 'the port'}: the damping is {slopes[chosen, place]:.0f} N.s/m "
                f"within {100.0 * _OTHER:.0f} % in all {len(records)} tests; add a test with about half of it (6.1.4)"
            )
    deviations = {port: _deviation(records[chosen], port, slopes[chosen, i]) for i, port in enumerate(ports)}
    others = sorted((k for k in range(len(records)) if k != chosen), key=lambda k: (int(np.argmax(changes[k])), k))
    damping = {port: float(slopes[chosen, i]) for i, port in enumerate(ports)}
    return Baseline(chosen, damping, deviations, (chosen, *others))


def _slope(record: TimeSeries, port: str) -> float:
    v, force = _moving(record, port)
    return float(v @ force / (v @ v))


def _deviation(record: TimeSeries, port: str, slope: float) -> float:
    v, force = _moving(record, port)
    return float(np.std(force - slope * v) / np.std(slope * v))


def _moving(record: TimeSeries, port: str) -> tuple[Array, Array]:
    v, force = (record[channel(port, quantity)] for quantity in ("velocity", "force"))
    return v - v.mean(), force - force.mean()
