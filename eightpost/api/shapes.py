"""Search for the target curves of a study: shapes of shocks, run by FMUs, the valving that gives them, and clicks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import qmc

from builder.build import build
from cosim.study.choice.assess import Knowledge, posterior_of
from cosim.study.choice.certainty import OBJECTIVE, Certainty
from cosim.study.choice.optimise import Search, search_study
from cosim.study.choice.shape_search import (
    ASSURED,
    Band,
    DrawnCar,
    Evaluation,
    Problem,
    Range,
    Robustness,
    ShapeOptimum,
    ShockSpace,
    VehicleDraws,
    band,
    groups_of,
    search,
)
from cosim.study.definition import Build, Study
from cosim.study.running.evaluator import Coupling
from cosim.study.running.sweep import Sweep, Trials
from cosim.study.running.workers import Workers
from cosim.study.table import StudyResult
from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.shock import Shock, StaticCurve, read_shock, write_shock
from eightpost.shock.curve import INNER_ORDER, KNOTS, OUTER_ORDER
from eightpost.shock.shape import (
    CURVE_NUMBERS,
    NUMBERS,
    Shape,
    ShapeFit,
    curve_parameters,
    difference,
    fit_force,
    fit_law,
    range_of,
    unit_of,
    with_slope,
)
from eightpost.virtual.damper import NearestValving, nearest_valving

if TYPE_CHECKING:
    from cosim.components.component import Variable


def change_of(
    build: Build, variables: Mapping[str, Variable], steps: Mapping[str, float], *, share: float, speeds: str
) -> tuple[dict[str, float], dict[str, float], str]:
    """Return a shock's parameters without and with a change of clicks, and a description of the change.

    Args:
        steps: Clicks by side, `rebound` and `compression`.
        share: Change of the slope that counts as a click, if the shock has no such adjuster [1].
        speeds: Speeds at which the slope changes: `low`, `high` or `all`.

    Raises:
        InputError: An adjuster is at its stop, or the shock has neither an adjuster nor a curve.
    """
    adjusters = {side: f"clicks.{side}" for side in steps if f"clicks.{side}" in variables}
    after, words = {}, []
    for side, name in adjusters.items():
        own, variable = _value(build, variables, name), variables[name]
        after[name] = own + steps[side]
        low, high = variable.minimum, variable.maximum
        if (low is not None and after[name] < low) or (high is not None and after[name] > high):
            raise InputError(
                f"{name} would be {after[name]:g}, beyond its stops {'-' if low is None else f'{low:g}'} to "
                f"{'-' if high is None else f'{high:g}'}; use fewer clicks"
            )
        words.append(f"{name} from {own:g} to {after[name]:g}")
    left = {side: count for side, count in steps.items() if side not in adjusters}
    if not left:
        return {}, after, ", ".join(words)
    before, changed = _slopes(build, variables, left, share, speeds)
    words += [f"{side} slope at {speeds} speeds {100.0 * share * count:+g} %" for side, count in left.items()]
    return before, {**changed, **after}, ", ".join(words)


def _slopes(
    build: Build, variables: Mapping[str, Variable], steps: Mapping[str, float], share: float, speeds: str
) -> tuple[dict[str, float], dict[str, float]]:
    same = after = _curve(build, variables)
    for place, (side, count) in enumerate(steps.items()):
        unchanged, after = with_slope(after, side, share * count, speeds)
        same = unchanged if place == 0 else same
    return curve_parameters(same), curve_parameters(after)


def _curve(build: Build, variables: Mapping[str, Variable]) -> StaticCurve:
    """Return the curve of a shock FMU of this project from its parameters."""
    sizes = {"inner": INNER_ORDER, "compression": OUTER_ORDER + 1, "rebound": OUTER_ORDER + 1}
    sizes |= dict.fromkeys(("knot_velocity", "knot_force", "knot_slope"), KNOTS)
    single = ("transition_speed", "transition_width", "compression_speed", "rebound_speed", "compression_slope",
              "rebound_slope")  # fmt: skip
    if "curve.compression_slope" not in variables:
        raise InputError(
            f"{build.fmu} has neither an adjuster of this name nor the curve of an eightpost FMU; run the change as "
            "another build of the study with its own parameters"
        )
    arrays: dict[str, Any] = {
        name: tuple(_value(build, variables, f"curve.{name}[{k}]") for k in range(1, size + 1))
        for name, size in sizes.items()
    }
    return StaticCurve(**arrays | {name: _value(build, variables, f"curve.{name}") for name in single})


def _value(build: Build, variables: Mapping[str, Variable], name: str) -> float:
    own = build.parameters.get(name, variables[name].start if name in variables else 0.0)
    return float(own or 0.0)


# ==== What the search is asked for ===================================================================================

#: Largest tolerance [1]: with a third, a drawn number is rarely below zero.
_WIDEST = 0.33


@dataclass(frozen=True, slots=True)
class Request:
    """What to search.

    Raises:
        InputError: There is no such number, limits are in the wrong order or of a number that does not vary, or the
            tolerance or the share of the gain is out of range.
    """

    #: Names of the numbers that vary; the others are those of the best build of the bank at each corner.
    vary: tuple[str, ...] = CURVE_NUMBERS
    #: Lower and upper limit [SI] by number; numbers without limits range over the bank.
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    corners: tuple[str, ...] = ()  #: Corners whose shocks are searched, with those that are alike; empty: all.
    tolerance: float = 0.03  #: Standard deviation of every number from shock to shock, as a share of its value [1].
    #: Draws of the tolerance, and weight of the scatter.
    robustness: Robustness = field(default_factory=lambda: Robustness(6))
    starts: int = 3  #: Number of starts of the search: the best setup of the bank, the baseline, and random points.
    keep: float = 0.8  #: Share of the gain that the band keeps [1].
    objective: str = ""  #: Measure to minimise; empty: the objective of the study.
    seed: int = 0  #: Seed of the random starts.
    uncertain: bool = True  #: Whether the errors that the vehicle states are drawn too.

    def __post_init__(self) -> None:
        if not 0.0 <= self.tolerance <= _WIDEST:
            raise InputError(f"tolerance must be 0 to {100.0 * _WIDEST:g} %, not {100.0 * self.tolerance:g} %")
        if not 0.0 < self.keep <= 1.0:
            raise InputError(
                f"keep, the share of the gain, must be above 0 and at most 100 %, not {100.0 * self.keep:g} %"
            )
        for name in (*self.vary, *self.limits):
            if name not in NUMBERS:
                raise InputError(f"a shape has no number {name!r}; its numbers are {', '.join(NUMBERS)}")
        for name, (low, high) in self.limits.items():
            if not low < high:
                unit = unit_of(name)
                raise InputError(f"limits of {name}: the lower one, {low:g} {unit}, must be below {high:g} {unit}")
            if name not in self.vary:
                raise InputError(f"there are limits of {name}, which does not vary; name it with --vary too")


# ==== The search =====================================================================================================

#: Setups that are run through the study with FMUs of their own.
VERIFIED = ("best of the bank", "targets", "nearest builds of the bank", "nearest valvings of the virtual damper")


def _shapes_of_bank(sources: Mapping[str, Path]) -> dict[str, ShapeFit]:
    """Return the shape of each build of a bank from its shock file."""
    if not sources:
        raise InputError(
            "no build of the bank is a shock file (.json), so the range of shapes is not known; name shock files in "
            "[bank], or state the limits of every number with --limit"
        )
    return {name: fit_law(read_shock(path).law) for name, path in sources.items()}


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Curves that a search found."""

    trials: Trials  #: Runs of the study.
    space: ShockSpace  #: Numbers that varied at each group of corners, with their ranges.
    fits: Mapping[str, ShapeFit]  #: Shape of each build of the bank that has a shock file, with its residual.
    bank: Mapping[str, str]  #: Builds of the best setup of the bank, by corner.
    bases: Mapping[tuple[str, ...], Shape]  #: Shape of the best setup of the bank, by group of corners.
    reference: Evaluation  #: Values of that setup, its shocks as shapes.
    optimum: ShapeOptimum  #: Result of the search.
    car: DrawnCar | None  #: Cars that the true one may be; None if the vehicle is taken to be exact.
    gains: Array  #: Gain over the best setup of the bank, for each draw of shocks and cars (N,).
    band: Band | None  #: Band that keeps the assured gain; None without one.

    def shapes_at(self, point: Array) -> dict[tuple[str, ...], Shape]:
        """Return the shape of each group of corners at a point (n,)."""
        numbers = self.space.numbers(self.space.values(point[None])[0])
        return {group: self.bases[group].with_numbers(own) for group, own in zip(self.bases, numbers, strict=True)}

    @property
    def predicted_gain(self) -> float:
        """Predicted objective of the best setup of the bank less that of the targets, shocks exactly as planned."""
        return float(self.reference.nominal[0]) - self.optimum.nominal

    @property
    def assured_gain(self) -> float:
        """Gain that is exceeded with a probability of 95 % over the draws of shocks and cars."""
        return float(np.quantile(self.gains, 1.0 - ASSURED))

    @property
    def chance(self) -> float:
        """Probability that the targets are better than the best setup of the bank, over the draws [1]."""
        return float(np.mean(self.gains > 0.0))


