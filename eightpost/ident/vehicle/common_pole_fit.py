"""Fit of one model with common poles, and the choice of its order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.ident.vehicle.pole_search import (
    FASTEST,
    Blocks,
    Feedthrough,
    Lag,
    Points,
    Refinement,
    RefinementResult,
    Solution,
    Subspace,
    evaluate,
    points_of,
    solve_inputs,
    subspace_of,
)
from eightpost.ident.vehicle.trust import OrderCandidate, Orders, PolePair
from eightpost.progress import parts
from eightpost.vehicle.statespace import Channel, StateSpace

Channels = tuple[Channel, ...]


# ---- Physical constraints on a vehicle model that follow from the names of its channels -----------------------------

#: Standard deviation of a velocity's zero response at 0 Hz, relative to its largest response [1].
_STILL = 1e-4


def direct_terms(outputs: Sequence[str], inputs: Sequence[str]) -> NDArray[np.bool_]:
    """Return which inputs may have a direct term in which outputs (p, m).

    Accelerations may have direct terms in all inputs (a solid axle and a rigid chassis connect the corners, damped
    tires the roads), tire forces and ride heights in the roads, other outputs in none.
    """
    roads_of = [_ends(name, "road") for name in inputs]
    return np.array([
        [output.endswith("acceleration") or (is_road and output.endswith(("tire_force", "ride_height")))
         for is_road in roads_of]
        for output in outputs
    ])  # fmt: skip


def lags_of(kind: str, outputs: Sequence[str], inputs: Sequence[str], high: float) -> tuple[Lag, ...]:
    """Return the lags of the inputs of a kind, "road" or "force", above a band up to `high` [Hz].

    Those of a road act on all outputs, those of a shock force on all but the velocities of other ports. A force has two
    of similar rates: their difference is its derivative in the band, like the yield of rubber in series. Faster ones
    fit as well, but a port with them needs steps of less than 0.8 ms.
    """
    moving = np.array([_ends(name, "velocity") for name in outputs])
    lags = []
    for place, name in enumerate(inputs):
        if _ends(name, kind):
            own = np.array([output == f"{name.removesuffix('force')}velocity" for output in outputs])
            acts = ~moving | own if kind == "force" else np.ones_like(moving)
            lags += [Lag(place, 2.0 * np.pi * high * ratio, acts) for ratio in _LAGS[kind]]
    return tuple(lags)


def integrals(outputs: Sequence[str]) -> dict[str, str]:
    """Return the velocity of each displacement whose velocity is an output too."""
    pairs = {name: name.removesuffix("displacement") + "velocity" for name in outputs if _ends(name, "displacement")}
    return {name: velocity for name, velocity in pairs.items() if velocity in outputs}


def _ends(name: str, quantity: str) -> bool:
    return name.rpartition(".")[2] == quantity


def _without_integrals(response: FrequencyResponse) -> FrequencyResponse:
    """Return the response with displacements merged into their velocities and zero velocities at 0 Hz.

    `s H_x` is a second estimate of `H_v`; the two are averaged, weighted by their variances. If the velocity was
    derived from the displacement, both come from one potentiometer, so the smaller variance is not reduced by
    averaging.
    """
    pairs, names = integrals(response.output_names), list(response.output_names)
    H, variance, s = response.H.copy(), response.variance, 2j * np.pi * response.frequency
    if variance is not None:
        variance = variance.copy()
        for displacement, velocity in pairs.items():
            x, v = names.index(displacement), names.index(velocity)
            other, own = variance[x] * np.abs(s) ** 2, variance[v].copy()
            known = np.isfinite(other) & np.isfinite(own)
            share = np.divide(own, own + other, out=np.zeros_like(own), where=known & (own + other > 0.0))
            H[v] = (1.0 - share) * H[v] + share * s * H[x]
            variance[v] = np.where(known, np.minimum(own, other), own)
    joined = replace(response, H=H, variance=variance)
    return _with_rest(joined.select(outputs=[name for name in names if name not in pairs]))


def _with_rest(response: FrequencyResponse) -> FrequencyResponse:
    """Add 0 Hz, where velocities are zero and other outputs unknown."""
    if response.frequency[0] == 0.0:
        return response
    H = np.concatenate((np.zeros((*response.H.shape[:2], 1)), response.H), axis=2)
    variance = response.variance
    if variance is None:
        variance = np.where(np.abs(response.H) > 0.0, 0.0, np.inf)
    largest = np.abs(response.H).max(axis=2)
    moving = np.array([_ends(name, "velocity") for name in response.output_names])[:, None]
    still = np.where(moving & (largest > 0.0), (_STILL * largest) ** 2, np.inf)
    frequency, variance = np.concatenate(([0.0], response.frequency)), np.concatenate((still[:, :, None], variance), 2)
    return FrequencyResponse(frequency, H, response.inputs, response.outputs, None, None, variance)


def _with_integrals(model: StateSpace, outputs: Sequence[Channel]) -> StateSpace:
    """Return the model with all `outputs`; displacements are the integrals `C_v A^-1` of their velocities."""
    pairs, names = integrals([channel.name for channel in outputs]), model.output_names
    C, D = np.zeros((len(outputs), len(model.A))), np.zeros((len(outputs), len(model.inputs)))
    inverse = np.linalg.inv(model.A)
    for i, channel in enumerate(outputs):
        row = names.index(pairs.get(channel.name, channel.name))
        if channel.name in pairs:
            C[i] = model.C[row] @ inverse
        else:
            C[i], D[i] = model.C[row], model.D[row]
    return StateSpace(model.A, model.B, C, D, model.inputs, tuple(outputs), None, model.name)


# ---- Correction of a model so that its velocities have exactly no response to constant inputs -----------------------

#: Number of frequencies at which the change is evaluated, and relative regularisation of its curvature [1].
_FREQUENCIES, _REGULAR = 100, 1e-12


def _bring_to_rest(model: StateSpace, slow: int, s: Complex, weight: Array) -> StateSpace:
    """Return the model with velocities that have no response to constant inputs.

    A singular system, such as that of two velocities that are the same, is solved in the sense of least squares.
    """
    velocities = [i for i, name in enumerate(model.output_names) if name.rpartition(".")[2] == "velocity"]
    if not velocities:
        return model
    held = _solved(model.A.T, model.C[velocities].T).T
    chosen = slice(None, None, max(1, s.size // _FREQUENCIES))
    moved, left = held[:, :slow], held @ model.B
    toward = _solved(_curvature(model, slow, s[chosen], weight[:, chosen]), moved.T)
    B = model.B.copy()
    B[:slow] -= toward @ _solved(moved @ toward, left)
    return replace(model, B=B)


def _solved(matrix: Array, right: Array) -> Array:
    """Return the solution of a linear system, that of least squares if the matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)


