"""Certainty with an uncertainty file, and spread of the leading setups over draws of the uncertain parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
from arro3.core import Array as Column
from arro3.core import DataType, list_array
from arro3.core import Table as ArrowTable
from numpy.typing import ArrayLike
from pydantic import BaseModel, Field
from scipy.stats import norm, qmc

from cosim.study.choice.assess import Knowledge
from cosim.study.choice.certainty import OBJECTIVE, Effect, VehicleSource
from cosim.study.choice.compare import read_run_to_run
from cosim.study.choice.sources import (
    UncertainParameter,
    effects_of,
    error_sources,
    parameter_values,
    stated_parameters,
)
from cosim.study.definition import Study
from cosim.study.running.evaluator import coupling_of
from cosim.study.running.sweep import Sweep
from cosim.study.running.workers import Workers
from cosim.study.table import StudyResult
from eightpost import units
from eightpost.array_types import Array, Integers
from eightpost.errors import FileFormatError, InputError
from eightpost.files import read_text
from eightpost.progress import Progress
from eightpost.signals.parquet_file import write_arrow
from eightpost.toml_document import parse_model
from eightpost.uncertainty import FittedParameter, LeftOutBlocks, correlation_of, square_root
from eightpost.validity import ParameterUncertainty

# ---- Uncertain parameters of shocks and vehicle, and studies in which they are drawn --------------------------------

#: Tolerance for the symmetry and the eigenvalues of a covariance, as a share of its largest entry.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Uncertain:
    """Parameters of one FMU with their covariance, such as that of a fit: n parameters.

    Raises:
        InputError: The shapes disagree, or the covariance is not symmetric or has negative variances.
    """

    part: str  #: Name of the build, or of the vehicle's component. A build has the same errors at every corner.
    names: tuple[str, ...]  #: Names of the FMU's parameters.
    values: Array  #: Best values (n,), each in the parameter's unit.
    covariance: Array  #: Covariance of the parameters (n, n).
    lowest: ArrayLike = -inf  #: Lower limits (n,), or one number for all; draws below are set to the limit.
    highest: ArrayLike = inf  #: Upper limits (n,), or one number for all.
    #: Changes of the parameters when blocks of the fit's test are left out; parts with the same test have correlated
    #: errors. None if they are not known.
    left_out: LeftOutBlocks | None = None

    def __post_init__(self) -> None:
        n = len(self.names)
        if np.shape(self.values) != (n,) or np.shape(self.covariance) != (n, n):
            raise InputError(
                f"{self.part}: {n} parameters need {n} values and a square covariance of that size; the shapes are "
                f"{np.shape(self.values)} and {np.shape(self.covariance)}"
            )
        scale = _ROUNDING * float(np.abs(self.covariance).max(initial=0.0))
        if not np.allclose(self.covariance, self.covariance.T, rtol=0.0, atol=scale):
            raise InputError(f"{self.part}: the covariance of {', '.join(self.names)} is not symmetric")
        if not np.linalg.eigvalsh(self.covariance).min(initial=0.0) >= -scale:
            raise InputError(
                f"{self.part}: the covariance of {', '.join(self.names)} has negative variances or NaN; omit the "
                "parameters that the fit did not determine"
            )

    @property
    def deviations(self) -> Array:
        """Standard deviations (n,) of the parameters."""
        return np.asarray(self.covariance.diagonal() ** 0.5)

    def at(self, standard: Array) -> Array:
        """Return parameter values (S, n) for standard normal numbers (S, n)."""
        drawn = self.values + standard @ square_root(self.covariance)
        return np.asarray(np.clip(drawn, self.lowest, self.highest), dtype=np.float64)


def drawn_studies(
    study: Study, uncertain: Sequence[Uncertain], *, draws: int, seed: int = 0, vehicles: Sequence[Path] = ()
) -> tuple[Study, ...]:
    """Return studies with drawn parameters: a Latin hypercube of their normal distribution.

    Args:
        uncertain: Uncertain parameters; each parameter at most once.
        seed: Seed of the random number generator; the same seed gives the same studies.
        vehicles: FMUs of equivalent vehicles; the draws use the study's own vehicle and these in turn.

    Raises:
        InputError: Fewer than two draws, or a part is neither a build of the bank nor the vehicle.
    """
    if draws < 2:
        raise InputError(f"a spread needs two or more draws, not {draws}")
    for entry in uncertain:
        _check_part(study, entry.part)
    sizes = [len(entry.names) for entry in uncertain]
    uniform = qmc.LatinHypercube(max(sum(sizes), 1), rng=seed).random(draws)[:, : sum(sizes)]
    fitted = [FittedParameter(entry.left_out, name) for entry in uncertain for name in entry.names]
    standard = norm.ppf(uniform) @ square_root(correlation_of(fitted))
    parts = np.split(standard, np.cumsum(sizes)[:-1], axis=1) if sizes else []
    values = [entry.at(part) for entry, part in zip(uncertain, parts, strict=True)]
    cars = [replace(study, vehicle=replace(study.vehicle, fmu=fmu)) for fmu in (study.vehicle.fmu, *vehicles)]
    return tuple(_with(cars[s % len(cars)], uncertain, [rows[s] for rows in values]) for s in range(draws))


def _check_part(study: Study, part: str) -> None:
    if part != study.vehicle.name and part not in study.bank:
        raise InputError(f"there is no part {part!r}; the parts are {', '.join((study.vehicle.name, *study.bank))}")


def _with(study: Study, uncertain: Sequence[Uncertain], values: Sequence[Array]) -> Study:
    bank, vehicle = dict(study.bank), study.vehicle
    for entry, row in zip(uncertain, values, strict=True):
        drawn = dict(zip(entry.names, row.tolist(), strict=True))
        if entry.part in bank:
            build = bank[entry.part]
            bank[entry.part] = replace(build, parameters={**build.parameters, **drawn})
        if entry.part == vehicle.name:
            vehicle = replace(vehicle, parameters={**vehicle.parameters, **drawn})
    return replace(study, bank=bank, vehicle=vehicle)


# ---- What is uncertain ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Uncertainties of a study's parts and of the rig."""

    parts: tuple[Uncertain, ...] = ()  #: Uncertain parameters with their covariance.
    #: Shock files by build; the uncertainty is read from the fit in the file.
    fits: Mapping[str, Path] = field(default_factory=dict)
    vehicles: tuple[Path, ...] = ()  #: FMUs of equivalent vehicles, such as fits of other records.
    run_to_run: Mapping[str, float] = field(default_factory=dict)  #: Standard deviation of one rig run by measure [SI].
    runs: int = 1  #: Number of rig runs of each setup that would be averaged.

    @property
    def any(self) -> bool:
        """Whether a parameter or the vehicle is uncertain."""
        return bool(self.parts or self.vehicles)


