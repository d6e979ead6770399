"""Whether the springs at the ports are straight: a force that grows with the square of the travel.

    F = F_2 (s / s_rms)^2

It is looked for as friction is: what of the outputs no linear response explains, and this force would. Progressive
coils and stops leave such a part; the vehicle FMU has no such spring, so it is said and not modelled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.response.records import gather
from eightpost.ident.vehicle.experiment import channel
from eightpost.ident.vehicle.friction.bands import bands
from eightpost.ident.vehicle.friction.projection import found_in
from eightpost.ident.vehicle.trust import FoundForce

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class SpringSearch:
    """How bent springs are looked for.

    Attributes:
        seconds: How much of each record is used [s].
        low: Lowest frequency [Hz].
        high: Highest [Hz].
        iterations: Gauss-Newton steps.
    """

    seconds: float = 100.0
    low: float = 0.3
    high: float = 16.0
    iterations: int = 2

    def find(self, tests: Sequence[TimeSeries], experiment: Experiment) -> Mapping[str, FoundForce]:
        """Return F_2 by port; nothing where the records have no travel of the ports.

        Args:
            tests: Records with the experiment's channels, friction in their forces, at one rate.
            experiment: What is input, shock force and output.

        Raises:
            TooShortError: The records hold too few bins.
        """
        if not all(channel(port, "displacement") in test for test in tests for port in experiment.ports):
            return {}
        samples = round(self.seconds * tests[0].sample_rate)
        marked = [_with_squares(test, experiment.ports, samples) for test in tests]
        squares = [channel(port, "travel_squared") for port in experiment.ports]
        records = gather(marked, [*experiment.inputs, *squares], experiment.outputs, experiment.baseline_damping)
        count = len(experiment.inputs)
        found = found_in(
            list(bands(records, low=self.low, high=self.high, inputs=count)), count, iterations=self.iterations
        )
        deviation = np.sqrt(np.diag(found.covariance))
        return {
            port: FoundForce(float(force), float(spread))
            for port, force, spread in zip(experiment.ports, found.forces, deviation, strict=True)
        }


def bent(springs: Mapping[str, FoundForce]) -> str | None:
    """Return a sentence on the springs that are not straight, None where none is told from noise."""
    found = {port: force for port, force in springs.items() if force.is_significant}
    if not found:
        return None
    listed = ", ".join(f"{port or 'port'} {f.said}" for port, f in found.items())
    return (
        "Springs or stops are not straight: a force that grows with the square of the travel, at its RMS (two sigma): "
        f"{listed}. The model has straight springs: it holds for travel of the tests' size."
    )


def _with_squares(series: TimeSeries, ports: Sequence[str], samples: int) -> TimeSeries:
    """Return the first samples of a record with `(s / s_rms)^2` of every port, as the channel `travel_squared`."""
    if len(series) > samples:
        series = series.window(float(series.time[0]), float(series.time[samples]))
    for port in ports:
        travel = series[channel(port, "displacement")]
        travel = travel - travel.mean()
        squared = np.square(travel) / max(float(np.mean(np.square(travel))), 1e-300)
        series = series.with_channel(channel(port, "travel_squared"), "1", squared)
    return series
