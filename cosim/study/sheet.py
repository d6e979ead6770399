"""Data of a study's report: one row for each setup, and the curves of the shocks."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from colorsys import hls_to_rgb
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path, PurePath
from typing import Literal, NamedTuple

import numpy as np
from pydantic import with_config
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from cosim.components.fmu_component import FmuComponent
from cosim.report.page import Origin
from cosim.session.run import run
from cosim.study.choice.certainty import OBJECTIVE, TIE, Certainty, Levels
from cosim.study.choice.rig_day import Selected
from cosim.study.choice.sensitivity import Sensitivity
from cosim.study.definition import Build, Parameters, Study
from cosim.study.measures import Measure
from cosim.study.table import StudyResult
from cosim.study.verdict import study_verdict
from cosim.systems.coupling import Scenario
from cosim.systems.system import System
from eightpost.array_types import Array, Flags, Integers
from eightpost.errors import EightpostError, FileFormatError
from eightpost.files import atomic_path, json_content
from eightpost.report.charts import COLORS
from eightpost.report.tables import Display
from eightpost.schema import OPEN, document_of
from eightpost.signals import Drivefile, TimeSeries
from eightpost.units import metric
from eightpost.verdict import Verdict, is_intact

# ==== Curves of the shocks of a bank, measured on their FMUs, and the pages that the FMUs carry ======================

#: Velocities of a curve [m/s]: closer together where shocks have their knees.
VELOCITIES = np.sign(np.linspace(-1.0, 1.0, 61)) * np.linspace(-1.0, 1.0, 61) ** 2

#: Time for which each velocity is held [s], much longer than the lag of a shock, and step of the run [s].
HELD, STEP = 0.05, 1e-3

#: Page that an FMU carries about itself.
_PAGE = "documentation/index.html"

#: File by which an FMU of this project is recognised; pages of other FMUs are not copied.
_OWN = "resources/eightpost.json"


class ShockCurve(NamedTuple):
    """Force of a shock at constant velocities, after its lag has died out."""

    velocity: Array  #: Velocities (K,) [m/s], positive in compression.
    force: Array  #: Forces (K,) [N], at rest displacement.


def shock_curves(study: Study) -> dict[str, ShockCurve]:
    """Return the curve of every build of a study's bank, measured by a run of its FMU with the build's parameters.

    A build whose FMU cannot run alone is left out: its curve is an addition to the page, not a result of the study.
    """
    curves = dict[str, ShockCurve]()
    for name, build in study.bank.items():
        try:
            curves[name] = shock_curve(build)
        except (EightpostError, OSError):
            continue
    return curves


def shock_curve(build: Build) -> ShockCurve:
    """Return the curve of one build.

    Raises:
        EightpostError: The FMU cannot be loaded or run alone.
    """
    time = STEP * np.arange(round(VELOCITIES.size * HELD / STEP) + 1)
    places = np.minimum((time / HELD + 1e-9).astype(np.int64), VELOCITIES.size - 1)
    shock = FmuComponent(build.fmu, "shock")
    inputs = [one for one in shock.variables.values() if one.causality == "input"]
    channels = {
        one.name: (one.unit.name if one.unit else "1", np.full(time.size, float(one.start or 0.0))) for one in inputs
    }
    channels["velocity"] = ("m/s", VELOCITIES[places])
    drive = Drivefile(TimeSeries.from_channels(time, channels))
    system = System({"shock": shock}, parameters={"shock": build.parameters})
    scenario = Scenario(float(time[-1]), drive, {name: f"shock.{name}" for name in channels}, record=("shock.force",))
    series = run(system, scenario, step=STEP, compared=False).series
    ends = HELD * (1.0 + np.arange(VELOCITIES.size)) - STEP
    return ShockCurve(VELOCITIES, np.interp(ends, series.time, series["shock.force"]))


def copy_shock_pages(study: Study, folder: Path) -> Mapping[str, str]:
    """Copy the page that each FMU of a bank carries; return the pages' paths relative to the folder, by build."""
    pages = dict[str, str]()
    for name, build in study.bank.items():
        try:
            with zipfile.ZipFile(build.fmu) as archive:
                content = archive.read(_PAGE) if {_PAGE, _OWN} <= set(archive.namelist()) else b""
        except (OSError, zipfile.BadZipFile):
            continue
        if content:
            page = Path("shocks", f"{re.sub(r'[^A-Za-z0-9]+', '_', name)}_{len(pages) + 1}.html")
            with atomic_path(folder / page) as temporary:
                temporary.write_bytes(content)
            pages[name] = page.as_posix()
    return pages