# ---- Draws, each of them simulated, and their file ------------------------------------------------------------------


def leading(result: StudyResult, count: int, measure: str | None = None) -> Integers:
    """Return the numbers of the best setups by the objective or a measure, and of the baseline, in increasing order."""
    rows = result.ranking(measure)[:count]
    baseline = result.baseline_row
    if baseline is not None and result.done[baseline]:
        rows = np.append(rows, baseline)
    return np.unique(result.setups[rows])


def run_draws(
    result: StudyResult,
    sweep: Sweep,
    workers: Workers,
    uncertain: Uncertainty,
    setups: Sequence[int],
    count: int,
    seed: int = 0,
) -> Iterator[StudyResult]:
    """Run setups with every draw, with the coupling of the study; completed runs in its folder are not repeated.

    Args:
        sweep: The study, whose FMUs the runs use.

    Yields:
        Results of the setups for each draw; nothing if nothing is uncertain.

    Raises:
        InputError: A part is not in the study, or an FMU lacks a parameter.
    """
    if uncertain.any:
        coupling = coupling_of(result)
        for study in drawn_studies(result.study, uncertain.parts, draws=count, seed=seed, vehicles=uncertain.vehicles):
            yield sweep.variant(study, sweep.folder).request(workers, coupling, setups)


class Spread(NamedTuple):
    """Values of one measure [SI], or of the objective, of K setups, and the same with drawn parameters."""

    measure: str
    setups: Integers  #: Numbers of the setups (K,).
    values: Array  #: Values with the best parameters (K,); NaN if the setup failed.
    draws: Array  #: Values with drawn parameters (S, K).


