"""Linearity of a car on the rig: coherence against response energy, and changes with the amplitude (6.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy.stats import beta

from eightpost.array_types import Array, Complex
from eightpost.corners import channel
from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident.preparation import Prepared
from eightpost.ident.vehicle.estimators import LocalPolynomial
from eightpost.ident.vehicle.experiment import Record, Records
from eightpost.signals import TimeSeries
from eightpost.vehicle.statespace import Channel

# ==== Inputs that move alone in a test ===============================================================================

#: An actuator is at rest below this fraction of the largest of its kind in the same test [1] ...
RESTING = 0.2
#: ... or below this fraction of the largest of its kind in any test [1].
SMALLEST = 0.03

#: A command below this fraction of the actuator's motion is ignored [1].
COMMANDED = 0.01

#: A channel is white noise if its steps exceed this multiple of its size; exactly white noise has 1.41 [1].
WHITE = 1.2

#: Drives of two tests are equal if they differ by less than this fraction of their size [1].
SAME_DRIVE = 0.1

#: A change of the force difference below this fraction of the force is run-to-run variation [1].
REPEATED = 0.1

#: A shock is unchanged if its change of force is below this fraction of the largest change [1].
UNCHANGED = 0.5

_LOADS = ("aero_force", "heave_force", "roll_moment", "pitch_moment")


class Excitation(NamedTuple):
    """Input that moves alone, with the outputs."""

    test: str  #: Name of the test.
    channel: Channel  #: Input channel.
    u: Array  #: Input (N,).
    y: Array  #: Outputs (p, N).
    outputs: tuple[Channel, ...]  #: Output channels.
    rate: float  #: Sample rate [Hz].


class _ExcitationList(NamedTuple):
    """Excitations, with notes on the tests that are omitted."""

    excitations: tuple[Excitation, ...]
    notes: tuple[str, ...]


def excitations(prepared: Prepared, outputs: Sequence[str]) -> _ExcitationList:
    """Return an excitation for every input that moves alone.

    A test in which one actuator moves is used directly. If a test has the drive of an earlier one and another shock at
    one corner, the input is that shock's change of force and the outputs are their changes (4.24 to 4.26).

    Args:
        prepared: Prepared records; they must be synchronised if shocks are compared.
        outputs: Names of the outputs.
    """
    inputs = [name for name in prepared.channels if name.endswith((".road", ".aero")) or name in ("road", *_LOADS)]
    moving = _moving(prepared, inputs)
    found: list[Excitation] = []
    notes: list[str] = []
    for number, (name, record) in enumerate(zip(prepared.names, prepared.records, strict=True)):
        same = [k for k in range(number) if moving[k] == moving[number] and _same(record, prepared.records[k], inputs)]
        if not moving[number]:
            notes.append(f"{name}: no actuator moves; omitted")
        elif same:
            baseline = (prepared.names[same[0]], prepared.records[same[0]])
            change = _shock_change(name, record, baseline, prepared.corners)
            if isinstance(change, str):
                notes.append(change)
            else:
                found.append(_shock_excitation(name, record, baseline[1], change, outputs))
        elif len(moving[number]) == 1:
            found.append(_excitation(name, record, moving[number][0], outputs))
        elif moving[number] in moving[:number]:
            first = prepared.names[moving.index(moving[number])]
            notes.append(f"{name}: its drive differs from that of {first}, or is not in step with it; omitted")
    return _ExcitationList(tuple(found), tuple(notes))


def _moving(prepared: Prepared, inputs: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the names of the inputs that move in each test."""
    sizes = [_sizes(record, inputs) for record in prepared.records]
    largest = {kind: max(_of_kind(each, kind) for each in sizes) for kind in {_kind(name) for name in inputs}}
    return [tuple(n for n in inputs if _moves(n, size, largest[_kind(n)])) for size in sizes]


class _Change(NamedTuple):
    """Change of a shock: name of its force, and change of its force difference (N,)."""

    force: str
    values: Array


def _sizes(record: TimeSeries, inputs: Sequence[str]) -> dict[str, float]:
    """Return the standard deviation of each input; 0 if the input is only noise."""
    return {name: float(record[name].std()) if _is_driven(record, name) else 0.0 for name in inputs}


def _is_driven(record: TimeSeries, name: str) -> bool:
    """Return whether an input was driven: its command moves, or without a command it is not white noise."""
    values, command = record[name], f"{name}_command"
    if command in record:
        return bool(record[command].std() > COMMANDED * values.std())
    return bool(np.std(np.diff(values)) < WHITE * values.std())


