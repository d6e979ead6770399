"""Data of a run: recorded signals, coupling error, energy, shares of time beyond limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cosim.results import rules
from cosim.results.validity import Model
from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class Coupled:
    """Local errors of the values that the ends of one bond assumed of each other, root mean squares in SI."""

    velocity_error: float  #: Local error of the velocity given to the shock [m/s].
    velocity_spread: float  #: Standard deviation of that velocity [m/s].
    force_error: float  #: Local error of the force given to the vehicle [N].
    force_spread: float  #: Standard deviation of that force [N].
    velocity_scale: float  #: Scale of the velocity's error [m/s]; see cosim.results.error_estimate.judged_by.
    force_scale: float  #: Scale of the force's error [N].

    @property
    def percent(self) -> float:
        """Larger of both local errors, in percent of its scale."""
        return 100.0 * max(self.velocity_error / self.velocity_scale, self.force_error / self.force_scale)


@dataclass(frozen=True, slots=True)
class BondEnergy:
    """Energy through one bond over a run."""

    #: Energy given at the velocity end minus energy received at the force end [J]; 0 in exact coupling.
    residual: float
    transferred: float  #: Sum of the magnitudes of the energy received at the force end in each step [J].

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
    """What a run gives, without its verdict."""

    series: TimeSeries  #: Recorded variables by `component.variable`, SI.
    converged: bool  #: Whether the equilibrium start was found and all steps converged; see `notes`.
    notes: tuple[str, ...]  #: Notes for the reader, in sentences.
    algorithm: str  #: Name of the algorithm.
    order: tuple[str, ...]  #: Components in the order of stepping.
    step: float  #: Coupling step [s].
    steps: int  #: Number of coupling steps.
    seconds: float  #: Wall time from the start of initialization [s]; for the default, of all its runs.
    equilibrium_sweeps: int  #: Number of evaluations until the equilibrium start converged.
    energy: Mapping[str, BondEnergy]  #: Energy residual and energy transferred [J] per bond.
    #: Recorded outputs with a direct term in an input that was held over each step: first order in it. Those of an FMU
    #: with directional derivatives are corrected, and not among them.
    held_direct: tuple[str, ...]
    identities: Mapping[str, str]  #: GUID of each component.
    sources: Mapping[str, str] = field(default_factory=dict)  #: File of each component.
    #: Values that differ from the components' defaults, by component; in their own units.
    parameters: Mapping[str, Mapping[str, float | bool | str]] = field(default_factory=dict)
    settling: float = 0.0  #: Time at the start that is excluded from response measures [s].
    #: Share of time beyond the fitted velocities, per shock.
    share_beyond_fit: Mapping[str, float] = field(default_factory=dict)
    #: Share of time beyond the measured settings of clicks and temperature, per such shock.
    share_beyond_settings: Mapping[str, float] = field(default_factory=dict)
    #: The same, beyond them by more than the nearest interval between them.
    share_far_beyond_settings: Mapping[str, float] = field(default_factory=dict)
    #: Share of time at a combination of settings that was not measured, per such shock.
    share_untested_settings: Mapping[str, float] = field(default_factory=dict)
    #: Share of time below zero load, per tire force; None if no static load is known.
    share_tire_off: Mapping[str, float | None] = field(default_factory=dict)
    #: Local errors of the values that the ends assumed of each other, per bond.
    coupled: Mapping[str, Coupled] = field(default_factory=dict)
    iterations: int = 0  #: Total number of iterations of implicit steps.
    rejected_steps: int = 0  #: Number of steps that an adaptive run repeated with a smaller step.
    largest_step: float = 0.0  #: Largest coupling step [s].
    partial: bool = False  #: Whether the run was interrupted or given up before its stop time.
    stepping_seconds: float = 0.0  #: Wall time of the steps alone [s]; for the default, of all its runs.
    #: Estimated coupling error per recorded variable and per decisive channel, in percent of its scale
    #: (cosim.results.error_estimate.scales) after settling; empty if only one run was made.
    stated_error: Mapping[str, float] = field(default_factory=dict)
    scheme: str = ""  #: Algorithm that the default chose; empty if an algorithm was given.
    #: Channels whose coupling error the verdict judges: velocities and forces of bonds, tire forces.
    decisive: frozenset[str] = frozenset()
    models: Mapping[str, Model] = field(default_factory=dict)  #: Components with the information that the verdict uses.
    tolerance: float = 0.0  #: Coupling error that the default aimed at, in percent; 0 if the step was given.
    ended_by: str = ""  #: Component that ended the simulation before its stop time, as an FMU may; empty if none did.
    ended_at: float | None = None  #: Time at which it did [s]; None if none did.
    unsettled_steps: int = 0  #: Number of implicit steps that did not converge.
    steps_of_all_runs: int = 0  #: Number of coupling steps of this run and of those that it was compared with.

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