def spreads_of(result: StudyResult, draws: Sequence[StudyResult], setups: Sequence[int]) -> tuple[Spread, ...]:
    """Return the spread of the objective, if the study has one, and of every measure, of setups that all draws have."""
    kept = np.asarray(setups, dtype=np.int64)
    for drawn in (result, *draws):
        kept = np.intersect1d(kept, drawn.setups)
    names = [*([OBJECTIVE] if result.study.objective else []), *(measure.name for measure in result.measures)]

    def values(one: StudyResult, name: str) -> Array:
        found = np.where(one.done, one.cost("" if name == OBJECTIVE else name), np.nan)
        return found[np.isin(one.setups, kept)]

    none = np.empty((0, kept.size))
    return tuple(
        Spread(name, kept, values(result, name), np.stack([values(one, name) for one in draws]) if draws else none)
        for name in names
    )


def write_spreads(spreads: Sequence[Spread], path: str | Path, result: StudyResult, stated: Uncertainty) -> None:
    """Write spreads with the stated run-to-run deviations, one row per measure [SI]."""
    noise = {OBJECTIVE: _objective_noise(result, stated.run_to_run), **stated.run_to_run}
    columns = {
        "measure": Column([one.measure for one in spreads], DataType.string()),
        "setups": _lists([one.setups for one in spreads]),
        "values": _lists([one.values for one in spreads]),
        "draws": _lists([one.draws for one in spreads]),
        "run_to_run": Column([noise.get(one.measure, 0.0) for one in spreads], DataType.float64()),
        "runs": Column([stated.runs] * len(spreads), DataType.int64()),
    }
    metadata = {b"study": result.provenance.digest.encode()}
    write_arrow(ArrowTable.from_pydict(columns, metadata=metadata), path)


def _lists(rows: Sequence[Array | Integers]) -> Column:
    """Return arrays as a column of lists, of lists of lists if they have two dimensions."""
    values = np.concatenate(rows)
    column = Column.from_numpy(values.ravel())
    if values.ndim > 1:
        column = list_array(values.shape[1] * np.arange(len(values) + 1, dtype=np.int32), column)
    return list_array(np.cumsum([0, *map(len, rows)], dtype=np.int32), column)


def _objective_noise(result: StudyResult, noise: Mapping[str, float]) -> float:
    """Return the run-to-run deviation of the objective, with independent deviations of its measures."""
    terms = result.study.objective
    squares = ((result.factor(term) * noise.get(term.measure, 0.0)) ** 2 for term in terms)
    return float(np.sqrt(sum(squares)))


# ==== Entries of an uncertainty file replace what the models state ===================================================

#: Departure of a parameter's value in the file from that in the study, in standard deviations, that is reported.
_APART = 1.0


def knowledge_of(
    result: StudyResult,
    uncertain: Uncertainty,
    run_to_run: Mapping[str, float],
    sweep: Sweep,
    workers: Workers,
    progress: Progress = lambda _done, _all: None,
) -> Knowledge:
    """Return what is known about a study with the entries of an uncertainty file.

    An entry replaces what the build's FMU states about the same parameter; the entry of a fit replaces all of it.
    Equivalent vehicles replace what the vehicle's FMU states; parameters of the vehicle are added to it.

    Args:
        sweep: The study, whose FMUs the runs use.
    """
    stated, unstated, notes = stated_parameters(result)
    named = {(part.part, name) for part in uncertain.parts for name in part.names}
    parameters = [one for one in stated if (one.part, one.stated.name) not in named]
    kept = len(parameters)
    for part in uncertain.parts:
        entries = _parameters(part, _values_in_study(result, part))
        notes += tuple(
            f"{part.part}: the study has {one.stated.name} = {one.value:.4g}, the uncertainty file {value:.4g}; only "
            "its deviation is used"
            for one, value in zip(entries, part.values.tolist(), strict=True)
            if abs(one.value - value) > _APART * one.stated.deviation
        )
        parameters += entries
    found = effects_of(result, parameters, sweep, workers, progress, vehicles=uncertain.vehicles)
    effects, place = list(found[:kept]), kept
    for part in uncertain.parts:
        effects += _correlated(found[place : place + len(part.names)], part)
        place += len(part.names)
    effects += found[place:]
    car = any(part.part == result.study.vehicle.name for part in uncertain.parts)
    source = VehicleSource.REPLACED if uncertain.vehicles else VehicleSource.ADDED if car else VehicleSource.MODEL
    known = {part.part for part in uncertain.parts}
    left = tuple(build for build in unstated if build not in known)
    return Knowledge(tuple(effects), left, run_to_run, notes=notes, vehicle=source)