def _moves(name: str, sizes: Mapping[str, float], largest: float) -> bool:
    return sizes[name] > max(RESTING * _of_kind(sizes, _kind(name)), SMALLEST * largest)


def _of_kind(sizes: Mapping[str, float], kind: str) -> float:
    return max(size for name, size in sizes.items() if _kind(name) == kind)


def _kind(name: str) -> str:
    return name.rpartition(".")[2]


def _excitation(name: str, record: TimeSeries, source: str, outputs: Sequence[str]) -> Excitation:
    chosen = record.select(outputs)
    channel = Channel(source, record.unit(source))
    return Excitation(name, channel, record[source], chosen.values, _channels(chosen), record.sample_rate)


def _same(record: TimeSeries, first: TimeSeries, inputs: Sequence[str]) -> bool:
    """Return whether two tests have the same drive, sample by sample."""
    return len(record) == len(first) and all(
        np.std(record[n] - first[n]) <= SAME_DRIVE * first[n].std() for n in inputs if _is_driven(first, n)
    )


def _shock_change(
    name: str, record: TimeSeries, baseline: tuple[str, TimeSeries], corners: Sequence[str]
) -> _Change | str:
    """Return the change of the shock, or a note on why the test cannot be used."""
    first = baseline[1]
    forces = [channel(corner, "force") for corner in corners]
    velocities = {force: force.removesuffix("force") + "velocity" for force in forces}
    rates = {force: _slope(first[force], first[velocity]) for force, velocity in velocities.items()}
    changes = {force: _change(record, first, force, velocities[force], rates[force]) for force in forces}
    largest = max(changes, key=lambda force: float(changes[force].std()))
    if changes[largest].std() < REPEATED * first[largest].std():
        return f"{name}: repeats {baseline[0]} with the same shocks; omitted"
    smallest = UNCHANGED * changes[largest].std()
    others = [force for force in forces if force != largest and changes[force].std() > smallest]
    if others:
        return f"{name}: {', '.join((largest, *others))} differ from {baseline[0]}; change one shock at a time"
    return _Change(largest, changes[largest])


def _slope(force: Array, velocity: Array) -> float:
    """Return the slope of the best-fit line of force over velocity [N.s/m]: C-bar of 6.3.1."""
    return float(force @ velocity / (velocity @ velocity))


def _change(record: TimeSeries, first: TimeSeries, force: str, velocity: str, rate: float) -> Array:
    """Return the change of the force difference F - c v (Eq 4.24)."""
    now, before = (series[force] - rate * series[velocity] for series in (record, first))
    return np.asarray(now - before, dtype=np.float64)


def _shock_excitation(
    name: str, record: TimeSeries, first: TimeSeries, change: _Change, outputs: Sequence[str]
) -> Excitation:
    now, before = record.select(outputs), first.select(outputs)
    channel = Channel(change.force, record.unit(change.force))
    return Excitation(name, channel, change.values, now.values - before.values, _channels(now), record.sample_rate)


def _channels(series: TimeSeries) -> tuple[Channel, ...]:
    return tuple(Channel(n, u) for n, u in zip(series.names, series.units, strict=True))


def by_input(found: Sequence[Excitation]) -> Mapping[str, tuple[Excitation, ...]]:
    """Return the excitations of each input, in descending order of size."""
    names = dict.fromkeys(each.channel.name for each in found)
    return {
        name: tuple(sorted((e for e in found if e.channel.name == name), key=lambda e: -float(e.u.std())))
        for name in names
    }


# ==== Paths that a linear model can predict (Table 6.4) ==============================================================

# ---- Response, coherence and energy of one input-output pair, as in Figs 6.9 to 6.18 --------------------------------

#: Length of the time response that is kept for plots [s] (Fig 6.9a).
SHOWN = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Response of an output to one input that moves alone."""

    test: str  #: Name of the test.
    input: Channel  #: Input channel.
    output: Channel  #: Output channel.
    frequency: Array  #: Frequencies at which the input has power (K,) [Hz].
    H: Complex  #: Frequency response (K,), output per input unit.
    coherence: Array  #: Coherence (K,) [1].
    variance: Array  #: Variance of H (K,), `E |H - E H|^2`.
    density: Array  #: Power spectral density of the output (K,) [unit2/Hz].
    input_density: Array  #: Power spectral density of the input (K,) [unit2/Hz].
    chance: float  #: Coherence that noise alone exceeds at 5 % of the frequencies [1].
    trace: Array  #: Part of the output for plots (T,).
    rate: float  #: Sample rate of the trace [Hz].

    @property
    def energy(self) -> float:
        """Power of the output over the input's band [unit2]."""
        return float(self.density.sum() * (self.frequency[1] - self.frequency[0]))

    @property
    def mean_coherence(self) -> float:
        """Fraction of the output's power that the input explains linearly [1]."""
        total = float(self.density.sum())
        return float(self.coherence @ self.density) / total if total > 0.0 else 0.0


