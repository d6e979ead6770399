"""Forces at the ports of a car, from what no linear response explains: the search for friction and for springs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array, Complex
from eightpost.corners import channel
from eightpost.errors import TooShortError
from eightpost.ident.threads import for_each
from eightpost.ident.vehicle.estimators import whole_spectra
from eightpost.ident.vehicle.experiment import Experiment, Records, gather
from eightpost.ident.vehicle.simulation import bristle_force, direction
from eightpost.ident.vehicle.trust import SIGNIFICANT, ForceEstimate
from eightpost.progress import parts, portion
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction, IdentifiedVehicle, LinearStepper, add_port_stiffness, friction

# ==== Forces at the ports ============================================================================================

# ---- Narrow bands of the spectra of whole records, in which each response is approximated by a polynomial -----------

_DEGREE = 2

#: Minimum number of equations per unknown.
_SPARE = 2.0

#: Amplitude of an input, relative to its largest, below which it has no power in a band [1].
_POWER_FLOOR = 1e-3


class Band(NamedTuple):
    """Spectra of all tests around one frequency."""

    frequency: float  #: Centre frequency of the band [Hz].
    U: Complex  #: Spectra of the inputs (tests, k, m).
    Y: Complex  #: Spectra of the outputs (tests, k, p).
    active: NDArray[np.bool_]  #: Mask of the inputs that have power (m,).

    def columns(self, U: Complex) -> Complex:
        """Return inputs U (tests, k, j) times powers of the position in the band, as columns (tests k, 3 j)."""
        tests, k, _ = U.shape
        return np.asarray((U[..., None, :] * _bends(k)[None, :, :, None]).reshape(tests * k, -1))

    def transients(self) -> Complex:
        """Return the columns (tests k, 3 tests) that represent the transients of each record."""
        tests, k, _ = self.U.shape
        columns = np.einsum("ij,ke->ikje", np.eye(tests), _bends(k)).reshape(tests * k, -1)
        return np.asarray(columns, dtype=np.complex128)


def _bends(k: int) -> Array:
    return np.linspace(-1.0, 1.0, k)[:, None] ** np.arange(_DEGREE + 1)


def bands(records: Records, *, low: float, high: float, inputs: int) -> Iterator[Band]:
    """Yield the bands from `low` to `high` [Hz], wide enough to fit a number of `inputs` at once.

    Raises:
        TooShortError: The records have too few frequency bins for one band.
    """
    spectra, tests = whole_spectra(records, high), len(records.tests)
    inside = spectra.frequency >= low
    lines, U, Y = spectra.frequency[inside], spectra.U[:, inside], spectra.Y[:, inside]
    width = int(np.ceil(_SPARE * (_DEGREE + 1) * (inputs + tests) / tests))
    width = max(width, (_DEGREE + 1) * (inputs + 2))
    if lines.size < width:
        raise TooShortError(
            f"the records have {lines.size} frequency bins from {low:g} to {high:g} Hz, but {inputs} inputs need "
            f"{width}; use longer records"
        )
    power = np.mean(np.abs(U) ** 2, axis=0)
    starts = range(0, lines.size - width + 1, width)
    local = np.stack([power[k : k + width].mean(axis=0) for k in starts])
    active = local > _POWER_FLOOR**2 * local.max(axis=0)
    for k, mask in zip(starts, active, strict=True):
        part = slice(k, k + width)
        yield Band(float(lines[k + width // 2]), U[:, part], Y[:, part], mask)


# ---- Forces at the ports from bands of spectra ----------------------------------------------------------------------


class ForceSolution(NamedTuple):
    """Estimated forces at the ports."""

    forces: Array  #: Forces F [N] (P,).
    covariance: Array  #: Covariance of the forces [N2] (P, P), from the scatter of the bands' gradients.
    residual: Array  #: Mean square residual of each output relative to that without the forces [1] (p,).

    @property
    def cost(self) -> float:
        """Mean of the residual over the outputs."""
        return float(self.residual.mean())

    def estimates(self, ports: Sequence[str]) -> dict[str, ForceEstimate]:
        """Return the force of every port with its standard deviation, by port."""
        deviation = np.sqrt(np.diag(self.covariance))
        pairs = zip(self.forces.tolist(), deviation.tolist(), strict=True)
        return {port: ForceEstimate(*pair) for port, pair in zip(ports, pairs, strict=True)}


def _solve_forces(parts: Sequence[Band], inputs: int, iterations: int) -> ForceSolution:
    """Estimate the forces at the ports.

    The bands have `inputs` inputs, force inputs last, followed by the signal of a unit force at each port.
    """
    ports = parts[0].U.shape[2] - inputs
    forces = np.zeros(ports)

    def noise_of(part: Band) -> Array:
        return _BandFit.of(part, inputs, forces).noise

    def slopes_of(pair: tuple[Band, Array]) -> tuple[Array, Array]:
        return _BandFit.of(pair[0], inputs, forces).slopes(pair[1])

    noise = for_each(parts, noise_of)
    for _ in range(iterations):
        slopes = for_each(zip(parts, noise, strict=True), slopes_of)
        gradients = np.stack([gradient for _, gradient in slopes])
        inverse = np.linalg.inv(np.sum([matrix for matrix, _ in slopes], axis=0))
        forces = forces + inverse @ gradients.sum(axis=0)
    # At the minimum the gradients of independent bands scatter around zero.
    scatter = gradients - gradients.mean(axis=0)
    left = np.divide(for_each(parts, noise_of), noise)
    return ForceSolution(forces, inverse @ (scatter.T @ scatter) @ inverse, np.mean(np.square(left), axis=0))


class _BandFit(NamedTuple):
    """Least-squares fit of a band for given forces at the ports."""

    band: Band
    inputs: int
    active: NDArray[np.bool_]
    Q: Complex
    coefficients: Complex
    misfit: Complex

    @classmethod
    def of(cls, band: Band, inputs: int, forces: Array) -> _BandFit:
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

    def slopes(self, noise: Array) -> tuple[Array, Array]:
        """Return the curvature (P, P) and the negative gradient (P,) of half the weighted residual by F."""
        ports = self.band.U.shape[2] - self.inputs
        explained = np.stack([self._explained(port, ports) / noise for port in range(ports)])
        flat = explained.reshape(ports, -1)
        misfit = (self.misfit / noise).reshape(-1)
        return np.real(flat.conj() @ flat.T), np.real(flat.conj() @ misfit)

    def _explained(self, port: int, ports: int) -> Complex:
        """Return the effect of a unit force at a port on the outputs (rows, p) that the columns cannot explain."""
        place = self.inputs - ports + port
        if not self.active[place]:
            return np.zeros_like(self.misfit)
        before, count = int(self.active[:place].sum()), int(self.active.sum())
        columns = self.band.columns(self.band.U[..., [self.inputs + port]])
        answer = columns @ self.coefficients[before::count][: columns.shape[1]]
        return np.asarray(answer - self.Q @ (self.Q.conj().T @ answer))


def _forces_of(
    tests: Sequence[TimeSeries], experiment: Experiment, kind: str, band: tuple[float, float], iterations: int
) -> ForceSolution:
    """Return the forces at the ports whose unit signals are the channels `kind` of the tests."""
    signals = [channel(port, kind) for port in experiment.ports]
    records = gather(tests, [*experiment.inputs, *signals], experiment.outputs, experiment.baseline_damping)
    count = len(experiment.inputs)
    return _solve_forces(list(bands(records, low=band[0], high=band[1], inputs=count)), count, iterations)


def _first(series: TimeSeries, seconds: float) -> TimeSeries:
    samples = round(seconds * series.sample_rate)
    return series if len(series) <= samples else series.window(float(series.time[0]), float(series.time[samples]))


# ==== Friction: which law explains most ==============================================================================

#: Velocities v_f of the tanh [m/s] and reaches z_s of the bristle [m] that are tried, in increasing order.
VELOCITIES = (0.001, 0.003, 0.006, 0.012, 0.024)
REACHES = (3e-5, 6e-5, 1e-4, 1.5e-4, 3e-4)

#: Ratios of static to sliding friction that are tried [1].
STATIC_RATIOS = (1.0, 1.15)


@dataclass(frozen=True, slots=True)
class FrictionSearch:
    """Settings of the friction estimate. All ports have the same law, each with its own force."""

    #: Velocities v_f of the law tanh(v / v_f) to try [m/s], in increasing order; empty: no such law.
    velocities: tuple[float, ...] = VELOCITIES
    #: Reaches z_s of a bristle to try [m], in increasing order; empty: no bristle.
    reaches: tuple[float, ...] = REACHES
    #: Durations of each record that are used to choose the law and to find the forces [s].
    seconds: tuple[float, float] = (100.0, 400.0)
    low: float = 0.3  #: Lowest frequency [Hz].
    high: float = 16.0  #: Highest frequency [Hz].
    iterations: int = 3  #: Number of Gauss-Newton steps.

    @property
    def creeping(self) -> FrictionSearch:
        """The same search without bristles."""
        return replace(self, velocities=self.velocities or VELOCITIES, reaches=())

    def find(self, tests: Sequence[TimeSeries], experiment: Experiment) -> FrictionEstimate:
        """Estimate the friction of every port with the law that leaves least unexplained.

        The records have the channels of the experiment, all at one sample rate.

        Raises:
            TooShortError: The records have too few frequency bins.
        """
        brief, whole = ([_first(test, duration) for test in tests] for duration in self.seconds)

        def cost(law: Friction) -> float:
            return self._at(brief, experiment, law).cost

        with portion(0.0, 0.4):
            creeping = [cost(Friction(1.0, velocity)) for velocity in parts(self.velocities)]
        with portion(0.4, 0.8):
            sticking = [cost(_sticking(reach, STATIC_RATIOS[0])) for reach in parts(self.reaches)]
        if not sticking or (creeping and min(creeping) <= min(sticking)):
            law = Friction(1.0, _lowest(self.velocities, creeping))
        else:
            # The reach hardly depends on the ratio, so all ratios are tried with the best reach.
            reach = _lowest(self.reaches, sticking)
            law = min((_sticking(reach, ratio) for ratio in STATIC_RATIOS), key=cost)
        return _estimate(experiment, self._at(whole, experiment, law), law)

    def _at(self, tests: Sequence[TimeSeries], experiment: Experiment, law: Friction) -> ForceSolution:
        """Return the forces for a law of 1 N at every port."""
        marked = []
        for test in tests:
            for port in experiment.ports:
                velocity, rate = test[channel(port, "velocity")], test.sample_rate
                unit = bristle_force(velocity, rate, law.bristle) if law.bristle.force else direction(
                    velocity, rate, law.velocity)  # fmt: skip
                test = test.with_channel(channel(port, "unit_friction"), "1", unit)  # noqa: PLW2901
            marked.append(test)
        return _forces_of(marked, experiment, "unit_friction", (self.low, self.high), self.iterations)


@dataclass(frozen=True, slots=True, eq=False)
class FrictionEstimate:
    """Estimated friction and the part of the residual that it explains."""

    friction: Mapping[str, Friction]  #: Friction by port; forces that are negative or not significant are set to zero.
    #: Estimated force of every port; its standard deviation comes from the scatter over the bands.
    forces: Mapping[str, ForceEstimate]
    #: Mean square of the part that no linear response explains, with friction relative to without [1], by output.
    residual: Mapping[str, float]

    @property
    def acts(self) -> bool:
        """Whether there is friction at any port."""
        return any(law.acts for law in self.friction.values())

    @property
    def sticks(self) -> bool:
        """Whether the friction at any port is a bristle."""
        return any(law.bristle.force > 0.0 for law in self.friction.values())

    def summary(self) -> str:
        """Return the forces, the law, and the part of the residual that remains as a sentence."""
        if not self.acts:
            return "No significant friction was found at the ports."
        forces = ", ".join(f"{port or 'port'} {force.text}" for port, force in self.forces.items())
        left = 100.0 * float(np.mean(list(self.residual.values())))
        law = next(law for law in self.friction.values() if law.acts)
        text = f"it creeps (tanh, friction velocity {1e3 * law.velocity:.2g} mm/s)"
        if law.bristle.force:
            reach, ratio = 1e3 * law.bristle.reach, law.bristle.static_ratio
            text = f"it sticks (bristle, reach {reach:.2g} mm, static over sliding force {ratio:.3g})"
        about = "Friction at the ports (+- two standard deviations)"
        return f"{about}: {forces}; {text}; {left:.0f} % of the residual remains."


def _sticking(reach: float, ratio: float) -> Friction:
    return Friction(bristle=Bristle(1.0, reach, ratio))


def _lowest(widths: Sequence[float], costs: Sequence[float]) -> float:
    """Return the minimum of the parabola over the width's logarithm through the lowest point and its neighbours."""
    x, y = np.log(widths), np.array(costs)
    k = int(np.argmin(y))
    if not 0 < k < len(y) - 1:
        return float(np.exp(x[k]))
    a, b, _ = np.polyfit(x[k - 1 : k + 2], y[k - 1 : k + 2], 2)
    return float(np.exp(np.clip(-0.5 * b / a, x[k - 1], x[k + 1])))


