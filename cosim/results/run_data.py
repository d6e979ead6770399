"""Data of a run: recorded signals, coupling error, energy, shares of time beyond limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cosim.results import rules
from cosim.results.validity import Model
from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class Coupled:
    """Local errors of the values that the ends of one bond assumed of each other, root mean squares in SI.

    Attributes:
        velocity_error: Local error of the velocity given to the shock [m/s].
        velocity_spread: Standard deviation of that velocity [m/s].
        force_error: Local error of the force given to the vehicle [N].
        force_spread: Standard deviation of that force [N].
        velocity_scale: Scale of the velocity's error [m/s]; see cosim.results.error_estimate.judged_by.
        force_scale: Scale of the force's error [N].
    """

    velocity_error: float
    velocity_spread: float
    force_error: float
    force_spread: float
    velocity_scale: float
    force_scale: float

    @property
    def percent(self) -> float:
        """Larger of both local errors, in percent of its scale."""
        return 100.0 * max(self.velocity_error / self.velocity_scale, self.force_error / self.force_scale)


@dataclass(frozen=True, slots=True)
class BondEnergy:
    """Energy through one bond over a run.

    Attributes:
        residual: Energy given at the velocity end minus energy received at the force end [J]; 0 in exact coupling.
        transferred: Sum of the magnitudes of the energy received at the force end in each step [J].
    """

    residual: float
    transferred: float

    @property
    def relative(self) -> float:
        """Residual as a share of the energy transferred [1]."""
        return self.residual / self.transferred if self.transferred else 0.0

    @property
    def acceptable(self) -> bool:
        """Whether the coupling adds or loses at most 5 % of the energy transferred."""
        return abs(self.relative) <= rules.LARGEST_RESIDUAL


@dataclass(frozen=True, repr=False)
class RunData:
    """What a run gives, without its verdict.

    Attributes:
        series: Recorded variables by `component.variable`, SI.
        converged: Whether the equilibrium start was found and all steps converged; see `notes`.
        notes: Notes for the reader, in sentences.
        algorithm: Name of the algorithm.
        order: Components in the order of stepping.
        step: Coupling step [s].
        steps: Number of coupling steps.
        seconds: Wall time from the start of initialization [s]; for the default, of all its runs.
        equilibrium_sweeps: Number of evaluations until the equilibrium start converged.
        energy: Energy residual and energy transferred [J] per bond.
        held_direct: Recorded outputs with a direct term in an input that was held over each step: first order in it.
        identities: GUID of each component.
        sources: File of each component.
        parameters: Values that differ from the components' defaults, by component; in their own units.
        settling: Time at the start that is excluded from response measures [s].
        share_beyond_fit: Share of time beyond the fitted velocities, per shock.
        share_beyond_settings: Share of time beyond the measured settings of clicks and temperature, per such shock.
        share_far_beyond_settings: The same, beyond them by more than the nearest interval between them.
        share_untested_settings: Share of time at a combination of settings that was not measured, per such shock.
        share_tire_off: Share of time below zero load, per tire force; None if no static load is known.
        coupled: Local errors of the values that the ends assumed of each other, per bond.
        iterations: Total number of iterations of implicit steps.
        rejected_steps: Number of steps that an adaptive run repeated with a smaller step.
        largest_step: Largest coupling step [s].
        partial: Whether the run was interrupted or given up before its stop time.
        ended_by: Component that ended the simulation before its stop time, as an FMU may; empty if none did.
        ended_at: Time at which it did [s]; None if none did.
        stepping_seconds: Wall time of the steps alone [s]; for the default, of all its runs.
        stated_error: Estimated coupling error per recorded variable and per decisive channel, in percent of its scale
            (cosim.results.error_estimate.scales) after settling; empty if only one run was made.
        scheme: Algorithm that the default chose; empty if an algorithm was given.
        decisive: Channels whose coupling error the verdict judges: velocities and forces of bonds, tire forces.
        models: Components with the information that the verdict uses.
        tolerance: Coupling error that the default aimed at, in percent; 0 if the step was given.
        unsettled_steps: Number of implicit steps that did not converge.
        steps_of_all_runs: Number of coupling steps of this run and of those that it was compared with.
    """

    series: TimeSeries
    converged: bool
    notes: tuple[str, ...]
    algorithm: str
    order: tuple[str, ...]
    step: float
    steps: int
    seconds: float
    equilibrium_sweeps: int
    energy: Mapping[str, BondEnergy]
    held_direct: tuple[str, ...]
    identities: Mapping[str, str]
    sources: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, float | bool | str]] = field(default_factory=dict)
    settling: float = 0.0
    share_beyond_fit: Mapping[str, float] = field(default_factory=dict)
    share_beyond_settings: Mapping[str, float] = field(default_factory=dict)
    share_far_beyond_settings: Mapping[str, float] = field(default_factory=dict)
    share_untested_settings: Mapping[str, float] = field(default_factory=dict)
    share_tire_off: Mapping[str, float | None] = field(default_factory=dict)
    coupled: Mapping[str, Coupled] = field(default_factory=dict)
    iterations: int = 0
    rejected_steps: int = 0
    largest_step: float = 0.0
    partial: bool = False
    stepping_seconds: float = 0.0
    stated_error: Mapping[str, float] = field(default_factory=dict)
    scheme: str = ""
    decisive: frozenset[str] = frozenset()
    models: Mapping[str, Model] = field(default_factory=dict)
    tolerance: float = 0.0
    ended_by: str = ""
    ended_at: float | None = None
    unsettled_steps: int = 0
    steps_of_all_runs: int = 0

    @property
    def coupling_error(self) -> float | None:
        """Largest stated error of the decisive channels, or of all channels if none is decisive [%].

        None if only one run was made.
        """
        chosen = [self.stated_error[name] for name in self.decisive if name in self.stated_error]
        return max(chosen or self.stated_error.values(), default=None)

    @property
    def has_equal_steps(self) -> bool:
        """Whether all coupling steps have the same size, except for rounding."""
        return self.largest_step <= self.step * (1.0 + 1e-9)

    @property
    def is_clean(self) -> bool:
        """Whether the run reached its stop time, every step converged, and no bond's local error is too large."""
        local = max((c.percent for c in self.coupled.values()), default=0.0)
        return not self.partial and self.unsettled_steps == 0 and local <= rules.LARGEST_ERROR

    def settled(self) -> TimeSeries:
        """Return the series without the settling time; the whole series if the run ended within it."""
        last = float(self.series.time[-1])
        return self.series.window(self.settling, last) if 0.0 < self.settling < last else self.series
