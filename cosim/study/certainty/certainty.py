"""Certainty of a study: its content, which certainty.parquet contains and the page shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from eightpost.array_types import Array, Flags, Integers
from eightpost.errors import InputError

#: Name of the weighted sum of Eq 2.6 among the measures.
OBJECTIVE = "objective"

#: Name of the contribution of the deviation of rig runs, which the true level of a setup does not have.
RUN_TO_RUN = "run to run"

#: Probabilities of the intervals.
PROBABILITIES = (0.5, 0.8, 0.95)

#: Joint probability with which the ties contain the best setup.
TIE = 0.95


class VehicleSource(StrEnum):
    """Origin of the uncertainty of the vehicle."""

    MODEL = "model"
    """What the vehicle's FMU states."""

    ADDED = "added"
    """What the FMU states, and parameters of the vehicle in an uncertainty file."""

    REPLACED = "replaced"
    """Equivalent vehicles in an uncertainty file, in place of what the FMU states."""


class Status(StrEnum):
    """Whether a contribution is part of the stated uncertainty."""

    INCLUDED = "included"
    LEFT_OUT = "not included"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Contribution:
    """One contribution to the uncertainty."""

    name: str  #: Name: vehicle, shock fits, build to build, run to run, coupling, parameters.
    status: Status  #: Whether it is included, not included, or unknown.
    text: str  #: Origin of its values, or what is missing, as a clause.


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """True levels of one measure for R setups, as a distribution."""

    #: Median of the true level (R,), SI; that of the objective in its own unit. NaN if the setup failed.
    expected: Array
    #: Half-widths of the intervals of `PROBABILITIES` (3, R): of ln(true / expected) if `relative`, else of true -
    #: expected. NaN if the uncertainty is not known.
    half_widths: Array
    best: Array  #: Probability of having the lowest true level of all feasible setups (R,); NaN if it is not known.
    relative: bool  #: Whether the half-widths are those of a logarithm.
    #: Origin of the vehicle's uncertainty of this measure: "stated" by the vehicle for this measure, "output" if it is
    #: that of the RMS of the measure's outputs (an approximation), "file" if an uncertainty file states the vehicle's,
    #: "terms" for the objective, "unknown".
    basis: str
    run_to_run: float = np.nan  #: Standard deviation of one rig run, in the unit of `expected`; NaN if it is not known.

    @property
    def is_known(self) -> bool:
        """Whether the uncertainty of this measure is known."""
        return self.basis != "unknown"

    def interval(self, probability: float = 0.95) -> tuple[Array, Array]:
        """Return the lower and upper ends (R,) of the intervals that contain the true level with a probability.

        Raises:
            InputError: The probability is not in `PROBABILITIES`.
        """
        if probability not in PROBABILITIES:
            raise InputError(f"there are intervals of {PROBABILITIES}, not of {probability!r}")
        half = self.half_widths[PROBABILITIES.index(probability)]
        if self.relative:
            return self.expected * np.exp(-half), self.expected * np.exp(half)
        return self.expected - half, self.expected + half


@dataclass(frozen=True, slots=True)
class TradeOff:
    """Level of a measure of the leading setup relative to the baseline's (without one: to the median setup's)."""

    measure: str  #: Name of the measure.
    change: float  #: Median of the true ratio minus 1 [1]; positive: the leading setup is higher, i.e. worse.
    low: float  #: Lower end of its 95 % interval [1].
    high: float  #: Upper end of its 95 % interval [1].
    lowest: float  #: The leading setup's level above the lowest predicted level of all feasible setups, relative [1].


@dataclass(frozen=True, slots=True)
class NextTest:
    """A setup to confirm on the rig."""

    setup: int  #: Number of the setup.
    #: Expected share of the variance of the differences within the ties that remains after this test and those before
    #: it [1].
    remaining: float


@dataclass(frozen=True, slots=True)
class Effect:
    """Effect of one uncertain parameter on the measures, linear in the parameter and additive over the corners.

    Changes are ln(changed / nominal) of a measure for a change of the parameter by one `deviation`.
    """

    part: str  #: Build whose parameter it is, or name of the vehicle's component.
    parameter: str  #: Name of the parameter.
    deviation: float  #: Standard deviation of the parameter, in its unit.
    copies: float  #: Standard deviation between copies of the build, in units of `deviation`; 0 if it is not known.
    shared: Mapping[str, float]  #: Change of the measures of all setups, by measure.
    #: Change of the measures of setups with a build at a corner, by corner, build and measure.
    changes: Mapping[str, Mapping[str, Mapping[str, float]]]
    #: Correlation of the parameter's error with that of the same parameter of other builds, by build; builds that are
    #: not listed are independent. Copies are always independent.
    correlations: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ConfirmedRun:
    """A rig run that the certainty takes into account."""

    file: str  #: Name of the record.
    setup: int  #: Number of the setup.
    drive: str  #: Name of the drive.
    digest: str  #: SHA-256 of the record.
    values: Mapping[str, float]  #: Measured levels by measure, SI.


