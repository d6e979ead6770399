"""One law fitted to prepared runs: options, outliers, the fit of laws with a lag, errors on left-out parts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.curve import knot_basis
from eightpost.ident.shock.dynamics import FadingLag, FullLag, NoLag, best_lag, dynamics_for, projected
from eightpost.ident.shock.force import ForceModel, GasTreatment, gas_columns, limits_for
from eightpost.ident.shock.problem import TOLERANCE, Minimum, Problem, Solution
from eightpost.ident.shock.runs import Prepared, Runs
from eightpost.progress import beats
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import LAWS, fit_form

# ==== Outliers: replaced or down-weighted ============================================================================

# ---- A first force model that is accurate enough to find outlying samples -------------------------------------------


def screened_force(runs: Runs) -> list[Array]:
    """Return the force of a single-lag model (N,) [N] over each run."""
    limits = limits_for(runs.measured, runs.rate)
    basis = knot_basis(runs.velocity, runs.inside)
    model = ForceModel(runs, basis, gas_columns(runs, "estimate")[0], FullLag(limits))
    force = model.force(best_lag(model, limits.time_constant))
    return [np.asarray(force[part]) for part in runs.parts]


# ---- Treatment of outliers ------------------------------------------------------------------------------------------

#: `auto`: only if there are outliers; `none`; `_huber` and `_tukey`: these weights in any case.
Robust = Literal["auto", "none", "huber", "tukey"]

#: Ratio of the standard deviation to the median absolute deviation of a normal distribution.
_NORMAL = 1.4826

#: A raw sample is a spike if it exceeds this many standard deviations of the noise, ...
_SPIKE = 10.0

#: ... and differs by this share of the force's standard deviation from a running median of this many samples. The
#: median follows anything longer than half of its samples; smaller spikes have no effect after the low-pass.
_SPIKES = ((5, 0.1), (7, 0.25))

#: Below this number of samples per period of the cutoff frequency, spikes cannot be distinguished from the motion.
_FINE = 10.0

#: Tuning constants of Huber and Tukey, in standard deviations; wide, because the residual is not normal noise.
_HUBER, _TUKEY = 2.5, 9.0

#: `auto` weights rows if one exceeds this many standard deviations, and this share of the force's standard deviation.
_FAR, _FAR_SHARE = 8.0, 0.5

#: Above this share the law or the curve does not fit, rather than samples being outliers; `auto` then changes nothing.
_MOST_OUTLIERS = 0.05

#: A row counts as down-weighted below this weight.
_DOWN = 0.5


def _spikes_of(raw: Array, predicted: Array, deviation: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return a raw signal (N,) without its spikes, and which samples (N,) were spikes.

    Args:
        raw: Measured signal.
        predicted: Signal predicted by a model; a running median follows the remainder.
        deviation: Standard deviation of the signal.
    """
    left, clean = raw - predicted, raw
    for size, share in _SPIKES:
        rest = left - median_filter(left, size=size, mode="nearest")
        noise = _NORMAL * float(np.median(np.abs(rest)))
        spiked = np.abs(rest) > max(_SPIKE * noise, share * deviation)
        clean = np.where(spiked & (clean == raw), raw - rest, clean)
    return clean, clean != raw


def without_spikes(test: DynoTest, prepared: Prepared, force: Array) -> tuple[DynoTest, int]:
    """Return a test whose force has no spikes over the prepared segment, and the number of replaced samples.

    Args:
        test: Measured test.
        prepared: Prepared part of the test.
        force: Force (N,) predicted at the prepared record's samples [N].
    """
    if test.series.sample_rate < _FINE * prepared.cutoff:
        return test, 0
    time = test.series.time - test.series.time[0]
    here = (time >= prepared.record.time[0]) & (time <= prepared.record.time[-1])
    predicted = np.interp(time[here], prepared.record.time, force)
    whole = test.series["force"].copy()
    whole[here], spiked = _spikes_of(whole[here], predicted, prepared.deviation)
    if not spiked.any():
        return test, 0
    return replace(test, series=test.series.with_channel("force", "N", whole)), int(spiked.sum())


def without_motion_spikes(test: DynoTest) -> tuple[DynoTest, dict[str, int]]:
    """Return a test whose motion has no outlying single samples, and the number of replaced samples by channel."""
    found: dict[str, int] = {}
    series = test.series
    for name in ("velocity", "displacement"):
        if name not in series:
            continue
        values = series[name]
        smooth = median_filter(values, size=5, mode="nearest")
        rest = values - smooth
        noise = _NORMAL * float(np.median(np.abs(rest)))
        spiked = np.abs(rest) > max(_SPIKE * noise, 0.1 * float(np.ptp(np.quantile(values, (0.01, 0.99)))))
        if spiked.any():
            found[name] = int(spiked.sum())
            series = series.with_channel(name, series.units[series.names.index(name)], np.where(spiked, smooth, values))
    return (replace(test, series=series), found) if found else (test, found)