def _values_in_study(result: StudyResult, part: Uncertain) -> Mapping[str, float]:
    study = result.study
    _check_part(study, part.part)
    made = study.vehicle if part.part == study.vehicle.name else study.bank[part.part]
    found = parameter_values(made.fmu, made.parameters, part.names)
    if missing := [name for name in part.names if name not in found]:
        raise InputError(f"{part.part}: {made.fmu} has no parameter {missing[0]!r}; remove it from the file")
    return found


def _parameters(part: Uncertain, values: Mapping[str, float]) -> list[UncertainParameter]:
    shape = (len(part.names),)
    low, high = (np.broadcast_to(limit, shape).tolist() for limit in (part.lowest, part.highest))
    rows = zip(part.names, part.deviations.tolist(), low, high, strict=True)
    return [
        UncertainParameter(part.part, values[name], ParameterUncertainty(name, deviation, None, *limits), part.left_out)
        for name, deviation, *limits in rows
    ]


def _correlated(effects: Sequence[Effect], part: Uncertain) -> list[Effect]:
    """Return the effects of independent combinations of correlated parameters."""
    deviations = part.deviations
    scale = np.where(deviations > 0.0, deviations, 1.0)
    correlation = part.covariance / np.outer(scale, scale)
    if np.allclose(correlation, np.diag(correlation.diagonal())) or len(effects) < 2:
        return list(effects)
    variances, axes = np.linalg.eigh(correlation)
    factors = axes * np.sqrt(np.maximum(variances, 0.0))
    name = " and ".join(part.names)
    return [_combined(effects, column, f"{name}, combination {k + 1}") for k, column in enumerate(factors.T)]


