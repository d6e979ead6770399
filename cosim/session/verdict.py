"""Data of a run, and the rules by which it is judged: coupling, energy, convergence, range of the models."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Protocol, runtime_checkable

import numpy as np

from cosim.systems.system import System
from eightpost.signals import TimeSeries
from eightpost.validity import Range, Validity
from eightpost.verdict import Grade, Reason, Rules, Verdict

# ---- Rules ----------------------------------------------------------------------------------------------------------

ABOUT = "range of the models"

#: Shares of time or energy beyond a limit of a model: above the first it is reported, above the second the result is
#: not usable.
NOTABLE_SHARE, LARGEST_SHARE = 0.01, 0.20

#: Share by which a variable may exceed the amplitudes of a record.
MARGIN = 0.1

#: Minimum number of samples for a check of a range.
_FEWEST = 10

#: Share of the power outside the frequencies of the records above which it is reported.
NOTABLE_POWER = 0.10

#: Largest coupling error of a result that can be used [% of the scale].
LARGEST_ERROR = 5.0

#: Residual, as a share of the energy transferred, above which a second run at half the step is recommended.
DOUBTFUL_RESIDUAL = 1e-2

#: Largest residual, as a share of the energy transferred, of a result that can be used. With ramped values the residual
#: was about the error of the shock velocity: 0.25 % at 1 ms, 0.9 % at 2 ms, 3.4 % at 4 ms
#: (docs/explanation/coupling.md).
LARGEST_RESIDUAL = 0.05

#: Coupling error up to which a run without a tolerance of its own is good [% of the scale].
GOOD_ERROR = 1.0

RULES = Rules()

COUPLING_ERROR = RULES.add("coupling error too large", "coupling", Grade.NOT_USABLE,
    condition=f"stated error of a bond's velocity or force or of a tire force above {LARGEST_ERROR:g} % of its "
    "scale (its standard deviation, with a floor)",
    why="setups of one car differ by a few percent in these signals: a larger error ranks the scheme, not the setups",
    remedy="give a smaller coupling step, or use the default algorithm",
)  # fmt: skip
COUPLING_TOLERANCE = RULES.add("coupling tolerance not met", "coupling", Grade.LIMITED,
    condition="the same error above the tolerance (default 0.2 %); for a run at a given step above "
    f"{GOOD_ERROR:g} %",
    why="the error is known, but it is larger than requested",
    remedy="compare only differences of several times this error, or give a smaller step",
)  # fmt: skip
COUPLING_GOOD = RULES.add("coupling error small", "coupling", Grade.USABLE,
    condition="the same error within the tolerance",
    why="the error is known and as small as requested",
)  # fmt: skip
COUPLING_UNKNOWN = RULES.add("coupling error not stated", "coupling", Grade.UNKNOWN,
    condition="the run states no error",
    why="a single run at one step does not show the error of the coupling",
    remedy="leave out --set comparison=no (compared=False), or use the default algorithm; both state the error unless "
    "a component makes steps of one size only",
)  # fmt: skip
COUPLING_NONE = RULES.add("nothing is coupled", "coupling", Grade.USABLE,
    condition="no connections form a loop, and no error is stated",
    why="components that only follow a drive, or feed each other one way, have no coupling loop",
)  # fmt: skip
LOCAL_ERROR = RULES.add("local error of a bond", "coupling", Grade.NOT_USABLE,
    condition=f"the values that the ends of a bond assume of each other are wrong by more than {LARGEST_ERROR:g} % of "
    "their scale in each step",
    why="two runs that alternate from step to step can agree at the recorded points; the error within the steps shows "
    "this, and therefore overrides the stated error",
    remedy="give a smaller coupling step, or use the implicit algorithm",
)  # fmt: skip
CHANNEL_ERROR = RULES.add("coupling error of other channels", "coupling", Grade.LIMITED,
    condition=f"stated error of any other recorded channel above {LARGEST_ERROR:g} %",
    why="accelerations have higher frequencies than forces and velocities, and larger errors",
    remedy="do not use these channels, or give a smaller coupling step",
)  # fmt: skip
ENERGY_RESIDUAL = RULES.add("energy residual too large", "energy", Grade.NOT_USABLE,
    condition=f"the coupling adds or loses more than {100 * LARGEST_RESIDUAL:g} % of the energy through a bond",
    why="the residual was about the error of the shock velocity: 0.25 % at 1 ms, 3.4 % at 4 ms "
        "(docs/explanation/coupling.md)",
    remedy="give a smaller coupling step",
)  # fmt: skip
ENERGY_DOUBTFUL = RULES.add("energy residual notable", "energy", Grade.LIMITED,
    condition=f"the coupling adds or loses more than {100 * DOUBTFUL_RESIDUAL:g} % of the energy through a bond",
    why="sound runs stay under 1 % (docs/explanation/coupling.md)",
    remedy="halve the coupling step and compare",
)  # fmt: skip
ENERGY_GOOD = RULES.add("energy residual small", "energy", Grade.USABLE,
    condition=f"no bond adds or loses more than {100 * DOUBTFUL_RESIDUAL:g} % of its energy",
    why="sound runs stay under 1 % (docs/explanation/coupling.md)",
)  # fmt: skip
NOT_CONVERGED = RULES.add("not converged", "convergence", Grade.NOT_USABLE,
    condition="the equilibrium start was not found, or steps did not converge",
    why="the result starts from, or contains, values that do not satisfy the equations of the system",
    remedy="give a smaller coupling step; the notes say which part did not converge",
)  # fmt: skip
ENDED_EARLY = RULES.add("ended early", "convergence", Grade.NOT_USABLE,
    condition="the run was interrupted, or could not continue",
    why="means, RMS values and spectra are those of a shorter part of the drive than requested",
    remedy="run it again; if the step became too small, allow a smaller step or a larger tolerance",
)  # fmt: skip
CONVERGED = RULES.add("converged", "convergence", Grade.USABLE,
    condition="the equilibrium start was found, every step converged, and the run reached its stop time",
    why="the run is complete",
)  # fmt: skip
MOSTLY_BEYOND_FIT = RULES.add("mostly outside the fitted velocities", "range of the models", Grade.NOT_USABLE,
    condition=f"a shock spends more than {100 * LARGEST_SHARE:g} % of the time outside the velocities that it was "
    "fitted on, or dissipates that share of its energy there",
    why="outside the record the curve is a straight continuation that no measurement supports: if the forces there are "
    "wrong by half, a tenth of the dissipated energy is wrong, which is more than setups of one car differ by",
    remedy="measure the shock at the velocities of this drive and fit it again",
)  # fmt: skip
BEYOND_FIT = RULES.add("outside the fitted velocities", "range of the models", Grade.LIMITED,
    condition=f"the same, above {100 * NOTABLE_SHARE:g} %",
    why="peaks depend on the continuation of the curve; below 1 %, forces that are wrong by half there change the "
    "dissipated energy by less than 0.5 %, which is about how far two runs of one shock on a rig differ",
    remedy="do not use peak forces; measure the shock at the velocities of this drive for more",
)  # fmt: skip
WITHIN_FIT = RULES.add("within the fitted velocities", "range of the models", Grade.USABLE,
    condition=f"at most {100 * NOTABLE_SHARE:g} % of the time and of the energy is outside",
    why="see above",
)  # fmt: skip
UNTESTED_SETTINGS = RULES.add("untested settings of a shock", "settings of the shocks", Grade.UNKNOWN,
    condition="`untested_settings` of a shock is 1 at any time: two or more adjusters, or an adjuster and the "
    "temperature, differ from the reference in a combination that was not measured",
    why="the effects of the adjusters are added there; whether one changes the effect of another is not known",
    remedy="measure the shock at this combination, or run it at a measured one",
)  # fmt: skip
FAR_BEYOND_SETTINGS = RULES.add("far beyond the settings of a shock", "settings of the shocks", Grade.UNKNOWN,
    condition="`beyond_settings` of a shock exceeds 1 at any time: a setting is beyond the measured ones by more than "
    "the nearest interval between them",
    why="adjusters act progressively near their stops; the continuation is a straight line",
    remedy="measure the shock at this setting, or run it at a measured one",
)  # fmt: skip
BEYOND_SETTINGS = RULES.add("beyond the settings of a shock", "settings of the shocks", Grade.LIMITED,
    condition="the same, above 0",
    why="there is no measurement beyond; the curve is continued in a straight line over the setting",
    remedy="measure the shock at this setting for more",
)  # fmt: skip
WITHIN_SETTINGS = RULES.add("within the settings of a shock", "settings of the shocks", Grade.USABLE,
    condition="both stay 0",
    why="the curve is interpolated between measured curves",
)  # fmt: skip
MOSTLY_TIRE_OFF = RULES.add("tire mostly off the ground", "range of the models", Grade.NOT_USABLE,
    condition=f"a tire is below zero load for more than {100 * LARGEST_SHARE:g} % of the time",
    why="a linear car pulls on the road there: the motion of that corner is not real meanwhile",
    remedy="use a smaller drive, or a car model whose tires can lift off",
)  # fmt: skip
TIRE_OFF = RULES.add("tire off the ground", "range of the models", Grade.LIMITED,
    condition="a tire is below zero load at all",
    why="a linear car pulls on the road there",
    remedy="do not use tire forces and motions near these times",
)  # fmt: skip
STATIC_LOAD_UNKNOWN = RULES.add("static tire force not given", "range of the models", Grade.LIMITED,
    condition="a car states no static tire force",
    why="lift-off of a tire cannot be detected, and tire forces are changes about an unknown load",
    remedy="give the car's static tire forces (parameter static_tire_force)",
)  # fmt: skip
MODEL_UNKNOWN = RULES.add("validity of a model unknown", "validity of the models", Grade.UNKNOWN,
    condition="a component does not state the range of validity of its model: an FMU of another tool, or of an older "
    "version of eightpost",
    why="the amplitudes and frequencies for which it is valid, and the quality of its fit, are not known here",
    remedy="ask its maker, and judge its range yourself; rebuild an FMU of eightpost",
)  # fmt: skip
MOSTLY_BEYOND = RULES.add("mostly beyond the fitted amplitudes", ABOUT, Grade.NOT_USABLE,
    condition=f"a variable is beyond the amplitudes of its model's records by more than {100 * MARGIN:g} % for more "
    f"than {100 * LARGEST_SHARE:g} % of the time",
    why="the model is not supported by any measurement there",
    remedy="test at the amplitudes of this drive and fit or identify again, or use a smaller drive",
)  # fmt: skip
BEYOND = RULES.add("beyond the fitted amplitudes", ABOUT, Grade.LIMITED,
    condition=f"the same, for more than {100 * NOTABLE_SHARE:g} % of the time",
    why="peaks depend on an extrapolation",
    remedy="do not use peaks; test at the amplitudes of this drive for more",
)  # fmt: skip
BEYOND_FREQUENCY = RULES.add("beyond the fitted frequencies", ABOUT, Grade.LIMITED,
    condition=f"more than {100 * NOTABLE_POWER:g} % of a variable's power is outside the frequencies of its model's "
    "records",
    why="phase and gain there depend only on the form of the model; the rest of the power is covered",
    remedy="judge setups by measures within the covered band; test at the frequencies of this drive for more",
)  # fmt: skip
COVERED = RULES.add("within the fitted ranges", ABOUT, Grade.USABLE,
    condition="the recorded variables stay within the amplitudes and frequencies of their models' records",
    why="each share is below the limits above",
)  # fmt: skip
CONDITION = RULES.add("conditions of the measurement", "conditions of the models", Grade.USABLE,
    condition="a model states the temperature or the gas pressure of its records",
    why="the model does not depend on them: the result is valid for these conditions",
    remedy="compare with the conditions on the track",
)  # fmt: skip


# ---- Data of a run --------------------------------------------------------------------------------------------------


@runtime_checkable
class _Described(Protocol):
    """Component that states the range of validity of its model."""

    @property
    def validity(self) -> Validity | None:
        """Range of validity; None if the component states none."""


@dataclass(frozen=True, slots=True)
class Model:
    """Component with the information that the verdict uses."""

    validity: Validity | None  #: Range of validity that the FMU states; None if it states none.
    source: str  #: File of the FMU.
    #: Recorded channel of each variable that has a range, and the factor from the channel to the variable.
    channels: Mapping[str, tuple[str, float]]


@dataclass(frozen=True, slots=True)
class Coupled:
    """Local errors of the values that the ends of one bond assumed of each other, root mean squares in SI."""

    velocity_error: float  #: Local error of the velocity given to the shock [m/s].
    velocity_spread: float  #: Standard deviation of that velocity [m/s].
    force_error: float  #: Local error of the force given to the vehicle [N].
    force_spread: float  #: Standard deviation of that force [N].
    velocity_scale: float  #: Scale of the velocity's error [m/s]; see cosim.session.result.judged_by.
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
        return abs(self.relative) <= LARGEST_RESIDUAL


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
    #: (cosim.session.result.scales) after settling; empty if only one run was made.
    stated_error: Mapping[str, float] = field(default_factory=dict)
    scheme: str = ""  #: Algorithm that the default chose; empty if an algorithm was given.
    has_loop: bool = False  #: Whether connections form a loop of components.
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
        return not self.partial and self.unsettled_steps == 0 and local <= LARGEST_ERROR

    def settled(self) -> TimeSeries:
        """Return the series without the settling time; the whole series if the run ended within it."""
        last = float(self.series.time[-1])
        return self.series.window(self.settling, last) if 0.0 < self.settling < last else self.series


# ---- Reasons from the ranges of the models --------------------------------------------------------------------------


def models_of(system: System, recorded: Iterable[str]) -> dict[str, Model]:
    """Return the components of a system with the information that the verdict uses.

    Args:
        system: Components and connections.
        recorded: Recorded channels, as `component.variable`.
    """
    names = frozenset(recorded)
    fed = {c.target: (c.source, c.gain) for c in system.all_connections if c.target not in system.sums}
    models = {}
    for name, component in system.components.items():
        validity = component.validity if isinstance(component, _Described) else None
        variables = {covered.variable for covered in validity.ranges} if validity else set[str]()
        channels = {variable: _channel(f"{name}.{variable}", fed, names) for variable in variables}
        recorded_channels = {variable: channel for variable, channel in channels.items() if channel is not None}
        models[name] = Model(validity, component.source, recorded_channels)
    return models


def _channel(name: str, fed: Mapping[str, tuple[str, float]], recorded: frozenset[str]) -> tuple[str, float] | None:
    """Return the recorded channel of a variable, and the factor from the channel to the variable."""
    if name in recorded:
        return name, 1.0
    source, gain = fed.get(name, ("", 1.0))
    return (source, gain) if source in recorded else None


def model_reasons(models: Mapping[str, Model], series: TimeSeries) -> Iterator[Reason]:
    """Yield the reasons that follow from the models themselves, and from their ranges.

    Args:
        models: Models by component.
        series: Series of the run without its settling time.
    """
    even = series if len(series) < _FEWEST or series.is_uniform else series.resample(series.sample_rate)
    for name, model in models.items():
        if model.validity is None:
            text = "the range of validity of the component's model is not known to this program"
            yield MODEL_UNKNOWN.reason(text, figure="0 ranges stated", origin=f"component {name} ({model.source})")
            continue
        origin = f"{name} ({model.source})"
        for reason in model.validity.verdict.reasons:
            yield replace(reason, origin=f"{model.source}: {reason.origin}")
        yield from _ranges(model, even, origin)


def _ranges(model: Model, series: TimeSeries, origin: str) -> Iterator[Reason]:
    assert model.validity is not None
    reasons = list[Reason]()
    examined = 0
    for covered in model.validity.ranges:
        if covered.kind == "condition":
            figure = f"{covered.variable} {covered}"
            yield CONDITION.reason("the result is valid for the conditions of the fit", figure=figure, origin=origin)
        elif covered.variable in model.channels and len(series) >= _FEWEST:
            examined += 1
            channel, factor = model.channels[covered.variable]
            reasons += _left(covered, factor * series[channel], series.sample_rate, origin)
    if examined and not reasons:
        figure = f"{examined} ranges, exceeded for less than {NOTABLE_SHARE:.0%} of the time"
        yield COVERED.reason("the run stays within the ranges of the model's records", figure=figure, origin=origin)
    yield from reasons


def _left(covered: Range, values: np.ndarray, rate: float, origin: str) -> Iterator[Reason]:
    """Yield a reason if values are outside a range."""
    if covered.kind == "frequency":
        share = _power_outside(values, rate, covered)
        if share > NOTABLE_POWER:
            figure = f"{covered.variable}: {share:.0%} of the power outside {covered}; limit {NOTABLE_POWER:.0%}"
            yield BEYOND_FREQUENCY.reason("the run leaves the frequencies of the records", figure=figure, origin=origin)
        return
    share = _time_outside(values, covered)
    if share > NOTABLE_SHARE:
        rule = BEYOND if share <= LARGEST_SHARE else MOSTLY_BEYOND
        limits = f"limits {NOTABLE_SHARE:.0%} and {LARGEST_SHARE:.0%}"
        figure = f"{covered.variable}: {share:.1%} of the time beyond {covered} about the mean; {limits}"
        yield rule.reason("the run leaves the amplitudes of the records", figure=figure, origin=origin)


def _time_outside(values: np.ndarray, covered: Range) -> float:
    """Return the share of samples (N,) that are farther from their mean than the records were from their own mean."""
    if covered.variable.rpartition(".")[2] == "velocity":
        low, high = covered.low, covered.high  # velocities are about zero
        middle = 0.0
    else:
        middle = 0.5 * (covered.low + covered.high)
        low, high = covered.low - middle, covered.high - middle
        middle = float(values.mean())
    beyond = (values - middle > (1.0 + MARGIN) * high) | (values - middle < (1.0 + MARGIN) * low)
    return float(np.mean(beyond))


def _power_outside(values: np.ndarray, rate: float, covered: Range) -> float:
    """Return the share of the power of values (N,) about their mean that is outside a range of frequencies."""
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    lines = np.fft.rfftfreq(values.size, 1.0 / rate)
    total = float(power.sum())
    return float(power[(lines < covered.low) | (lines > covered.high)].sum()) / total if total else 0.0


# ==== Reasons from limits that are watched at every step: velocities, settings, tires off the ground =================


def limit_reasons(run: RunData) -> Iterator[Reason]:
    """Yield the reasons from the shares of time beyond the limits of shocks and tires."""
    yield from _fitted(run)
    yield from _settings(run)
    yield from _tires(run)


def _fitted(run: RunData) -> Iterator[Reason]:
    for shock, time in run.share_beyond_fit.items():
        energy = _energy_beyond(run, shock)
        share = max(time, energy or 0.0)
        beyond = BEYOND_FIT if share <= LARGEST_SHARE else MOSTLY_BEYOND_FIT
        rule, within = (WITHIN_FIT, "stays within") if share <= NOTABLE_SHARE else (beyond, "leaves")
        dissipated = "" if energy is None else f", {energy:.1%} of its energy"
        yield rule.reason(
            f"the shock {within} the velocities that it was fitted on",
            figure=f"outside {time:.1%} of the time{dissipated}; limits {NOTABLE_SHARE:.0%} and {LARGEST_SHARE:.0%}",
            origin=f"component {shock}",
        )


def _settings(run: RunData) -> Iterator[Reason]:
    """Yield the reasons about the settings of shocks that have them."""
    for shock, beyond in run.share_beyond_settings.items():
        far = run.share_far_beyond_settings.get(shock, 0.0)
        untested = run.share_untested_settings.get(shock, 0.0)
        origin = f"component {shock}"
        if beyond > 0.0:
            yield (FAR_BEYOND_SETTINGS if far > 0.0 else BEYOND_SETTINGS).reason(
                "the shock is set beyond the settings that were measured",
                figure=f"{beyond:.0%} of the time, by more than an interval between measured settings {far:.0%}",
                origin=origin,
            )
        if untested > 0.0:
            figure = f"{untested:.0%} of the time"
            yield UNTESTED_SETTINGS.reason(
                "the shock is at a combination of settings that was not measured", figure=figure, origin=origin
            )
        if not beyond and not untested:
            figure = "0 % of the time beyond or at an untested combination"
            yield WITHIN_SETTINGS.reason("the shock is at measured settings", figure=figure, origin=origin)


def _energy_beyond(run: RunData, shock: str) -> float | None:
    """Return the share of a shock's dissipated energy outside its fitted velocities; None if not recorded."""
    names = (f"{shock}.dissipated_power", f"{shock}.beyond_fit")
    if not set(names) <= set(run.series.names):
        return None
    settled = run.settled()
    power, beyond = (abs(settled[name]) for name in names)
    total = float(power.sum())
    return float(power[beyond > 0.5].sum()) / total if total else 0.0


