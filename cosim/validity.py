"""What the models of a system say of themselves, and how far a run kept to the ranges that they cover."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from eightpost.signals import TimeSeries
from eightpost.validity import Range, Validity
from eightpost.verdict import Grade, Reason, Rule

if TYPE_CHECKING:
    from cosim.system import System

ABOUT = "range of the models"

#: Shares of time or energy beyond a limit of a model: from the first on it is said, from the second on the result is
#: not usable.
NOTABLE_SHARE, LARGEST_SHARE = 0.01, 0.20

#: A record covers its own amplitudes and this share more.
MARGIN = 0.1

#: Fewer samples say nothing of a range.
_FEWEST = 10

#: Share of the power beyond the frequencies of the records from which it is said.
NOTABLE_POWER = 0.10

MODEL_UNKNOWN = Rule(
    "validity of a model unknown", "validity of the models", Grade.UNKNOWN,
    condition="a component does not say how far its model can be used: an FMU of another maker, or of an older version "
    "of eightpost",
    why="for what amplitudes and frequencies it holds, and how well it was fitted, is not known to this program",
    remedy="ask its maker, and judge its range yourself; build an FMU of eightpost again",
)  # fmt: skip
MOSTLY_BEYOND = Rule(
    "mostly beyond the fitted amplitudes", ABOUT, Grade.NOT_USABLE,
    condition=f"a variable is beyond the amplitudes of its model's records by more than {100 * MARGIN:g} % for more "
    f"than {100 * LARGEST_SHARE:g} % of the time",
    why="the model says nothing there that was ever measured",
    remedy="test at the amplitudes of this drive and fit or identify again, or use a smaller drive",
)  # fmt: skip
BEYOND = Rule(
    "beyond the fitted amplitudes", ABOUT, Grade.LIMITED,
    condition=f"the same, for more than {100 * NOTABLE_SHARE:g} % of the time",
    why="peaks rest on an extrapolation",
    remedy="do not use peaks; test at the amplitudes of this drive for more",
)  # fmt: skip
BEYOND_FREQUENCY = Rule(
    "beyond the fitted frequencies", ABOUT, Grade.LIMITED,
    condition=f"more than {100 * NOTABLE_POWER:g} % of a velocity's power is outside the frequencies of its model's "
    "records",
    why="phase and gain there rest on the form of the model alone; the rest of the power is covered",
    remedy="judge setups by measures within the covered band; test at the frequencies of this drive for more",
)  # fmt: skip
COVERED = Rule(
    "within the fitted ranges", ABOUT, Grade.USABLE,
    condition="the recorded variables keep to the amplitudes and frequencies of their models' records",
    why="each share is below the limits above",
    remedy="nothing",
)  # fmt: skip
CONDITION = Rule(
    "conditions of the measurement", "conditions of the models", Grade.USABLE,
    condition="a model states the temperature or the gas pressure of its records",
    why="the model does not follow them: the result holds for these conditions",
    remedy="compare with the conditions on the track",
)  # fmt: skip

RULES: tuple[Rule, ...] = tuple(value for value in list(globals().values()) if isinstance(value, Rule))


@runtime_checkable
class Described(Protocol):
    """A component that says how far its model can be used."""

    @property
    def validity(self) -> Validity | None:
        """What it says; None where it says nothing."""


@dataclass(frozen=True, slots=True)
class Model:
    """A component as the verdict sees it.

    Args:
        validity: Range of use that the FMU states; None where it states none.
        source: File of the FMU.
        channels: Recorded channel of each of its variables that has a range, and the factor from one to the other.
    """

    validity: Validity | None
    source: str
    channels: Mapping[str, tuple[str, float]]


def models_of(system: System, recorded: Iterable[str]) -> dict[str, Model]:
    """Return the components of a system as the verdict sees them.

    Args:
        system: Components and connections.
        recorded: Recorded channels, as `component.variable`.
    """
    names = frozenset(recorded)
    fed = {c.target: (c.source, c.gain) for c in system.all_connections if c.target not in system.sums}
    found = {}
    for name, component in system.components.items():
        validity = component.validity if isinstance(component, Described) else None
        known = {covered.variable for covered in validity.ranges} if validity else set[str]()
        channels = {variable: _channel(f"{name}.{variable}", fed, names) for variable in known}
        kept = {variable: channel for variable, channel in channels.items() if channel is not None}
        found[name] = Model(validity, component.source, kept)
    return found


def _channel(name: str, fed: Mapping[str, tuple[str, float]], recorded: frozenset[str]) -> tuple[str, float] | None:
    """Return the recorded channel that a variable is in, and the factor from the channel to it."""
    if name in recorded:
        return name, 1.0
    source, gain = fed.get(name, ("", 1.0))
    return (source, gain) if source in recorded else None


def model_reasons(models: Mapping[str, Model], series: TimeSeries) -> Iterator[Reason]:
    """Yield what models say of themselves, and how far a run kept to their ranges.

    Args:
        models: By component.
        series: The settled run.
    """
    even = series if len(series) < _FEWEST or series.is_uniform else series.resample(series.sample_rate)
    for name, model in models.items():
        if model.validity is None:
            said = "how far the component's model can be used is not known to this program"
            yield MODEL_UNKNOWN.reason(said, figure="0 ranges stated", origin=f"component {name} ({model.source})")
            continue
        origin = f"{name} ({model.source})"
        for reason in model.validity.verdict.reasons:
            yield replace(reason, origin=f"{model.source}: {reason.origin}")
        yield from _ranges(model, even, origin)


def _ranges(model: Model, series: TimeSeries, origin: str) -> Iterator[Reason]:
    assert model.validity is not None
    found = list[Reason]()
    examined = 0
    for covered in model.validity.ranges:
        if covered.kind == "condition":
            figure = f"{covered.variable} {covered}"
            yield CONDITION.reason("the result holds for the conditions of the fit", figure=figure, origin=origin)
        elif covered.variable in model.channels and len(series) >= _FEWEST:
            examined += 1
            found += _left(covered, *_values(model, covered, series), origin)
    if examined and not found:
        figure = f"{examined} ranges, left for less than {NOTABLE_SHARE:.0%} of the time"
        yield COVERED.reason("the run keeps to the ranges of the model's records", figure=figure, origin=origin)
    yield from found


def _values(model: Model, covered: Range, series: TimeSeries) -> tuple[np.ndarray, float]:
    channel, factor = model.channels[covered.variable]
    return factor * series[channel], series.sample_rate


def _left(covered: Range, values: np.ndarray, rate: float, origin: str) -> Iterator[Reason]:
    """Yield a reason where values leave a range."""
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
    """Return the share of samples (N,) that are farther from their mean than the records were from theirs."""
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
