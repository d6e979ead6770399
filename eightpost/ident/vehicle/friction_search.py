"""Search for the friction at the ports of a car: which law explains most of what no linear response explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.ident.response.records import gather
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.friction import direction
from eightpost.ident.vehicle.port_laws import bristle_force
from eightpost.ident.vehicle.projection import ForceSolution, bands, solve_forces
from eightpost.ident.vehicle.trust import SIGNIFICANT, ForceEstimate
from eightpost.progress import parts, portion
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction

#: Velocities v_f of the tanh [m/s] and reaches z_s of the bristle [m] that are tried, in increasing order.
VELOCITIES = (0.001, 0.003, 0.006, 0.012, 0.024)
REACHES = (3e-5, 6e-5, 1e-4, 1.5e-4, 3e-4)

#: Ratios of static to sliding friction that are tried [1].
STATIC_RATIOS = (1.0, 1.15)


class Candidate(NamedTuple):
    """A law that was tried: friction of 1 N, and the mean square that it leaves unexplained, relative to none [1]."""

    law: Friction
    cost: float

    @property
    def width(self) -> float:
        """Reach of the bristle [m], or velocity v_f of the tanh [m/s]."""
        return self.law.bristle.reach if self.law.bristle.force else self.law.velocity


@dataclass(frozen=True, slots=True)
class FrictionSearch:
    """Settings of the friction estimate. All ports have the same law, each with its own force."""

    #: Velocities v_f of the law tanh(v / v_f) to try [m/s], in increasing order; empty: no such law.
    velocities: tuple[float, ...] = VELOCITIES
    #: Reaches z_s of a bristle to try [m], in increasing order; empty: no bristle.
    reaches: tuple[float, ...] = REACHES
    static_ratios: tuple[float, ...] = STATIC_RATIOS  #: Ratios of static to sliding friction of the bristle to try [1].
    #: Durations of each record that are used to choose the law and to find the forces [s].
    seconds: tuple[float, float] = (100.0, 400.0)
    low: float = 0.3  #: Lowest frequency [Hz].
    high: float = 16.0  #: Highest frequency [Hz].
    iterations: int = 3  #: Number of Gauss-Newton steps.

    @property
    def creeping(self) -> FrictionSearch:
        """The same search without bristles."""
        return replace(self, velocities=self.velocities or VELOCITIES, reaches=())

    def find(self, tests: Sequence[TimeSeries], experiment: Experiment) -> FrictionEstimate:
        """Estimate the friction of every port with the law that leaves least unexplained.

        Args:
            tests: Records with the channels of the experiment, all at one sample rate.
            experiment: Inputs, shock forces and outputs of the tests.

        Raises:
            TooShortError: The records have too few frequency bins.
        """
        brief, whole = ([_first(test, duration) for test in tests] for duration in self.seconds)
        with portion(0.0, 0.4):
            tried = [self._tried(brief, experiment, Friction(1.0, velocity)) for velocity in parts(self.velocities)]
        first, *others = self.static_ratios
        with portion(0.4, 0.8):
            bristles = [self._tried(brief, experiment, Friction(bristle=Bristle(1.0, reach, first)))
                        for reach in parts(self.reaches)]  # fmt: skip
        best = min((family for family in (tried, bristles) if family), key=_least)
        law = _with_width(best[0].law, _lowest(best))
        if law.bristle.force:
            # The reach hardly depends on the ratio, so other ratios are tried with the best reach only.
            ratios = [law._replace(bristle=replace(law.bristle, static_ratio=ratio)) for ratio in (first, *others)]
            at_best = [self._tried(brief, experiment, ratio) for ratio in ratios]
            law, bristles = min(at_best, key=lambda one: one.cost).law, [*bristles, *at_best]
        return _estimate(experiment, self._at(whole, experiment, law), law, (*tried, *bristles))

    def _tried(self, tests: Sequence[TimeSeries], experiment: Experiment, law: Friction) -> Candidate:
        return Candidate(law, self._at(tests, experiment, law).cost)

    def _at(self, tests: Sequence[TimeSeries], experiment: Experiment, law: Friction) -> ForceSolution:
        marked = [_with_unit_friction(test, experiment.ports, law) for test in tests]
        units = [channel(port, "unit_friction") for port in experiment.ports]
        records = gather(marked, [*experiment.inputs, *units], experiment.outputs, experiment.baseline_damping)
        count = len(experiment.inputs)
        return solve_forces(list(bands(records, low=self.low, high=self.high, inputs=count)), count, self.iterations)


@dataclass(frozen=True, slots=True, eq=False)
class FrictionEstimate:
    """Estimated friction and the part of the residual that it explains."""

    friction: Mapping[str, Friction]  #: Friction by port; forces that are negative or not significant are set to zero.
    #: Estimated force of every port; its standard deviation comes from the scatter over the bands.
    forces: Mapping[str, ForceEstimate]
    #: Mean square of the part that no linear response explains, with friction relative to without [1], by output.
    residual: Mapping[str, float]
    profile: tuple[Candidate, ...]  #: All laws that were tried.

    @property
    def acts(self) -> bool:
        """Whether there is friction at any port."""
        return any(law.acts for law in self.friction.values())

    @property
    def sticks(self) -> bool:
        """Whether the friction at any port is a bristle."""
        return any(law.bristle.force > 0.0 for law in self.friction.values())

    def table(self) -> str:
        """Return the RMS of every output's residual with friction, relative to that without, as a Markdown table."""
        lines = ["| output | residual with friction relative to without [%] |", "|---|---|"]
        return "\n".join((*lines, *(f"| {name} | {100.0 * share**0.5:.0f} |" for name, share in self.residual.items())))

    def summary(self) -> str:
        """Return the forces, the law, and the part of the residual that remains as a sentence."""
        if not self.acts:
            return "No significant friction was found at the ports."
        forces = ", ".join(f"{port or 'port'} {force.text}" for port, force in self.forces.items())
        left = 100.0 * float(np.mean(list(self.residual.values())))
        law = law_text(next(law for law in self.friction.values() if law.acts))
        about = "Friction at the ports (+- two standard deviations)"
        return f"{about}: {forces}; {law}; {left:.0f} % of the residual remains."