def _combined(effects: Sequence[Effect], factors: Array, name: str) -> Effect:
    def summed(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
        names = dict.fromkeys(measure for row in rows for measure in row)
        return {m: float(sum(f * row.get(m, 0.0) for f, row in zip(factors, rows, strict=True))) for m in names}

    places = dict.fromkeys((c, b) for one in effects for c, builds in one.changes.items() for b in builds)
    changes: dict[str, dict[str, dict[str, float]]] = {}
    for corner, build in places:
        row = summed([one.changes.get(corner, {}).get(build, {}) for one in effects])
        changes.setdefault(corner, {})[build] = row
    return Effect(effects[0].part, name, 1.0, 0.0, summed([one.shared for one in effects]), changes)


# ---- Check of the linear model by simulated draws -------------------------------------------------------------------


class LinearityCheck(NamedTuple):
    """Largest difference between the linear effects and simulated draws."""

    measure: str  #: Name of the measure.
    setup: int  #: Number of the setup.
    linear: float  #: Standard deviation of its difference from the leading setup by the linear effects, SI.
    simulated: float  #: The same from simulated draws, SI.
    draws: int  #: Number of draws.

    def summary(self) -> str:
        """Return the check as a sentence."""
        change = 100.0 * (self.linear / self.simulated - 1.0)
        return (
            f"linear effects against {self.draws} simulated draws: the standard deviation of a difference from the "
            f"leading setup differs most for setup {self.setup}, {self.measure}: {change:+.0f} %"
        )


def linearity_check(result: StudyResult, known: Knowledge, spreads: Sequence[Spread]) -> LinearityCheck | None:
    """Return the largest difference between the linear effects and simulated draws; None without draws.

    Setups whose difference varies by less than a tenth of the largest variation are left out: their relative difference
    matters little.
    """
    sources = error_sources(result, known.effects, vehicle=known.vehicle)
    rows = {int(number): row for row, number in enumerate(result.setups)}
    found = list[LinearityCheck]()
    for spread in spreads:
        if spread.measure not in sources.names or len(spread.draws) < 2 or not np.isfinite(spread.values).any():
            continue
        m, leader = sources.index(spread.measure), int(np.nanargmin(spread.values))
        chosen = np.array([rows[int(number)] for number in spread.setups])
        changes = spread.values[:, None] * sources.by_parameter(chosen, m)
        linear = np.sqrt(np.sum((changes - changes[leader]) ** 2, axis=1))
        simulated = (spread.draws - spread.draws[:, leader : leader + 1]).std(axis=0, ddof=1)
        for k in np.flatnonzero(simulated > 0.1 * np.nanmax(simulated)).tolist():
            figures = int(spread.setups[k]), float(linear[k]), float(simulated[k]), len(spread.draws)
            found.append(LinearityCheck(spread.measure, *figures))
    return max(found, key=lambda one: abs(np.log(max(one.linear, 1e-300) / one.simulated))) if found else None


# ---- Reader of uncertainty files (TOML, docs/how_to/study_choice.md) ------------------------------------------------


class _Known(BaseModel, extra="forbid"):
    value: float
    deviation: float = Field(ge=0.0)
    lowest: float = -inf
    highest: float = inf


class _Part(BaseModel, extra="forbid"):
    part: str
    parameters: dict[str, _Known] = Field(min_length=1)
    correlation: list[list[float]] | None = None


class _File(BaseModel, extra="forbid"):
    schema_: int = Field(alias="schema")
    uncertain: list[_Part] = Field(default_factory=list)
    fits: dict[str, str] = Field(default_factory=dict)
    vehicles: list[str] = Field(default_factory=list)
    run_to_run: dict[str, float | str] = Field(default_factory=dict)
    compared: str = ""
    runs: int = Field(default=1, ge=1)


def read_uncertainty(path: str | Path, result: StudyResult) -> Uncertainty:
    """Read an uncertainty file for a study; paths in it are relative to the file.

    Raises:
        FileFormatError: The file cannot be read, or an entry is unknown, missing or invalid; the message has its line.
    """
    path = Path(path)
    text = read_text(path, advice="name an uncertainty file (docs/how_to/study_choice.md)")
    document = parse_model(_File, text, path, 1)
    try:
        return _uncertainty(document, path.parent, result)
    except InputError as error:
        raise FileFormatError(str(error), path=path) from error


def _uncertainty(document: _File, folder: Path, result: StudyResult) -> Uncertainty:
    for build in document.fits:
        if build not in result.study.bank:
            raise InputError(f"fits: there is no build {build!r}; the builds are {', '.join(result.study.bank)}")
    measured = read_run_to_run(folder / document.compared) if document.compared else {}
    return Uncertainty(
        parts=tuple(_part(entry) for entry in document.uncertain),
        fits={build: folder / file for build, file in document.fits.items()},
        vehicles=tuple(folder / file for file in document.vehicles),
        run_to_run=measured | {name: _noise(name, value, result) for name, value in document.run_to_run.items()},
        runs=document.runs,
    )


def _part(entry: _Part) -> Uncertain:
    known = list(entry.parameters.values())
    deviation = np.array([k.deviation for k in known])
    rows = np.eye(len(known)).tolist() if entry.correlation is None else entry.correlation
    if [len(row) for row in rows] != [len(known)] * len(known):
        raise InputError(
            f"{entry.part}: the correlation of {len(known)} parameters must be a matrix of {len(known)} rows and "
            "columns"
        )
    return Uncertain(
        entry.part,
        tuple(entry.parameters),
        np.array([k.value for k in known]),
        np.array(rows) * np.outer(deviation, deviation),
        np.array([k.lowest for k in known]),
        np.array([k.highest for k in known]),
    )


def _noise(name: str, value: float | str, result: StudyResult) -> float:
    """Return a run-to-run deviation in SI; numbers without a unit are in SI."""
    result.study.measure(name)
    if not isinstance(value, str):
        return value
    number, unit = units.quantity(value)
    return abs(float(units.convert(number, unit, result.unit(name))))