def _estimate(experiment: Experiment, solution: ForceSolution, law: Friction) -> FrictionEstimate:
    """Return the friction whose forces are significant, for a law of 1 N."""
    forces = solution.estimates(experiment.ports)
    significant = {port: one.value if one.value > SIGNIFICANT * one.deviation else 0.0 for port, one in forces.items()}
    sticks = law.bristle.force > 0.0
    laws = {port: law._replace(bristle=replace(law.bristle, force=force)) if sticks else law._replace(force=force)
            for port, force in significant.items()}  # fmt: skip
    return FrictionEstimate(laws, forces, dict(zip(experiment.outputs, solution.residual.tolist(), strict=True)))


# ==== Nonlinear springs: their test, and the coefficient of the port springs that represent them =====================

#: Sentences on the springs of a model.
_LINEAR = "The model has linear springs; it is valid for travel as in the tests."
MODELLED = "The vehicle has these forces at its ports (k2 d^2)."


@dataclass(frozen=True, slots=True)
class SpringSearch:
    """Settings of the test for nonlinear springs."""

    seconds: float = 100.0  #: Duration of each record that is used [s].
    low: float = 0.3  #: Lowest frequency [Hz].
    high: float = 16.0  #: Highest frequency [Hz].
    iterations: int = 4  #: Number of Gauss-Newton steps.

    def find(self, tests: Sequence[TimeSeries], experiment: Experiment) -> Mapping[str, ForceEstimate]:
        """Return F_2 by port, or an empty mapping if the records have no travel of the ports.

        The records have the channels of the experiment, all at one sample rate, and forces that include friction.

        Raises:
            TooShortError: The records have too few frequency bins.
        """
        if not all(channel(port, "displacement") in test for test in tests for port in experiment.ports):
            return {}
        sizes, marked = _mean_squares(tests[0], experiment.ports), []
        for test in tests:
            part = _first(test, self.seconds)
            # The mean squares are the same for all records, so that one force belongs to all of them.
            for port, size in sizes.items():
                travel = part[channel(port, "displacement")]
                squared = np.square(travel - travel.mean()) / size
                part = part.with_channel(channel(port, "travel_squared"), "1", squared)
            marked.append(part)
        band = (self.low, self.high)
        return _forces_of(marked, experiment, "travel_squared", band, self.iterations).estimates(experiment.ports)