def paths(excitation: Excitation, recipe: LocalPolynomial) -> tuple[Path, ...]:
    """Return the paths from one input to all outputs.

    They are estimated by local polynomials, because windowed blocks have leakage: with blocks of 4 s a linear quarter
    car has a coherence of 0.83.

    Args:
        excitation: Input and outputs.
        recipe: Estimator, with the width of its bands.

    Raises:
        TooShortError: The record has too few bins.
        TypeError: The recipe does not estimate the coherence.
    """
    record = Record(excitation.u[None], excitation.y)
    response = recipe.estimate(Records((record,), excitation.rate, (excitation.channel,), excitation.outputs))
    coherence, variance = response.coherence, response.variance
    if coherence is None or variance is None:
        raise TypeError(f"{recipe} does not estimate the coherence")
    active = np.isfinite(variance[0, 0])
    source = _density(excitation.u[None], excitation.rate, response.frequency)[0, active]
    densities = _density(excitation.y, excitation.rate, response.frequency)[:, active]
    middle = excitation.u.size // 2
    piece = slice(middle, middle + round(SHOWN * excitation.rate))
    chance = _chance(recipe, excitation.u.size / excitation.rate)
    return tuple(
        Path(
            excitation.test,
            excitation.channel,
            output,
            response.frequency[active],
            response.H[i, 0, active],
            coherence[i, active],
            variance[i, 0, active],
            densities[i],
            source,
            chance,
            excitation.y[i, piece],
            excitation.rate,
        )
        for i, output in enumerate(excitation.outputs)
    )


def _density(values: Array, rate: float, centres: Array) -> Array:
    """Return the power spectral density of values (C, N), averaged over the cells around `centres` (K,)."""
    size = values.shape[1]
    power = np.abs(np.fft.rfft(values)) ** 2 * (2.0 / (rate * size))
    lines = np.arange(power.shape[1]) * (rate / size)
    edges = np.concatenate((centres, [2.0 * centres[-1] - centres[-2]])) - 0.5 * (centres[1] - centres[0])
    starts = np.searchsorted(lines, edges)
    summed = np.concatenate((np.zeros((len(power), 1)), np.cumsum(power, axis=1)), axis=1)
    return np.asarray((summed[:, starts[1:]] - summed[:, starts[:-1]]) / np.diff(starts), dtype=np.float64)


def _chance(recipe: LocalPolynomial, duration: float) -> float:
    """Return the 95 % quantile of the coherence of pure noise, for B complex bins and P unknowns of the polynomials."""
    unknowns = 2 * (recipe.degree + 1)
    smallest = int(np.ceil((recipe.spare * unknowns - 1.0) / 2.0))
    bins = 2 * max(smallest, round((recipe.half_width or 0.0) * duration)) + 1
    left = float(beta.ppf(0.05, bins - unknowns, unknowns))
    return float(max(0.0, 1.0 - left * bins / (bins - unknowns)))


# ---- Conditions of Table 6.4 ----------------------------------------------------------------------------------------


class Condition(Enum):
    """Condition of Table 6.4."""

    I = 1  # noqa: E741  the numeral of the dissertation
    II = 2
    III = 3
    IV = 4

    @property
    def meaning(self) -> str:
        """Explanation of the condition."""
        return _MEANINGS[self]


