"""Chapter 5.1 and 5.2: the seven-DOF car, its responses, and the equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dissertation.checks import difference, difference_by_output, holds
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import FREQUENCY, Line, Plot, decibel_axis, decibels, figure_of
from eightpost.array_types import Array, Complex
from eightpost.ident.vehicle.frequency_response import HighResidual, through_points
from eightpost.report.charts import Figure
from eightpost.units import si_factor
from eightpost.vehicle import (
    CORNERS,
    Corners,
    SevenDof,
    StateSpace,
    StructuralVehicle,
    add_port_damping,
    read_vehicle,
    shipped,
)

_FREQUENCY = np.geomspace(0.1, 30.0, 1200)
_INCH, _POUND = si_factor("in"), si_factor("lbf")

#: Inputs of Figs 5.3 to 5.5 with their amplitudes: 1000 lb, 1 in, 100 lb.
_SIZES = {"heave_force": 1000.0 * _POUND, "lf.road": _INCH, "lf.force": 100.0 * _POUND}
_US = {"heave_force": "lbf", "lf.road": "in", "lf.force": "lbf"}


def parameters() -> SevenDof:
    """Return Table 5.1 as printed."""
    vehicle = read_vehicle(shipped("seven_dof"))
    assert isinstance(vehicle, StructuralVehicle)
    assert isinstance(vehicle.parameters, SevenDof)
    return vehicle.parameters


@cache
def _car() -> StateSpace:
    return parameters().with_damper()


@cache
def _responses() -> Mapping[tuple[str, str], Array]:
    """Return the magnitudes (K,) of all paths for the amplitudes of the text."""
    model = _car()
    H = np.abs(model.frequency_response(_FREQUENCY))
    return {
        (output, source): H[i, model.input_names.index(source)] * size
        for i, output in enumerate(model.output_names)
        for source, size in _SIZES.items()
    }


def _at(output: str, source: str, frequency: float) -> float:
    return float(np.interp(frequency, _FREQUENCY, _responses()[output, source]))


def _peak(output: str, source: str, low: float = 0.1, high: float = 8.0) -> float:
    """Return the largest magnitude in a band; up to 8 Hz are the modes of the chassis."""
    inside = (low <= _FREQUENCY) & (high >= _FREQUENCY)
    return float(_responses()[output, source][inside].max())


def _drop(quantity: str, source: str, frequency: float) -> float:
    """Return how far the other corners are below the left front one, as a mean [dB]."""
    own, *others = (decibels(np.array([_at(f"{c}.{quantity}", source, frequency)]))[0] for c in CORNERS)
    return float(own - np.mean(others))


def _figure(outputs: tuple[str, ...], unit: str) -> Figure:
    plots = []
    for source, us in _US.items():
        H = {
            output: decibels(_responses()[output, source] / _SIZES[source], si_factor(unit) / si_factor(us))
            for output in outputs
        }
        lines = [Line(output, _FREQUENCY, row) for output, row in H.items()]
        plots.append(Plot(f"over {source}", FREQUENCY, decibel_axis(f"{unit}/{us}"), lines))
    return figure_of("Magnitudes of the car of Table 5.1 with its linear dampers.", plots)


_READ = "The text reads round numbers from a decibel plot; its resonance is that of the chassis (3 to 5 Hz)."


def figure_5_3(_: Effort) -> Findings:
    """Shock velocities."""
    return Findings(
        {
            "heave_peak": _peak("lf.velocity", "heave_force"),
            "heave_low": _at("lf.velocity", "heave_force", 1.0),
            "heave_high": _at("lf.velocity", "heave_force", 9.0),
            "road_low": _at("lf.velocity", "lf.road", 1.0),
            "road_peak": _at("lf.velocity", "lf.road", 5.0),
            "road_drop": _drop("velocity", "lf.road", 10.0),
            "force": _at("lf.velocity", "lf.force", 5.0),
            "force_drop": _drop("velocity", "lf.force", 15.0),
        },
        blocks=[_figure(tuple(f"{c}.velocity" for c in CORNERS), "in/s")],
        note=_READ,
    )


def figure_5_4(_: Effort) -> Findings:
    """Tire forces."""
    return Findings(
        {
            "heave_peak": _peak("lf.tire_force", "heave_force"),
            "heave_low": _at("lf.tire_force", "heave_force", 0.1),
            "heave_high": _at("lf.tire_force", "heave_force", 10.0),
            "road_low": _at("lf.tire_force", "lf.road", 0.1),
            "road_peak": _peak("lf.tire_force", "lf.road", high=30.0),
            "force_low": _at("lf.tire_force", "lf.force", 0.1),
            "force_peak": _peak("lf.tire_force", "lf.force"),
            "force_drop": _drop("tire_force", "lf.force", 10.0),
        },
        blocks=[_figure(tuple(f"{c}.tire_force" for c in CORNERS), "lbf")],
        note=_READ,
    )


def figure_5_5(_: Effort) -> Findings:
    """Ride heights."""
    heave = {end: _peak(f"{end}.ride_height", "heave_force", high=5.0) for end in ("front", "rear")}
    road = _responses()["front.ride_height", "lf.road"]
    roll_off = [decibels(np.array([_at("front.ride_height", "heave_force", f)]))[0] for f in (6.0, 10.0, 15.0, 30.0)]
    steep = (roll_off[0] - roll_off[2]) / np.log10(2.5)
    low = _at("front.ride_height", "lf.road", 0.3)
    no_overhang = replace(parameters(), front_overhang=0.0, rear_overhang=0.0).with_damper()
    H = no_overhang.select(inputs=["lf.road"], outputs=["front.ride_height", "rear.ride_height"])
    axles = np.abs(H.frequency_response(_FREQUENCY)[:, 0]).max(axis=1)
    return Findings(
        {
            "heave_front": heave["front"],
            "heave_rear": heave["rear"],
            "slope": float(roll_off[1] - roll_off[3]) / float(np.log10(3.0)),
            "road_front": float(road.max()),
            "road_rear": float(_responses()["rear.ride_height", "lf.road"].max()),
            "road_frequency": float(_FREQUENCY[np.argmax(road)]),
        },
        {"low": (low < 0.1 * road.max(), f"at 0.3 Hz {low / _INCH:.2g} in, at the peak {road.max() / _INCH:.2g} in")},
        [_figure(("front.ride_height", "rear.ride_height"), "in")],
        f"{_READ} The ride heights depend on the distances from the axles to nose and spoiler, which are not printed "
        f"(45 in here). Above the axles themselves the peaks are {axles[0]:.2g} and {axles[1]:.2g} in. Just above the "
        f"modes the roll-off is steeper: {steep:.0f} dB per decade from 6 to 15 Hz.",
    )


def table_5_1(_: Effort) -> Findings:
    """The shipped vehicle file has the printed parameters; the text's shares are computed from them."""
    car = parameters()
    front, rear = car.unsprung_mass.lf + car.unsprung_mass.rf, car.unsprung_mass.lr + car.unsprung_mass.rr
    total = car.sprung_mass + front + rear
    radii = {
        "roll_radius": np.sqrt(car.roll_inertia / car.sprung_mass) / car.track_width,
        "pitch_radius": np.sqrt(car.pitch_inertia / car.sprung_mass) / car.wheelbase,
    }
    return Findings(
        {
            "track": car.track_width, "a": car.cg_to_front_axle, "b": car.cg_to_rear_axle, "mass": car.sprung_mass,
            "roll": car.roll_inertia, "pitch": car.pitch_inertia, "front_mass": car.unsprung_mass.lf,
            "rear_mass": car.unsprung_mass.lr, "front_rate": car.spring_rate.lf, "rear_rate": car.spring_rate.lr,
            "tire": car.tire_stiffness.lf, "damper": car.damping.lf, "sprung_share": 100.0 * car.sprung_mass / total,
            "front_share": 100.0 * front / (front + rear), "total": total,
        } | {name: 100.0 * float(value) for name, value in radii.items()},
        note="The printed inertias do not have the radii of gyration of the text (docs/evidence/errata.md).",
    )  # fmt: skip


