"""The Bouc-Wen hysteresis model, often fitted to measured dampers, for comparison with the laws of `eightpost fit`.

    F = c v + k x + alpha z + F0,    z' = A v - beta |v| |z|^(n-1) z - gamma v |z|^n

(Y. K. Wen, J. Eng. Mech. Div. 102(2), 1976; for dampers B. F. Spencer et al., J. Eng. Mech. 123(3), 1997). A only
scales z, so A = 1 and z is a length [m]; its largest magnitude is z_m = (beta + gamma)^(-1/n). The force is linear in
c, k, alpha and each run's F0: these are solved exactly for every trial of (z_m, beta z_m^n, n), which nonlinear least
squares optimizes from twenty starts. All signs of c, k and alpha are allowed. z starts at 0.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from eightpost.ident.shock.runs import Prepared, prepare
from eightpost.rig import DynoTest
from eightpost.signals import TimeSeries

Array = NDArray[np.float64]

#: Start values: z_m as a share of half the stroke [1], beta z_m^n [1], n [1].
REACHES, SHARES, EXPONENTS = (0.01, 0.03, 0.1, 0.3, 1.0), (0.5, 0.9), (1.0, 2.0)
#: Bounds of the same three values; beta z_m^n + gamma z_m^n = 1.
BOUNDS = ((1e-4, 10.0), (0.05, 50.0), (1.0, 8.0))

#: Evaluations from every start, number of best starts that are continued, and evaluations of these.
_FIRST, _FOLLOWED, _LAST = 8, 2, 60

#: Approximate change of dz/dx in a step of the integration [1] ...
_FINE = 0.5
#: ... and maximum number of steps per sample: z has reached its limit by then.
_MOST = 60


@dataclass(frozen=True, slots=True)
class BoucWen:
    """The Bouc-Wen law with A = 1."""

    damping: float  #: c [N.s/m].
    stiffness: float  #: k [N/m].
    hysteresis: float  #: alpha [N/m].
    offset: float  #: F0 of the first fitted run [N].
    reach: float  #: z_m [m].
    share: float  #: beta z_m^n [1]; gamma z_m^n is 1 - beta z_m^n.
    exponent: float  #: n [1].
    reference: float  #: Displacement at which the force of k is zero [m].

    def force(self, record: TimeSeries) -> Array:
        """Return F (N,) [N] along a record with velocity [m/s] and displacement [m] from the reference."""
        z = _hysteresis_of(record, np.array([self.reach, self.share, self.exponent]))
        spring = self.stiffness * record["displacement"] + self.offset
        return np.asarray(self.damping * record["velocity"] + spring + self.hysteresis * z)


@dataclass(frozen=True, slots=True)
class BoucWenFit:
    """A fit and its quality."""

    law: BoucWen  #: Best law.
    rms: float  #: RMS residual [N]; model and measurement pass the same low-pass filter.
    deviation: float  #: Standard deviation of the measured force, each run about its own mean [N].
    #: RMS residual [N] for each of twenty starts before the best were continued, in ascending order.
    costs: tuple[float, ...]
    seconds: float  #: Computing time without compilation [s].


def fit_bouc_wen(tests: Sequence[DynoTest], *, segment: tuple[float, float] | None = None) -> BoucWenFit:
    """Fit the law to one or several runs of one damper; each run has its own F0.

    Args:
        tests: Runs with displacement.
        segment: Time range of each run that is fitted [s]; see `eightpost.ident.fit_shock`.
    """
    hysteresis(np.zeros(2), 0.5, np.array([1.0, 0.5, 1.0]))  # compile before the time is measured
    started = time.perf_counter()
    problem = _Problem.of([prepare(test, segment=segment) for test in tests])
    starts = [np.log(start) for start in product(REACHES, SHARES, EXPONENTS)]
    first = sorted((problem.minimum(start, _FIRST) for start in starts), key=lambda one: float(one.cost))
    best = min((problem.minimum(one.x, _LAST) for one in first[:_FOLLOWED]), key=lambda one: float(one.cost))
    shape = problem.shape(best.x)
    linear, error = problem.solved(shape)
    return BoucWenFit(
        BoucWen(*linear[:4].tolist(), *shape.tolist(), problem.runs[0].reference),
        rms=float(np.sqrt(np.mean(error**2))),
        deviation=problem.deviation,
        costs=tuple(float(np.sqrt(2.0 * one.cost / error.size)) for one in first),
        seconds=time.perf_counter() - started,
    )


def predict(law: BoucWen, prepared: Prepared) -> Array:
    """Return the law's force in the segment of a record [N], filtered with the record's low-pass."""
    about = prepared.record["displacement"] + prepared.reference - law.reference
    record = prepared.record.with_channel("displacement", "m", about)
    return np.asarray(prepared.filtered(law.force(record))[prepared.inside])


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """The least-squares problem over a shape (z_m, share, n); all other parameters are solved for."""

    runs: tuple[Prepared, ...]  #: Prepared runs.
    stroke: float  #: Half of the longest stroke [m].
    target: Array  #: Measured force of all runs (N,) [N].
    #: Regressors of c, k and each run's F0 after the low-pass (N, 2 + runs); they do not depend on the shape.
    known: Array
    basis: Array  #: Orthonormal basis of the columns of `known`.
    rest: Array  #: Residual of `target` after regression on `known` (N,) [N].

    @classmethod
    def of(cls, runs: Sequence[Prepared]) -> _Problem:
        """Return the problem for one or several runs."""
        stroke = 0.5 * max(float(np.ptp(run.record["displacement"][run.inside])) for run in runs)
        target = np.concatenate([run.measured for run in runs])
        known = np.vstack([_known(run, number, len(runs)) for number, run in enumerate(runs)])
        basis = np.linalg.qr(known)[0]
        return cls(tuple(runs), stroke, target, known, basis, target - basis @ (basis.T @ target))

    @property
    def deviation(self) -> float:
        """Standard deviation of the target, each run about its own mean [N]."""
        squares = sum(float(np.sum((run.measured - run.measured.mean()) ** 2)) for run in self.runs)
        return float(np.sqrt(squares / self.target.size))

    def minimum(self, start: Array, evaluations: int) -> OptimizeResult:
        """Return a solution of nonlinear least squares from a start, in logarithms of (z_m over stroke, share, n)."""
        low, high = np.log(BOUNDS).T
        inside = np.clip(start, low + 1e-6, high - 1e-6)
        return least_squares(self.residual, inside, bounds=(low, high), ftol=1e-6, max_nfev=evaluations)

    def shape(self, logarithms: Array) -> Array:
        """Return z_m [m], share and n."""
        return np.array([self.stroke, 1.0, 1.0]) * np.exp(logarithms)

    def residual(self, logarithms: Array) -> Array:
        """Return the residual (N,) [N] with the best c, k, alpha and F0."""
        z = self.z(self.shape(logarithms))
        new = z - self.basis @ (self.basis.T @ z)
        return np.asarray(self.rest - new * (new @ self.rest) / max(new @ new, 1e-300))

    def solved(self, shape: Array) -> tuple[Array, Array]:
        """Return the best (c, k, alpha, F0 of each run) for a shape, and the residual [N]."""
        design = np.column_stack([self.known[:, :2], self.z(shape), self.known[:, 2:]])
        size = np.linalg.norm(design, axis=0)
        linear = np.linalg.lstsq(design / size, self.target, rcond=None)[0] / size
        return linear, design @ linear - self.target

    def z(self, shape: Array) -> Array:
        """Return z of all runs (N,) [m], with the same low-pass as the force."""
        return np.concatenate([run.filtered(_hysteresis_of(run.record, shape))[run.inside] for run in self.runs])


def _known(run: Prepared, number: int, count: int) -> Array:
    motion = run.filtered(np.vstack([run.record["velocity"], run.record["displacement"]]))[:, run.inside].T
    own = np.zeros((motion.shape[0], count))
    own[:, number] = 1.0
    return np.hstack([motion, own])


def _hysteresis_of(record: TimeSeries, shape: Array) -> Array:
    z: Array = hysteresis(np.ascontiguousarray(record["velocity"]), 1.0 / record.sample_rate, shape)
    return z


@njit(cache=False, error_model="numpy")  # type: ignore[untyped-decorator]
def hysteresis(velocity: Array, step: float, shape: Array) -> Array:
    """Return z (N,) [m] along a velocity (N,) [m/s] sampled every `step` [s]; z starts at 0.

    z depends on the path and not on time, and dz/dx only depends on z and the direction. The displacement of each
    sample, computed with the trapezoidal rule, is integrated in small steps with the fourth-order Runge-Kutta method.
    """
    reach, share, exponent = shape[0], shape[1], shape[2]
    z = np.zeros(velocity.size)
    here = 0.0  # z over z_m
    for n in range(1, velocity.size):
        way = 0.5 * (velocity[n - 1] + velocity[n]) * step / reach
        parts = min(_MOST, 1 + int(abs(way) * exponent * max(share, 1.0) / _FINE))
        h = way / parts
        sign = 1.0 if way > 0.0 else -1.0
        for _ in range(parts):
            a = _slope(here, sign, share, exponent)
            b = _slope(here + 0.5 * h * a, sign, share, exponent)
            c = _slope(here + 0.5 * h * b, sign, share, exponent)
            d = _slope(here + h * c, sign, share, exponent)
            here = min(1.0, max(-1.0, here + h * (a + 2.0 * b + 2.0 * c + d) / 6.0))
        z[n] = reach * here
    return z


@njit(inline="always", error_model="numpy")  # type: ignore[untyped-decorator]
def _slope(z: float, sign: float, share: float, exponent: float) -> float:
    """Return the derivative of z / z_m with respect to x / z_m for a direction of motion."""
    same = 1.0 if z * sign > 0.0 else -1.0
    return 1.0 - abs(z) ** exponent * (share * same + 1.0 - share)