_MEANINGS = {
    Condition.I: "high response, high coherence: a linear model predicts it",
    Condition.II: "low response, high coherence: a linear model predicts that it is low",
    Condition.III: "high response, low coherence: a linear model cannot predict it",
    Condition.IV: "low response, low coherence: the model's response may be set to a low value",
}


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Thresholds between low and high; 6.2 gives no numbers but calls a coherence of 0.5 low."""

    coherence: float = 0.5  #: Lowest coherence that is high [1].
    level: float = -20.0  #: Lowest level of a response that is high, relative to the output's largest power [dB].

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0.0 < self.coherence < 1.0:
            raise ParameterError(f"the coherence threshold must be between 0 and 1, not {self.coherence:g}")
        if not self.level < 0.0:
            raise ParameterError(f"the level threshold must be below 0 dB, not {self.level:g}")

    def condition(self, coherence: float, level: float) -> Condition:
        """Return the condition of a coherence [1] and a level [dB]."""
        if coherence >= self.coherence:
            return Condition.I if level >= self.level else Condition.II
        return Condition.III if level >= self.level else Condition.IV

    def shares(self, coherence: Array, level: Array, energy: Array) -> dict[Condition, float]:
        """Return the fraction of the energy under each condition.

        Args:
            coherence: Coherence (K,) [1].
            level: Level (K,) [dB].
            energy: Energy (K,), in any scale.
        """
        conditions = [self.condition(float(c), float(db)) for c, db in zip(coherence, level, strict=True)]
        total = float(energy.sum())
        parts = {kind: float(energy[[each is kind for each in conditions]].sum()) for kind in Condition}
        return {kind: part / total if total > 0.0 else 0.0 for kind, part in parts.items()}


# ---- Assessment of linearity by coherence and response energy (6.2), and by changes with the amplitude --------------

#: Default estimator of the responses.
BANDS = LocalPolynomial(half_width=0.25, spacing=0.1, high=25.0)

#: Factor by which two tests of one input must differ to count as different amplitudes [1].
OTHER_SIZE = 1.5

#: A change with the amplitude is notable above this fraction of the response [1] ...
NOTABLE = 0.05
#: ... and above this multiple of the change that noise alone gives [1].
BEYOND_NOISE = 2.0


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on one path."""

    input: str  #: Name of the input.
    output: str  #: Name of the output.
    condition: Condition  #: Condition of Table 6.4 of the whole path.
    coherence: float  #: Mean coherence over the band, weighted by the output's energy [1].
    level: float  #: Energy of the output relative to its largest from any input of the same kind of test [dB].
    #: Fraction of the output's energy under each condition, classified frequency by frequency [1].
    shares: Mapping[Condition, float]


