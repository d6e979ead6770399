"""One law fitted to prepared runs: options, the fit of laws with a lag, errors on left-out parts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.errors import choice_of
from eightpost.ident.shock.curve import CELLS, KnotBasis, basis_on
from eightpost.ident.shock.dynamics import FadingLag, FullLag, NoLag, best_lag, dynamics_for, projected
from eightpost.ident.shock.force import Dynamics, ForceModel, GasColumns, GasTreatment, gas_columns, limits_for
from eightpost.ident.shock.problem import TOLERANCE, FitModel, FitProblem, JointFit
from eightpost.ident.shock.runs import Runs
from eightpost.least_squares import Minimum, Residual, Robust, Weigh, downweighted_rows, reweighted, weights_for
from eightpost.progress import beats
from eightpost.shock import LAWS, fit_form
from eightpost.shock.laws import named_law

# ==== Options of a fit ===============================================================================================

#: A name in `LAWS`.
LawName = str
RecipeName = Literal["joint", "boggs"]

#: The law of a fit if none is named, by recipe.
DEFAULT_LAW = {"joint": "hysteresis", "boggs": "lpnl2"}

#: Form of a law that has a recipe of its own (hysteresis.py).
_LAGGED_VELOCITY = "lagged velocity"


@dataclass(frozen=True, slots=True)
class Choices:
    """Options of a fit."""

    #: `joint` (all parameters together, a curve through knots) or `boggs` (one after the other, a curve of polynomials,
    #: as in 3.3).
    recipe: RecipeName = "joint"
    #: Treatment of the gas force F_0 + K (x - x_ref), x_ref the mean displacement: `estimate` fits it and makes it part
    #: of the shock; `included` fits it and leaves it out of the shock, because the car's static load includes it;
    #: `subtracted`: the dynamometer has already subtracted it.
    gas: GasTreatment = "estimate"
    robust: Robust = "auto"  #: Treatment of outliers: `auto`, `none`, `huber`, `tukey` (boggs: always none).

    def law(self, name: str | None) -> str:
        """Return the law to fit, if all options are known.

        Raises:
            ParameterError: An option or the law is unknown.
        """
        choice_of("recipe", self.recipe, get_args(RecipeName))
        choice_of("gas treatment", self.gas, get_args(GasTreatment))
        choice_of("robust", self.robust, get_args(Robust))
        return named_law(DEFAULT_LAW[self.recipe] if name is None else name)

    @property
    def is_screened(self) -> bool:
        """Whether spikes are replaced before the fit."""
        return self.recipe != "boggs" and self.robust != "none"


def has_own_recipe(law: str) -> bool:
    """Return whether a law is fitted by a recipe of its own (hysteresis.py)."""
    return fit_form(LAWS[law]) == _LAGGED_VELOCITY


# ==== A fitted law, as the errors on left-out parts use it ===========================================================


@dataclass(frozen=True, slots=True, eq=False)
class FittedLaw(ABC):
    """A law fitted to the runs of one or more settings, from which it can be fitted again with other weights."""

    law: str  #: Name of the law.
    notes: tuple[str, ...]  #: Notes on the choices that differ from the dissertation's, without those of the recipe.
    model: FitModel  #: Model of the whole records with the weights of the fit.

    @property
    def runs(self) -> Runs:
        """The runs with the weights of the fit."""
        return self.model.runs

    @property
    def weights(self) -> Array:
        """Weights (R,) of the rows."""
        return self.runs.weights

    @property
    @abstractmethod
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""

    @property
    @abstractmethod
    def has_converged(self) -> bool:
        """Whether the search ended at a minimum."""

    @abstractmethod
    def solution(self) -> JointFit:
        """Return the solution with its covariance."""

    @abstractmethod
    def refitted_rows(self, weights: Array) -> Array:
        """Return the force (R,) [N] of a free simulation, fitted again with weights (R,) from this minimum."""

    def robust_weights(self, weigh: Weigh) -> Array:
        """Return the weights (R,) that the residuals give, those of each setting by its own."""
        sizes = np.cumsum([model.runs.target.size for model in self.model.models])[:-1]
        parts = zip(np.split(self.error, sizes), self.model.models, strict=True)
        return np.concatenate([weigh(error, model.runs.deviation) for error, model in parts])

    def downweighted(self) -> tuple[int, list[str]]:
        """Return the number of samples that were down-weighted as outliers, and a note if there are any."""
        down, rows = downweighted_rows(self.weights), self.weights.size
        samples = round(down * self.runs.measured.size / rows)
        if not samples:
            return 0, []
        return samples, [f"{samples} samples ({100.0 * down / rows:.2g} %) were down-weighted as outliers"]


def joint_model(groups: Sequence[Runs], gas: GasColumns, dynamics: Dynamics, *, cells: int = CELLS) -> FitModel:
    """Return the model of the runs of each setting: their curves have the same knots."""
    knots = KnotBasis.of(np.concatenate([runs.velocity[runs.inside] for runs in groups]), cells=cells)
    models, start, offset = [], 0, 0
    for runs in groups:
        stop, last = start + runs.velocity.size, offset + (len(runs.prepared) if gas.offsets else 0)
        columns = [*range(offset, last), *([gas.columns.shape[1] - 1] if gas.size else [])]
        part = GasColumns(gas.columns[start:stop, columns], last - offset, gas.size, gas.reference)
        models.append(ForceModel(runs, basis_on(knots, runs.velocity), part, dynamics))
        start, offset = stop, last
    return FitModel(tuple(models))


def all_runs(groups: Sequence[Runs]) -> Runs:
    """Return the runs of all settings, with their weights."""
    if len(groups) == 1:
        return groups[0]
    runs = Runs.of([prepared for group in groups for prepared in group.prepared])
    return runs.weighted(np.concatenate([group.weights for group in groups]))


def hardest(groups: Sequence[Runs]) -> Runs:
    """Return the runs of the setting with the largest force, from which the search of a joint fit starts."""
    return max(groups, key=lambda runs: runs.deviation)


# ==== All parameters together, with outliers down-weighted ===========================================================
# The curve rises through knots. LPNL2 is never worse than LPF1 (the full lag), which it includes as a special case. A
# law is first fitted to a sketch, a part of the samples if they are costly; outliers are weighted there too. The result
# is then optimised on the whole record.

#: Maximum number of reweightings.
_WEIGHINGS = 4

#: Number of starting points of LPNL2 that are optimised, roughly, to their minimum.
_FOLLOWED = 2

#: Tolerance of these rough searches: the best start is known long before its minimum is.
_GUIDE = 1e-3

#: Tolerance of sketches, and of fits to parts of a record, which start from the fit to everything and must not stop
#: near it. The held-out errors change by less than 0.003 % of the force's standard deviation.
_REFIT = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class LawFit(FittedLaw):
    """A law fitted to runs, or a sketch of it."""

    problem: FitProblem  #: Problem on the samples used: those of thinned records in the sketch of a costly law.
    minimum: Minimum[Residual]  #: Its minimum.
    full_lag: Minimum[Residual] | None  #: Minimum of LPF1 from which the search started; None for a law without lag.

    @property
    def is_final(self) -> bool:
        """Whether it is a minimum on the whole record."""
        return self.problem.tolerance == TOLERANCE

    @property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        return self.problem.model.error(self.minimum.end.parameters)

    @property
    def has_converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.minimum.converged

    def solution(self) -> JointFit:
        """Return the solution with its covariance."""
        return self.problem.fit_at(self.minimum)

    def reweighted(self, weights: Array) -> LawFit:
        """Return the sketch with other weights (R,) of the rows, optimised from its minimum."""
        model = self.model.weighted(weights)
        problem = FitProblem(model) if self.is_final else _sketched(model)
        minimum = problem.minimum_from(self.minimum.end.parameters)
        return replace(self, model=model, problem=problem, minimum=minimum)

    def finished(self) -> LawFit:
        """Return the sketch optimised on the whole record."""
        if self.is_final:
            return self
        problem = FitProblem(self.model)
        minimum = problem.minimum_from(self.minimum.end.parameters)
        if self.full_lag is not None and isinstance(self.model.dynamics, FadingLag):
            minimum = min((minimum, _like(self.full_lag, problem)), key=lambda found: found.cost)
        return replace(self, problem=problem, minimum=minimum)

    def refitted_rows(self, weights: Array) -> Array:
        """Return the force (R,) [N] of a free simulation, fitted again with weights (R,) from this minimum.

        A costly law is optimised on a thinned record, but to the end: if the search stopped near its start, the fit to
        everything, the rows without weight would have been seen.
        """
        minimum = _sketched(self.model.weighted(weights)).minimum_from(self.minimum.end.parameters)
        return self.model.rows(minimum.end.parameters)


def fit_law(groups: Sequence[Runs], law: str, choices: Choices) -> LawFit:
    """Fit a law with a curve through knots for each setting to the runs of each."""
    weigh = weights_for(choices.robust)
    if len(groups) == 1:
        sketch = _sketch_of(groups[0], law, choices)
        whole = sketch.finished()
        if weigh is None or sketch.is_final or (sketch.weights == 1.0).all():
            return whole
        return reweighted(whole, lambda fit: fit.robust_weights(weigh), LawFit.reweighted, 1)
    gas, notes = gas_columns(all_runs(groups), choices.gas)
    first = fit_law([hardest(groups)], law, choices)
    model = joint_model(groups, gas, first.model.dynamics)
    problem = FitProblem(model)
    theta = first.minimum.end.parameters[first.model.first.linear_count :]
    minimum = problem.minimum_from(_static_start(model, theta))
    joint = LawFit(law, (*first.notes, *notes), model, problem, minimum, None)
    return joint if weigh is None else _reweighted(joint, weigh)


def _sketch_of(runs: Runs, law: str, choices: Choices) -> LawFit:
    """Return the sketch of a law, with weights that follow its residuals."""
    gas, notes = gas_columns(runs, choices.gas)
    model = joint_model([runs], gas, dynamics_for(LAWS[law], limits_for(runs.measured, runs.rate)))
    problem, minimum, full_lag = _searched(model)
    sketch = LawFit(law, (*model.dynamics.changes(), *notes), model, problem, minimum, full_lag)
    weigh = weights_for(choices.robust)
    return sketch if weigh is None else _reweighted(sketch, weigh)


def _static_start(model: FitModel, theta: Array) -> Array:
    """Return a start: each curve by linear least squares without a lag, and a given theta."""
    x = np.zeros(model.size)
    for part, place in zip(model.models, model.places, strict=True):
        linear = projected(part, part.curve_rows())[0]
        least = 0.05 * max(float(linear[: part.curve_count].mean()), 0.0)
        linear[: part.curve_count] = np.maximum(linear[: part.curve_count], least)
        x[place] = np.concatenate([linear, theta])
    return x


def _searched(model: FitModel) -> tuple[FitProblem, Minimum[Residual], Minimum[Residual] | None]:
    """Return the problem of a sketch with its minimum, and that of LPF1 from which the search started."""
    dynamics, single = model.dynamics, model.first
    tau = None if isinstance(dynamics, NoLag) else float(best_lag(single, dynamics.limits.time_constant)[-1])
    start = projected(single, single.curve_rows(tau))[0]
    if tau is None:
        return FitProblem(model), FitProblem(model).minimum_from(start), None
    lagged = FitProblem(model.with_dynamics(FullLag(dynamics.limits, dynamics.kind)))
    full_lag = lagged.minimum_from(np.append(start, tau))
    if isinstance(dynamics, FullLag):
        return lagged, full_lag, full_lag
    problem, parameters = _sketched(model), full_lag.end.parameters
    starts = dynamics.starts(problem.model.first, parameters, _FOLLOWED)
    best = _best(problem, starts or [np.append(parameters[:-1], dynamics.like_full_lag(single, parameters))])
    return problem, problem.minimum_from(best), full_lag


def _sketched(model: FitModel) -> FitProblem:
    """Return the problem with which a model of the whole record is sketched, and fitted to parts of it."""
    return FitProblem(model.coarse if model.dynamics.is_costly else model, tolerance=_REFIT)


def _best(problem: FitProblem, starts: Sequence[Array]) -> Array:
    """Return the end of a rough search from the best of some starting points."""
    if len(starts) == 1:
        return starts[0]
    guides = [replace(problem, tolerance=_GUIDE).minimum_from(start) for start in starts]
    return min(guides, key=lambda guide: guide.cost).end.parameters


def _like(full_lag: Minimum[Residual], problem: FitProblem) -> Minimum[Residual]:
    """Return LPF1's minimum as parameters of the problem of a law that fades."""
    parameters, model = full_lag.end.parameters, problem.model
    same = np.append(parameters[:-1], model.dynamics.like_full_lag(model.first, parameters))
    return Minimum(problem.at(same), True, "LPF1's solution: no fading of the lag is better")


