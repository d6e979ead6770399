"""Friction at the ports of a car, estimated from what no linear response explains."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.signal import resample

from eightpost.array_types import Array, Complex
from eightpost.corners import channel
from eightpost.errors import ParameterError, TooShortError
from eightpost.ident.response.records import Records, gather
from eightpost.ident.threads import for_each
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.trust import SIGNIFICANT, ForceEstimate
from eightpost.signals import TimeSeries
from eightpost.vehicle import Friction

# ---- Narrow bands of the spectra of whole records, in which each response is approximated by a polynomial -----------

_DEGREE = 2

#: Minimum number of equations per unknown.
_SPARE = 2.0

#: Amplitude of an input, relative to its largest, below which it has no power in a band [1].
_POWER_FLOOR = 1e-3


class _Band(NamedTuple):
    """Spectra of all tests around one frequency.

    Attributes:
        frequency: Centre frequency of the band [Hz].
        U: Spectra of the inputs (tests, k, m).
        Y: Spectra of the outputs (tests, k, p).
        active: Mask of the inputs that have power (m,).
    """

    frequency: float
    U: Complex
    Y: Complex
    active: NDArray[np.bool_]

    def columns(self, U: Complex) -> Complex:
        """Return inputs (tests, k, j) times powers of the position in the band, as columns (tests k, 3 j)."""
        tests, k, _ = U.shape
        return np.asarray((U[..., None, :] * _bends(k)[None, :, :, None]).reshape(tests * k, -1))

    def transients(self) -> Complex:
        """Return the columns (tests k, 3 tests) that represent the transients of each record."""
        tests, k, _ = self.U.shape
        columns = np.einsum("ij,ke->ikje", np.eye(tests), _bends(k)).reshape(tests * k, -1)
        return np.asarray(columns, dtype=np.complex128)


def _bends(k: int) -> Array:
    return np.linspace(-1.0, 1.0, k)[:, None] ** np.arange(_DEGREE + 1)


def bands(records: Records, *, low: float, high: float, inputs: int) -> Iterator[_Band]:
    """Yield the bands from `low` to `high` [Hz].

    Args:
        records: Records of the tests.
        low: Lowest frequency [Hz].
        high: Highest frequency [Hz].
        inputs: Number of inputs that are fitted at once; it determines the width of the bands.

    Raises:
        TooShortError: The records have too few frequency bins for one band.
    """
    size = min(test.u.shape[1] for test in records.tests)
    lines = np.arange(size // 2 + 1) * (records.rate / size)
    kept = np.flatnonzero((lines >= low) & (lines <= high))
    tests = len(records.tests)
    width = int(np.ceil(_SPARE * (_DEGREE + 1) * (inputs + tests) / tests))
    width = max(width, (_DEGREE + 1) * (inputs + 2))
    if kept.size < width:
        raise TooShortError(
            f"the records have {kept.size} frequency bins from {low:g} to {high:g} Hz, but {inputs} inputs need "
            f"{width}; use longer records"
        )
    U, Y = (_spectra(rows, size, kept) for rows in ([t.u for t in records.tests], [t.y for t in records.tests]))
    power = np.mean(np.abs(U) ** 2, axis=0)
    starts = range(0, kept.size - width + 1, width)
    local = np.stack([power[k : k + width].mean(axis=0) for k in starts])
    active = local > _POWER_FLOOR**2 * local.max(axis=0)
    for k, mask in zip(starts, active, strict=True):
        part = slice(k, k + width)
        yield _Band(float(lines[kept[k + width // 2]]), U[:, part], Y[:, part], mask)


def _spectra(rows: Sequence[Array], size: int, kept: NDArray[np.intp]) -> Complex:
    return np.stack([np.fft.rfft(values[:, :size])[:, kept].T for values in rows])


# ---- Friction forces from bands of spectra --------------------------------------------------------------------------


class _ForceSolution(NamedTuple):
    """Estimated forces at the ports.

    Attributes:
        forces: Forces F [N] (P,).
        covariance: Covariance of the forces [N2] (P, P), from the scatter of the bands' gradients.
        residual: Mean square residual of each output relative to that without the forces [1] (p,).
    """

    forces: Array
    covariance: Array
    residual: Array

    @property
    def cost(self) -> float:
        """Mean of the residual over the outputs."""
        return float(self.residual.mean())

    def estimates(self, ports: Sequence[str]) -> dict[str, ForceEstimate]:
        """Return the force of every port with its standard deviation, by port."""
        deviation = np.sqrt(np.diag(self.covariance))
        pairs = zip(self.forces.tolist(), deviation.tolist(), strict=True)
        return {port: ForceEstimate(*pair) for port, pair in zip(ports, pairs, strict=True)}


def solve_forces(parts: Sequence[_Band], inputs: int, iterations: int) -> _ForceSolution:
    """Estimate the forces at the ports.

    Args:
        parts: Bands with `inputs` inputs, force inputs last, followed by the signal of a unit force at each port.
        inputs: Number of inputs without the signals of unit forces.
        iterations: Number of Gauss-Newton steps, starting from zero forces.
    """
    ports = parts[0].U.shape[2] - inputs
    forces = np.zeros(ports)
    noise = for_each(parts, lambda part: _BandFit.of(part, inputs, forces).noise)
    for _ in range(iterations):
        slopes = _slopes(parts, noise, inputs, forces)
        matrix = np.sum([slope.matrix for slope in slopes], axis=0)
        gradients = np.stack([slope.gradient for slope in slopes])
        inverse = np.linalg.inv(matrix)
        forces = forces + inverse @ gradients.sum(axis=0)
    # At the minimum the gradients of independent bands scatter around zero.
    scatter = gradients - gradients.mean(axis=0)
    left = np.divide(for_each(parts, lambda part: _BandFit.of(part, inputs, forces).noise), noise)
    return _ForceSolution(forces, inverse @ (scatter.T @ scatter) @ inverse, np.mean(np.square(left), axis=0))


def _slopes(parts: Sequence[_Band], noise: Sequence[Array], inputs: int, forces: Array) -> list[_Slopes]:
    weighted = zip(parts, noise, strict=True)
    return for_each(weighted, lambda pair: _BandFit.of(pair[0], inputs, forces).slopes(pair[1]))


class _Slopes(NamedTuple):
    matrix: Array
    gradient: Array


class _BandFit(NamedTuple):
    """Least-squares fit of a band for given forces at the ports."""

    band: _Band
    inputs: int
    active: NDArray[np.bool_]
    Q: Complex
    coefficients: Complex
    misfit: Complex

    @classmethod
    def of(cls, band: _Band, inputs: int, forces: Array) -> _BandFit:
        """Fit a band."""
        U = band.U[..., :inputs].copy()
        U[..., inputs - forces.size :] += band.U[..., inputs:] * forces
        # The force at a port is active in the same bands as the force input.
        active = band.active[:inputs]
        matrix = np.concatenate((band.columns(U[..., active]), band.transients()), axis=1)
        size = np.linalg.norm(matrix, axis=0)
        size[size == 0.0] = 1.0
        Q, R = np.linalg.qr(matrix / size)
        Y = band.Y.reshape(len(matrix), -1)
        share = Q.conj().T @ Y
        coefficients = np.linalg.lstsq(R, share, rcond=1e-13)[0] / size[:, None]
        return cls(band, inputs, active, Q, coefficients, Y - Q @ share)

    @property
    def noise(self) -> Array:
        """RMS of the residual per degree of freedom (p,)."""
        free = max(len(self.misfit) - self.Q.shape[1], 1)
        return np.asarray(np.sqrt(np.sum(np.abs(self.misfit) ** 2, axis=0) / free))

    def slopes(self, noise: Array) -> _Slopes:
        """Return the curvature (P, P) and the negative gradient (P,) of half the weighted residual by F."""
        ports = self.band.U.shape[2] - self.inputs
        explained = np.stack([self._explained(port, ports) / noise for port in range(ports)])
        flat = explained.reshape(ports, -1)
        misfit = (self.misfit / noise).reshape(-1)
        return _Slopes(np.real(flat.conj() @ flat.T), np.real(flat.conj() @ misfit))

    def _explained(self, port: int, ports: int) -> Complex:
        """Return the effect of a unit force at a port on the outputs (rows, p) that the columns cannot explain."""
        place = self.inputs - ports + port
        if not self.active[place]:
            return np.zeros_like(self.misfit)
        own, count = int(self.active[:place].sum()), int(self.active.sum())
        columns = self.band.columns(self.band.U[..., [self.inputs + port]])
        answer = columns @ self.coefficients[own::count][: columns.shape[1]]
        return np.asarray(answer - self.Q @ (self.Q.conj().T @ answer))


# ---- Friction at the ports of a car ---------------------------------------------------------------------------------

#: Function that returns a friction of 1 N (N,) for a velocity (N,) [m/s], its sample rate [Hz] and a friction velocity.
Signal = Callable[[Array, float, float], Array]

#: Rate [Hz] at which the law is evaluated: harmonics of the tanh far above the records' band would otherwise alias.
_RATE = 1000.0


def direction(velocity: Array, rate: float, width: float) -> Array:
    """Return `tanh(v / v_f)` (N,), evaluated at a higher rate and band-limited to the rate of the record.

    Args:
        velocity: Shock velocity v of a record [m/s] (N,).
        rate: Sample rate of the record [Hz].
        width: Friction velocity v_f [m/s].
    """
    if not width > 0.0:
        raise ParameterError(f"the friction velocity is {width!r} m/s; it must be above zero")
    finer = max(1, round(_RATE / rate))
    if finer == 1:
        return np.tanh(velocity / width)
    # Padding avoids lengths with a large prime factor, whose transforms take ten times as long.
    padded = np.zeros(next_fast_len(velocity.size, real=True))
    padded[: velocity.size] = velocity
    fine = resample(padded, padded.size * finer)
    return np.asarray(resample(np.tanh(fine / width), padded.size)[: velocity.size], dtype=np.float64)


def with_friction(series: TimeSeries, friction: Mapping[str, Friction]) -> TimeSeries:
    """Return a record whose shock forces include the friction of their ports.

    Args:
        series: Record with `force` and `velocity` of each port.
        friction: Friction by port: "lf", ...; "" for a quarter car.
    """
    for port, law in friction.items():
        if law.force:
            name, velocity = channel(port, "force"), series[channel(port, "velocity")]
            rubbing = law.force * direction(velocity, series.sample_rate, law.velocity)
            series = series.with_channel(name, "N", series[name] + rubbing)
    return series


def _with_directions(series: TimeSeries, ports: Sequence[str], width: float, signal: Signal = direction) -> TimeSeries:
    """Return a record with a friction of 1 N at every port in the channel `friction_direction`."""
    for port in ports:
        values = signal(series[channel(port, "velocity")], series.sample_rate, width)
        series = series.with_channel(channel(port, "friction_direction"), "1", values)
    return series


# ---- Estimate of the friction at the ports --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class FrictionSearch:
    """Settings of the friction estimate.

    Attributes:
        velocities: Friction velocities v_f to try, the same at all ports [m/s].
        seconds: Durations of each record that are used to find the velocity and to find the forces [s].
        low: Lowest frequency [Hz].
        high: Highest frequency [Hz].
        iterations: Number of Gauss-Newton steps.
        signal: Friction of 1 N as a function of velocity, rate and friction velocity; default `direction`, the law of
            the vehicle FMU. Another law shows the error of that one; the identified vehicle always has the FMU's law.
    """

    velocities: tuple[float, ...] = (0.001, 0.003, 0.006, 0.012, 0.024)
    seconds: tuple[float, float] = (100.0, 400.0)
    low: float = 0.3
    high: float = 16.0
    iterations: int = 3
    signal: Signal = direction

    def find(self, tests: Sequence[TimeSeries], experiment: Experiment) -> FrictionEstimate:
        """Estimate the friction of every port.

        Args:
            tests: Records with the channels of the experiment, all at one sample rate.
            experiment: Inputs, shock forces and outputs of the tests.

        Raises:
            TooShortError: The records have too few frequency bins.
        """
        brief, whole = ([_first(test, duration) for test in tests] for duration in self.seconds)
        profile = tuple((width, self._at(brief, experiment, width).cost) for width in self.velocities)
        width = _lowest(profile)
        return _estimate(experiment, self._at(whole, experiment, width), width, profile)

    def _at(self, tests: Sequence[TimeSeries], experiment: Experiment, width: float) -> _ForceSolution:
        marked = [_with_directions(test, experiment.ports, width, self.signal) for test in tests]
        directions = [channel(port, "friction_direction") for port in experiment.ports]
        records = gather(marked, [*experiment.inputs, *directions], experiment.outputs, experiment.baseline_damping)
        count = len(experiment.inputs)
        return solve_forces(list(bands(records, low=self.low, high=self.high, inputs=count)), count, self.iterations)


@dataclass(frozen=True, slots=True, eq=False)
class FrictionEstimate:
    """Estimated friction and the part of the residual that it explains.

    Attributes:
        friction: Friction by port; forces that are negative or not significant are set to zero.
        forces: Estimated force of every port; its standard deviation comes from the scatter over the bands.
        residual: Mean square of the part that no linear response explains, with friction relative to without [1], by
            output.
        profile: Pairs (v_f [m/s], mean of the residual [1]) of all friction velocities that were tried.
    """

    friction: Mapping[str, Friction]
    forces: Mapping[str, ForceEstimate]
    residual: Mapping[str, float]
    profile: tuple[tuple[float, float], ...]

    @property
    def acts(self) -> bool:
        """Whether there is friction at any port."""
        return any(law.force > 0.0 for law in self.friction.values())

    def table(self) -> str:
        """Return the RMS of every output's residual with friction, relative to that without, as a Markdown table."""
        lines = ["| output | residual with friction relative to without [%] |", "|---|---|"]
        return "\n".join((*lines, *(f"| {name} | {100.0 * share**0.5:.0f} |" for name, share in self.residual.items())))

    def summary(self) -> str:
        """Return the forces and the part of the residual that remains as a sentence."""
        if not self.acts:
            return "No significant friction was found at the ports."
        forces = ", ".join(f"{port or 'port'} {force.text}" for port, force in self.forces.items())
        width = 1e3 * next(iter(self.friction.values())).velocity
        left = 100.0 * float(np.mean(list(self.residual.values())))
        return (
            f"Friction at the ports (+- two standard deviations): {forces}; friction velocity {width:.2g} mm/s; "
            f"{left:.0f} % of the residual remains."
        )


