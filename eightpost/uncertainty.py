"""Uncertainty of response measures of an identified vehicle, and what the errors of several fits have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np
from pydantic import with_config
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from eightpost.array_types import Array
from eightpost.errors import InputError, ParameterError
from eightpost.schema import OPEN, checked

# ---- Measures: what all setups share, and what belongs to one setup -------------------------------------------------
# A study reads `MeasureUncertainty` of every measure from its car (docs/explanation/vehicle_uncertainty.md).

#: Degrees of freedom of Student's t distribution of the errors: their standard deviations are themselves uncertain.
DEGREES = 4.0

#: Size of the part of an own error that only neighbouring setups share, per unit of `own`, and how near they are [1].
LOCAL, REACH = 0.05, 0.04

#: Number of frequencies of `local_features`.
_FREQUENCIES = 32

#: Measure of the sum of the tire forces of all wheels.
TOTAL = "total_tire_force"

#: Limits between the bands by which spectra are compared [Hz].
LIMITS = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 17.0, 23.0, 30.0)

#: Share of power below which a band is empty, and that it counts as having [1].
EMPTY = 0.005

#: Scales of the common and of the own error on a drive at `_drive_distance` 1 of the records, relative to the spread of
#: their errors over the bands, and per share of the drive's power above all bands that are not empty in the records:
#: the error there is as large as the output (docs/explanation/vehicle_uncertainty.md).
_BEYOND, _BEYOND_OWN, _UNSEEN = 4.0, 1.5, 0.7

#: Number of standard deviations from which predictions are corrected by a common error.
_SIGNIFICANT = 2.0


@dataclass(frozen=True, slots=True)
class MeasuredLevel:
    """Error of a predicted RMS that records with one drive show."""

    error: float  #: ln(predicted / measured), mean over the records [1].
    deviation: float  #: Standard deviation of this mean as the common error of all setups on that drive [1].
    spread: float  #: Standard deviation of the error over the bands, weighted by power, partly that of all measures.
    shares: tuple[float, ...]  #: Shares of the measured power in the bands (`len(LIMITS) + 1`).


@with_config(OPEN)
@dataclass(frozen=True, slots=True)
class MeasureUncertainty:
    """Uncertainty of the RMS of an output on a drive, for setups that the vehicle was not tested with.

        ln(predicted / true) = bias + common + own(setup)

    All setups on one drive share bias and common error, so they say nothing on which of them is better. The own errors
    of two setups differ the more, the more the setups differ: the scale of the difference is `own` times their
    `separation`. Errors have Student's t distribution with `DEGREES` degrees of freedom.

    `common`, `own` and `bias` are for the drive of the tests; `on_drive` returns the uncertainty on another one.
    """

    common: float  #: Scale of the relative error that all setups share [1].
    own: float  #: Scale of the relative error between two setups per unit of their separation [1].
    bias: float = 0.0  #: Common error by which predictions are corrected [1].
    levels: tuple[MeasuredLevel, ...] = ()  #: Measured errors; empty in files of earlier versions.
    #: Entries of a file of an earlier version that this one does not use; the digest of the file covers them.
    earlier: tuple[tuple[str, float], ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        if not min(self.common, self.own) >= 0.0:
            raise InputError(
                f"the uncertainty of a measure must be numbers of 0 or more, not {self.common!r} and {self.own!r}"
            )

    def to_json(self) -> dict[str, Any]:
        """Return the uncertainty as a JSON document, as the version wrote it that found it."""
        own = asdict(self)
        del own["earlier"]
        if self.earlier:
            own = {"common": self.common, "own": self.own, **dict(self.earlier)}
        return own

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> MeasureUncertainty:
        """Return the uncertainty of a document; entries of earlier versions are kept for the file's digest.

        Raises:
            InputError: The document is not the uncertainty of a measure.
        """
        place, known = "uncertainty.measures", {entry.name for entry in fields(cls)}
        earlier = {name: value for name, value in document.items() if name not in known}
        return replace(
            checked(cls, document, place=place), earlier=tuple(checked(dict[str, float], earlier, place=place).items())
        )

    @classmethod
    def of_levels(cls, levels: Sequence[MeasuredLevel], own: float) -> MeasureUncertainty:
        """Return the uncertainty that measured errors show, for the drive of the first of them, that of the tests."""
        found = cls(0.0, own, 0.0, tuple(levels))
        return replace(found.on_drive(levels[0].shares), levels=found.levels)

    def on_drive(self, shares: Sequence[float]) -> MeasureUncertainty:
        """Return the uncertainty on a drive on which the measure has given shares of its power in the bands.

        Records count the less, the more their spectra differ from the drive's. A common error that is significant
        becomes the bias. The result is final: it has no measured errors. It is `self` if these or the shares are not
        known.
        """
        if not self.levels or not len(shares):
            return self
        moved = [(one.spread * _drive_distance(shares, one.shares), _UNSEEN * unseen(shares, one.shares))
                 for one in self.levels]  # fmt: skip
        scales = [math.hypot(one.deviation, _BEYOND * far, empty)
                  for one, (far, empty) in zip(self.levels, moved, strict=True)]  # fmt: skip
        weights = np.array(scales) ** -2.0
        error = float(weights @ [one.error for one in self.levels] / weights.sum())
        deviation = float(weights.sum() ** -0.5)
        own = math.hypot(self.own, _BEYOND_OWN * moved[0][0], moved[0][1])
        if abs(error) > _SIGNIFICANT * deviation:
            return MeasureUncertainty(deviation, own, error)
        return MeasureUncertainty(math.hypot(deviation, error), own)

    def interval(
        self, predicted: float, level: float = 0.95, *, distance: float = 0.0, change: float = 0.0
    ) -> tuple[float, float]:
        """Return the interval that contains the true value of a measure with a given probability.

        Args:
            predicted: Predicted value of the measure.
            level: Probability [1], between 0 and 1.
            distance: Distance of the setup from the mean of the setups on that drive, or from the tests' setup.
            change: Logarithm of the ratio of this measure of the setup and of that mean [1].

        Raises:
            ParameterError: The level is not between 0 and 1.
        """
        factor, middle = 1.0 + self.half_width(separation(distance, change), level), predicted * math.exp(-self.bias)
        return middle / factor, middle * factor

    def half_width(self, apart: float, level: float = 0.95) -> float:
        """Return the relative half width of an interval [1]; see `interval`.

        Args:
            apart: Separation of the setups [1].
            level: Probability [1], between 0 and 1.

        Raises:
            ParameterError: The level is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ParameterError(f"the level of an interval is {level!r}; it must be between 0 and 1, e.g. 0.95")
        from scipy.special import stdtrit  # noqa: PLC0415 -- slow to load, and most callers need no interval

        scale = math.hypot(self.common, self.own * apart)
        return math.expm1(scale * float(stdtrit(DEGREES, 0.5 + 0.5 * level)))

    def probability_below(self, first: float, second: float, *, distance: float) -> float:
        """Return the probability that the first setup's true value is below that of the second; 0.5 if equal."""
        change = math.log(second / first)
        scale = self.own * separation(distance, change)
        if scale == 0.0:
            return 0.5 if change == 0.0 else float(change > 0.0)
        from scipy.special import stdtr  # noqa: PLC0415 -- slow to load, and most callers need no order

        return float(stdtr(DEGREES, change / scale))