def _reweighted(fit: LawFit, weigh: Weigh) -> LawFit:
    """Return a sketch with weights that follow its residuals; the last reweighting is done on the whole record."""
    times = _WEIGHINGS if fit.is_final else _WEIGHINGS - 1
    return reweighted(fit, lambda found: found.robust_weights(weigh), LawFit.reweighted, times)


# ==== Errors on parts of the records, or whole runs, that are left out of the fit and then predicted =================
# The law is simulated freely over every record, with the parameters of a fit to the other parts, and only the part that
# was left out counts.

#: Number of contiguous blocks of a record, of which each is left out once.
BLOCKS = 4

#: Gap on either side of a block, in which the residual is correlated with that of the block [s], and its upper bound as
#: a share of the record.
_GAP, _GAP_SHARE = 0.3, 0.02

#: Number of pieces of a left-out block or run whose errors are counted one by one.
PIECES = 4

#: Smallest mean square error [1] that counts; smaller ones are rounding.
_FLOOR = 1e-14

#: An addition to a law must lower the error by this share, and by more than one standard error.
WORTHWHILE = 0.02

#: Maximum number of fits that leave out runs or builds; with more of these, several are left out together.
_MOST_FITS = 8

#: Parts of the records that are left out.
Parts = Literal["builds", "runs", "quarters"]


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """A part of the records that is left out of a fit and predicted."""

    kept: NDArray[np.bool_]  #: Whether each row (R,) is fitted.
    parts: tuple[slice, ...]  #: Rows that are predicted, each a part of one run.
    is_whole: bool  #: Whether the parts are whole runs. The offset of such a run is then unknown.


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Errors of a law on what was left out."""

    #: Mean square error of each piece over the variance of the force of its run [1]; without the offset if whole runs
    #: were left out.
    pieces: tuple[float, ...]

    @property
    def percent(self) -> float:
        """Mean of the pieces' RMS errors in percent of the force's standard deviation."""
        return 100.0 * float(np.mean(np.sqrt(self.pieces)))

    def is_beaten_by(self, other: HeldOut) -> bool:
        """Return whether the other errors are lower by a notable share, and by more than one standard error.

        The pieces are compared one by one: all laws have larger errors on the same pieces, and one of these would
        outweigh the others in a difference of means.
        """
        ratios = _logarithms(self.pieces) - _logarithms(other.pieces)
        spread = float(np.std(ratios, ddof=1) / np.sqrt(ratios.size)) if ratios.size > 1 else 0.0
        return bool(ratios.mean() > max(spread, -np.log1p(-WORTHWHILE)))


@dataclass(frozen=True, slots=True)
class HeldOutErrors:
    """Errors of a fitted law on parts of the records that were left out of its fit, beside those of LPNL2."""

    left_out: Parts  #: Parts that were left out: `builds`, `runs` or `quarters`.
    percent: float  #: Error of the law in percent of the force's standard deviation.
    #: Error of LPNL2 on the same parts; None if the law is LPNL2, or if this cannot be fitted.
    lpnl2_percent: float | None = None

    def __str__(self) -> str:
        other = "" if self.lpnl2_percent is None else f" (LPNL2: {self.lpnl2_percent:.3g} %)"
        what = "quarters of the record" if self.left_out == "quarters" else f"whole {self.left_out}"
        return f"held-out error {self.percent:.3g} % of the force's standard deviation{other}, on {what}"

    def to_json(self) -> dict[str, Any]:
        """Return the errors as JSON values."""
        other = {} if self.lpnl2_percent is None else {"lpnl2_percent": self.lpnl2_percent}
        return {"left_out": self.left_out, "percent": self.percent, **other}


def _logarithms(pieces: tuple[float, ...]) -> Array:
    """Return the logarithms of RMS errors (P,), given mean squares."""
    return np.asarray(0.5 * np.log(np.maximum(pieces, _FLOOR)))


def left_out_blocks(runs: Runs) -> list[LeftOut]:
    """Return four sets of blocks with gaps; each set contains every fourth sixteenth of every run."""
    found = []
    for number in range(BLOCKS):
        kept, parts = np.ones(runs.target.size, dtype=bool), []
        for rows, rate in zip(_rows_of(runs), (f.row_rate for f in runs.filters), strict=True):
            ends = np.linspace(rows.start, rows.stop, BLOCKS * PIECES + 1).astype(int).tolist()
            gap = round(min(_GAP * rate, _GAP_SHARE * (rows.stop - rows.start)))
            for start, stop in list(pairwise(ends))[number::BLOCKS]:
                kept[max(start - gap, rows.start) : min(stop + gap, rows.stop)] = False
                parts.append(slice(start, stop))
        found.append(LeftOut(kept, tuple(parts), is_whole=False))
    return found


def left_out_groups(runs: Runs, names: Sequence[object]) -> list[LeftOut]:
    """Return the runs of each name (one for each run), of many names in groups."""
    rows, found, each = _rows_of(runs), [], list(dict.fromkeys(names))
    fits = min(len(each), _MOST_FITS)
    for number in range(fits):
        group = each[number::fits]
        kept, parts = (
            np.ones(runs.target.size, dtype=bool),
            tuple(r for r, n in zip(rows, names, strict=True) if n in group),
        )
        for part in parts:
            kept[part] = False
        found.append(LeftOut(kept, parts, is_whole=True))
    return found


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """A fitted law and its predictions of parts that are left out, each computed once when it is needed."""

    fit: FittedLaw  #: Fit to all records, from which the fits without a part start.

    @property
    def left_out(self) -> Parts:
        """Whole builds or runs if each run has another of its motion that is not left out with it, else quarters."""
        runs = self.fit.runs
        return "builds" if runs.has_repeated_builds else "runs" if runs.has_repeated_motions else "quarters"

    def errors(self, counted: Array) -> HeldOut:
        """Return the errors on what is left out, with weights (R,) of the rows, such as 0 for outliers."""
        pieces: list[float] = []
        target, runs = self.fit.runs.target, _rows_of(self.fit.runs)
        for part, force in self._predicted:
            for rows in part.parts:
                measured, here, weights = target[rows], force[rows], counted[rows]
                run = next(run for run in runs if run.start <= rows.start < run.stop)
                variance = max(_deviation(target[run], counted[run]) ** 2, 1e-300)
                error = here - measured
                if part.is_whole:
                    error = error - np.average(error, weights=weights)
                pieces += _mean_squares(error, weights, variance)
        return HeldOut(tuple(pieces))

    @cached_property
    def _predicted(self) -> list[tuple[LeftOut, Array]]:
        """Each part with the force (R,) [N] of a fit without it."""
        runs = self.fit.runs
        names = [p.build if self.left_out == "builds" else n for n, p in enumerate(runs.prepared)]
        parts = left_out_blocks(runs) if self.left_out == "quarters" else left_out_groups(runs, names)
        return [(part, self.fit.refitted_rows(runs.weights * part.kept)) for part in beats(parts)]


def _mean_squares(error: Array, weights: Array, variance: float) -> list[float]:
    """Return the mean square errors over a variance of the pieces of a part; a piece of outliers alone is left out."""
    ends = np.linspace(0, error.size, PIECES + 1).astype(int)
    slices = [slice(a, b) for a, b in pairwise(ends.tolist())]
    return [
        float(np.average(error[here] ** 2, weights=weights[here])) / variance
        for here in slices
        if weights[here].sum() > 0.0
    ]


def _deviation(values: Array, weights: Array) -> float:
    return float(np.sqrt(np.average((values - np.average(values, weights=weights)) ** 2, weights=weights)))


def _rows_of(runs: Runs) -> list[slice]:
    ends = np.cumsum([0, *(f.rows.size for f in runs.filters)]).tolist()
    return [slice(a, b) for a, b in pairwise(ends)]