def _tires(run: RunData) -> Iterator[Reason]:
    for tire, off in run.share_tire_off.items():
        if off is None:
            yield STATIC_LOAD_UNKNOWN.reason(
                "lift-off of tires cannot be detected: no static tire force is given", figure="0 N", origin=tire
            )
        elif off > 0.0:
            rule = TIRE_OFF if off <= LARGEST_SHARE else MOSTLY_TIRE_OFF
            figure = f"{off:.1%} of the time; limit {LARGEST_SHARE:.0%}"
            yield rule.reason("a tire is off the ground", figure=figure, origin=tire)


# ==== Verdict: coupling error, energy, convergence, and the limits of the models =====================================


def verdict_of(run: RunData) -> Verdict:
    """Return the verdict on a run."""
    return Verdict(
        (
            *_coupling(run),
            *_energy(run),
            *_convergence(run),
            *limit_reasons(run),
            *model_reasons(run.models, run.settled()),
        )
    )


def _coupling(run: RunData) -> Iterator[Reason]:
    yield from _local(run)
    errors = run.stated_error
    decisive = {name: error for name, error in errors.items() if name in run.decisive} or errors
    if not decisive or not all(map(isfinite, decisive.values())):
        yield _not_stated(run)
        return
    yield _stated(run, *max(decisive.items(), key=lambda item: item[1]))
    others = {name: e for name, e in errors.items() if name not in decisive and e > LARGEST_ERROR}
    if others:
        name = max(others, key=lambda each: others[each])
        yield CHANNEL_ERROR.reason(
            f"the coupling error of {len(others)} other channel{'' if len(others) == 1 else 's'} is too large; "
            f"largest: {name}",
            figure=f"{_percent(others[name])}; limit {LARGEST_ERROR:g} %",
            origin="coupling error per channel",
        )