def _find_curves(
    requested: Sweep,
    sources: Mapping[str, Path],
    workers: Workers,
    coupling: Coupling,
    request: Request,
    certainty: Certainty | None = None,
    progress: Callable[[int], None] = lambda _runs: None,
) -> Curves:
    """Search for the curves to aim at and their band; see `aim` for the arguments and errors."""
    study = requested.study
    fits = _shapes_of_bank(sources)
    known, best = _best_of_bank(requested, workers, coupling, request.objective)
    bank = known.setup(best).builds
    car = _drawn_car(known, best, certainty, request.objective) if request.uncertain else None
    groups = searched_groups(study, request.corners)
    bases = {group: _base(fits, bank[group[0]]) for group in groups}
    folder = requested.folder / "shapes"
    space = _space(study, bank, bases, fits, _fmu(bases[groups[0]], folder), request)
    trials = Trials(study, requested.units, workers, coupling)
    own = space.point([bases[group].numbers() for group in groups])
    starts = _starts(space, own, study, fits, request)
    planned = search(Problem(trials, space, objective=request.objective), starts, progress=progress)
    robust = Problem(trials, space, request.robustness, request.objective, car)
    optimum = search(robust, [planned.point], iterations=_POLISHING, progress=progress)
    reference = robust.evaluate(own[None])
    start = float(reference.nominal[0])
    gains = start - robust.drawn(optimum.point[None])[0]
    kept = None
    if start > optimum.assured:
        exact = Problem(trials, space, Robustness(0, request.robustness.weight), request.objective, car)
        kept = band(exact, optimum, start, share=request.keep)
        progress(trials.count)
    optimum = replace(optimum, starts=planned.starts, status=(*planned.status, *optimum.status))
    return Curves(trials, space, fits, bank, bases, reference, optimum, car, gains, kept)


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """Curves to aim at, described and verified."""

    study: Study  #: Study.
    digest: str  #: Digest of the study's result.
    request: Request  #: Request.
    curves: Curves  #: Curves that the search found.
    targets: tuple[Target, ...]  #: Target curve of each group of corners.
    verified: StudyResult  #: Runs of FMUs of their own through the study, in the order of `VERIFIED`.
    runs: int  #: Number of setups that were run.

    def verified_objective(self, rank: int) -> float:
        """Return the objective of a run in `verified`, which are in the order of `VERIFIED`."""
        return float(_objectives(self.verified, self.request.objective)[rank])