def weights_for(robust: Robust) -> Callable[[Array, float], Array] | None:
    """Return the function of residuals (R,) and the force's standard deviation [N] that gives weights (R,), or None."""
    kinds: dict[str, Callable[[Array, float], Array] | None] = {
        "none": None,
        "huber": lambda residual, _: _huber(residual),
        "tukey": lambda residual, _: _tukey(residual),
        "auto": _only_where_far,
    }
    return kinds[robust]


def _huber(residual: Array) -> Array:
    """Return Huber's weights (R,): 1 up to a number of standard deviations, then falling as 1 / |r|."""
    size = np.abs(residual) / (_HUBER * _scale(residual))
    return np.asarray(1.0 / np.maximum(size, 1.0))


def _tukey(residual: Array) -> Array:
    """Return Tukey's bisquare weights (R,): 0 beyond a number of standard deviations."""
    size = np.minimum(np.abs(residual) / (_TUKEY * _scale(residual)), 1.0)
    return np.asarray((1.0 - size**2) ** 2)


def nearly_equal(weights: Array, others: Array) -> bool:
    """Return whether weights (R,) are so close to others that a fit with them would be the same."""
    return bool(np.abs(weights - others).max() < 0.05)


def downweighted_rows(weights: Array) -> int:
    """Return the number of rows with a weight below one half."""
    return int(np.sum(weights < _DOWN))


def _only_where_far(residual: Array, deviation: float) -> Array:
    size = np.abs(residual)
    far = size > max(_FAR * _scale(residual), _FAR_SHARE * deviation)
    weights = _tukey(residual)
    few = downweighted_rows(weights) <= _MOST_OUTLIERS * weights.size
    return weights if far.any() and few else np.ones_like(residual)


def _scale(residual: Array) -> float:
    middle = float(np.median(residual))
    return max(_NORMAL * float(np.median(np.abs(residual - middle))), 1e-12)


#: Maximum number of searches for spikes.
_SCREENINGS = 3


def screened_runs(
    tests: Sequence[DynoTest], prepared: Callable[[Sequence[DynoTest]], Runs]
) -> tuple[Runs, int, list[str]]:
    """Return runs without spikes, the number of replaced samples, and notes on what was replaced.

    Args:
        tests: Measured tests.
        prepared: Function that prepares tests for the fit.
    """
    cleaned, notes = [], []
    total = 0
    for test in tests:
        clean, found = without_motion_spikes(test)
        cleaned.append(clean)
        total += sum(found.values())
        notes += [f"{count} outlying samples of {name} were replaced" for name, count in found.items()]
    runs, counts = prepared(cleaned), [0] * len(cleaned)
    for _ in range(_SCREENINGS):
        forces = screened_force(runs)
        found_now = [without_spikes(t, p, f) for t, p, f in zip(cleaned, runs.prepared, forces, strict=True)]
        if [count for _, count in found_now] == counts:
            break
        counts = [count for _, count in found_now]
        runs = prepared([test for test, _ in found_now])
    spikes = sum(counts)
    if spikes:
        notes.append(f"{spikes} samples of the force were replaced: spikes, far from the model, and their neighbours")
    return runs, total + spikes, notes


# ==== Options of a fit ===============================================================================================

#: A name in `LAWS`.
LawName = str
RecipeName = Literal["joint", "boggs"]

#: The law of a fit if none is named, by recipe.
DEFAULT_LAW = {"joint": "hysteresis", "boggs": "lpnl2"}

#: Form of a law that has a recipe of its own (hysteresis_fit.py).
_LAGGED_VELOCITY = "lagged velocity"