def law_text(law: Friction) -> str:
    """Return the law of a friction and its width as text."""
    if law.bristle.force:
        own = law.bristle
        return f"it sticks (bristle, reach {1e3 * own.reach:.2g} mm, static over sliding force {own.static_ratio:.3g})"
    return f"it creeps (tanh, friction velocity {1e3 * law.velocity:.2g} mm/s)"


def _with_unit_friction(series: TimeSeries, ports: Sequence[str], law: Friction) -> TimeSeries:
    """Return a record with the law of 1 N at every port in the channel `unit_friction`."""
    for port in ports:
        values = _unit(series[channel(port, "velocity")], series.sample_rate, law)
        series = series.with_channel(channel(port, "unit_friction"), "1", values)
    return series


def _unit(velocity: Array, rate: float, law: Friction) -> Array:
    return bristle_force(velocity, rate, law.bristle) if law.bristle.force else direction(velocity, rate, law.velocity)


def _with_width(law: Friction, width: float) -> Friction:
    if law.bristle.force:
        return law._replace(bristle=replace(law.bristle, reach=width))
    return law._replace(velocity=width)


def _scaled(law: Friction, force: float) -> Friction:
    """Return a law of 1 N with another force."""
    if law.bristle.force:
        return law._replace(bristle=replace(law.bristle, force=force))
    return law._replace(force=force)


def _first(series: TimeSeries, seconds: float) -> TimeSeries:
    samples = round(seconds * series.sample_rate)
    return series if len(series) <= samples else series.window(float(series.time[0]), float(series.time[0]) + seconds)


def _least(family: Sequence[Candidate]) -> float:
    return min(tried.cost for tried in family)


def _lowest(family: Sequence[Candidate]) -> float:
    """Return the minimum of the parabola over the width's logarithm through the lowest point and its neighbours."""
    x, y = np.log([tried.width for tried in family]), np.array([tried.cost for tried in family])
    k = int(np.argmin(y))
    if not 0 < k < len(y) - 1:
        return float(np.exp(x[k]))
    a, b, _ = np.polyfit(x[k - 1 : k + 2], y[k - 1 : k + 2], 2)
    return float(np.exp(np.clip(-0.5 * b / a, x[k - 1], x[k + 1])))


def _estimate(
    experiment: Experiment, found: ForceSolution, law: Friction, profile: tuple[Candidate, ...]
) -> FrictionEstimate:
    forces = found.estimates(experiment.ports)
    significant = {port: one.value if one.value > SIGNIFICANT * one.deviation else 0.0 for port, one in forces.items()}
    return FrictionEstimate(
        {port: _scaled(law, force) for port, force in significant.items()},
        forces,
        dict(zip(experiment.outputs, found.residual.tolist(), strict=True)),
        profile,
    )