@dataclass(frozen=True, slots=True)
class AmplitudeEffect:
    """Change of a response with the input's amplitude; the response of a linear car does not change.

    Coherence does not detect such a change: friction makes the car stiffer in a small test than in a large one, but
    each test alone is coherent.
    """

    input: str  #: Name of the input.
    output: str  #: Name of the output.
    small: float  #: Standard deviation of the input in the small test, in its unit.
    large: float  #: Standard deviation of the input in the large test, in its unit.
    #: Relative error of the output in the small test if it is predicted with the response of the large test [1].
    change: float
    chance: float  #: Value of `change` that noise alone gives [1].

    @property
    def is_notable(self) -> bool:
        """Whether the response depends on the amplitude by more than noise explains."""
        return self.change > max(NOTABLE, BEYOND_NOISE * self.chance)

    def __str__(self) -> str:
        return (
            f"{self.output} from {self.input}: the response changes by {100.0 * self.change:.1f} % at "
            f"{self.large / self.small:.3g} times the amplitude; noise explains {100.0 * self.chance:.1f} %"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Linearity:
    """Linearity of a car on the rig."""

    paths: tuple[Path, ...]  #: Paths, one per input and output, from the largest test of each input.
    verdicts: tuple[Verdict, ...]  #: Verdicts, one per path, in the same order.
    #: Effects of the amplitude for inputs that have tests with several amplitudes.
    effects: tuple[AmplitudeEffect, ...]
    thresholds: Thresholds  #: Thresholds between low and high.
    notes: tuple[str, ...]  #: Notes on tests that are omitted.

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of the tests."""
        return tuple(dict.fromkeys(path.input.name for path in self.paths))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(dict.fromkeys(path.output.name for path in self.paths))

    def verdict(self, output: str, input: str) -> Verdict:
        """Return the verdict on one path.

        Raises:
            InputError: There is no such path.
        """
        for each in self.verdicts:
            if (each.input, each.output) == (input, output):
                return each
        raise InputError(f"there is no path from {input!r} to {output!r}; the inputs are {', '.join(self.inputs)}")

    def levels(self, path: Path) -> Array:
        """Return the level of a path over frequency (K,), relative to the output's largest density [dB]."""
        return _decibel(path.density, _largest_density(self.paths, path))


def judge_linearity(
    prepared: Prepared,
    *,
    outputs: Sequence[str] = (),
    recipe: LocalPolynomial | None = None,
    thresholds: Thresholds | None = None,
) -> Linearity:
    """Assess every path whose input moves alone in a test (6.2).

    Args:
        prepared: Tests with one actuator each, with one or several amplitudes; or a baseline and tests with one
            changed shock each.
        outputs: Names of the output channels; empty takes shock velocities, tire forces and ride heights.
        recipe: Estimator of the responses; None takes bands of 0.5 Hz, every 0.1 Hz up to 25 Hz.
        thresholds: Thresholds between low and high; None takes the defaults.

    Raises:
        InputError: There is no test in which one input moves alone.
        TooShortError: A record is so short that the coherence of noise exceeds the threshold.
    """
    recipe, thresholds = recipe or BANDS, thresholds or Thresholds()
    found = excitations(prepared, outputs or _key_outputs(prepared.channels))
    if not found.excitations:
        raise InputError(
            "there is no test in which one input moves alone: give tests with one actuator (virtual rig --test "
            f"single), or a baseline and tests of the same drive with one other shock each ({'; '.join(found.notes)})"
        )
    grouped = by_input(found.excitations)
    estimates = {name: [paths(each, recipe) for each in tests] for name, tests in grouped.items()}
    largest = tuple(path for tests in estimates.values() for path in tests[0])
    _check_length(largest, thresholds)
    sizes = {name: [float(each.u.std()) for each in tests] for name, tests in grouped.items()}
    effects = [
        _effect(small, large, sizes[name][i], sizes[name][0])
        for name, tests in estimates.items()
        for i, test in enumerate(tests[1:], start=1)
        if sizes[name][0] > OTHER_SIZE * sizes[name][i]
        for small, large in zip(test, tests[0], strict=True)
    ]
    verdicts = tuple(_verdict(path, largest, thresholds) for path in largest)
    return Linearity(largest, verdicts, tuple(effects), thresholds, found.notes)


def _key_outputs(channels: Sequence[str]) -> tuple[str, ...]:
    """Return the key outputs of section 6.2 among the channels."""
    return tuple(name for name in channels if name.endswith(("velocity", "tire_force", "ride_height")))


def _check_length(found: Sequence[Path], thresholds: Thresholds) -> None:
    for path in found:
        if path.chance > thresholds.coherence:
            raise TooShortError(
                f"{path.test}: the record is so short that noise has a coherence of {path.chance:.2f}, above the "
                f"threshold of {thresholds.coherence:g}; use wider bands or a longer record"
            )


def _verdict(path: Path, found: Sequence[Path], thresholds: Thresholds) -> Verdict:
    energies = [other.energy for other in found if _comparable(other, path)]
    level = float(_decibel(np.array([path.energy]), max(energies))[0])
    levels = _decibel(path.density, _largest_density(found, path))
    shares = thresholds.shares(path.coherence, levels, path.density)
    condition = thresholds.condition(path.mean_coherence, level)
    return Verdict(path.input.name, path.output.name, condition, path.mean_coherence, level, shares)


def _comparable(other: Path, path: Path) -> bool:
    """Return whether two paths have the same output, and inputs of the same type: actuators, or shocks."""
    same = other.output == path.output
    return same and _is_shock(other.input.name) == _is_shock(path.input.name)


def _is_shock(name: str) -> bool:
    return name == "force" or name.endswith(".force")


def _largest_density(found: Sequence[Path], path: Path) -> float:
    return max(float(other.density.max()) for other in found if _comparable(other, path))


def _decibel(power: Array, reference: float) -> Array:
    return np.asarray(10.0 * np.log10(np.maximum(power, 1e-300) / max(reference, 1e-300)), dtype=np.float64)


def _effect(small: Path, large: Path, small_size: float, large_size: float) -> AmplitudeEffect:
    shared, i, j = np.intersect1d(small.frequency, large.frequency, return_indices=True)
    weight = small.input_density[i]
    whole = float(np.sum(np.abs(large.H[j]) ** 2 * weight))
    wrong = float(np.sum(np.abs(small.H[i] - large.H[j]) ** 2 * weight))
    noise = float(np.sum((small.variance[i] + large.variance[j]) * weight))
    if not shared.size or whole == 0.0:
        return AmplitudeEffect(small.input.name, small.output.name, small_size, large_size, 0.0, 0.0)
    return AmplitudeEffect(
        small.input.name, small.output.name, small_size, large_size, np.sqrt(wrong / whole), np.sqrt(noise / whole)
    )
