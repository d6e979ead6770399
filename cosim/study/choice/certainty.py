"""Certainty of a study: its content, which certainty.parquet contains and the page shows, and its verdict."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal, NotRequired, cast, get_type_hints

import numpy as np
from arro3.core import DataType, Field, Schema
from pydantic import TypeAdapter, with_config

from cosim.study.table import StudyResult
from eightpost.array_types import Array, Flags, Integers
from eightpost.errors import FileFormatError, InputError
from eightpost.files import MALFORMED, check_schema, parse_json
from eightpost.schema import OPEN, checked, object_of
from eightpost.signals.parquet_file import Table, read_table, write_table
from eightpost.verdict import Reason, Rules, listed

# ---- Content --------------------------------------------------------------------------------------------------------

#: Name of the weighted sum of Eq 2.6 among the measures.
OBJECTIVE = "objective"

#: Name of the contribution of the deviation of rig runs, which the true level of a setup does not have.
RUN_TO_RUN = "run to run"

#: Probabilities of the intervals.
PROBABILITIES = (0.5, 0.8, 0.95)

#: Fields with one value for each setup, by the criterion.
_OWN = ("best", "among", "feasible")

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
    #: Median of the true change, relative to the size of the other level [1]; positive: the leading setup is higher,
    #: i.e. worse.
    change: float
    low: float  #: Lower end of its 95 % interval [1].
    high: float  #: Upper end of its 95 % interval [1].
    lowest: float  #: The leading setup's level above the lowest predicted level of all feasible setups, relative [1].


def relative_change(level: float | Array, reference: float | Array) -> Array:
    """Return the change from a reference, relative to its size [1]: positive for a higher level, also below 0."""
    return np.asarray((level - reference) / np.abs(reference))


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
        for what in _OWN:
            if (count := getattr(self, what).size) != self.setups.size:
                raise InputError(f"the certainty of {self.setups.size} setups has {count} values of {what}")

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


# ---- Summary in a few sentences, for the console and the page -------------------------------------------------------

#: Number of ties and of other measures that are named.
_TIES, _MEASURES = 5, 3


def summary_lines(result: StudyResult, certainty: Certainty) -> Iterator[str]:
    """Yield the tie set with its probabilities, trade-offs, next tests, and what is not known."""
    if certainty.leader is None:
        yield "no setup meets the constraints with a notable probability"
        return
    leader = result.study.space.setup(certainty.leader)
    chance = chance_text(certainty.probability(leader.index))
    if certainty.is_known and certainty.left_out:
        missing = listed(one.name for one in certainty.left_out)
        yield f"probably the best by {certainty.criterion}: setup {leader.index} ({leader}); not included: {missing}"
    elif certainty.is_known:
        yield f"most probably the best by {certainty.criterion}: setup {leader.index} ({leader}), {chance}"
    else:
        yield f"lowest by {certainty.criterion}: setup {leader.index} ({leader}); how sure this is, is not known"
        yield f"from the known contributions alone, it is the best with a probability of {chance}"
    yield _ties(certainty)
    yield from _trade_offs(certainty)
    if certainty.tests:
        names = ", ".join(str(test.setup) for test in certainty.tests)
        left = chance_text(certainty.tests[-1].remaining)
        left = left if certainty.tests[-1].remaining < 0.001 else f"about {left}"
        exact = ", if rig runs repeat exactly" if certainty.assumes_exact_runs else ""
        yield f"test next: {names}; {left} of the uncertainty about the ties remains{exact} (eightpost study confirm)"
    for one in certainty.contributions:
        if one.status is not Status.INCLUDED:
            yield f"{one.status.value}: {one.name}: {one.text}"
    yield from (f"approximation: {text}" for text in (*certainty.notes, *certainty.remarks))


def chance_text(probability: float) -> str:
    """Return a probability in percent.

    >>> chance_text(0.6234), chance_text(0.9996), chance_text(0.0001)
    ('62 %', 'above 99.9 %', 'below 0.1 %')
    """
    if 0.001 <= probability <= 0.999:
        return f"{100.0 * probability:.1f} %" if not 0.1 <= probability <= 0.9 else f"{100.0 * probability:.0f} %"
    return "above 99.9 %" if probability > 0.5 else "below 0.1 %"


def _ties(certainty: Certainty) -> str:
    count = len(certainty.ties)
    if count == 1:
        return f"no other setup is needed to contain the best one with a probability of {100 * TIE:g} %"
    named = ", ".join(f"{setup} {chance_text(certainty.probability(setup))}" for setup in certainty.ties[:_TIES])
    more = f" and {count - _TIES} more" if count > _TIES else ""
    return f"{count} setups are tied; one of them is the best with a probability of {100 * TIE:g} %: {named}{more}"


def _trade_offs(certainty: Certainty) -> Iterator[str]:
    """Yield the changes of other measures of the leading setup from the baseline, the largest first."""
    worse = sorted((one for one in certainty.trade_offs if one.low > 0.0), key=lambda one: -one.change)
    better = sorted((one for one in certainty.trade_offs if one.high < 0.0), key=lambda one: one.change)
    for words, found in (("worse", worse), ("better", better)):
        if found:
            named = ", ".join(
                f"{one.measure} {100 * one.change:+.1f} % ({100 * one.low:+.1f} to {100 * one.high:+.1f})"
                for one in found[:_MEASURES]
            )
            more = f" and {len(found) - _MEASURES} more" if len(found) > _MEASURES else ""
            yield f"{words} than the baseline with a probability of 97.5 %: {named}{more}"


# ---- Reasons of a study's verdict that concern the certainty of the choice ------------------------------------------

ABOUT = "choice"

RULES = Rules.read(Path(__file__).with_suffix(".txt"), tie=100 * TIE)


def certainty_reasons(certainty: Certainty | None) -> list[Reason]:
    """Return the reasons of a certainty; None if it was not computed."""
    return [RULES.reason(*row) for row in _reasons(certainty)]


def _reasons(certainty: Certainty | None) -> Iterator[tuple[str, str, str, str]]:
    """Yield rule, statement, figure and origin of each reason."""
    if certainty is None:
        yield "certainty not computed", "it is not known how sure the choice is", "0 draws", "the folder"
        return
    if certainty.leader is None:
        return  # no setup is feasible, which is a reason of its own
    chance = certainty.probability(certainty.leader)
    figure = f"probability of setup {certainty.leader}: {chance_text(chance)}"
    origin = f"{certainty.criterion}; {certainty.draws} draws"
    if len(certainty.ties) > 1:
        figure = f"{len(certainty.ties)} setups; {figure}, less than {100 * TIE:g} %"
        yield "setups tied", "several setups may be the best", figure, origin
    elif certainty.is_known and certainty.left_out:
        names = listed(one.name for one in certainty.left_out)
        figure = f"not included: {names}; without it, {figure}"
        rule = "one setup is the best by a part of the uncertainty"
        yield rule, "one setup is the best by the included contributions", figure, origin
    elif certainty.is_known:
        yield "one setup is the best", "one setup is the best", figure, origin
    for one in certainty.contributions:
        if one.status is Status.UNKNOWN:
            rule, statement = "uncertainty of the choice unknown", "a contribution to the uncertainty is unknown"
            yield rule, statement, f"{one.name}: {one.text}", origin
    if certainty.contradictions:
        worst = min(certainty.contradictions, key=lambda one: one.probability)
        change = 100.0 * (worst.measured / worst.predicted - 1.0)
        figure = f"{worst.measure} {change:+.2g} % from the prediction, probability {chance_text(worst.probability)}"
        names = listed(one.file for one in certainty.contradictions)
        yield "rig runs contradict the prediction", "a record contradicts the prediction", figure, names


# ---- The file certainty.parquet: one row per setup, and a header (docs/explanation/certainty.md) --------------------

#: Version of the files that are written, and the newest version that can be read.
SCHEMA = 1

_KEY = b"eightpost"


#: Fields of a certainty that are columns. All others are entries of the header.
_COLUMNS = ("setups", "levels", *_OWN)


@dataclass(frozen=True, slots=True)
class _Measure:
    """Header of one measure."""

    name: str
    relative: bool
    basis: str
    run_to_run: float | None = None


_ENTRIES = {one.name: get_type_hints(Certainty)[one.name] if one.default is MISSING
            else NotRequired[get_type_hints(Certainty)[one.name]]
            for one in fields(Certainty) if one.name not in _COLUMNS}  # fmt: skip

#: Header of a certainty: everything that is not a column.
_KINDS = {"schema": Literal["eightpost.certainty"], "schema_version": int, "measures": tuple[_Measure, ...]} | _ENTRIES
_Header: Any = with_config(OPEN)(object_of(_KINDS))


def _columns_of(measure: str) -> tuple[str, str, tuple[str, ...]]:
    """Return the names of the columns of a measure: expected level, probability of being best, half-widths."""
    widths = tuple(f"half width {100.0 * probability:g} % of {measure}" for probability in PROBABILITIES)
    return f"expected {measure}", f"best by {measure}", widths


def write_certainty(certainty: Certainty, path: str | Path) -> None:
    """Write a certainty; an existing file is replaced only after the new one is complete."""
    single, double = DataType.float32(), DataType.float64()
    columns: list[tuple[str, DataType, Any]] = [("setup", DataType.int64(), certainty.setups)]
    columns += [(name, single, getattr(certainty, name)) for name in _OWN]
    columns.append(("tie", DataType.bool(), certainty.tie))
    for name, levels in certainty.levels.items():
        expected, best, widths = _columns_of(name)
        columns.append((expected, double, levels.expected))
        columns += [(width, single, half) for width, half in zip(widths, levels.half_widths, strict=True)]
        columns.append((best, single, levels.best))
    measures = tuple(
        _Measure(name, one.relative, one.basis, one.run_to_run if np.isfinite(one.run_to_run) else None)
        for name, one in certainty.levels.items()
    )
    own = {name: getattr(certainty, name) for name in _ENTRIES}
    stated = {"schema": "eightpost.certainty", "schema_version": SCHEMA, "measures": measures, **own}
    header = TypeAdapter(_Header).dump_python(stated, mode="json")
    metadata = {_KEY: json.dumps(header, allow_nan=False).encode()}
    schema = Schema([Field(name, kind) for name, kind, _ in columns], metadata=metadata)
    write_table(Table(schema, {name: values for name, _, values in columns}), Path(path))


def read_certainty(path: str | Path, *, digest: str | None = None) -> Certainty:
    """Read a certainty that `write_certainty` wrote.

    Args:
        path: File, such as certainty.parquet in the folder of a study.
        digest: Digest of the study's result (Provenance.digest); None accepts a certainty of any study.

    Raises:
        FileFormatError: The file cannot be read, or belongs to another study.
    """
    path = Path(path)
    table = read_table(path, advice="run `eightpost study` again, or `eightpost study robust`")
    metadata = table.schema.metadata
    content: Any = parse_json(metadata[_KEY], path) if _KEY in metadata else None
    if not isinstance(content, dict) or content.get("schema") != "eightpost.certainty":
        raise FileFormatError("is not the certainty of a study; name the certainty.parquet of a study", path=path)
    check_schema(content, SCHEMA, path, key="schema_version")
    again = "run `eightpost study` again"
    stated = checked(_Header, content, path=path, advice=again)
    own: dict[str, Any] = {name: stated[name] for name in _ENTRIES if name in stated}
    if digest is not None and own["digest"] != digest:
        raise FileFormatError(f"belongs to another study or to other FMUs; {again}", path=path)
    try:
        return Certainty(
            setups=np.asarray(table["setup"], dtype=np.int64),
            levels={measure.name: _levels(table, measure) for measure in stated["measures"]},
            **own,
            **cast("dict[str, Any]", {name: table[name] for name in _OWN}),
        )
    except MALFORMED as error:
        if isinstance(error, FileFormatError):
            raise
        what = f"is not a certainty that this version can read ({error}); {again}"
        raise FileFormatError(what, path=path) from error


def _levels(table: Table, measure: _Measure) -> Levels:
    expected, best, widths = _columns_of(measure.name)
    half, noise = np.stack([table[width] for width in widths]), measure.run_to_run
    stated = (measure.relative, measure.basis, np.nan if noise is None else noise)
    return Levels(table[expected], half, table[best], *stated)