def aim(
    requested: Sweep,
    sources: Mapping[str, Path],
    workers: Workers,
    coupling: Coupling,
    request: Request,
    certainty: Certainty | None = None,
    progress: Callable[[int], None] = lambda _runs: None,
) -> Aim:
    """Search for the curves to aim at, describe them, and verify them by runs of their own FMUs.

    Args:
        requested: Checked study with the runs of its bank; the bank is run first where it was not.
        certainty: Certainty of the study, whose rig runs are taken into account; None: without.

    Raises:
        InputError: A corner, number or limit is wrong, or the bank has no shock file.
    """
    found = _find_curves(requested, sources, workers, coupling, request, certainty, progress)
    shapes = found.shapes_at(found.optimum.point)
    problem = Problem(found.trials, found.space, objective=request.objective)
    targets = targets_of(problem, found.optimum, found.band, shapes, found.bases, found.fits, sources)
    verified = _verified(requested, workers, coupling, found.bank, targets)
    return Aim(requested.study, requested.digest, request, found, targets, verified, found.trials.count)


def _space(
    study: Study,
    bank: Mapping[str, str],
    bases: Mapping[tuple[str, ...], Shape],
    fits: Mapping[str, ShapeFit],
    fmu: Path,
    request: Request,
) -> ShockSpace:
    """Return the space of the shapes at the groups of corners; other corners keep the builds of the bank."""

    def build_of(group: tuple[str, ...], numbers: Mapping[str, float]) -> Build:
        return Build(fmu, bases[group].with_numbers(numbers).parameters())

    searched = {corner for group in bases for corner in group}
    fixed = {corner: study.bank[name] for corner, name in bank.items() if corner not in searched}
    return ShockSpace(tuple(bases), tuple(_range(name, request, fits) for name in request.vary), build_of, fixed)