def _mean_squares(series: TimeSeries, ports: Sequence[str]) -> dict[str, float]:
    """Return the mean square of every port's travel about its mean [m2]."""
    return {port: max(float(np.var(series[channel(port, "displacement")])), 1e-300) for port in ports}


def port_springs(
    springs: Mapping[str, ForceEstimate], tests: Sequence[TimeSeries], ports: Sequence[str]
) -> dict[str, float]:
    """Return the coefficient k2 [N/m2] of the ports' springs `k2 d^2` with a significant force, by port."""
    found = {port: force.value for port, force in springs.items() if force.is_significant}
    sizes = _mean_squares(tests[0], [port for port in ports if port in found])
    return {port: found[port] / size for port, size in sizes.items()}


def about_tests(vehicle: IdentifiedVehicle, loads: Mapping[str, float]) -> IdentifiedVehicle:
    """Return a vehicle about the mean of its tests whose port springs have the mean travel of its tests.

    `loads` are the mean loads on the chassis in the tests [N, N.m], by input. The vehicle is unchanged if it has no
    steady state without loads.
    """
    try:
        without = _travel(vehicle, {load: -mean for load, mean in loads.items()})
    except ValueError:
        return vehicle
    laws = {p: law._replace(mean_travel=-without[p]) if p in without else law for p, law in vehicle.friction.items()}
    return replace(vehicle, friction=laws) if without else vehicle


