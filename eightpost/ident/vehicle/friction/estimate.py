"""How much friction the tests show: what leaves the least residual of the linear car around it.

The response of the car is fitted band by band with the friction in its force inputs. For a wrong friction the outputs
hold what no linear response explains. The residual is quadratic in the responses, which are eliminated (variable
projection), and nearly so in the friction forces, which Gauss-Newton finds in a few steps; the friction velocity is
looked for on a grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.response.records import gather
from eightpost.ident.vehicle.experiment import channel
from eightpost.ident.vehicle.friction.bands import bands
from eightpost.ident.vehicle.friction.law import Signal, direction, with_directions
from eightpost.ident.vehicle.friction.projection import Found, found_in
from eightpost.ident.vehicle.trust import SIGNIFICANT, FoundForce
from eightpost.vehicle import Friction

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class FrictionSearch:
    """How friction is looked for.

    Attributes:
        velocities: Friction velocities v_f that are tried, all ports alike [m/s].
        seconds: How much of each record the velocities are tried on, and how much the forces are found on [s].
        low: Lowest frequency [Hz].
        high: Highest [Hz].
        iterations: Gauss-Newton steps.
        signal: Friction of one newton from velocity, rate and width, as `direction` has it: the law of the vehicle FMU.
            Another law tells what that one costs; the vehicle that is identified keeps the FMU's.
    """

    velocities: tuple[float, ...] = (0.001, 0.003, 0.006, 0.012, 0.024)
    seconds: tuple[float, float] = (100.0, 400.0)
    low: float = 0.3
    high: float = 16.0
    iterations: int = 3
    signal: Signal = direction

    def find(self, tests: Sequence[TimeSeries], experiment: Experiment) -> FrictionEstimate:
        """Find the friction of every port.

        Args:
            tests: Records with the experiment's channels, at one rate.
            experiment: What is input, shock force and output.

        Raises:
            TooShortError: The records hold too few bins.
        """
        brief, whole = ([_first(test, most) for test in tests] for most in self.seconds)
        profile = tuple((width, self._at(brief, experiment, width).cost) for width in self.velocities)
        width = _lowest(profile)
        return _estimate(experiment, self._at(whole, experiment, width), width, profile)

    def _at(self, tests: Sequence[TimeSeries], experiment: Experiment, width: float) -> Found:
        marked = [with_directions(test, experiment.ports, width, self.signal) for test in tests]
        directions = [channel(port, "friction_direction") for port in experiment.ports]
        records = gather(marked, [*experiment.inputs, *directions], experiment.outputs, experiment.baseline_damping)
        count = len(experiment.inputs)
        return found_in(list(bands(records, low=self.low, high=self.high, inputs=count)), count, self.iterations)


@dataclass(frozen=True, slots=True, eq=False)
class FrictionEstimate:
    """The friction that was found, and what it explains.

    Attributes:
        friction: By port; a force that is not significant, or below zero, is zero.
        force: By port, as found [N].
        deviation: Standard deviation of each port's force [N], from the scatter over the bands.
        residual: By output, mean square of what no linear response explains, with friction over without [1].
        profile: (v_f [m/s], mean of the residual [1]) of every friction velocity that was tried.
    """

    friction: Mapping[str, Friction]
    force: Mapping[str, float]
    deviation: Mapping[str, float]
    residual: Mapping[str, float]
    profile: tuple[tuple[float, float], ...]

    @property
    def found(self) -> Mapping[str, FoundForce]:
        """Every port's force with its deviation."""
        return {port: FoundForce(force, self.deviation[port]) for port, force in self.force.items()}

    @property
    def acts(self) -> bool:
        """Whether there is friction at any port."""
        return any(law.force > 0.0 for law in self.friction.values())

    def table(self) -> str:
        """Return what is left of every output's residual with friction, as Markdown: RMS over that without."""
        lines = ["| output | residual with friction over without [%] |", "|---|---|"]
        return "\n".join((*lines, *(f"| {name} | {100.0 * share**0.5:.0f} |" for name, share in self.residual.items())))

    def said(self) -> str:
        """Return the forces and what they explain as a sentence."""
        if not self.acts:
            return "No friction at the ports is told from noise."
        forces = ", ".join(f"{port or 'port'} {force.said}" for port, force in self.found.items())
        width = 1e3 * next(iter(self.friction.values())).velocity
        left = 100.0 * float(np.mean(list(self.residual.values())))
        return (
            f"Friction at the ports (two sigma): {forces}, over {width:.2g} mm/s; {left:.0f} % of the residual is left."
        )


def _first(series: TimeSeries, seconds: float) -> TimeSeries:
    samples = round(seconds * series.sample_rate)
    return series if len(series) <= samples else series.window(float(series.time[0]), float(series.time[0]) + seconds)


def _lowest(profile: Sequence[tuple[float, float]]) -> float:
    """Return where the parabola through the lowest point and its neighbours, over log v_f, is lowest."""
    x, y = np.log([width for width, _ in profile]), np.array([cost for _, cost in profile])
    k = int(np.argmin(y))
    if not 0 < k < len(y) - 1:
        return float(np.exp(x[k]))
    a, b, _ = np.polyfit(x[k - 1 : k + 2], y[k - 1 : k + 2], 2)
    return float(np.exp(np.clip(-0.5 * b / a, x[k - 1], x[k + 1])))


def _estimate(
    experiment: Experiment, found: Found, width: float, profile: tuple[tuple[float, float], ...]
) -> FrictionEstimate:
    deviation = np.sqrt(np.diag(found.covariance))
    held = np.where(found.forces > SIGNIFICANT * deviation, found.forces, 0.0)
    ports = experiment.ports
    return FrictionEstimate(
        {port: Friction(float(force), width) for port, force in zip(ports, held, strict=True)},
        dict(zip(ports, found.forces.tolist(), strict=True)),
        dict(zip(ports, deviation.tolist(), strict=True)),
        dict(zip(experiment.outputs, found.residual.tolist(), strict=True)),
        profile,
    )