_NO_CHOICE = "the choice among laws, 'auto', was removed: omit the law, and hysteresis is fitted"


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

        Args:
            name: Name of the law; None for the default.

        Raises:
            ParameterError: An option or the law is unknown.
        """
        options = (
            ("recipe", self.recipe, get_args(RecipeName)),
            ("gas treatment", self.gas, get_args(GasTreatment)),
            ("robust", self.robust, get_args(Robust)),
            ("law", DEFAULT_LAW.get(self.recipe) if name is None else name, tuple(LAWS)),
        )
        for what, value, known in options:
            if what == "law" and value == "auto":
                raise ParameterError(_NO_CHOICE)
            if value not in known:
                raise ParameterError(f"unknown {what} {value!r}; it must be one of {', '.join(known)}")
        return str(options[-1][1])

    @property
    def is_screened(self) -> bool:
        """Whether spikes are replaced before the fit."""
        return self.recipe != "boggs" and self.robust != "none"


def has_own_recipe(law: str) -> bool:
    """Return whether a law is fitted by a recipe of its own (hysteresis_fit.py)."""
    return fit_form(LAWS[law]) == _LAGGED_VELOCITY


# ==== A fitted law, as the comparison of laws uses it ================================================================


@dataclass(frozen=True, slots=True, eq=False)
class FittedLaw(ABC):
    """A law fitted to runs, from which it can be fitted again with other weights."""

    law: str  #: Name of the law.
    notes: tuple[str, ...]  #: Notes on the choices that differ from the dissertation's, without those of the recipe.

    @property
    @abstractmethod
    def runs(self) -> Runs:
        """The runs with the weights of the fit."""

    @property
    @abstractmethod
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""

    @property
    @abstractmethod
    def has_converged(self) -> bool:
        """Whether the search ended at a minimum."""

    @abstractmethod
    def solution(self) -> Solution:
        """Return the solution with its covariance."""

    @abstractmethod
    def refitted_rows(self, weights: Array) -> Array:
        """Return the force (R,) [N] of a free simulation, fitted again with weights (R,) from this minimum."""

    def downweighted(self) -> tuple[int, list[str]]:
        """Return the number of samples that were down-weighted as outliers, and a note if there are any."""
        down, rows = downweighted_rows(self.runs.weights), self.runs.weights.size
        samples = round(down * self.runs.measured.size / rows)
        if not samples:
            return 0, []
        return samples, [f"{samples} samples ({100.0 * down / rows:.2g} %) were down-weighted as outliers"]


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

    minimum: Minimum  #: Minimum on the samples used: those of a thinned record in the sketch of a costly law.
    whole: ForceModel  #: Model of the whole record with the weights used for the minimum.
    full_lag: Minimum | None  #: Minimum of LPF1 from which the search started; None for a law without lag.

    @property
    def is_final(self) -> bool:
        """Whether it is a minimum on the whole record."""
        return self.minimum.problem.tolerance == TOLERANCE

    @property
    def runs(self) -> Runs:
        """The runs with the weights of the fit."""
        return self.whole.runs

    @property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        model = self.minimum.problem.model
        return np.asarray(model.rows(self.minimum.parameters) - model.runs.target)

    @property
    def has_converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.minimum.converged

    def solution(self) -> Solution:
        """Return the solution with its covariance."""
        return self.minimum.solution()

    def reweighted(self, weights: Array) -> LawFit:
        """Return the sketch with other weights (R,) of the rows, optimised from its minimum."""
        model = self.whole.weighted(weights)
        problem = Problem(model) if self.is_final else _sketched(model)
        return replace(self, minimum=problem.minimum_from(self.minimum.parameters), whole=model)

    def finished(self) -> LawFit:
        """Return the sketch optimised on the whole record."""
        if self.is_final:
            return self
        model = self.whole
        minimum = Problem(model).minimum_from(self.minimum.parameters)
        if self.full_lag is not None and isinstance(model.dynamics, FadingLag):
            like = _like(self.full_lag, model.dynamics, self.runs.weights)
            minimum = min((minimum, like), key=lambda m: m.cost)
        return replace(self, minimum=minimum)

    def refitted_rows(self, weights: Array) -> Array:
        """Return the force (R,) [N] of a free simulation, fitted again with weights (R,) from this minimum.

        A costly law is optimised on a thinned record, but to the end: if the search stopped near its start, the fit to
        everything, the rows without weight would have been seen.
        """
        minimum = _sketched(self.whole.weighted(weights)).minimum_from(self.minimum.parameters)
        return self.minimum.problem.model.rows(minimum.parameters)


def fit_law(runs: Runs, law: str, choices: Choices) -> LawFit:
    """Fit a law with a curve through knots to runs."""
    gas, gas_notes = gas_columns(runs, choices.gas)
    dynamics = dynamics_for(LAWS[law], limits_for(runs.measured, runs.rate))
    model = ForceModel(runs, knot_basis(runs.velocity, runs.inside), gas, dynamics)
    minimum, full_lag = _searched(model)
    sketch = LawFit(law, (*dynamics.changes(), *gas_notes), minimum, model, full_lag)
    return _robust(sketch, weights_for(choices.robust))


def _searched(model: ForceModel) -> tuple[Minimum, Minimum | None]:
    """Return the minimum of a sketch, and that of LPF1 from which the search started."""
    dynamics = model.dynamics
    tau = None if isinstance(dynamics, NoLag) else float(best_lag(model, dynamics.limits.time_constant)[-1])
    start = projected(model, model.curve_rows(tau))[0]
    if tau is None:
        return Problem(model).minimum_from(start), None
    full_lag = Problem(model.with_dynamics(FullLag(dynamics.limits, dynamics.kind))).minimum_from(np.append(start, tau))
    if isinstance(dynamics, FullLag):
        return full_lag, full_lag
    problem, parameters = _sketched(model), full_lag.parameters
    starts = dynamics.starts(problem.model, parameters, _FOLLOWED)
    best = _best(problem, starts or [np.append(parameters[:-1], dynamics.like_full_lag(model, parameters))])
    return problem.minimum_from(best), full_lag


def _sketched(model: ForceModel) -> Problem:
    """Return the problem with which a model of the whole record is sketched, and fitted to parts of it."""
    return Problem(model.coarse if model.dynamics.is_costly else model, tolerance=_REFIT)


def _best(problem: Problem, starts: Sequence[Array]) -> Array:
    """Return the end of a rough search from the best of some starting points."""
    if len(starts) == 1:
        return starts[0]
    guides = [replace(problem, tolerance=_GUIDE).minimum_from(start) for start in starts]
    return min(guides, key=lambda guide: guide.cost).parameters


def _like(full_lag: Minimum, dynamics: FadingLag, weights: Array) -> Minimum:
    """Return LPF1's minimum as parameters of a law that fades, with weights (R,) of the rows."""
    model = full_lag.problem.model.with_dynamics(dynamics).weighted(weights)
    same = np.append(full_lag.parameters[:-1], dynamics.like_full_lag(model, full_lag.parameters))
    return Problem(model).at(same, "LPF1's solution: no fading of the lag is better")