def _curvature(model: StateSpace, slow: int, s: Complex, weight: Array) -> Array:
    """Return the cost matrix of changes of the slow states' inputs (slow, slow)."""
    A, C = model.A[:slow, :slow], model.C[:, :slow]
    total = np.zeros((slow, slow))
    for frequency, size in zip(s, weight.T, strict=True):
        answers = size[:, None] * np.linalg.solve((frequency * np.eye(slow) - A).T, C.T).T
        total += np.real(answers.conj().T @ answers)
    return np.asarray(total + _REGULAR * np.trace(total) * np.eye(slow))


# ---- Choice of the number of states ---------------------------------------------------------------------------------

#: Ratio of a singular value to the next one from which the gap is clear [1].
CLEAR_GAP = 2.0

#: Relative change of frequency and damping ratio below which a pole is stable from one order to the next [1].
_STEADY_FREQUENCY, _STEADY_DAMPING = 0.01, 0.05


@dataclass(frozen=True, slots=True, eq=False)
class OrderStudy:
    """Comparison of models of increasing order."""

    orders: tuple[int, ...]  #: Even numbers of states (R,).
    costs: Array  #: Sum of squares of each model's weighted misfit, with optimal inputs and outputs for its poles (R,).
    gaps: Array  #: Ratio of the singular value of the order to the next one [1] (R,).
    poles: tuple[Complex, ...]  #: Poles of each model before unstable ones are mirrored [1/s].
    samples: int  #: Number of real values that were fitted.
    parameters: Array  #: Number of parameters of each model (R,).

    @property
    def clear(self) -> bool:
        """Whether the singular values have a clear gap."""
        return bool(self.gaps.max() >= CLEAR_GAP)

    @property
    def suggested(self) -> int:
        """The highest order with a clear gap; without one, the sufficient order."""
        return self.orders[int(np.flatnonzero(self.gaps >= CLEAR_GAP)[-1])] if self.clear else self.sufficient

    @property
    def sufficient(self) -> int:
        """The smallest order with a misfit like that of the order with the minimum description length.

            N log(cost / N) + parameters log N

        Source: J. Rissanen, "Modeling by shortest data description", Automatica 14 (1978) 465-471, doi
        10.1016/0005-1098(78)90005-5.
        """
        N = float(self.samples)
        length = N * np.log(np.maximum(self.costs, 1e-300) / N) + self.parameters * np.log(N)
        best = self.costs[int(np.argmin(length))]
        return self.orders[int(np.flatnonzero(self.costs <= _ALIKE**2 * best)[0])]

    @property
    def candidates(self) -> tuple[OrderCandidate, ...]:
        """The pole pairs of all orders, each with whether the order before has it too."""
        tried: list[OrderCandidate] = []
        before = np.zeros((0, 2))
        for order, gap, poles in zip(self.orders, self.gaps, self.poles, strict=True):
            upper = poles[poles.imag > 0.0]
            now = np.stack((np.abs(upper) / (2.0 * np.pi), -upper.real / np.abs(upper)), axis=1)
            pairs = tuple(
                PolePair(
                    float(w),
                    float(zeta),
                    bool((
                        (np.abs(before[:, 0] - w) <= _STEADY_FREQUENCY * w)
                        & (np.abs(before[:, 1] - zeta) <= _STEADY_DAMPING * abs(zeta))
                    ).any()),
                )
                for w, zeta in now
            )  # fmt: skip
            tried.append(OrderCandidate(order, float(gap), pairs))
            before = now
        return tuple(tried)