#: Largest number of steps of the robust search, which starts from the best of the searches without draws.
_POLISHING = 12

#: Largest number of setups of a bank that is run completely; larger banks are searched.
_EXHAUSTIVE = 5000


def bank_plan(requested: Sweep) -> str:
    """Return which setups of the bank are run before the curves are searched."""
    if len(requested.study.space) > _EXHAUSTIVE:
        return f"at most {Search().evaluations} to be evaluated; then the curves are searched"
    return f"{requested.left} to be run; then the curves are searched"


def _best_of_bank(requested: Sweep, workers: Workers, coupling: Coupling, objective: str) -> tuple[StudyResult, int]:
    """Return the runs of the bank, and the row of its best setup."""
    study = requested.study
    if len(study.space) > _EXHAUSTIVE:
        result, _ = search_study(requested, workers, coupling, Search((objective,) if objective else ()))
    else:
        result = requested.request(workers, coupling, study.space.indices.tolist())
    rows = result.ranking(objective or None)
    if not rows.size:
        raise InputError("no setup of the bank runs and meets the constraints, so there is nothing to compare with")
    return result, int(rows[0])


def _drawn_car(result: StudyResult, best: int, certainty: Certainty | None, objective: str = "") -> DrawnCar | None:
    """Return the cars that the true one may be, given the rig runs; None if the vehicle states no uncertainty."""
    known = Knowledge.of(certainty) if certainty else Knowledge()
    draws = VehicleDraws.of(result, posterior_of(result, known))
    name = objective or (OBJECTIVE if result.study.objective else result.measures[0].name)
    return None if draws is None else DrawnCar.of(result, draws, name, best)