def _first(series: TimeSeries, seconds: float) -> TimeSeries:
    samples = round(seconds * series.sample_rate)
    return series if len(series) <= samples else series.window(float(series.time[0]), float(series.time[0]) + seconds)


def _lowest(profile: Sequence[tuple[float, float]]) -> float:
    """Return the minimum of the parabola over log v_f through the lowest point and its neighbours."""
    x, y = np.log([width for width, _ in profile]), np.array([cost for _, cost in profile])
    k = int(np.argmin(y))
    if not 0 < k < len(y) - 1:
        return float(np.exp(x[k]))
    a, b, _ = np.polyfit(x[k - 1 : k + 2], y[k - 1 : k + 2], 2)
    return float(np.exp(np.clip(-0.5 * b / a, x[k - 1], x[k + 1])))


def _estimate(
    experiment: Experiment, found: _ForceSolution, width: float, profile: tuple[tuple[float, float], ...]
) -> FrictionEstimate:
    forces = found.estimates(experiment.ports)
    significant = {port: one.value if one.value > SIGNIFICANT * one.deviation else 0.0 for port, one in forces.items()}
    return FrictionEstimate(
        {port: Friction(force, width) for port, force in significant.items()},
        forces,
        dict(zip(experiment.outputs, found.residual.tolist(), strict=True)),
        profile,
    )