def _study_orders(points: Points, subspace: Subspace, through: Feedthrough, orders: tuple[int, ...]) -> OrderStudy:
    """Compare the models of several even orders that one subspace gives."""
    values, (p, m) = subspace.values, through.direct.shape
    models = [_start(points, subspace, order, through)[0] for order in parts(orders)]
    return OrderStudy(
        orders,
        np.array([solution.cost for solution in models]),
        np.array([values[order - 1] / max(values[order], 1e-12 * values[0]) for order in orders]),
        tuple(solution.blocks.poles for solution in models),
        2 * int(points.known.sum()),
        np.array([order * (p + m) + through.count for order in orders]),
    )


def _start(points: Points, subspace: Subspace, order: int, through: Feedthrough) -> tuple[Solution, int]:
    """Return the subspace's model of an order and the number of unstable poles that were mirrored."""
    blocks, C, mirrored = subspace.blocks(order)
    return evaluate(points, solve_inputs(points, blocks, C, through), through), mirrored


# ---- Fit of one minimal linear model to a response; all paths share the same poles, as section 6.6 asks -------------

#: A misfit below this many standard deviations is attributed to noise [1].
_EXPLAINED = 1.1

#: Ratios of the rates of an input's lags to the upper end of the band [1].
_LAGS = {"road": (20.0,), "force": (4.0, 3.0)}

#: Largest ratio of the misfits of a smaller and a larger model between which the smaller one is chosen [1].
_ALIKE = 1.05

#: Largest number of states that lags replace.
_FEWER = 4

#: Number of frequencies at which models of increasing order are compared, and models with and without lags.
_STUDIED = 100