def separation(distance: float, change: float) -> float:
    """Return how far two setups are apart for a measure, as its own error sees it.

        sqrt(d^2 + c^2 + 2 L^2 (1 - exp(-d^2 / (2 R^2))))

    The first term is a gradient of the error over all measures. The second one is an error of the range of the measure
    itself over the setups, which a model states too wide or too narrow. The third one is an error that setups share
    only with those that are nearer than `REACH`, of size `LOCAL`.

    Args:
        distance: `setup_distance` d of the setups.
        change: Logarithm c of the ratio of the measure's predictions.
    """
    local = -2.0 * LOCAL**2 * math.expm1(-0.5 * (distance / REACH) ** 2)
    return math.hypot(distance, change, math.sqrt(local))


def band_shares(power: Array, frequency: Array) -> Array:
    """Return the sums of spectral lines (..., K) at given frequencies [Hz] in the bands (..., bands)."""
    places = np.digitize(frequency, LIMITS)
    return np.stack([power[..., places == band].sum(axis=-1) for band in range(len(LIMITS) + 1)], axis=-1)


def _drive_distance(first: Sequence[float], second: Sequence[float]) -> float:
    """Return how far the spectrum of a measure on a drive is from that of records.

    sqrt(sum (v - w)^2 / (w + 0.005)),    v, w: shares of the power in the bands on the drive and in the records
    """
    v, w = np.asarray(first), np.asarray(second)
    return float(np.sqrt(np.sum((v - w) ** 2 / (w + EMPTY))))


