"""Drive file iteration (dissertation 2.5, Eq 2.7): the next drive from all passes so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.corners import channel
from eightpost.drivefile.target import LimitHit, Limits, Lines, PassErrors, Target, pass_errors, within_limits
from eightpost.errors import ParameterError
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.ident.vehicle.simulation import bristle_force
from eightpost.shock import ShockLaw
from eightpost.signals.filters import velocity_from_displacement
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, StructuralVehicle, Vehicle, add_port_damping

# ==== Response to the commands of the rig, from an identified car or a car's parameters ==============================

_CUTOFF = 50.0  #: Low-pass of displacements before differentiation, as for the rig's records [Hz].


@dataclass(frozen=True, slots=True)
class ActuatorBands:
    """Control bandwidths of the rig's actuators, second-order Butterworth low-passes.

    Raises:
        ParameterError: A bandwidth is not above 0 Hz.
    """

    wheelloader: float = 125.0  #: Bandwidth of the wheelloaders [Hz]; 125 in 6.1.1.
    aeroloader: float = 9.0  #: Bandwidth of the aeroloaders [Hz]; 9 in 6.1.1.

    def __post_init__(self) -> None:
        if not (self.wheelloader > 0.0 and self.aeroloader > 0.0):
            raise ParameterError(f"{self}: the bandwidths must be above 0 Hz")

    def response(self, frequency: Array, units: tuple[str, ...]) -> Complex:
        """Return the actual value per command (K, m) for inputs with the given units at frequencies (K,) [Hz]."""
        bands = np.array([self.wheelloader if unit == "m" else self.aeroloader for unit in units])
        ratio = frequency[:, None] / bands
        return np.asarray(1.0 / (1.0 + np.sqrt(2.0) * 1j * ratio - ratio**2), dtype=np.complex128)


@dataclass(frozen=True, slots=True, eq=False)
class StartResponse:
    """Response that an iteration starts with."""

    #: Response from the commands to the target channels at the lines of a drive file, with the coherence of the
    #: identification.
    response: FrequencyResponse
    static: Array  #: Change of the target channels per steady input (p, m); zero in columns of roads.
    notes: tuple[str, ...] = ()  #: Notes for the user, one sentence each.


def start_response(
    vehicle: Vehicle,
    target: Target,
    *,
    shocks: Mapping[str, ShockLaw] | None = None,
    actuators: ActuatorBands | None = None,
    measured: FrequencyResponse | None = None,
) -> StartResponse:
    """Return the response of a car on the rig, about its motion on the track.

    Friction and shocks are replaced by the linear dampers that take up the same power at the velocities of the
    track record: c = <F v> / <v^2>. A corner without a shock has the damping of the identification; actuators have the
    bandwidths of 6.1.1 by default. The response of the identification, if it is known, gives the coherence.

    Raises:
        ParameterError: The car lacks a target channel, or is not continuous.
    """
    model, notes = _about_the_track(vehicle, target, shocks or {})
    if missing := [name for name in target.names if name not in model.output_names]:
        raise ParameterError(
            f"the car {vehicle.name!r} lacks the outputs {', '.join(missing)}; identify it with these channels, or "
            "choose other channels with --set channels"
        )
    rig = tuple(c for c in model.inputs if c.name.rpartition(".")[2] != "force")
    chosen = model.select(inputs=[c.name for c in rig], outputs=target.names)
    frequency = target.lines.frequency
    follows = (actuators or ActuatorBands()).response(frequency, tuple(c.unit for c in rig))
    H = chosen.frequency_response(frequency) * follows.T[None]
    coherence = _measured_coherence(measured, target, frequency)
    return StartResponse(
        FrequencyResponse(frequency, H, rig, chosen.outputs, coherence), _static(chosen, notes), tuple(notes)
    )


def _about_the_track(vehicle: Vehicle, target: Target, shocks: Mapping[str, ShockLaw]) -> tuple[StateSpace, list[str]]:
    notes: list[str] = []
    if isinstance(vehicle, StructuralVehicle):
        if shocks:
            raise ParameterError(f"{vehicle.name} has its own dampers; omit --shock")
        return vehicle.with_damper(), notes
    added, rate = {}, target.rate
    for port in {**vehicle.baseline_damping, **vehicle.friction, **shocks}:
        name = channel(port, "displacement")
        if name not in target.names:
            notes.append(f"{name} is not a target, so friction and shock of this corner are not converted to damping.")
            continue
        velocity = velocity_from_displacement(target.series[name], rate, min(_CUTOFF, 0.4 * rate))
        added[port] = _added_damping(vehicle, port, shocks.get(port), (velocity, rate))
    if unknown := [port for port in shocks if channel(port, "force") not in vehicle.state_space.input_names]:
        raise ParameterError(f"the car {vehicle.name!r} has no corner {unknown[0]!r}; correct --shock")
    return add_port_damping(vehicle.state_space, added), notes


def _added_damping(vehicle: IdentifiedVehicle, port: str, law: ShockLaw | None, on_track: tuple[Array, float]) -> float:
    """Return the damping [N.s/m] of friction and shock at the track's velocities, minus the baseline damping.

    `on_track` has the velocities of the port [m/s] and their sample rate [Hz].
    """
    velocity, rate = on_track
    friction = vehicle.friction.get(port, Friction())
    force = friction.force * np.tanh(velocity / friction.velocity) + bristle_force(velocity, rate, friction.bristle)
    if law is not None:
        grid = np.linspace(velocity.min(), velocity.max(), 201)
        force = force + np.interp(velocity, grid, [law.static_force(float(v)) for v in grid])
        force = force - vehicle.baseline_damping.get(port, 0.0) * velocity
    return float(np.mean(force * velocity) / np.mean(velocity**2))


def _measured_coherence(measured: FrequencyResponse | None, target: Target, frequency: Array) -> Array | None:
    """Return the coherence (p, K) of the identification at the lines; 0 above its band, its edge value below."""
    if measured is None or measured.coherence is None or not set(target.names) <= set(measured.output_names):
        return None
    rows = [measured.coherence[measured.output_names.index(name)] for name in target.names]
    return np.stack([np.interp(frequency, measured.frequency, row, right=0.0) for row in rows])


def _static(model: StateSpace, notes: list[str]) -> Array:
    """Return the static gain (p, m), with zero columns for roads."""
    try:
        gain = model.dc_gain()
    except ParameterError as error:
        notes.append(f"The means of the target are not reproduced: {error}.")
        return np.zeros((len(model.outputs), len(model.inputs)))
    return np.asarray(np.where(np.array([c.unit != "m" for c in model.inputs]), gain, 0.0))


# ==== Regularised inverse of a frequency response, line by line ======================================================

#: Amplitude of an input that counts as much as that of another unit: the scale of the regularisation, by SI unit.
TYPICAL = {"m": 0.002, "N": 700.0, "N.m": 1000.0}
_FLOOR = 0.01  #: Minimum amplitude of a channel in a band, relative to its largest one, to which errors are scaled [1].


@dataclass(frozen=True, slots=True, eq=False)
class Inverse:
    """Regularised inverse of a response, with its conditioning."""

    G: Complex  #: Inverse (K, m, p) in input unit per output unit.
    singular: Array  #: Singular values (K, r) of the scaled response, largest first [1].
    kept: Array  #: Share of each singular direction that the inverse uses (K, r) [1]: `s^2 / (s^2 + lambda^2)`.

    @property
    def condition(self) -> Array:
        """Ratio of the largest singular value to the smallest one (K,) [1]."""
        return np.asarray(self.singular[:, 0] / np.maximum(self.singular[:, -1], 1e-300))

    @property
    def rank(self) -> Array:
        """Number of directions (K,) that the inverse uses: the sum of their shares [1]."""
        return np.asarray(self.kept.sum(axis=1))


def regularised_inverse(H: Complex, outputs: Array, units: tuple[str, ...], regularisation: float) -> Inverse:
    """Return the Tikhonov-regularised inverse of a response H (K, p, m) at each line.

        S = Y^-1 H U = W diag(s) V^H,   G = U V diag(s / (s^2 + lambda^2)) W^H Y^-1,   lambda = r s_max

    Y are the amplitudes of the target channels (K, p), so that all channels count equally, U typical amplitudes of the
    inputs, and r is the regularisation [1]. Directions with singular values far below lambda are not driven: the rig
    cannot reach them without commands that are far larger than typical ones.

    Raises:
        ParameterError: An input has another unit than m, N or N.m.
    """
    if unknown := [unit for unit in units if unit not in TYPICAL]:
        raise ParameterError(f"an input has the unit {unknown[0]}; inputs of a rig have {', '.join(TYPICAL)}")
    inputs = np.array([TYPICAL[unit] for unit in units])
    W, s, Vh = np.linalg.svd(H / outputs[:, :, None] * inputs, full_matrices=False)
    square, floor = s**2, np.maximum((regularisation * s[:, :1]) ** 2, 1e-300)
    weights = s / (square + floor)
    G = inputs[:, None] * (np.conj(Vh.transpose(0, 2, 1)) * weights[:, None, :]) @ np.conj(W.transpose(0, 2, 1))
    return Inverse((G / outputs[:, None, :]).astype(np.complex128), s, square / (square + floor))


# ==== Correction of the response between passes, and gains from coherence, by channel and band =======================

_MEMORY = 0.5  #: Weight of a step relative to the step after it [1].
_PRIOR = 0.1  #: Weight of the starting response relative to that of the steps [1].
_LOWEST = 0.15  #: Minimum gain relative to the maximum gain [1]; a channel without coherence is not abandoned.
_UNKNOWN = 0.6  #: Gain where the identification has no coherence, for example above its band [1].
_NO_STEP = 1e-16  #: Power of a step, relative to that of the target, below which it carries no information [1].


def correction(
    H: Complex, passes: Sequence[tuple[Complex, Complex]], lines: Lines, width: float
) -> tuple[Complex, Array]:
    """Return the correction from the changes between successive passes, in bands of a width [Hz].

    A pass is the lines of its commands (K, m) and those of the target channels that the rig measured (K, p).
    It is the factor of each target channel (K, p) by which the starting response is multiplied. The second result is
    the coherence of the predicted and the measured change in the last step (K, p) [1].

    A step from one pass to the next changes the drive by dX and the record by dY. With the prediction dP = H dX by the
    starting response (K, p, m), the factor c of a channel in a band minimises

        sum_steps w |dY - c dP|^2 + prior |c - 1|^2

    Later steps and steps with high coherence have larger weights, because the car's response to small changes about the
    target is needed, and noise and drift from pass to pass must not enter it. The first step is that from rest.
    """
    measured = np.zeros((len(H), H.shape[1]), dtype=np.complex128)
    predicted = np.zeros(measured.shape)
    coherence = np.ones(measured.shape)
    last_drive, last_record = (np.zeros_like(rows) for rows in passes[0])
    for drive, record in passes:
        dP, dY = np.einsum("kij,kj->ki", H, drive - last_drive), record - last_record
        power, cross = lines.band_sum(np.abs(dP) ** 2, width), lines.band_sum(dY * np.conj(dP), width)
        moved = power > _NO_STEP * np.max(np.abs(record) ** 2, initial=1e-300)
        likeness = _coherence(cross, power, dY, lines, width)
        weight = np.where(moved, likeness / np.sqrt(np.where(moved, power, 1.0)), 0.0)
        measured = _MEMORY * measured + weight * cross
        predicted = _MEMORY * predicted + weight * power
        coherence = np.where(moved, likeness, coherence)
        last_drive, last_record = drive, record
    known = predicted > 0.0
    total = np.where(known, (1.0 + _PRIOR) * predicted, 1.0)
    factor = np.where(known, (measured + _PRIOR * predicted) / total, 1.0)
    return np.asarray(factor, dtype=np.complex128), np.asarray(coherence, dtype=np.float64)


def _coherence(cross: Complex, power: Array, dY: Complex, lines: Lines, width: float) -> Array:
    """Return the coherence (K, p) in bands, without the bias 1 / n of an estimate from n lines."""
    whole = np.maximum(power * lines.band_sum(np.abs(dY) ** 2, width), 1e-300)
    count = lines.band_sum(np.ones(len(dY)), width)[:, None]
    raw = np.abs(cross) ** 2 / whole
    return np.asarray(np.clip((raw - 1.0 / count) / (1.0 - 1.0 / count), 0.0, 1.0))


def _start_gains(coherence: Array | None, shape: tuple[int, int], highest: float) -> Array:
    """Return the gains (K, p) of the first pass from the identification's coherence (p, K); None is taken as 1."""
    if coherence is None:
        return np.full(shape, highest)
    return np.asarray(highest * np.maximum(coherence.T, _UNKNOWN))