@dataclass(frozen=True, slots=True)
class CommonPoleFit:
    """Settings of the common-pole fit: a subspace estimate, refined by maximum likelihood.

    Raises:
        ParameterError: The order is odd or below 2, or another value is outside its range.
    """

    order: int | None = None  #: Number of states, even, without the lags; None uses the suggested order.
    low: float = 0.1  #: Lowest frequency of the fit [Hz].
    #: Highest frequency of the fit [Hz]. Above it the rig's drive fades and noise of the measured forces biases the
    #: estimate.
    high: float = 16.0
    #: Lower limit of the standard deviation of a response value, relative to the size of its output [1].
    floor: float = 2e-3
    max_states: int = 28  #: Highest order that may be suggested.
    #: Whether roads may act through lags, which represent tire damping, and shock forces, which represent rubber.
    lags: bool = True
    refinement: Refinement = field(default_factory=Refinement)  #: Settings of the likelihood maximisation.

    def __post_init__(self) -> None:
        if self.order is not None and (self.order < 2 or self.order % 2):
            raise ParameterError(f"the order is {self.order}; a model consists of pairs of poles; give 2, 4, 6 ...")
        if not (0.0 <= self.low < self.high and self.floor > 0.0 and self.max_states >= 2):
            raise ParameterError(f"{self}: low must be at least 0 and below high, floor above 0, max_states at least 2")

    def fit(self, response: FrequencyResponse) -> CommonPoleModel:
        """Fit a response estimated around a baseline damping.

        Raises:
            InputError: A channel has no value in the band.
            TooShortError: The response has too few values for the number of states.
        """
        joined = _without_integrals(response.band(self.low, self.high))
        points = points_of(joined, floor=self.floor)
        fewer = points.thinned(_STUDIED)
        subspace = subspace_of(points, max_states=max(self.max_states, self.order or 0))
        tried: list[tuple[_Start, RefinementResult]] = []
        for through in parts(self._forms(joined.output_names, joined.input_names)):
            low = tried[0][0].study.suggested - _FEWER if tried else 2
            study = _study_orders(fewer, subspace, through, tuple(range(max(low, 2), self.max_states + 1, 2)))
            orders = (study.suggested, study.sufficient) if tried else (study.suggested,)
            for order in (self.order,) if self.order else dict.fromkeys(orders):
                start, mirrored = _start(points, subspace, order, through)
                model = self._without_fast_blocks(fewer, start.blocks, through)
                explains = np.sqrt(model.solution.cost / fewer.known.sum()) < _EXPLAINED
                if explains:
                    break
            if not tried or _ALIKE**2 * model.solution.cost < tried[-1][1].solution.cost:
                first = _Start(study, mirrored, start.cost, start.blocks.states, self.order is not None)
                tried.append((first, model))
            if explains:
                break
        first, chosen = tried[-1]
        refined = self._without_fast_blocks(points, chosen.solution.blocks, chosen.solution.through)
        misfit, whole = np.abs(refined.solution.misfit) ** 2, np.abs(points.weight * points.H) ** 2
        known = np.maximum(points.known.sum(axis=(1, 2)), 1)
        residual = np.sqrt(misfit.sum(axis=(1, 2)) / np.maximum(whole.sum(axis=(1, 2)), 1e-300))
        excess = np.sqrt(misfit.sum(axis=(1, 2)) / known)
        names, velocities = joined.output_names, integrals(response.output_names)
        of_fitted = dict(zip(names, residual.tolist(), strict=True))
        return CommonPoleModel(
            state_space(refined.solution, points, joined.inputs, joined.outputs, response.outputs),
            # Displacements are not fitted; each has the residual of its velocity.
            {name: of_fitted[velocities.get(name, name)] for name in response.output_names},
            dict(zip(names, excess.tolist(), strict=True)),
            refined,
            points,
            joined.inputs,
            joined.outputs,
            first,
            (float(joined.frequency[1]), float(joined.frequency[-1])),
        )

    def _forms(self, outputs: Sequence[str], inputs: Sequence[str]) -> list[Feedthrough]:
        """Return the forms of the model that are tried, simple ones first, until one explains the response."""
        forms, lags = [Feedthrough(direct_terms(outputs, inputs))], tuple[Lag, ...]()
        for kind in _LAGS if self.lags else ():
            lags += lags_of(kind, outputs, inputs, self.high)
            forms.append(replace(forms[0], lags=lags))
        return forms

    def _without_fast_blocks(self, points: Points, blocks: Blocks, through: Feedthrough) -> RefinementResult:
        """Return the refined model; blocks faster than `FASTEST` are removed before and after, until none is found."""
        limit = FASTEST * 2.0 * np.pi * self.high
        best = self.refinement.refine(points, blocks.slower_than(limit), through)
        while (slow := best.solution.blocks.slower_than(limit)).states < best.solution.blocks.states:
            again = self.refinement.refine(points, slow, through)
            best = again._replace(iterations=best.iterations + again.iterations)
        return best


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """Start model from the subspace method."""

    study: OrderStudy  #: Comparison of models of increasing order.
    mirrored: int  #: Number of poles of the start model that were unstable and were mirrored.
    cost: float  #: Sum of squares of the weighted misfit of the start model.
    order: int  #: Number of states of the start model.
    requested: bool  #: Whether this number was given.