def _local(run: RunData) -> Iterator[Reason]:
    for bond, coupled in run.coupled.items():
        if not coupled.percent <= LARGEST_ERROR:
            yield LOCAL_ERROR.reason(
                "the values that the ends of a bond assume of each other are wrong in every step",
                figure=f"{_percent(coupled.percent)} of the scale; limit {LARGEST_ERROR:g} %",
                origin=f"bond {bond}",
            )


def _not_stated(run: RunData) -> Reason:
    if not (run.energy or run.coupled or run.has_loop):
        return COUPLING_NONE.reason("there is no coupling loop", figure="0 bonds", origin="the system")
    return COUPLING_UNKNOWN.reason(
        "the coupling error is not stated",
        figure=f"known for 0 of {len(run.series.names)} channels",
        origin=f"{run.algorithm} at {1e3 * run.step:g} ms",
    )


def _stated(run: RunData, name: str, error: float) -> Reason:
    limit = run.tolerance or GOOD_ERROR
    origin = f"channel {name}, {run.scheme or run.algorithm} at {1e3 * run.step:g} ms"
    if error > LARGEST_ERROR:
        figure = f"{_percent(error)} of the scale; limit {LARGEST_ERROR:g} %"
        return COUPLING_ERROR.reason("the coupling error is too large", figure=figure, origin=origin)
    named = "tolerance" if run.tolerance else "good up to"
    figure = f"{_percent(error)} of the scale; {named} {limit:g} %"
    if error > limit:
        return COUPLING_TOLERANCE.reason("the coupling error is larger than requested", figure=figure, origin=origin)
    return COUPLING_GOOD.reason("the coupling error is small", figure=figure, origin=origin)