def gains(coherence: Array, highest: float) -> Array:
    """Return the gains (K, p) for the coherence of the last step: `highest` times the coherence.

    If noise or drift from pass to pass dominates a step, its coherence is low and so is the gain. The drive then
    averages over the passes.
    """
    return np.asarray(highest * np.maximum(coherence, _LOWEST))


# ==== The iteration ==================================================================================================

#: Ratio of a pass's error to the smallest error so far above which the pass is rejected [1]; a pass that is worse than
#: a rig at rest is also rejected.
REJECTED = 1.5
PATIENCE = 3  #: Number of rejected passes in a row after which the iteration has diverged.
#: Number of passes that must reduce the smallest error by `_PROGRESS`; otherwise the iteration has stalled.
_RECENT, _PROGRESS = 3, 0.05
_STEADY = 0.05  #: Smallest direction of the steady loads that is used, relative to the largest [1].


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of an iteration."""

    gain: float = 0.9  #: Maximum gain K of Eq 2.7 [1].
    width: float = 1.0  #: Width of the bands in which coherence and correction are estimated [Hz].
    regularisation: float = 0.02  #: Regularisation relative to the largest singular value of each line [1].
    acceleration: float = 0.025  #: Accepted error of the accelerations, relative to their RMS [1].
    #: Accepted error of the displacements and all other channels, relative to their RMS [1].
    displacement: float = 0.01
    #: Whether the response is corrected between passes and the gains follow the coherence of the passes.
    is_updated: bool = True
    has_means: bool = True  #: Whether the means of the displacements are reproduced by steady loads.
    limits: Limits = field(default_factory=Limits)  #: Limits of the actuators.

    def __post_init__(self) -> None:
        if not 0.0 < self.gain <= 1.0:
            raise ParameterError(f"the gain must be above 0 and at most 1, not {self.gain:g}")
        if not (self.width > 0.0 and 0.0 <= self.regularisation < 1.0):
            raise ParameterError(
                f"the band width ({self.width:g} Hz) must be above 0 and the regularisation ({self.regularisation:g}) "
                "from 0 to below 1"
            )
        if not (self.acceleration > 0.0 and self.displacement > 0.0):
            raise ParameterError("the accepted errors must be above 0")


class Status(StrEnum):
    """Status of an iteration."""

    RUNNING = "running"
    CONVERGED = "converged"
    STALLED = "stalled"
    DIVERGED = "diverged"


@dataclass(frozen=True)
class Problem:
    """A target, the response that the iteration starts with, and the settings."""

    target: Target  #: Target.
    start: StartResponse  #: Starting response.
    settings: Settings  #: Settings.

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the m commands."""
        return self.start.response.input_names

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the m commands."""
        return tuple(channel.unit for channel in self.start.response.inputs)

    @cached_property
    def response(self) -> Complex:
        """Starting response (K, p, m)."""
        return np.ascontiguousarray(np.moveaxis(self.start.response.H, -1, 0))

    @cached_property
    def wanted(self) -> Complex:
        """Lines of the target (K, p)."""
        return self.target.lines.spectrum(self.target.rows)

    def accepted(self, name: str) -> float:
        """Return the accepted error of a target channel [1]."""
        unit = self.target.units[self.target.names.index(name)]
        return self.settings.acceleration if unit == "m/s2" else self.settings.displacement


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """A drive and the record that the rig measured with it."""

    drive: Array  #: Commands (m, N), SI, with their means.
    record: Array  #: Target channels (p, N), SI, with their means.


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """State of an iteration after some passes, and the next drive."""

    errors: tuple[PassErrors, ...]  #: Errors of each pass.
    best: int  #: Index of the pass with the smallest error; -1 if no pass is better than a rig at rest.
    rejections: int  #: Number of rejected passes at the end.
    status: Status  #: Status.
    drive: Array  #: Next commands (m, N), SI.
    hits: tuple[LimitHit, ...]  #: Limits that changed the next commands.
    H: Complex  #: Corrected response (K, p, m).
    inverse: Inverse  #: Regularised inverse of the corrected response.
    gains: Array  #: Gains of the next update (K, p) [1].
    unreachable: Array  #: RMS of the target that the inverse leaves by itself, by channel relative to its RMS (p,) [1].


def advance(problem: Problem, passes: Sequence[Pass]) -> Outcome:
    """Return the state after the passes, and the next drive; without passes, it is the first one.

        X_next = X + G K (Y_d - Y)                                                   (2.7)

    X, Y are those of the last pass. If its error exceeds `REJECTED` times the smallest error, they are those of the
    best pass, and the gains are halved for each rejected pass in a row. Before the first pass, X and Y are 0.
    """
    target, settings, lines = problem.target, problem.settings, problem.target.lines
    errors = tuple(pass_errors(target, one.record) for one in passes)
    best, rejections = _history([one.total for one in errors])
    moving = [target.without_means(one.record)[0] for one in passes]
    H = problem.response
    gain = _start_gains(problem.start.response.coherence, problem.wanted.shape, settings.gain)
    if passes and settings.is_updated:
        spectra = [(lines.spectrum(one.drive - one.drive[:, :1]), lines.spectrum(rows))
                   for one, rows in zip(passes, moving, strict=True)]  # fmt: skip
        factor, coherence = correction(H, spectra, lines, settings.width)
        H, gain = H * factor[:, :, None], gains(coherence, settings.gain)
    scale = np.sqrt(lines.band_mean(np.abs(problem.wanted) ** 2, settings.width))
    scale = np.maximum(scale, _FLOOR * scale.max(axis=0))
    inverse = regularised_inverse(H, scale, problem.units, settings.regularisation)
    gain = gain * 0.5**rejections
    before, error, base = np.zeros((len(problem.units), lines.samples)), problem.wanted, None
    if passes and (best >= 0 or not rejections):
        k = best if rejections else len(passes) - 1
        base = passes[k]
        before = base.drive - base.drive[:, :1]
        error = lines.spectrum(target.error_window * (target.rows - moving[k]))
    update = lines.rows(np.einsum("kij,kj->ki", inverse.G, gain * error))
    commands = before + target.drive_window * update + _steady_loads(problem, base)[:, None]
    drive, hits = within_limits(commands, problem.inputs, problem.units, lines, settings.limits, target.drive_window)
    status = _status(problem, errors, best, rejections)
    left = problem.wanted - np.einsum("kij,kj->ki", H @ inverse.G, problem.wanted)
    unreachable = np.linalg.norm(left, axis=0) / np.linalg.norm(problem.wanted, axis=0)
    return Outcome(errors, best, rejections, status, drive, hits, H, inverse, gain, unreachable)


def _history(totals: Sequence[float]) -> tuple[int, int]:
    """Return the index of the best pass (-1: a rig at rest, with an error of 1) and the rejections at the end."""
    best, smallest, rejections = -1, 1.0, 0
    for k, total in enumerate(totals):
        rejections = rejections + 1 if total > (REJECTED if best >= 0 else 1.0) * smallest else 0
        if total < smallest:
            best, smallest = k, total
    return best, rejections


def _steady_loads(problem: Problem, base: Pass | None) -> Array:
    """Return the steady commands (m,): those of a pass, changed for its mean displacements."""
    target, settings = problem.target, problem.settings
    before = np.zeros(len(problem.units)) if base is None else base.drive[:, 0]
    if not settings.has_means:
        return before
    missing = target.means if base is None else target.means - target.without_means(base.record)[1]
    rows = np.array([unit == "m" for unit in target.units])
    inputs = np.array([TYPICAL[unit] for unit in problem.units])
    inverse = np.linalg.pinv(problem.start.static[rows] * inputs, rcond=_STEADY)
    return np.asarray(before + settings.gain * inputs * (inverse @ missing[rows]))


def _status(problem: Problem, errors: Sequence[PassErrors], best: int, rejections: int) -> Status:
    firsts = {name.rpartition(".")[2]: name for name in problem.target.names}
    if best >= 0 and all((errors[best].of_quantity(q) or 0.0) <= problem.accepted(n) for q, n in firsts.items()):
        return Status.CONVERGED
    if rejections >= PATIENCE:
        return Status.DIVERGED
    totals = [one.total for one in errors]
    if len(totals) > _RECENT and min(totals[-_RECENT:]) > (1.0 - _PROGRESS) * min(totals[:-_RECENT]):
        return Status.STALLED
    return Status.RUNNING
