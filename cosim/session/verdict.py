"""Data of a run, and the rules by which it is judged: coupling, energy, convergence, range of the models."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from cosim.systems.system import System
from eightpost.signals import TimeSeries
from eightpost.validity import Range, Validity
from eightpost.verdict import Reason, Rules, Verdict

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

RULES = Rules.read(
    Path(__file__).with_suffix(".txt"), largest_error=LARGEST_ERROR, good_error=GOOD_ERROR,
    largest_residual=100 * LARGEST_RESIDUAL, doubtful_residual=100 * DOUBTFUL_RESIDUAL,
    largest_share=100 * LARGEST_SHARE, notable_share=100 * NOTABLE_SHARE, margin=100 * MARGIN,
    notable_power=100 * NOTABLE_POWER,
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


# ---- Reasons as rows: rule, statement, figure, origin ---------------------------------------------------------------

_Rows = Iterator[tuple[str, str, str, str]]


def verdict_of(run: RunData) -> Verdict:
    """Return the verdict on a run: coupling error, energy, convergence, and the limits of the models."""
    rows = (*_coupling(run), *_energy(run), *_convergence(run), *_fitted(run), *_settings(run), *_tires(run))
    return Verdict((*(RULES.reason(*row) for row in rows), *_model_reasons(run.models, run.settled())))


def _coupling(run: RunData) -> _Rows:
    for bond, coupled in run.coupled.items():
        if not coupled.percent <= LARGEST_ERROR:
            statement = "the values that the ends of a bond assume of each other are wrong in every step"
            figure = f"{_percent(coupled.percent)} of the scale; limit {LARGEST_ERROR:g} %"
            yield "local error of a bond", statement, figure, f"bond {bond}"
    errors = run.stated_error
    decisive = {name: error for name, error in errors.items() if name in run.decisive} or errors
    if not decisive or not all(map(isfinite, decisive.values())):
        if run.energy or run.coupled or run.has_loop:
            figure, origin = f"known for 0 of {len(run.series.names)} channels", f"{run.algorithm} at {_step(run)}"
            yield "coupling error not stated", "the coupling error is not stated", figure, origin
        else:
            yield "nothing is coupled", "there is no coupling loop", "0 bonds", "the system"
        return
    yield _stated(run, *max(decisive.items(), key=lambda item: item[1]))
    others = {name: e for name, e in errors.items() if name not in decisive and e > LARGEST_ERROR}
    if others:
        name = max(others, key=lambda each: others[each])
        count = f"{len(others)} other channel{'' if len(others) == 1 else 's'}"
        statement = f"the coupling error of {count} is too large; largest: {name}"
        figure = f"{_percent(others[name])}; limit {LARGEST_ERROR:g} %"
        yield "coupling error of other channels", statement, figure, "coupling error per channel"


def _stated(run: RunData, name: str, error: float) -> tuple[str, str, str, str]:
    limit = run.tolerance or GOOD_ERROR
    origin = f"channel {name}, {run.scheme or run.algorithm} at {_step(run)}"
    if error > LARGEST_ERROR:
        figure = f"{_percent(error)} of the scale; limit {LARGEST_ERROR:g} %"
        return "coupling error too large", "the coupling error is too large", figure, origin
    figure = f"{_percent(error)} of the scale; {'tolerance' if run.tolerance else 'good up to'} {limit:g} %"
    if error > limit:
        return "coupling tolerance not met", "the coupling error is larger than requested", figure, origin
    return "coupling error small", "the coupling error is small", figure, origin


def _energy(run: RunData) -> _Rows:
    shares = {bond: abs(energy.relative) for bond, energy in run.energy.items()}
    bad = {bond: share for bond, share in shares.items() if not share <= DOUBTFUL_RESIDUAL}
    for bond, share in bad.items():
        rule = "energy residual notable" if share <= LARGEST_RESIDUAL else "energy residual too large"
        figure = f"{share:.2%} of the energy transferred; limit {LARGEST_RESIDUAL:.0%}"
        yield rule, "the coupling adds or loses energy", figure, f"bond {bond}"
    if shares and not bad:
        worst = max(shares, key=lambda bond: shares[bond])
        figure = f"{shares[worst]:.2%}; limit {LARGEST_RESIDUAL:.0%}"
        yield "energy residual small", "the coupling conserves energy", figure, f"bond {worst}"


def _convergence(run: RunData) -> _Rows:
    end = f"{float(run.series.time[-1]):g} s" if len(run.series) else "0 s"
    if run.partial:
        yield "ended early", "the run ended early", f"at {end}", run.algorithm
    if not run.converged:
        yield "not converged", "the run did not converge", run.notes[0] if run.notes else "no note", run.algorithm
    if run.converged and not run.partial:
        yield "converged", "the run reached its stop time", f"{run.steps} steps, {end}", "the run"


def _percent(value: float) -> str:
    return f"{value:.2g} %" if abs(value) < 10.0 else f"{value:.0f} %"


def _step(run: RunData) -> str:
    return f"{1e3 * run.step:g} ms"


# ---- Reasons from limits that are watched at every step: velocities, settings, tires off the ground -----------------


def _fitted(run: RunData) -> _Rows:
    for shock, time in run.share_beyond_fit.items():
        energy = _energy_beyond(run, shock)
        share = max(time, energy or 0.0)
        rule, within = "mostly outside the fitted velocities", "leaves"
        if share <= NOTABLE_SHARE:
            rule, within = "within the fitted velocities", "stays within"
        elif share <= LARGEST_SHARE:
            rule = "outside the fitted velocities"
        dissipated = "" if energy is None else f", {energy:.1%} of its energy"
        figure = f"outside {time:.1%} of the time{dissipated}; limits {NOTABLE_SHARE:.0%} and {LARGEST_SHARE:.0%}"
        yield rule, f"the shock {within} the velocities that it was fitted on", figure, f"component {shock}"


def _energy_beyond(run: RunData, shock: str) -> float | None:
    """Return the share of a shock's dissipated energy outside its fitted velocities; None if not recorded."""
    names = (f"{shock}.dissipated_power", f"{shock}.beyond_fit")
    if not set(names) <= set(run.series.names):
        return None
    settled = run.settled()
    power, beyond = (abs(settled[name]) for name in names)
    total = float(power.sum())
    return float(power[beyond > 0.5].sum()) / total if total else 0.0