def unseen(first: Sequence[float], second: Sequence[float]) -> float:
    """Return the share of the power on a drive that lies above all bands that are not empty in records.

    It counts in proportion to what a band lacks of not being empty.
    """
    highest = max(k for k, share in enumerate(second) if share >= EMPTY)
    above = zip(first[highest + 1 :], second[highest + 1 :], strict=True)
    return sum(power * (1.0 - share / EMPTY) for power, share in above)


def local_features(positions: Array) -> Array:
    """Return features (S, F) of setups at positions (S, M): their products are those of the local part of the error.

        phi(x) . phi(y) ~ L^2 exp(-|x - y|^2 / (2 R^2))

    A random gradient over the features is a random smooth function of the position. Source: A. Rahimi, B. Recht, Random
    features for large-scale kernel machines (NIPS 2007); here the frequencies have the exact second moments.
    """
    size = positions.shape[1]
    frequencies = np.random.default_rng(0).standard_normal((_FREQUENCIES, size))
    if 0 < size < _FREQUENCIES:
        left, _, right = np.linalg.svd(frequencies, full_matrices=False)
        frequencies = math.sqrt(_FREQUENCIES) * left @ right
    phases = positions @ frequencies.T / REACH
    return np.asarray(LOCAL / math.sqrt(_FREQUENCIES) * np.hstack([np.cos(phases), np.sin(phases)]))


def setup_distance(first: Mapping[str, float], second: Mapping[str, float]) -> float:
    """Return the distance of two setups: the RMS over all measures of ln(first / second).

    Args:
        first: Predicted measures of a setup, by name.
        second: Predicted measures of another setup with the same names.

    Raises:
        ParameterError: The setups do not have the same measures.
    """
    if set(first) != set(second) or not first:
        missing = ", ".join(sorted(set(first) ^ set(second))) or "all of them"
        raise ParameterError(f"both setups need the same measures; {missing} are missing from one of them")
    changes = [math.log(first[name] / second[name]) for name in first]
    return math.sqrt(sum(change * change for change in changes) / len(changes))


# ---- Changes of fits when the same block of the same test is left out -----------------------------------------------
# A fit errs where its law does not describe the shock. Shocks that were tested with the same signal and fitted with the
# same law err alike, so that the difference of two of them is known better than each of them. How much they have in
# common shows when each block of the test is left out (jackknife): the changes of the parameters are correlated over
# the blocks as their errors are.

#: Name of the section in the fit of a shock file, and in the uncertainty of a model.
_SECTION = "left_out_blocks"

#: Maximum number of blocks that are kept; those of longer tests are joined.
BLOCKS = 100

#: Smallest number of blocks whose changes show a correlation.
_FEWEST = 8

#: RMS difference of the blocks' velocities, as a share of their RMS value, up to which two tests have the same signal.
_SAME = 0.1

#: Significant digits and decimal places that are kept: of velocities, and of changes, which are about 0.1.
_DIGITS, _PLACES = 4, 4


_Section = TypedDict("_Section", {"velocity [m/s]": tuple[float, ...], "changes": dict[str, tuple[float, ...]]})