# ---- Equations ------------------------------------------------------------------------------------------------------


def equation_5_1(_: Effort) -> Findings:
    """Compare T with a rigid plane."""
    car, generator = parameters(), np.random.default_rng(0)
    z, roll, pitch = generator.standard_normal((3, 20))
    T = car.corner_heights
    half = car.track_width / 2.0
    places = [(s * half, ahead) for ahead in (car.cg_to_front_axle, -car.cg_to_rear_axle) for s in (1.0, -1.0)]
    plane = np.stack([z + left * roll - ahead * pitch for left, ahead in places])
    return Findings(claims={"holds": holds(difference(T @ np.stack([z, roll, pitch]), plane))})


def equation_5_14(_: Effort) -> Findings:
    """Compare the car with bars to the car without."""
    rate = 5e4
    car = parameters()
    models = [replace(car, front_anti_roll_rate=k).coupled() for k in (rate, 0.0)]
    K = models[1].A[7:, :7] - models[0].A[7:, :7]  # M^-1 times the stiffness of the bar
    heave = np.array([1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    roll = np.eye(7)[1]
    moment = car.roll_inertia * float(K[1] @ roll)
    return Findings(
        claims={
            "heave": holds(float(np.abs(K @ heave).max() / np.abs(K).max())),
            "roll": holds(abs(moment / rate - 1.0)),
        }
    )


def equation_5_19(_: Effort) -> Findings:
    """Check the state matrices against Eq 5.17 and 5.18, assembled here from T, K_s, K_t and C_s."""
    car, model = parameters(), _car()
    T, zero = car.corner_heights, np.zeros
    Ks, Kt, Cs = (np.diag(np.array(rates)) for rates in (car.spring_rate, car.tire_stiffness, car.damping))
    K = np.block([[T.T @ Ks @ T, -T.T @ Ks], [-Ks @ T, Ks + Kt]])
    C = np.block([[T.T @ Cs @ T, -T.T @ Cs], [-Cs @ T, Cs]])
    L = np.block([[zero((3, 4)), np.eye(3), T.T], [Kt, zero((4, 3)), -np.eye(4)]])
    mass = np.array([car.sprung_mass, car.roll_inertia, car.pitch_inertia, *car.unsprung_mass])
    generator = np.random.default_rng(0)
    Z, dZ, u = (
        generator.standard_normal((7, 30)),
        generator.standard_normal((7, 30)),
        generator.standard_normal((11, 30)),
    )
    ours = mass[:, None] * (model.A[7:] @ np.vstack([Z, dZ]) + model.B[7:] @ u)
    modes = model.modes()
    text = ", ".join(f"{mode.frequency_hz:.2f} Hz {100.0 * mode.damping_ratio:.0f} %" for mode in modes)
    stable = len(modes) == 7 and all(mode.damping_ratio > 0.0 for mode in modes)
    return Findings(claims={"holds": holds(difference(ours, L @ u - C @ dZ - K @ Z)), "modes": (stable, text)})


_RIG = ("lf.road", "rf.road", "lr.road", "rr.road", "heave_force", "roll_moment", "pitch_moment")
_FORCES = tuple(f"{corner}.force" for corner in CORNERS)
_VELOCITIES = tuple(f"{corner}.velocity" for corner in CORNERS)


def _parts(model: StateSpace, frequency: Array) -> tuple[Complex, Complex, list[int]]:
    """Return H_rig (p, 7, K), H_shocks (p, 4, K) and the rows of the shock velocities."""
    H = model.frequency_response(frequency)
    columns = [[model.input_names.index(name) for name in names] for names in (_RIG, _FORCES)]
    return H[:, columns[0]], H[:, columns[1]], [model.output_names.index(name) for name in _VELOCITIES]


def equation_5_34(_: Effort) -> Findings:
    """Rank of rig inputs and forces of linear shocks over many blocks."""
    car = parameters()
    H, _H, rows = _parts(car.with_damper(), np.array([4.5]))
    forces = np.array(car.damping)[:, None] * H[rows, :, 0] * _scales()
    rank = _rank(np.vstack([np.eye(7), forces]) @ _draws(7, 40))
    return Findings(claims={"dependent": (rank == 7, f"rank {rank} of 11 inputs over 40 blocks at 4.5 Hz")})


def _scales() -> Array:
    """Return plausible amplitudes of the rig's inputs, so that ranks do not depend on units."""
    return np.array([_INCH] * 4 + [500.0 * _POUND] * 3)


def _draws(rows: int, blocks: int) -> Complex:
    generator = np.random.default_rng(0)
    return generator.standard_normal((rows, blocks)) + 1j * generator.standard_normal((rows, blocks))


def _rank(rows: Complex) -> int:
    """Return the rank of inputs (m, blocks), each relative to its own size."""
    scaled = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return int(np.linalg.matrix_rank(scaled, tol=1e-9))


def equation_5_37(_: Effort) -> Findings:
    """Close the loops of the undamped car with linear shocks."""
    car = parameters()
    H_rig, H_shocks, rows = _parts(car.coupled(), _FREQUENCY)
    C = np.diag(np.array(car.damping))
    found = []
    for part in (H_rig, H_shocks):
        loop = np.eye(4)[None] - C @ np.moveaxis(H_shocks[rows], 2, 0)
        force = np.linalg.solve(loop, C @ np.moveaxis(part[rows], 2, 0))
        found.append(part + np.einsum("pfk,kfm->pmk", H_shocks, force))
    expected = np.concatenate(_parts(_car(), _FREQUENCY)[:2], axis=1)
    return Findings(claims={"holds": holds(difference_by_output(np.concatenate(found, axis=1), expected))})


def _experiments(blocks: int = 1) -> tuple[Complex, Complex]:
    """Return U (11, N) and Y (p, N) of Eq 5.40 at 4.5 Hz: 7 baseline blocks, and `blocks` with each alternate shock."""
    car, frequency = parameters(), np.array([4.5])
    baseline = np.array(car.damping)
    U, Y = [], []
    for number, count in enumerate((7, *[blocks] * 4)):
        rates = baseline.copy()
        if number:
            rates[number - 1] = 0.4 * baseline[number - 1]
        H, _H, rows = _parts(replace(car, damping=Corners(*rates)).with_damper(), frequency)
        u = _scales()[:, None] * _draws(7 * (number + 1), count)[-7:]
        y = H[:, :, 0] @ u
        U.append(np.vstack([u, (rates - baseline)[:, None] * y[rows]]))
        Y.append(y)
    return np.hstack(U), np.hstack(Y)


def equation_5_40(_: Effort) -> Findings:
    """Rank of the eleven experiments."""
    U, _Y = _experiments()
    rank = _rank(U)
    return Findings(claims={"rank": (rank == 11, f"rank {rank} of {len(U)} inputs in {U.shape[1]} blocks")})


def equation_5_45(_: Effort) -> Findings:
    """Solve Eq 5.40 at once and one after the other, and compare with the car."""
    U, Y = _experiments()
    together = np.linalg.lstsq(U.T, Y.T, rcond=None)[0].T
    rig = np.linalg.lstsq(U[:7, :7].T, Y[:, :7].T, rcond=None)[0].T
    columns = []
    for number in range(4):
        at = 7 + number
        rest = Y[:, at] - rig @ U[:7, at]
        columns.append(rest / U[7 + number, at])
    one_by_one = np.hstack([rig, np.stack(columns, axis=1)])
    return Findings(claims={"holds": holds(difference_by_output(one_by_one, together), 1e-6)})


@dataclass(frozen=True, slots=True)
class LowResidual:
    """Residual fit of Eq 5.49, `H = K exp(i (phi + b f)) / f^N`, through two points, for all below the first."""

    low: float  #: Lower control point [Hz], about 1 in 5.3.2; all below it is replaced.
    high: float  #: Upper control point [Hz], about 4.

    def apply(self, frequency: Array, path: Complex) -> Complex:
        """Return the path (K,) with its low frequencies replaced."""
        order, gain, _, (start, slope) = through_points(frequency, path, self.low, self.high)
        inside = frequency < self.low
        changed = path.copy()
        changed[inside] = gain * np.exp(1j * (start + slope * frequency[inside])) / frequency[inside] ** order
        return changed


def _residual(treatment: HighResidual | LowResidual, slope: float) -> Findings:
    f = np.arange(0.1, 30.0, 0.1)
    path = np.asarray(3.0 * np.exp(1j * (0.7 + slope * f)) / f**1.8, dtype=np.complex128)
    return Findings(claims={"holds": holds(difference(treatment.apply(f, path) * f**1.8, path * f**1.8))})


def equation_5_48(_: Effort) -> Findings:
    """Continue a path above 6 Hz from its values at 6 and 7 Hz."""
    return _residual(HighResidual(6.0, 7.0), 0.0)


def equation_5_49(_: Effort) -> Findings:
    """Continue a path below 1 Hz from its values at 1 and 4 Hz."""
    return _residual(LowResidual(1.0, 4.0), 0.2)


def baseline_car(damping: Mapping[str, float]) -> StateSpace:
    """Return the ideal car around a baseline damping by corner [N.s/m]."""
    return add_port_damping(parameters().coupled(), damping)


COMPUTATIONS = {
    "figure-5.3": figure_5_3,
    "figure-5.4": figure_5_4,
    "figure-5.5": figure_5_5,
    "table-5.1": table_5_1,
    "equation-5.1": equation_5_1,
    "equation-5.14": equation_5_14,
    "equation-5.19": equation_5_19,
    "equation-5.34": equation_5_34,
    "equation-5.37": equation_5_37,
    "equation-5.40": equation_5_40,
    "equation-5.45": equation_5_45,
    "equation-5.48": equation_5_48,
    "equation-5.49": equation_5_49,
}