def _settings(run: RunData) -> _Rows:
    for shock, beyond in run.share_beyond_settings.items():
        far = run.share_far_beyond_settings.get(shock, 0.0)
        untested = run.share_untested_settings.get(shock, 0.0)
        origin = f"component {shock}"
        if beyond > 0.0:
            rule = "far beyond the settings of a shock" if far > 0.0 else "beyond the settings of a shock"
            figure = f"{beyond:.0%} of the time, by more than an interval between measured settings {far:.0%}"
            yield rule, "the shock is set beyond the settings that were measured", figure, origin
        if untested > 0.0:
            statement = "the shock is at a combination of settings that was not measured"
            yield "untested settings of a shock", statement, f"{untested:.0%} of the time", origin
        if not beyond and not untested:
            figure = "0 % of the time beyond or at an untested combination"
            yield "within the settings of a shock", "the shock is at measured settings", figure, origin


def _tires(run: RunData) -> _Rows:
    for tire, off in run.share_tire_off.items():
        if off is None:
            statement = "lift-off of tires cannot be detected: no static tire force is given"
            yield "static tire force not given", statement, "0 N", tire
        elif off > 0.0:
            rule = "tire off the ground" if off <= LARGEST_SHARE else "tire mostly off the ground"
            yield rule, "a tire is off the ground", f"{off:.1%} of the time; limit {LARGEST_SHARE:.0%}", tire


# ---- Reasons from the ranges of the models --------------------------------------------------------------------------