def _robust(sketch: LawFit, weigh: Callable[[Array, float], Array] | None) -> LawFit:
    """Return the finished sketch with weights that follow its own residuals; without `weigh` all weights are equal."""
    if weigh is None:
        return sketch.finished()
    sketch = _reweighted(sketch, weigh)
    whole = sketch.finished()
    if not sketch.is_final and (sketch.runs.weights < 1.0).any():
        weights = weigh(whole.error, whole.runs.deviation)
        whole = whole if nearly_equal(weights, whole.runs.weights) else whole.reweighted(weights)
    return whole


def _reweighted(first: LawFit, weigh: Callable[[Array, float], Array]) -> LawFit:
    """Return a sketch with weights that follow its own residuals; the last reweighting is done on the whole record."""
    sketch = first
    for count in range(_WEIGHINGS if first.is_final else _WEIGHINGS - 1):
        weights = weigh(sketch.error, sketch.runs.deviation)
        if nearly_equal(weights, sketch.runs.weights):
            break
        if count and (weights == first.runs.weights).all():
            return first  # no outliers after all; further reweighting would alternate between two results
        sketch = sketch.reweighted(weights)
    return sketch


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
        for rows, rate in zip(_rows_of(runs), _rates(runs), strict=True):
            ends = np.linspace(rows.start, rows.stop, BLOCKS * PIECES + 1).astype(int).tolist()
            gap = round(min(_GAP * rate, _GAP_SHARE * (rows.stop - rows.start)))
            for start, stop in list(pairwise(ends))[number::BLOCKS]:
                kept[max(start - gap, rows.start) : min(stop + gap, rows.stop)] = False
                parts.append(slice(start, stop))
        found.append(LeftOut(kept, tuple(parts), is_whole=False))
    return found


def _left_out_runs(runs: Runs) -> list[LeftOut]:
    """Return each run, of many runs in groups."""
    rows, found = _rows_of(runs), []
    fits = min(len(rows), _MOST_FITS)
    for number in range(fits):
        kept, parts = np.ones(runs.target.size, dtype=bool), tuple(rows[number::fits])
        for part in parts:
            kept[part] = False
        found.append(LeftOut(kept, parts, is_whole=True))
    return found


def _left_out_builds(runs: Runs) -> list[LeftOut]:
    """Return all runs of each build, of many builds in groups."""
    builds, rows, found = runs.builds, _rows_of(runs), []
    fits = min(len(builds), _MOST_FITS)
    for number in range(fits):
        kept, group = np.ones(runs.target.size, dtype=bool), builds[number::fits]
        parts = tuple(part for part, p in zip(rows, runs.prepared, strict=True) if p.build in group)
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
        left_out = {"builds": _left_out_builds, "runs": _left_out_runs, "quarters": left_out_blocks}[self.left_out]
        return [(part, self.fit.refitted_rows(runs.weights * part.kept)) for part in beats(left_out(runs))]


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


def _rates(runs: Runs) -> list[float]:
    return [f.row_rate for f in runs.filters]