def _energy(run: RunData) -> Iterator[Reason]:
    shares = {bond: abs(energy.relative) for bond, energy in run.energy.items()}
    bad = {bond: share for bond, share in shares.items() if not share <= DOUBTFUL_RESIDUAL}
    for bond, share in bad.items():
        rule = ENERGY_DOUBTFUL if share <= LARGEST_RESIDUAL else ENERGY_RESIDUAL
        yield rule.reason(
            "the coupling adds or loses energy",
            figure=f"{share:.2%} of the energy transferred; limit {LARGEST_RESIDUAL:.0%}",
            origin=f"bond {bond}",
        )
    if shares and not bad:
        worst = max(shares, key=lambda bond: shares[bond])
        yield ENERGY_GOOD.reason(
            "the coupling conserves energy",
            figure=f"{shares[worst]:.2%}; limit {LARGEST_RESIDUAL:.0%}",
            origin=f"bond {worst}",
        )


def _convergence(run: RunData) -> Iterator[Reason]:
    end = f"{float(run.series.time[-1]):g} s" if len(run.series) else "0 s"
    if run.partial:
        yield ENDED_EARLY.reason("the run ended early", figure=f"at {end}", origin=run.algorithm)
    if not run.converged:
        notes = run.notes[0] if run.notes else "no note"
        yield NOT_CONVERGED.reason("the run did not converge", figure=notes, origin=run.algorithm)
    if run.converged and not run.partial:
        figure = f"{run.steps} steps, {end}"
        yield CONVERGED.reason("the run reached its stop time", figure=figure, origin="the run")


def _percent(value: float) -> str:
    return f"{value:.2g} %" if abs(value) < 10.0 else f"{value:.0f} %"