@dataclass(frozen=True, slots=True, eq=False)
class CommonPoleModel:
    """A common-pole model with details of its fit."""

    model: StateSpace  #: Minimal, continuous and stable model with the channels of the response.
    #: RMS of the misfit relative to that of the response, weighted as in the fit [1], by output.
    residual: Mapping[str, float]
    #: RMS of the misfit in standard deviations of the estimate, by output; 1 if noise explains it.
    excess: Mapping[str, float]
    refined: RefinementResult  #: Result of the refinement, in scaled channels.
    points: Points  #: Response values that were fitted.
    inputs: Channels  #: Inputs of `points`.
    fitted: Channels  #: Outputs of `points`.
    start: _Start  #: Start model from the subspace method.
    band: tuple[float, float]  #: Lowest and highest fitted frequency [Hz].

    @property
    def order(self) -> int:
        """The number of states without the lags."""
        return self.refined.solution.blocks.states

    @property
    def orders(self) -> Orders:
        """The choice of the number of states, with the poles of all orders."""
        study = self.start.study
        return Orders(study.candidates, self.order, study.clear and self.start.order == study.suggested, self.band[1])

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the search for the user, one sentence each."""
        study, notes = self.start.study, []
        lags = {kind: sum(_ends(self.inputs[lag.input].name, kind) for lag in self.refined.solution.through.lags)
                for kind in _LAGS}  # fmt: skip
        by_gap = study.clear and self.start.order == study.suggested
        if not by_gap and not self.start.requested:
            gap = f"a clear gap only at {study.suggested} states" if study.clear else "no clear gap"
            notes.append(
                f"The singular values have {gap}; with {self.start.order} states the misfit is within "
                f"{100.0 * (_ALIKE - 1.0):.0f} % of that of the minimum description length."
            )
        removed = self.start.order - self.order
        if self.start.requested and self.start.order != study.suggested:
            notes.append(f"{self.start.order} states were requested; {study.suggested} are suggested.")
        if removed:
            notes.append(f"{removed} states with natural frequencies far above the band were removed.")
        if self.start.mirrored:
            notes.append(
                f"{self.start.mirrored} unstable poles of the start model were mirrored before the refinement."
            )
        if lags["road"]:
            notes.append(f"The roads also act through {lags['road']} fast lags, which represent tire damping.")
        if lags["force"]:
            notes.append(f"The shock forces also act through {lags['force']} lags, which represent rubber in series.")
        if not self.refined.converged:
            notes.append(f"The refinement did not converge in {self.refined.iterations} steps; the best model is used.")
        return tuple(notes)


def state_space(
    solution: Solution, points: Points, inputs: Channels, fitted: Channels, outputs: Channels
) -> StateSpace:
    """Return the state-space model of a solution in the units of the response, with all `outputs`."""
    u, y = points.input_size, points.output_size
    lags = solution.through.lags
    driven = np.array([lag.rate * np.eye(u.size)[lag.input] for lag in lags]).reshape(-1, u.size)
    model = StateSpace(
        block_diag(solution.blocks.A, np.diag([-lag.rate for lag in lags])),
        np.vstack((solution.blocks.input_matrix, driven)) / u,
        np.hstack((solution.C, solution.lagged)) * y[:, None],
        solution.D * y[:, None] / u,
        inputs,
        fitted,
        None,
        "common_poles",
    )
    weight = points.weight.mean(axis=1) / y[:, None]
    return _with_integrals(_bring_to_rest(model, solution.blocks.states, points.s, weight), outputs)


# ---- Model of fewer tests, near that of all tests -------------------------------------------------------------------


def refitted(found: CommonPoleModel, response: FrequencyResponse, *, floor: float) -> StateSpace:
    """Return a model of another response, one step of the refinement from a model; its order does not change.

    `floor` is that of `CommonPoleFit`.
    """
    solution = found.refined.solution
    points = points_of(_without_integrals(response.band(*found.band)), floor=floor)
    # The inputs of the blocks are scaled by those of the points.
    blocks = replace(solution.blocks, B=solution.blocks.B * points.input_size / found.points.input_size)
    refined = Refinement(max_iterations=1).refine(points, blocks, solution.through)
    return state_space(refined.solution, points, found.inputs, found.fitted, found.model.outputs)