def models_of(system: System, recorded: Iterable[str]) -> dict[str, Model]:
    """Return the components of a system with the information that the verdict uses.

    Args:
        system: Components and connections.
        recorded: Recorded channels, as `component.variable`.
    """
    own = {name: (name, 1.0) for name in recorded}
    fed = {c.target: (c.source, c.gain) for c in system.all_connections if c.target not in system.sums}
    channels = {target: channel for target, channel in fed.items() if channel[0] in own} | own
    models = {}
    for name, component in system.components.items():
        validity = component.validity if isinstance(component, _Described) else None
        variables = {covered.variable for covered in validity.ranges} if validity else set[str]()
        known = {v: channels[f"{name}.{v}"] for v in variables if f"{name}.{v}" in channels}
        models[name] = Model(validity, component.source, known)
    return models


def _model_reasons(models: Mapping[str, Model], series: TimeSeries) -> Iterator[Reason]:
    """Yield the reasons that follow from the models themselves, and from their ranges."""
    even = series if len(series) < _FEWEST or series.is_uniform else series.resample(series.sample_rate)
    for name, model in models.items():
        origin = f"{name} ({model.source})"
        if model.validity is None:
            statement = "the range of validity of the component's model is not known to this program"
            yield RULES.reason("validity of a model unknown", statement, "0 ranges stated", f"component {origin}")
            continue
        for reason in model.validity.verdict.reasons:
            yield replace(reason, origin=f"{model.source}: {reason.origin}")
        yield from (RULES.reason(*row, origin) for row in _ranges(model, model.validity, even))


def _ranges(model: Model, validity: Validity, series: TimeSeries) -> Iterator[tuple[str, str, str]]:
    """Yield rule, statement and figure for the ranges of a model: those left last, or one reason if none is."""
    left, examined = list[tuple[str, str, str]](), 0
    for covered in validity.ranges:
        if covered.kind == "condition":
            statement = "the result is valid for the conditions of the fit"
            yield "conditions of the measurement", statement, f"{covered.variable} {covered}"
        elif covered.variable in model.channels and len(series) >= _FEWEST:
            examined += 1
            channel, factor = model.channels[covered.variable]
            left += _left(covered, factor * series[channel], series.sample_rate)
    if examined and not left:
        figure = f"{examined} ranges, exceeded for less than {NOTABLE_SHARE:.0%} of the time"
        yield "within the fitted ranges", "the run stays within the ranges of the model's records", figure
    yield from left


def _left(covered: Range, values: np.ndarray, rate: float) -> Iterator[tuple[str, str, str]]:
    """Yield a reason if values are outside a range: of frequencies, or of amplitudes."""
    if covered.kind == "frequency":
        share = _power_outside(values, rate, covered)
        if share > NOTABLE_POWER:
            figure = f"{covered.variable}: {share:.0%} of the power outside {covered}; limit {NOTABLE_POWER:.0%}"
            yield "beyond the fitted frequencies", "the run leaves the frequencies of the records", figure
        return
    share = _time_outside(values, covered)
    if share > NOTABLE_SHARE:
        rule = "beyond the fitted amplitudes" if share <= LARGEST_SHARE else "mostly beyond the fitted amplitudes"
        limits = f"limits {NOTABLE_SHARE:.0%} and {LARGEST_SHARE:.0%}"
        figure = f"{covered.variable}: {share:.1%} of the time beyond {covered} about the mean; {limits}"
        yield rule, "the run leaves the amplitudes of the records", figure


def _time_outside(values: np.ndarray, covered: Range) -> float:
    """Return the share of samples (N,) that are farther from their mean than the records were from their own mean."""
    middle, expected = 0.0, 0.0  # velocities are about zero
    if covered.variable.rpartition(".")[2] != "velocity":
        middle, expected = float(values.mean()), 0.5 * (covered.low + covered.high)
    low, high = covered.low - expected, covered.high - expected
    beyond = (values - middle > (1.0 + MARGIN) * high) | (values - middle < (1.0 + MARGIN) * low)
    return float(np.mean(beyond))


def _power_outside(values: np.ndarray, rate: float, covered: Range) -> float:
    """Return the share of the power of values (N,) about their mean that is outside a range of frequencies."""
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    lines = np.fft.rfftfreq(values.size, 1.0 / rate)
    total = float(power.sum())
    return float(power[(lines < covered.low) | (lines > covered.high)].sum()) / total if total else 0.0
