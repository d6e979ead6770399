"""Estimate of the friction at the ports: the friction with which a linear car leaves the minimum residual.

The response of the car is fitted band by band with the friction included in its force inputs. With a wrong friction the
outputs contain a part that no linear response explains. The residual is quadratic in the responses, which are
eliminated (variable projection), and nearly quadratic in the friction forces, which Gauss-Newton finds in a few steps.
The friction velocity is searched on a grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.response.records import gather
from eightpost.ident.vehicle.experiment import channel
from eightpost.ident.vehicle.friction.bands import bands
from eightpost.ident.vehicle.friction.law import Signal, direction, with_directions
from eightpost.ident.vehicle.friction.projection import ForceSolution, solve_forces
from eightpost.ident.vehicle.trust import SIGNIFICANT, ForceEstimate
from eightpost.vehicle import Friction

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class FrictionSearch:
    """Settings of the friction estimate.

    Attributes:
        velocities: Friction velocities v_f to try, the same at all ports [m/s].
        seconds: Durations of each record that are used to find the velocity and to find the forces [s].
        low: Lowest frequency [Hz].
        high: Highest frequency [Hz].
        iterations: Number of Gauss-Newton steps.
        signal: Friction of 1 N as a function of velocity, rate and friction velocity; default `direction`, the law of
            the vehicle FMU. Another law shows the error of that one; the identified vehicle always has the FMU's law.
    """

    velocities: tuple[float, ...] = (0.001, 0.003, 0.006, 0.012, 0.024)
    seconds: tuple[float, float] = (100.0, 400.0)
    low: float = 0.3
    high: float = 16.0
    iterations: int = 3
    signal: Signal = direction

    def find(self, tests: Sequence[TimeSeries], experiment: Experiment) -> FrictionEstimate:
        """Estimate the friction of every port.

        Args:
            tests: Records with the channels of the experiment, all at one sample rate.
            experiment: Inputs, shock forces and outputs of the tests.

        Raises:
            TooShortError: The records have too few frequency bins.
        """
        brief, whole = ([_first(test, duration) for test in tests] for duration in self.seconds)
        profile = tuple((width, self._at(brief, experiment, width).cost) for width in self.velocities)
        width = _lowest(profile)
        return _estimate(experiment, self._at(whole, experiment, width), width, profile)

    def _at(self, tests: Sequence[TimeSeries], experiment: Experiment, width: float) -> ForceSolution:
        marked = [with_directions(test, experiment.ports, width, self.signal) for test in tests]
        directions = [channel(port, "friction_direction") for port in experiment.ports]
        records = gather(marked, [*experiment.inputs, *directions], experiment.outputs, experiment.baseline_damping)
        count = len(experiment.inputs)
        return solve_forces(list(bands(records, low=self.low, high=self.high, inputs=count)), count, self.iterations)


@dataclass(frozen=True, slots=True, eq=False)
class FrictionEstimate:
    """Estimated friction and the part of the residual that it explains.

    Attributes:
        friction: Friction by port; forces that are negative or not significant are set to zero.
        force: Estimated force by port [N].
        deviation: Standard deviation of the force by port [N], from the scatter over the bands.
        residual: Mean square of the part that no linear response explains, with friction relative to without [1], by
            output.
        profile: Pairs (v_f [m/s], mean of the residual [1]) of all friction velocities that were tried.
    """

    friction: Mapping[str, Friction]
    force: Mapping[str, float]
    deviation: Mapping[str, float]
    residual: Mapping[str, float]
    profile: tuple[tuple[float, float], ...]

    @property
    def forces(self) -> Mapping[str, ForceEstimate]:
        """Estimated force of every port with its standard deviation."""
        return {port: ForceEstimate(force, self.deviation[port]) for port, force in self.force.items()}

    @property
    def acts(self) -> bool:
        """Whether there is friction at any port."""
        return any(law.force > 0.0 for law in self.friction.values())

    def table(self) -> str:
        """Return the RMS of every output's residual with friction, relative to that without, as a Markdown table."""
        lines = ["| output | residual with friction relative to without [%] |", "|---|---|"]
        return "\n".join((*lines, *(f"| {name} | {100.0 * share**0.5:.0f} |" for name, share in self.residual.items())))

    def summary(self) -> str:
        """Return the forces and the part of the residual that remains as a sentence."""
        if not self.acts:
            return "No significant friction was found at the ports."
        forces = ", ".join(f"{port or 'port'} {force.text}" for port, force in self.forces.items())
        width = 1e3 * next(iter(self.friction.values())).velocity
        left = 100.0 * float(np.mean(list(self.residual.values())))
        return (
            f"Friction at the ports (+- two standard deviations): {forces}; friction velocity {width:.2g} mm/s; "
            f"{left:.0f} % of the residual remains."
        )


def _first(series: TimeSeries, seconds: float) -> TimeSeries:
    samples = round(seconds * series.sample_rate)
    return series if len(series) <= samples else series.window(float(series.time[0]), float(series.time[0]) + seconds)


def _lowest(profile: Sequence[tuple[float, float]]) -> float:
    """Return the minimum of the parabola over log v_f through the lowest point and its neighbours."""
    x, y = np.log([width for width, _ in profile]), np.array([cost for _, cost in profile])
    k = int(np.argmin(y))
    if not 0 < k < len(y) - 1:
        return float(np.exp(x[k]))
    a, b, _ = np.polyfit(x[k - 1 : k + 2], y[k - 1 : k + 2], 2)
    return float(np.exp(np.clip(-0.5 * b / a, x[k - 1], x[k + 1])))


def _estimate(
    experiment: Experiment, found: ForceSolution, width: float, profile: tuple[tuple[float, float], ...]
) -> FrictionEstimate:
    deviation = np.sqrt(np.diag(found.covariance))
    significant = np.where(found.forces > SIGNIFICANT * deviation, found.forces, 0.0)
    ports = experiment.ports
    return FrictionEstimate(
        {port: Friction(float(force), width) for port, force in zip(ports, significant, strict=True)},
        dict(zip(ports, found.forces.tolist(), strict=True)),
        dict(zip(ports, deviation.tolist(), strict=True)),
        dict(zip(experiment.outputs, found.residual.tolist(), strict=True)),
        profile,
    )
