"""How far a linear model can go: coherence against response energy (6.2), and what the amplitude changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import InputError, TooShortError
from eightpost.ident.linearity.conditions import Condition, Thresholds
from eightpost.ident.linearity.excitations import by_input, excitations
from eightpost.ident.linearity.path import Path, outputs_of, paths
from eightpost.ident.response.local_polynomial import LocalPolynomial

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eightpost.ident.preparation import Prepared

    Array = NDArray[np.float64]

#: How responses are estimated.
BANDS = LocalPolynomial(half_width=0.25, spacing=0.1, high=25.0)

#: Tests of one input are of several amplitudes when these differ by this factor.
OTHER_SIZE = 1.5

#: A change with amplitude counts from this part of the response [1] ...
NOTABLE = 0.05
#: ... and this many times what noise makes of it.
BEYOND_NOISE = 2.0


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is said of one path.

    Attributes:
        input: The input.
        output: The output.
        condition: Of Table 6.4, of the path as a whole.
        coherence: Mean over the band, weighted by the output's energy [1].
        level: The output's energy under its largest from any input of the same kind of test [dB].
        shares: Part of the output's energy under each condition, frequency by frequency [1].
    """

    input: str
    output: str
    condition: Condition
    coherence: float
    level: float
    shares: Mapping[Condition, float]


@dataclass(frozen=True, slots=True)
class AmplitudeEffect:
    """How a response changes with the input's size: a linear car's does not.

    Coherence is blind to it: friction that makes a small test stiffer than a large one leaves each of them coherent.

    Attributes:
        input: The input.
        output: The output.
        small: Standard deviation of the input in the small test, its unit.
        large: In the large one.
        change: Of the output's answer to the small test, had the response been that of the large one [1].
        chance: What noise makes of `change` [1].
    """

    input: str
    output: str
    small: float
    large: float
    change: float
    chance: float

    @property
    def is_notable(self) -> bool:
        """Whether the response depends on the amplitude, by more than noise says."""
        return self.change > max(NOTABLE, BEYOND_NOISE * self.chance)


@dataclass(frozen=True, slots=True, eq=False)
class Linearity:
    """The linearity of a car on the rig.

    Attributes:
        paths: One per input and output, from the largest test of each input.
        verdicts: One per path, in the same order.
        effects: Of the amplitude, where an input has tests of several sizes.
        thresholds: What high and low are.
        notes: What was left out and why.
    """

    paths: tuple[Path, ...]
    verdicts: tuple[Verdict, ...]
    effects: tuple[AmplitudeEffect, ...]
    thresholds: Thresholds
    notes: tuple[str, ...]

    @property
    def inputs(self) -> tuple[str, ...]:
        """The inputs, in the order of the tests."""
        return tuple(dict.fromkeys(path.input.name for path in self.paths))

    @property
    def outputs(self) -> tuple[str, ...]:
        """The outputs."""
        return tuple(dict.fromkeys(path.output.name for path in self.paths))

    def verdict(self, output: str, input: str) -> Verdict:
        """Return what is said of one path."""
        for each in self.verdicts:
            if (each.input, each.output) == (input, output):
                return each
        raise InputError(f"no path from {input!r} to {output!r}; inputs are {', '.join(self.inputs)}")

    def levels(self, path: Path) -> Array:
        """Return the level of a path over frequency (K,) [dB of the output's largest density]."""
        return _decibel(path.density, _largest_density(self.paths, path))


def judge_linearity(
    prepared: Prepared,
    *,
    outputs: Sequence[str] = (),
    recipe: LocalPolynomial | None = None,
    thresholds: Thresholds | None = None,
) -> Linearity:
    """Judge every path whose input moves alone in a test (6.2).

    Args:
        prepared: Tests with one actuator each, of one amplitude or several; or a baseline and alternates.
        outputs: Channels; shock velocities, tire forces and ride heights when empty.
        recipe: How responses are estimated; bands of 0.5 Hz, every 0.1 Hz to 25 Hz, unless told.
        thresholds: What high and low are.

    Raises:
        InputError: In no test one input moves alone.
        TooShortError: A record is so short that noise is as coherent as the threshold.
    """
    recipe, thresholds = recipe or BANDS, thresholds or Thresholds()
    found = excitations(prepared, outputs_of(prepared.channels, outputs))
    if not found.excitations:
        raise InputError(
            "in none of the tests one input moves alone: give tests with one actuator (eightpost rig --test single), "
            f"or a baseline and tests of the same drive with one other shock each ({'; '.join(found.notes)})"
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


def _check_length(found: Sequence[Path], thresholds: Thresholds) -> None:
    for path in found:
        if path.chance > thresholds.coherence:
            raise TooShortError(
                f"{path.test}: the record is so short that noise is coherent to {path.chance:.2f}, above the threshold "
                f"of {thresholds.coherence:g}; take wider bands or a longer record"
            )


def _verdict(path: Path, found: Sequence[Path], thresholds: Thresholds) -> Verdict:
    alike = [other.energy for other in found if _comparable(other, path)]
    level = float(_decibel(np.array([path.energy]), max(alike))[0])
    levels = _decibel(path.density, _largest_density(found, path))
    shares = thresholds.shares(path.coherence, levels, path.density)
    condition = thresholds.condition(path.mean_coherence, level)
    return Verdict(path.input.name, path.output.name, condition, path.mean_coherence, level, shares)


def _comparable(other: Path, path: Path) -> bool:
    """Say whether two paths have the same output, and inputs of the same sort: actuators, or shocks."""
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