@dataclass(frozen=True, slots=True)
class Contradiction:
    """A measured level that the prediction and its uncertainty do not explain."""

    file: str  #: Name of the record.
    setup: int  #: Number of the setup.
    measure: str  #: Name of the measure.
    predicted: float  #: Predicted level, SI.
    measured: float  #: Measured level, SI.
    probability: float  #: Probability of a deviation at least as large.
    #: Whether the certainty takes the level into account nevertheless: a level that contradicts the other rig runs is
    #: left out, one that agrees with them is not.
    used: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Certainty:
    """Certainty of a study of R setups."""

    digest: str  #: Digest of the study's result.
    criterion: str  #: Quantity by which setups are ranked, lowest first: `OBJECTIVE` or the name of a measure.
    top: int  #: Number k of `among`.
    setups: Integers  #: Numbers of the setups (R,), as in the table of the study.
    best: Array  #: Probability of being the best feasible setup by the criterion (R,).
    among: Array  #: Probability of being among the best k feasible setups (R,).
    feasible: Array  #: Probability of meeting all constraints (R,).
    #: Numbers of the setups of the smallest set that contains the best one with a probability of 95 %, most probable
    #: first; empty if nothing about the uncertainty is known.
    ties: tuple[int, ...]
    levels: Mapping[str, Levels]  #: True levels by measure, and of `OBJECTIVE` if the study has one.
    contributions: tuple[Contribution, ...] = ()  #: Contributions to the uncertainty.
    tests: tuple[NextTest, ...] = ()  #: Setups to confirm on the rig, the most informative first.
    trade_offs: tuple[TradeOff, ...] = ()  #: Other measures of the leading setup.
    effects: tuple[Effect, ...] = ()  #: Effects of uncertain parameters of shocks and vehicle.
    runs: tuple[ConfirmedRun, ...] = ()  #: Rig runs that are taken into account.
    contradictions: tuple[Contradiction, ...] = ()  #: Measured levels that the prediction does not explain.
    draws: int = 0  #: Number of draws of the probabilities.
    unstated: tuple[str, ...] = ()  #: Builds whose parameters' uncertainty is not known.
    vehicle: VehicleSource = VehicleSource.MODEL  #: Origin of the uncertainty of the vehicle.
    notes: tuple[str, ...] = ()  #: Sentences about the uncertain parameters.
    remarks: tuple[str, ...] = ()  #: Sentences about approximations of the computation.

    def __post_init__(self) -> None:
        for what in ("best", "among", "feasible"):
            if getattr(self, what).shape != self.setups.shape:
                raise InputError(
                    f"the certainty of {self.setups.size} setups has {getattr(self, what).size} values of {what}"
                )

    @property
    def is_known(self) -> bool:
        """Whether no contribution to the uncertainty of the criterion is unknown."""
        return all(one.status is not Status.UNKNOWN for one in self.contributions)

    @property
    def left_out(self) -> tuple[Contribution, ...]:
        """Contributions to the uncertainty of the true levels that are not included; noise of rig runs is not one."""
        return tuple(one for one in self.contributions if one.status is Status.LEFT_OUT and one.name != RUN_TO_RUN)

    @property
    def assumes_exact_runs(self) -> bool:
        """Whether rig runs count as exact, because their deviation from run to run is not known."""
        return any(one.name == RUN_TO_RUN and one.status is not Status.INCLUDED for one in self.contributions)

    @property
    def leader(self) -> int | None:
        """Number of the setup that is most probably the best; None if no setup is feasible."""
        return self.ties[0] if self.ties else None

    @property
    def tie(self) -> Flags:
        """Whether each setup is one of the ties (R,)."""
        return np.isin(self.setups, self.ties)

    def row(self, setup: int) -> int:
        """Return the row of a setup.

        Raises:
            InputError: There is no such setup.
        """
        found = np.flatnonzero(self.setups == setup)
        if not found.size:
            raise InputError(f"the certainty has no setup {setup}")
        return int(found[0])

    def probability(self, setup: int) -> float:
        """Return the probability that a setup is the best."""
        return float(self.best[self.row(setup)])
