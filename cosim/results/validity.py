"""Range of validity of the models of a system, and how far a run stayed within it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from cosim.systems.system import System
from eightpost.signals import TimeSeries
from eightpost.validity import Range, Validity
from eightpost.verdict import Grade, Reason, Rules

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

RULES = Rules()

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
        known = {covered.variable for covered in validity.ranges} if validity else set[str]()
        channels = {variable: _channel(f"{name}.{variable}", fed, names) for variable in known}
        kept = {variable: channel for variable, channel in channels.items() if channel is not None}
        models[name] = Model(validity, component.source, kept)
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
            reasons += _left(covered, *_values(model, covered, series), origin)
    if examined and not reasons:
        figure = f"{examined} ranges, exceeded for less than {NOTABLE_SHARE:.0%} of the time"
        yield COVERED.reason("the run stays within the ranges of the model's records", figure=figure, origin=origin)
    yield from reasons


def _values(model: Model, covered: Range, series: TimeSeries) -> tuple[np.ndarray, float]:
    channel, factor = model.channels[covered.variable]
    return factor * series[channel], series.sample_rate


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