@dataclass(frozen=True, slots=True)
class LeftOutBlocks:
    """Changes of fitted parameters when each of B blocks of a test is left out.

    Raises:
        InputError: The numbers of values differ, a value is not finite, or all are 0.
    """

    velocity: tuple[float, ...]  #: RMS velocity of each block (B,) [m/s], by which the same test is recognised.
    #: Change of each parameter by block (B,), about its mean and relative to the root of its sum of squares [1], by
    #: name.
    changes: Mapping[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        for name, values in (("velocity", self.velocity), *self.changes.items()):
            if len(values) != len(self.velocity) or not np.all(np.isfinite(values)) or not np.any(values):
                raise InputError(
                    f"left-out blocks: {name} must be {len(self.velocity)} finite numbers, one for each block and not "
                    "all of them 0; fit the shock again"
                )

    @classmethod
    def of(cls, velocity: Array, changes: Mapping[str, Array]) -> LeftOutBlocks:
        """Return the changes of parameters by name; a parameter that does not change, or is NaN, is omitted.

        Leaving out two blocks changes a fit by the sum of both changes, to first order, so blocks are joined by sums.

        Args:
            velocity: RMS velocity of each block (B,) [m/s].
            changes: Change of each parameter by block (B,).
        """
        ends = np.linspace(0, velocity.size, min(velocity.size, BLOCKS) + 1).astype(int)
        starts, sizes = ends[:-1], np.diff(ends)
        joint = np.sqrt(np.add.reduceat(velocity**2, starts) / sizes)
        apart = {name: _apart(np.add.reduceat(values, starts)) for name, values in changes.items()}
        kept = {name: tuple(np.round(values, _PLACES).tolist()) for name, values in apart.items() if np.any(values)}
        return cls(tuple(float(f"{value:.{_DIGITS}g}") for value in joint.tolist()), kept)

    def has_the_test_of(self, other: LeftOutBlocks) -> bool:
        """Return whether two parts had the same test: as many blocks, of the same velocities."""
        if not _FEWEST <= len(self.velocity) == len(other.velocity):
            return False
        first, second = np.array(self.velocity), np.array(other.velocity)
        return bool(np.sum((first - second) ** 2) <= _SAME**2 * np.sum(first * second))

    def section(self) -> dict[str, Any]:
        """Return the changes as the section of a JSON document; `left_out_of` reads it."""
        changes = {name: list(values) for name, values in self.changes.items()}
        return {_SECTION: {"velocity [m/s]": list(self.velocity), "changes": changes}}

    @classmethod
    def from_json(cls, document: Any) -> LeftOutBlocks:
        """Return the changes of a section.

        Raises:
            InputError: The document is not one of left-out blocks.
        """
        section = checked(_Section, document, place=_SECTION)
        return cls(section["velocity [m/s]"], section["changes"])


class FittedParameter(NamedTuple):
    """A parameter of a fitted part, and the changes of the part's fit; None if the part states none."""

    blocks: LeftOutBlocks | None
    name: str


def _apart(values: Array) -> Array:
    """Return values about their mean, relative to the root of the sum of squares; 0 if they are equal or NaN."""
    apart = values - values.mean()
    size = float(np.linalg.norm(apart))
    return apart / size if size > 0.0 else np.zeros(values.size)


def left_out_of(document: Mapping[str, Any]) -> LeftOutBlocks | None:
    """Return the changes in the section of a shock file's fit or of a model's uncertainty; None if it has none.

    Raises:
        InputError: The section is not one of left-out blocks.
    """
    section = document.get(_SECTION)
    return None if section is None else LeftOutBlocks.from_json(section)


def correlation_of(parameters: Sequence[FittedParameter]) -> Array:
    """Return the correlation (n, n) of the errors of fitted parameters.

    The same parameter of shocks with the same test has the correlation of its changes, which is shrunk the more, the
    less it exceeds what independent changes of so few blocks would show (Schaefer and Strimmer 2005). All others count
    as independent. That includes different parameters of one fit: the changes say that their errors largely cancel,
    those of both sides for example, but an error of the law's form does not follow such a combination.
    """
    found = np.eye(len(parameters))
    for places in _groups(parameters):
        changes = [one.blocks.changes[one.name] for one in (parameters[k] for k in places) if one.blocks]
        found[np.ix_(places, places)] = _shrunk(np.array(changes))
    return found


def square_root(covariance: Array) -> Array:
    """Return the symmetric square root (n, n) of a covariance; negative eigenvalues, due to rounding, count as 0."""
    variances, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * np.sqrt(np.maximum(variances, 0.0))) @ axes.T)


def _groups(parameters: Sequence[FittedParameter]) -> list[list[int]]:
    """Return the positions of equal parameters of parts with the same test: that of the first part of each group."""
    groups: list[tuple[LeftOutBlocks, list[int]]] = []
    for place, (blocks, name) in enumerate(parameters):
        if blocks is None or name not in blocks.changes:
            continue
        for first, places in groups:
            if parameters[places[0]].name == name and blocks.has_the_test_of(first):
                places.append(place)
                break
        else:
            groups.append((blocks, [place]))
    return [places for _, places in groups]


def _shrunk(changes: Array) -> Array:
    """Return the correlation (n, n) of changes (n, B), shrunk towards independence; equal ones are one fit."""
    changes, place = np.unique(changes, axis=0, return_inverse=True)
    size = np.linalg.norm(changes, axis=1, keepdims=True)
    found = (changes / size) @ (changes / size).T
    apart = found[~np.eye(len(found), dtype=bool)]
    by_chance = float(np.sum((1.0 - np.minimum(apart**2, 1.0)) ** 2)) / max(changes.shape[1] - 1, 1)
    share = min(by_chance / max(float(np.sum(apart**2)), 1e-300), 1.0)
    found *= 1.0 - share
    np.fill_diagonal(found, 1.0)
    return np.asarray(found[np.ix_(place.ravel(), place.ravel())])