# ---- Colours of the builds of a bank --------------------------------------------------------------------------------

_GOLDEN = 0.618034


def build_colors(count: int) -> tuple[str, ...]:
    """Return distinct colours: first those of the run's page, then hues that are far from each other."""
    more = (hls_to_rgb(_GOLDEN * k % 1.0, 0.35 + 0.15 * (k % 3), 0.6) for k in range(count - len(COLORS)))
    return (*COLORS[:count], *("#" + "".join(f"{round(255 * part):02x}" for part in rgb) for rgb in more))


# ---- Display units of the page --------------------------------------------------------------------------------------


class Scale(NamedTuple):
    """Display units of a quantity in both systems."""

    us: Display
    metric: Display

    @classmethod
    def of(cls, si: str, display: str = "") -> Scale:
        """Return the display units of an SI unit; an unknown unit of a user-defined measure is shown unchanged.

        Args:
            display: US customary unit that the measure asks for; default: that of the table of display units.
        """
        us = display if display != si else ""
        return cls(Display.of(si, us) if us else Display.us(si), Display.of(si, metric(si)))


# ---- Data of the report ---------------------------------------------------------------------------------------------


class Uncertainty(NamedTuple):
    """Uncertainty of one measure of S setups; NaN if not known."""

    low: Array  #: (S,) lower ends of the 95 % intervals of the true values [SI].
    high: Array  #: (S,) upper ends [SI].
    best: Array  #: (S,) probability of having the best true value of all feasible setups [1].
    tied: Flags  #: (S,) whether a setup is one of the smallest set that contains the best with a probability of 95 %.


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One value of every setup: a measure, or the objective."""

    name: str  #: Display name.
    scale: Scale  #: Display units.
    values: Array  #: Values in SI (S,); NaN for failed setups.
    better: Literal["low", "high"] = "low"  #: Whether low or high values are better.
    uncertainty: Uncertainty | None = None  #: Uncertainty of the values; None if not known.

    @property
    def extremes(self) -> tuple[float, float]:
        """Minimum and maximum over all setups [SI], as in Table 7.4; zeros if no setup has a value."""
        known = self.values[np.isfinite(self.values)]
        return (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)

    @property
    def levels(self) -> Array:
        """Levels (S,): 0 for the lowest value of all setups, 1 for the highest (7.2)."""
        low, high = self.extremes
        return (self.values - low) / ((high - low) or 1.0)


class Bound(NamedTuple):
    """One limit of a constraint (G of Eq 2.3): `measure`, `at least` or `at most`, the value [SI]."""

    measure: str
    word: Literal["at least", "at most"]
    value: float
    scale: Scale

    def __str__(self) -> str:
        """Return the limit in US customary units."""
        return f"{self.measure} {self.word} {self.scale.us(self.value):.4g} {self.scale.us.unit}"


class Weighted(NamedTuple):
    """Term of the objective: the weight times the measure in the unit of `display`."""

    measure: str
    weight: float
    display: Display


@dataclass(frozen=True, slots=True)
class Background:
    """Title, objective, constraints, notes and provenance of a report."""

    title: str = "Setup study"  #: Heading of the page.
    objective: str = ""  #: Formula of the objective in words; empty if the study has none.
    constraints: tuple[Bound, ...] = ()  #: Limits of the constraints.
    notes: tuple[str, ...] = ()  #: Notes that limit the use of the numbers.
    facts: tuple[tuple[str, str], ...] = ()  #: Settings and versions, as pairs of name and value.
    origins: tuple[Origin, ...] = ()  #: Files that the study used.
    #: Command that computes the traces of a setup, with `{setup}` in place of its number; may be empty.
    trace_command: str = ""
    verdict: Verdict = field(default_factory=Verdict)  #: Verdict on the study.


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """Measures of S setups with C corners."""

    corners: tuple[str, ...]  #: Names of the corners.
    builds: tuple[str, ...]  #: Names of all builds of the bank.
    settings: tuple[str, ...]  #: Clicks and other parameters of each build, as text; empty if it has none.
    numbers: Integers  #: Numbers of the setups (S,), each once.
    placed: Integers  #: Index of the build of each setup at each corner (S, C).
    measures: tuple[Column, ...]  #: Columns in display order: the measures of the objective and the constraints first.
    allowed: Flags  #: Whether a setup meets every constraint (S,).
    coupling_error: Array  #: Estimated coupling error [%] (S,); NaN if not known.
    objective: Column | None = None  #: Values by which setups are ranked; the first measure if None.
    failures: Mapping[int, str] = field(default_factory=dict)  #: Reason of the failure by row.
    marks: Mapping[int, str] = field(default_factory=dict)  #: Marks of setups by row.
    baseline: int | None = None  #: Row of the baseline setup.
    terms: tuple[Weighted, ...] = ()  #: Terms of the objective.
    certainty: Certainty | None = None  #: Certainty of the choice; None if it was not computed.
    background: Background = field(default_factory=Background)  #: Title, objective, constraints, notes and provenance.

    @property
    def ranked_by(self) -> Column:
        """The objective, or the first measure where the study has none."""
        return self.objective or self.measures[0]

    @property
    def done(self) -> Flags:
        """Whether a setup has a value to rank it by (S,)."""
        return np.isfinite(self.ranked_by.values) & ~np.isin(np.arange(self.numbers.size), list(self.failures))

    @property
    def order(self) -> Integers:
        """Rows from the best to the worst (S,): feasible setups, those that break a constraint, failed ones."""
        cost = self.ranked_by.values * (1.0 if self.ranked_by.better == "low" else -1.0)
        return np.lexsort((self.numbers, cost, ~self.allowed, ~self.done)).astype(np.int64)

    def row(self, number: int) -> int | None:
        """Return the row of a setup by its number; None if the study does not contain it."""
        found = np.flatnonzero(self.numbers == number)
        return int(found[0]) if found.size else None

    def remark(self, row: int) -> str:
        """Return the remark on a setup: its failure, else its mark and whether it breaks a constraint; may be empty."""
        broken = "" if self.allowed[row] else "breaks a constraint"
        return self.failures.get(row) or ", ".join(filter(None, (self.marks.get(row, ""), broken)))

    def fitted(self, row: int) -> str:
        """Return the builds of a setup as text, corner by corner.

        For example `LF C/B, RF C/B, LR AA/B, RR C/C`.
        """
        places = zip(self.corners, self.placed[row], strict=True)
        return ", ".join(f"{corner.upper()} {self.builds[build]}" for corner, build in places)


#: Content and page of the curves to aim at, which `eightpost study shapes` writes.
AIM, AIM_PAGE = "shapes.json", "shapes.html"


class _Gain(TypedDict):
    predicted: float
    assured: float
    includes_car: bool


class _Objective(TypedDict):
    best_of_bank: float


@with_config(OPEN)
class _Aim(TypedDict):
    """Entries of the curves to aim at that the page of a study shows."""

    digest: str
    gain: _Gain
    objective: _Objective


class AimPage(NamedTuple):
    """Page of the curves to aim at."""

    path: str  #: Path relative to the page of the study.
    gain: float  #: Predicted gain over the best setup of the bank, as a share of its objective [1].
    assured: float  #: Gain that is exceeded with a probability of 95 % over the draws [1].
    is_sure: bool  #: Whether the errors of the vehicle are included in it.

    @classmethod
    def of(cls, folder: Path, digest: str) -> AimPage | None:
        """Return the page in the folder of a study; None if it has none of the study with this digest, unedited."""
        if not (folder / AIM_PAGE).is_file():
            return None
        try:
            content = json_content(folder / AIM)
            found = document_of(_Aim, content, folder / AIM, "shapes", 1, "run eightpost study shapes again")
        except FileFormatError:
            return None
        gain, best = found["gain"], abs(found["objective"]["best_of_bank"])
        if found["digest"] != digest or not is_intact(content) or not best:
            return None
        return cls(AIM_PAGE, gain["predicted"] / best, gain["assured"] / best, gain["includes_car"])


@dataclass(frozen=True, slots=True, eq=False)
class Extras:
    """Optional content of a report."""

    traces: Mapping[int, TimeSeries] = field(default_factory=dict)  #: Time traces by setup number.
    sensitivities: Sequence[Sensitivity] = ()  #: Sensitivities of all or some measures.
    selection: Sequence[Selected] = ()  #: Setups to confirm on the rig.
    curves: Mapping[str, ShockCurve] = field(default_factory=dict)  #: Curves of the shocks, by build.
    shock_pages: Mapping[str, str] = field(default_factory=dict)  #: Pages of the shocks relative to the page, by build.
    aim: AimPage | None = None  #: Curves to aim at; None if none were searched.


def shown_columns(sheet: Sheet) -> tuple[Column, ...]:
    """Return the objective, if there is one, and the measures."""
    return (*((sheet.objective,) if sheet.objective else ()), *sheet.measures)


# ==== Data of the report from the result of a study ==================================================================


def tied_rows(best: Array) -> Flags:
    """Return the smallest set of rows that contains the best one with a probability of 95 %, as flags (S,).

    Args:
        best: Probability of each row of having the best value (S,); NaN counts as zero.
    """
    chance = np.nan_to_num(best)
    order = np.argsort(-chance, kind="stable")
    count = int(np.searchsorted(np.cumsum(chance[order]), TIE)) + 1
    flags = np.zeros(chance.size, dtype=np.bool_)
    flags[order[:count]] = chance[order[:count]] > 0.0
    return flags


def _uncertainty_of(levels: Levels | None) -> Uncertainty | None:
    """Return the uncertainty of a measure; None if it is not known."""
    if levels is None or not levels.is_known:
        return None
    low, high = levels.interval()
    return Uncertainty(low, high, levels.best, tied_rows(levels.best))


def sheet_of(result: StudyResult, *, certainty: Certainty | None = None, trace_command: str = "") -> Sheet:
    """Return the report data of a result.

    Args:
        certainty: Certainty of the study; None if it was not computed.
        trace_command: Command that computes the traces of a setup, with `{setup}` in place of its number.
    """
    levels = certainty.levels if certainty else {}
    builds, messages = tuple(result.study.bank), result.table["message"]
    units = {one.measure: one.unit or result.unit(one.measure) for one in result.study.objective}
    ranked = result.objective
    return Sheet(
        corners=tuple(result.study.corners),
        builds=builds,
        settings=tuple(_setting(build) for build in result.study.bank.values()),
        numbers=result.setups,
        placed=result.places(builds),
        measures=tuple(_column(result, one.name, levels.get(one.name)) for one in _by_interest(result.study)),
        allowed=result.feasible,
        coupling_error=result.column("coupling_error_percent"),
        objective=None
        if ranked is None
        else Column(OBJECTIVE, Scale.of("1"), ranked, uncertainty=_uncertainty_of(levels.get(OBJECTIVE))),
        failures={row: messages[row] or "it did not finish" for row in np.flatnonzero(~result.done).tolist()},
        marks={row: result.table["marks"][row] for row in np.flatnonzero(result.is_marked).tolist()},
        baseline=result.baseline_row,
        certainty=certainty,
        terms=tuple(
            Weighted(one.measure, one.weight, Display.of(result.unit(one.measure), units[one.measure]))
            for one in result.study.objective
        ),
        background=background(result, trace_command, certainty),
    )


def _setting(build: Build) -> str:
    """Return the parameters of a build as text, such as `rebound 20 clicks`."""
    clicks: str = "clicks."
    words: list[str] = []
    for name, value in build.parameters.items():
        adjuster = name.removeprefix(clicks)
        words.append(f"{adjuster} {value} clicks" if adjuster != name else f"{name.replace('_', ' ')} {value}")
    return ", ".join(words)


def background(result: StudyResult, trace_command: str, certainty: Certainty | None = None) -> Background:
    """Return objective, constraints, notes, settings and files of a result."""
    study = result.study
    terms = " + ".join(f"{term.weight:g} × ({term.measure} [{term.unit}])" for term in study.objective)
    notes = list[str]()
    if result.partial:
        counts = f"{len(result)} of {len(study.space)} setups were run"
        notes.append(f"The study is not complete: {counts}. Levels and ranks are of these.")
    if not study.vehicle.means_trusted:
        notes.append("The vehicle's response to constant inputs is not trusted, so the study has no measures of means.")
    return Background(
        title=study.name or "Setup study",
        objective=terms,
        constraints=tuple(_bounds(result)),
        notes=tuple(notes),
        facts=tuple(_facts(result)),
        origins=tuple(_origins(result)),
        trace_command=trace_command,
        verdict=study_verdict(result, certainty),
    )


def _by_interest(study: Study) -> list[Measure]:
    """Return the measures in display order: objective, constraints, others, and last those that depend on a mean."""
    names = (*(term.measure for term in study.objective), *(bound.measure for bound in study.constraints))
    named = [study.measure(name) for name in dict.fromkeys(names)]
    others = [measure for measure in study.measures if measure not in named]
    return [*named, *sorted(others, key=lambda measure: measure.absolute)]


def _column(result: StudyResult, name: str, levels: Levels | None) -> Column:
    scale = Scale.of(result.unit(name), result.display(name))
    rewarded = any(term.measure == name and term.weight < 0.0 for term in result.study.objective)
    return Column(name, scale, result.values(name), "high" if rewarded else "low", _uncertainty_of(levels))


def _bounds(result: StudyResult) -> Iterator[Bound]:
    for constraint in result.study.constraints:
        name = constraint.measure
        scale = Scale.of(result.unit(name), result.display(name))
        if isfinite(constraint.at_least):
            yield Bound(name, "at least", constraint.at_least, scale)
        if isfinite(constraint.at_most):
            yield Bound(name, "at most", constraint.at_most, scale)


def _facts(result: StudyResult) -> Iterator[tuple[str, str]]:
    study, seconds = result.study, result.column("seconds")
    yield "Setups", f"{len(result)} of {len(study.space)}, from {len(study.bank)} builds"
    if study.alike:
        yield "Corners with the same build", "; ".join(" and ".join(group) for group in study.alike)
    for drive in study.drives:
        yield f"Drive {drive.name}", f"{drive.file}, from {drive.start:g} to {drive.start + drive.stop:g} s"
    yield "Settling, left out of every measure", f"{study.settling:g} s"
    yield "Target coupling error", f"{study.accuracy:g} % of each signal's standard deviation"
    yield "Record step of the measured signals", f"{1e3 * study.record_step:g} ms"
    coupling = result.provenance.settings.get("coupling")
    if isinstance(coupling, Mapping):
        yield "Coupling", f"{coupling['scheme']}, steps of {1e3 * coupling['step']:g} ms"
    for name, one in result.provenance.above_band.items():
        yield f"Power of {name} above {one.high:.3g} Hz, where the vehicle was not identified", f"{one.share:.1%}"
    yield "Total wall time of all runs", f"{np.nansum(seconds):.4g} s"
    yield "Digest of the study", result.provenance.digest
    yield "Computed by", f"eightpost {result.provenance.tool_version}"


def _origins(result: StudyResult) -> Iterator[Origin]:
    """Yield the vehicle, the builds, the drives, and the other files that were read."""
    study, source = result.study, result.provenance
    guids, digests = _by_name(source.guids), _by_name(source.digests)
    files: dict[str, tuple[PurePath, Parameters]] = {"vehicle": (study.vehicle.fmu, study.vehicle.parameters)}
    files |= {f"build {name}": (build.fmu, build.parameters) for name, build in study.bank.items()}
    files |= {f"drive {drive.name}": (drive.file, {}) for drive in study.drives}
    known = {str(file) for file, _ in files.values()}
    files |= {f"file {PurePath(path).name}": (PurePath(path), {}) for path in source.digests if path not in known}
    for what, (file, parameters) in files.items():
        identity, digest = (found.get(str(file)) or found.get(file.name, "") for found in (guids, digests))
        changed = tuple(f"{name} = {value}" for name, value in parameters.items())
        yield Origin(what, file.name, identity, "", digest, changed)


def _by_name(known: Mapping[str, str]) -> dict[str, str]:
    """Return values by path, and also by file name if only one path has that name."""
    names = [PurePath(path).name for path in known]
    single = {PurePath(path).name: value for path, value in known.items() if names.count(PurePath(path).name) == 1}
    return single | dict(known)