def searched_groups(study: Study, corners: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of alike corners that contain one of the corners; without corners all groups.

    Raises:
        InputError: There is no such corner.
    """
    if unknown := sorted(set(corners) - set(study.corners)):
        raise InputError(f"there is no corner {unknown[0]!r}; the corners are {', '.join(study.corners)}")
    return tuple(group for group in groups_of(study) if not corners or set(group) & set(corners))


def _base(fits: Mapping[str, ShapeFit], build_name: str) -> Shape:
    """Return the shape of a build; of a build without a shock file, that of the first one with."""
    return (fits.get(build_name) or next(iter(fits.values()))).shape


def _range(name: str, request: Request, fits: Mapping[str, ShapeFit]) -> Range:
    stated = request.limits.get(name)
    low, high = stated or range_of([fit.shape for fit in fits.values()], name)
    return Range(name, low, high, request.tolerance)


def _starts(space: ShockSpace, own: Array, study: Study, fits: Mapping[str, ShapeFit], request: Request) -> list[Array]:
    """Return the best setup of the bank, the baseline, and random points."""
    found = [own]
    if study.baseline and request.starts > 1:
        shapes = [_base(fits, study.baseline[group[0]]) for group in space.groups]
        found.append(space.point([shape.numbers() for shape in shapes]))
    count = max(request.starts - len(found), 0)
    return [*found, *qmc.LatinHypercube(space.size, rng=request.seed).random(count)]


def _fmu(shape: Shape, folder: Path) -> Path:
    """Build the FMU that plays every shape in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "any_shape.json"
    write_shock(Shock("any shape", shape.law()), path)
    return build([path], folder / "fmus")[0].path


# ---- Verification: FMUs of their own, run as any setup of a study ---------------------------------------------------


def _verified(
    requested: Sweep, workers: Workers, coupling: Coupling, bank: Mapping[str, str], targets: Sequence[Target]
) -> StudyResult:
    """Run the setups of `VERIFIED`; the rows are in this order."""
    study, folder = requested.study, requested.folder / "shapes"
    own, setups = dict(study.bank), [dict(bank) for _ in VERIFIED]
    shocks = {}
    for target in targets:
        shocks[f"target {target.name}"] = target.shape, folder / f"{target.name}.json"
        shocks[f"valving {target.name}"] = target.valving_shape, folder / f"{target.name}_valving.json"
    for name, (shape, path) in shocks.items():
        write_shock(Shock(name, shape.law()), path)
    built = build([path for _, path in shocks.values()], folder / "fmus")
    own |= {name: Build(item.path) for name, item in zip(shocks, built, strict=True)}
    for target in targets:
        planned, valved = f"target {target.name}", f"valving {target.name}"
        for setup, name in zip(setups[1:], (planned, target.neighbours[0].build, valved), strict=True):
            setup.update(dict.fromkeys(target.corners, name))
    allowed = {corner: tuple(dict.fromkeys(one[corner] for one in setups)) for corner in study.corners}
    checked = replace(study, bank=own, corners=allowed, alike=(), baseline=bank, name=f"{study.name}: targets")
    runs = requested.variant(checked, folder)
    numbers = [checked.space.find(one).index for one in setups]
    result = runs.request(workers, coupling, numbers)
    rows = np.searchsorted(result.setups, numbers)
    return replace(result, table=result.table.take(rows), _cache={})


def _objectives(result: StudyResult, measure: str) -> Array:
    if measure:
        return result.values(measure)
    own = result.objective
    return result.values(result.measures[0].name) if own is None else own


# ==== What is known about each target curve: its band, the builds of the bank and the valving near it ================


@dataclass(frozen=True, slots=True)
class _Neighbour:
    """A build of the bank near a target."""

    build: str  #: Name of the build.
    difference: float  #: RMS difference of the forces [N].
    relative: float  #: The same as a share of the target's RMS force [1].
    objective: float  #: Objective with this build at the target's corners and the targets elsewhere.


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """The curve to aim at for a group of corners."""

    corners: tuple[str, ...]  #: Corners with this shock.
    shape: Shape  #: Target.
    velocity: Array  #: Velocities (N,) [m/s].
    low: Array  #: Lowest force at `velocity` within the band (N,) [N].
    high: Array  #: Highest force at `velocity` within the band (N,) [N].
    #: Interval of each varied number that keeps the gain while the others stay [SI].
    alone: Mapping[str, tuple[float, float]]
    at_limit: tuple[str, ...]  #: Numbers that are at an end of their range.
    neighbours: tuple[_Neighbour, ...]  #: Builds of the bank, nearest first.
    valving: NearestValving  #: Nearest valving of the virtual damper.
    valving_shape: Shape  #: Shape of its static curve, with the lag of the target.
    valving_objective: float  #: Objective with that shape at the target's corners and the targets elsewhere.

    @property
    def name(self) -> str:
        """Name of the group: its corners joined by +."""
        return "+".join(self.corners)


#: Velocities at which the band is stated [m/s].
_VELOCITY = np.concatenate([-(np.linspace(1.0, 0.0, 41) ** 2), np.linspace(0.0, 1.0, 41)[1:] ** 2])

#: Distance from an end of the range that counts as being there, as a share of the range.
_AT_LIMIT = 0.01


def targets_of(
    problem: Problem,
    optimum: ShapeOptimum,
    kept: Band | None,
    shapes: Mapping[tuple[str, ...], Shape],
    bases: Mapping[tuple[str, ...], Shape],
    fits: Mapping[str, ShapeFit],
    sources: Mapping[str, Path],
) -> tuple[Target, ...]:
    """Return the targets with band, nearest builds and valving; builds and valvings are run in one batch."""
    space, study = problem.space, problem.trials.study
    planned = space.trial(space.values(optimum.point[None])[0])
    valvings = {group: nearest_valving(shape.curve().force) for group, shape in shapes.items()}
    trials, keys = list[Mapping[str, Build]](), list[tuple[tuple[str, ...], str]]()
    given = {}
    for group, shape in shapes.items():
        for name in fits:
            keys.append((group, name))
            trials.append({**planned, **dict.fromkeys(group, study.bank[name])})
        same = _shape_of_valving(valvings[group], shape)
        keys.append((group, ""))
        given[group] = same
        any_fmu = planned[group[0]].fmu
        trials.append({**planned, **dict.fromkeys(group, Build(any_fmu, same.parameters()))})
    objectives = dict(zip(keys, problem.scores(trials).objectives[:, 0].tolist(), strict=True))
    found = []
    for place, (group, shape) in enumerate(shapes.items()):
        low, high = _force_band(space, kept, place, bases[group], shape)
        neighbours = []
        for name in fits:
            apart = difference(shape, read_shock(sources[name]).law.curve.force)
            neighbours.append(_Neighbour(name, *apart, objectives[group, name]))
        neighbours.sort(key=lambda one: one.difference)
        alone, limits = _intervals(space, optimum, kept, place)
        found.append(Target(group, shape, _VELOCITY, low, high, alone, limits, tuple(neighbours), valvings[group],
                            given[group], objectives[group, ""]))  # fmt: skip
    return tuple(found)


def _shape_of_valving(found: NearestValving, target: Shape) -> Shape:
    """Return the shape of the static force of a valving, with seal friction and level, and the lag of its target."""

    def force(velocity: float) -> float:
        return float(np.interp(velocity, found.velocity, found.force))

    end = float(found.velocity[-1])
    shape = fit_force(force, end, end).shape
    return replace(shape, lag=target.lag, lag_force=target.lag_force, gas=target.gas)


def _force_band(
    space: ShockSpace, kept: Band | None, place: int, base: Shape, shape: Shape
) -> tuple[Array, Array]:  # fmt: skip
    """Return the lowest and the highest force (N,) [N] of the shapes in the band of a group."""
    points = np.empty((0, space.size)) if kept is None else kept.points
    shapes = [base.with_numbers(space.numbers(values)[place]) for values in space.values(points)]
    curves = [one.curve() for one in (shape, *shapes)]
    forces = np.array([[curve.force(v) for v in _VELOCITY.tolist()] for curve in curves])
    return forces.min(axis=0), forces.max(axis=0)


def _intervals(
    space: ShockSpace, optimum: ShapeOptimum, kept: Band | None, place: int
) -> tuple[dict[str, tuple[float, float]], tuple[str, ...]]:
    """Return the interval of each number that keeps the gain alone, and the numbers at an end of their range."""
    own = slice(place * len(space.ranges), (place + 1) * len(space.ranges))
    places = optimum.point[own]
    ends = np.repeat(places[:, None], 2, axis=1) if kept is None else kept.alone[own]
    alone = {one.name: (float(one.value(low)), float(one.value(high)))
             for one, (low, high) in zip(space.ranges, ends, strict=True)}  # fmt: skip
    limits = tuple(one.name for one, at in zip(space.ranges, places, strict=True) if abs(at - 0.5) >= 0.5 - _AT_LIMIT)
    return alone, limits