def about_loads(vehicle: IdentifiedVehicle, loads: Mapping[str, float]) -> IdentifiedVehicle:
    """Return a vehicle about the state with a drive's mean loads [N, N.m], to simulate the drive without its means.

    Raises:
        ValueError: There is no steady state with these loads.
    """
    unloaded = vehicle.unloaded()
    stiffer = {port: 2.0 * vehicle.friction[port].spring * d for port, d in _travel(unloaded, loads).items()}
    return replace(unloaded, state_space=add_port_stiffness(unloaded.state_space, stiffer), validity=None)


def _travel(vehicle: IdentifiedVehicle, loads: Mapping[str, float]) -> dict[str, float]:
    """Return the displacements at constant loads by port with a spring [m]; ValueError: there is no steady state."""
    springs = [port for port, law in vehicle.friction.items() if law.spring]
    if not springs:
        return {}
    model = vehicle.state_space
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    names = [channel(port, "") for port in springs]
    ports = friction.named_ports(stepper, (model.input_names, model.output_names), names, names)
    none, k2 = np.zeros(len(springs)), np.array([vehicle.friction[port].spring for port in springs])
    u = np.array([loads.get(name, 0.0) for name in model.input_names])
    x = friction.equilibrium(stepper, friction.PortFriction(ports, none, none + 1.0, spring=k2), u)
    return dict(zip(springs, (ports.displacement @ x).tolist(), strict=True))


def nonlinear_spring_sentence(springs: Mapping[str, ForceEstimate], *, held: str = _LINEAR) -> str | None:
    """Return a sentence on the nonlinear springs, or None if no force is significant; `held` is on the model."""
    found = {port: force for port, force in springs.items() if force.is_significant}
    if not found:
        return None
    listed = ", ".join(f"{port or 'port'} {f.text}" for port, f in found.items())
    return (
        "Springs or stops are not linear. Forces that grow with the square of the travel, at the RMS travel (+- two "
        f"standard deviations): {listed}. {held}"
    )
