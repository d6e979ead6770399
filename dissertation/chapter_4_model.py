"""Chapter 4: the quarter car, its responses over damping and stiffness, and the equations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.constants import g
from scipy.signal import bilinear

from dissertation.checks import difference, difference_by_output, falls, holds, response, shown
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import FREQUENCY, Line, Plot, decibel_axis, decibels, figure_of
from eightpost.array_types import Array, Complex
from eightpost.ident.vehicle.siso_models import QUARTER_CAR, RationalFit
from eightpost.report.charts import Figure
from eightpost.units import si_factor
from eightpost.vehicle import QuarterCar, StructuralVehicle, read_vehicle, shipped
from eightpost.virtual import CONFIGURATIONS, SHIMS_OF_BUILD
from eightpost.virtual.drivefiles import RATE, TABLE_4_4, quarter_random
from eightpost.virtual.valves import SHIM_SETS

_FREQUENCY = np.geomspace(0.5, 30.0, 1500)
_INPUTS = ("road", "aero_force", "force")
_DAMPINGS = (0.5, 1.0, 2.0, 3.0)
_STIFFNESSES = (0.05, 0.5, 1.0, 2.0, 3.0)
_UNITS = {
    ("tire_force", "road"): "lbf/in",
    ("tire_force", "aero_force"): "lbf/lbf",
    ("tire_force", "force"): "lbf/lbf",
    ("ride_height", "road"): "in/in",
    ("ride_height", "aero_force"): "in/lbf",
    ("ride_height", "force"): "in/lbf",
}


def parameters() -> QuarterCar:
    """Return Table 4.1 as printed."""
    vehicle = read_vehicle(shipped("quarter_car"))
    assert isinstance(vehicle, StructuralVehicle)
    assert isinstance(vehicle.parameters, QuarterCar)
    return vehicle.parameters


def printed_ideal() -> QuarterCar:
    """Return the car that gives the ideal column of Table 4.2: 17.5 lbf/(in/s), and masses with g = 386 in/s2."""
    rounded = g / (386.0 * si_factor("in"))
    car = parameters()
    return replace(
        car,
        damping=17.5 * si_factor("lbf/(in/s)"),
        sprung_mass=car.sprung_mass * rounded,
        unsprung_mass=car.unsprung_mass * rounded,
    )


@cache
def _magnitudes(output: str, source: str, damping: float = 1.0, stiffness: float = 1.0) -> Array:
    """Return the magnitude (K,) of a path with damping and stiffness relative to Table 4.1."""
    car = parameters()
    changed = replace(car, damping=damping * car.damping, suspension_stiffness=stiffness * car.suspension_stiffness)
    return np.abs(response(changed.with_damper(), output, source, _FREQUENCY))


# ---- Figs 4.2 to 4.5 ------------------------------------------------------------------------------------------------


def _figure(output: str, name: str, values: tuple[float, ...]) -> Figure:
    """Return the three panels of a figure: each input, with a line for each damping or stiffness."""
    plots = []
    for source in _INPUTS:
        unit = _UNITS[output, source]
        lines = [
            Line(
                f"{100.0 * value:g} % {name}",
                _FREQUENCY,
                decibels(_magnitudes(output, source, **{name: value}), si_factor(unit)),
            )
            for value in values
        ]
        plots.append(Plot(f"{output} over {source}", FREQUENCY, decibel_axis(unit), lines))
    return figure_of(f"Magnitude of {output.replace('_', ' ')} for each input.", plots)


def _peaks(output: str, source: str, name: str, values: tuple[float, ...]) -> list[float]:
    return [float(_magnitudes(output, source, **{name: value}).max()) for value in values]


def _worse(output: str, source: str) -> tuple[float, float]:
    """Return the first band above the resonance in which 300 % damping gives more than 100 % [Hz]."""
    more = _magnitudes(output, source, damping=3.0) > _magnitudes(output, source)
    changes = np.flatnonzero(np.diff(more.astype(int)))
    first = int(changes[0])
    last = int(changes[1]) if changes.size > 1 else _FREQUENCY.size - 1
    return float(_FREQUENCY[first]), float(_FREQUENCY[last])


def _increase(output: str, source: str) -> float:
    """Return the largest increase by 300 % damping above the resonance [dB]."""
    return float(np.max(decibels(_magnitudes(output, source, damping=3.0)) - decibels(_magnitudes(output, source))))


def figure_4_2(_: Effort) -> Findings:
    """Tire force over damping."""
    road = np.stack([decibels(_magnitudes("tire_force", "road", damping=c)) for c in _DAMPINGS])
    effect = np.ptp(road, axis=0)
    start, stop = _worse("tire_force", "road")
    peaks = _peaks("tire_force", "road", "damping", _DAMPINGS)
    force = np.stack([_magnitudes("tire_force", "force", damping=c) for c in _DAMPINGS])
    high = _FREQUENCY > 10.0
    changes = [
        float(
            np.max(
                np.abs(decibels(_magnitudes("tire_force", s, damping=3.0)) - decibels(_magnitudes("tire_force", s)))[
                    high
                ]
            )
        )
        for s in ("aero_force", "road")
    ]
    return Findings(
        {
            "resonance": float(_FREQUENCY[np.argmax(_magnitudes("tire_force", "road"))]),
            "effect": float(_FREQUENCY[np.argmax(effect > 1.0)]),
            "worse_from": start,
            "worse_to": stop,
        },
        {
            "peak": (falls(peaks), f"peaks {shown([p / si_factor('lbf/in') for p in peaks], 'lbf/in')}"),
            "after": (stop > start, f"300 % is above 100 % from {start:.3g} to {stop:.3g} Hz"),
            "aero_less": (
                changes[0] < changes[1],
                f"from 10 Hz on, 300 % changes the aeroloader path by up to {changes[0]:.2g} dB, the road path by "
                f"{changes[1]:.2g} dB",
            ),
            "authority": (
                bool(np.all(np.diff(force, axis=0) <= 0.0)),
                f"largest ratio of neighbouring dampings {np.max(force[1:] / force[:-1]):.3g}",
            ),
        },
        [_figure("tire_force", "damping", _DAMPINGS)],
        "The text reads frequencies from a plot. With linear magnitudes, the lines of the road path cross at "
        f"{start:.3g} and {stop:.3g} Hz; where two lines differ by less than a decibel, a plot does not show it.",
    )


def figure_4_3(_: Effort) -> Findings:
    """Ride height over damping."""
    peaks = {source: _peaks("ride_height", source, "damping", _DAMPINGS) for source in _INPUTS[:2]}
    ride, tire = _increase("ride_height", "road"), _increase("tire_force", "road")
    ratios = " and ".join(f"{values[-1] / values[0]:.2g}" for values in peaks.values())
    return Findings(
        claims={
            "peak": (all(map(falls, peaks.values())), f"with 300 % instead of 50 %, {ratios} of the peak"),
            "small": (ride < tire, f"at most {ride:.2g} dB for the ride height, {tire:.2g} dB for the tire force"),
        },
        blocks=[_figure("ride_height", "damping", _DAMPINGS)],
    )


def figure_4_4(_: Effort) -> Findings:
    """Tire force over stiffness."""
    modes = [
        replace(parameters(), suspension_stiffness=k * parameters().suspension_stiffness).with_damper().modes()[0]
        for k in _STIFFNESSES
    ]
    frequencies, ratios = ([float(value) for value in column] for column in zip(*modes, strict=True))
    before, after = (
        [float(np.interp(f, _FREQUENCY, _magnitudes("tire_force", "road", stiffness=k))) for k in _STIFFNESSES]
        for f in (1.0, 8.0)
    )
    force = [_magnitudes("tire_force", "force", stiffness=k) for k in _STIFFNESSES]
    ends = [float(np.interp(f, _FREQUENCY, force[0] / force[-1])) for f in (1.0, 10.0)]
    soft = np.max(_magnitudes("tire_force", "road", stiffness=0.05)[_FREQUENCY < 6.0])
    base = np.max(_magnitudes("tire_force", "road")[_FREQUENCY < 6.0])
    pounds = si_factor("lbf/in")
    return Findings(
        claims={
            "frequency": (falls(frequencies[::-1]), f"mode 1 at {shown(frequencies, 'Hz')}"),
            "damping": (falls(ratios), f"damping ratios {shown(ratios)}"),
            "before": (falls(before), f"at 1 Hz {shown([v / pounds for v in before], 'lbf/in')}"),
            "after": (
                falls(after[:0:-1]),
                f"at 8 Hz, from 50 to 300 %: {shown([v / pounds for v in after[1:]], 'lbf/in')}",
            ),
            "soft": (bool(soft < 0.3 * base), f"largest tire force below 6 Hz {soft / base:.2g} of that at 100 %"),
            "authority": (min(ends) > 1.0, f"5 % over 300 %: {ends[0]:.3g} at 1 Hz, {ends[1]:.3g} at 10 Hz"),
        },
        blocks=[_figure("tire_force", "stiffness", _STIFFNESSES)],
    )


def figure_4_5(_: Effort) -> Findings:
    """Ride height over stiffness."""
    peaks = [float(_FREQUENCY[np.argmax(_magnitudes("ride_height", "road", stiffness=k))]) for k in _STIFFNESSES[1:]]
    low = [
        float(np.interp(1.0, _FREQUENCY, _magnitudes("ride_height", "aero_force", stiffness=k))) for k in _STIFFNESSES
    ]
    unit = si_factor("in/lbf")
    return Findings(
        claims={
            "frequency": (falls(peaks[::-1]), f"peaks at {shown(peaks, 'Hz')}"),
            "low": (falls(low), f"aeroloader at 1 Hz {shown([1e3 * v / unit for v in low], 'in per 1000 lbf')}"),
        },
        blocks=[_figure("ride_height", "stiffness", _STIFFNESSES)],
    )


# ---- Tables ---------------------------------------------------------------------------------------------------------


def table_4_1(_: Effort) -> Findings:
    """The shipped vehicle file has the printed parameters."""
    car = parameters()
    return Findings(
        {
            "m1": car.sprung_mass * g,
            "m2": car.unsprung_mass * g,
            "k": car.suspension_stiffness,
            "kt": car.tire_stiffness,
            "c": car.damping,
        }
    )


def table_4_3(_: Effort) -> Findings:
    """Amplitudes of the generated drive at the printed frequencies, relative to 1 Hz."""
    values = quarter_random(1, duration=20.0).series["road"][: round(10.0 * RATE)]
    lines = np.abs(np.fft.rfft(values))
    frequencies = (0.1, 1.0, 2.0, 3.0, 5.0, 8.0, 10.0, 15.0, 20.0)
    return Findings({f"amplitude/{f:g} Hz": float(lines[round(10.0 * f)] / lines[10]) for f in frequencies})


def table_4_4(_: Effort) -> Findings:
    """Amplitudes of the sine program."""
    return Findings({f"amplitude/{f:g} Hz": amplitude * si_factor("in") for f, amplitude in TABLE_4_4})


def table_4_5(_: Effort) -> Findings:
    """Settings of the six configurations of the virtual rig."""
    settings = [CONFIGURATIONS[number] for number in (1, 2, 5, 6, 9, 10)]
    found: dict[str, float] = {}
    for k, setting in enumerate(settings, start=1):
        found |= {
            f"configuration {k}/build": setting.build,
            f"configuration {k}/gas": setting.gas_pressure / si_factor("psi"),
        }
    clicks = [setting.clicks for setting in settings]
    first, second, last = (SHIMS_OF_BUILD[build] for build in (1, 2, 4))
    hardness = list(SHIM_SETS).index
    others = max(hardness(first.compression), hardness(second.compression))
    stacks = f"shims {first.compression}, {second.compression} and {last.compression} (Table 7.2)"
    claims = {
        "bleed": (clicks == [1, 14] * 3, "1 and 14 clicks from fully open"),
        "head": (hardness(first.head) > hardness(second.head), f"shims {first.head} and {second.head} (Table 7.2)"),
        "compression": (hardness(last.compression) > others, stacks),
    }
    note = "3.2.2 and 3.4.1 give build 4 the softer compression shims, as here. Its HV is printed as 0."
    return Findings(found, claims, note=note)


# ---- Equations ------------------------------------------------------------------------------------------------------


def equation_4_2(_: Effort) -> Findings:
    """Check the state matrices against M, C, K and L."""
    car = parameters()
    model = car.with_damper()
    m, c, k, kt = (
        np.diag([car.sprung_mass, car.unsprung_mass]),
        car.damping,
        car.suspension_stiffness,
        car.tire_stiffness,
    )
    C, K = c * np.array([[1, -1], [-1, 1]]), np.array([[k, -k], [-k, k + kt]])
    L = np.array([[0, -1, 1], [kt, 0, -1]])
    generator = np.random.default_rng(0)
    w, dw, u = (
        generator.standard_normal((2, 50)),
        generator.standard_normal((2, 50)),
        generator.standard_normal((3, 50)),
    )
    ours = (model.A @ np.vstack([w, dw]) + model.B @ u)[2:]
    return Findings(claims={"holds": holds(difference(m @ ours, L @ u - C @ dw - K @ w))})


def equation_4_6(_: Effort) -> Findings:
    """Check Newton's law on the whole car."""
    car = parameters()
    model = car.with_damper()
    H = {name: model.select(outputs=[name]).frequency_response(_FREQUENCY)[0] for name in model.output_names}
    inertia = car.sprung_mass * H["chassis_acceleration"] + car.unsprung_mass * H["hub_acceleration"]
    load = np.zeros_like(inertia)
    load[1] = 1.0  # the aeroloader pushes down
    return Findings(claims={"holds": holds(difference(H["tire_force"] - load, inertia))})


def equation_4_14(_: Effort) -> Findings:
    """Compare Eq 4.14 with the bilinear transform of 1 / (tau s + 1), and with the exact lag."""
    tau, step = 1.3e-3, 1.0 / 500.0
    ratio = 2.0 * tau / step
    b, a = bilinear([1.0], [tau, 1.0], fs=1.0 / step)
    printed = np.array([1.0, 1.0]) / (1.0 + ratio), np.array([1.0 + ratio, 1.0 - ratio]) / (1.0 + ratio)
    error = max(difference(printed[0], b / a[0]), difference(printed[1], a / a[0]))
    f = np.linspace(0.1, 20.0, 200)
    z = np.exp(-2j * np.pi * f * step)
    discrete = (1.0 + z) / ((1.0 + ratio) + (1.0 - ratio) * z)
    warped = difference(discrete, 1.0 / (tau * 2j * np.pi * f + 1.0))
    return Findings(claims={"lag": holds(error), "exact": holds(warped, 0.01)})


def equation_4_19(_: Effort) -> Findings:
    """Solve a random least-squares problem in both ways."""
    generator = np.random.default_rng(0)

    def draw(*shape: int) -> Complex:
        return generator.standard_normal(shape) + 1j * generator.standard_normal(shape)

    U, Y = draw(20, 3), draw(20, 1)
    normal = np.linalg.solve(U.conj().T @ U, U.conj().T @ Y)
    return Findings(claims={"holds": holds(difference(normal, np.linalg.lstsq(U, Y, rcond=None)[0]))})


def equation_4_21(_: Effort) -> Findings:
    """Close the loop of the undamped car with a linear shock."""
    car = parameters()
    open_loop, closed = car.coupled(), car.with_damper()
    H, S = open_loop.frequency_response(_FREQUENCY), open_loop.output_names.index("velocity")
    c = car.damping
    ours = H[:, :2] + H[:, 2:] * (c * H[S, :2] / (1.0 - c * H[S, 2]))
    expected = closed.frequency_response(_FREQUENCY)[:, :2]
    generator = np.random.default_rng(1)
    u = generator.standard_normal((2, 30)) + 1j * generator.standard_normal((2, 30))
    force = c * ours[S, :, 100] @ u
    rank = int(np.linalg.matrix_rank(np.vstack([u, force]), tol=1e-9 * float(np.abs(force).max())))
    return Findings(
        claims={
            "closed": holds(difference_by_output(ours, expected)),
            "dependent": (rank == 2, f"rank {rank} of three inputs over 30 blocks"),
        }
    )


def equation_4_26(_: Effort) -> Findings:
    """Subtract two experiments with the dampers c and c / 2 on one drive."""
    car = parameters()
    baseline, other = (replace(car, damping=s * car.damping).with_damper() for s in (1.0, 0.5))
    H = baseline.frequency_response(_FREQUENCY)
    one, two = (model.frequency_response(_FREQUENCY)[:, 0] for model in (baseline, other))
    S = baseline.output_names.index("velocity")
    change = (0.5 - 1.0) * car.damping * two[S]  # Eq 4.24 with the other shock in place
    return Findings(claims={"holds": holds(difference_by_output(H[:, 2] * change, two - one))})


def equation_4_27(_: Effort) -> Findings:
    """Fit a rational function to the ideal response."""
    model = parameters().with_damper()
    f = np.arange(0.1, 30.0, 0.105)
    fit = RationalFit(4, 4).fit(f, response(model, "tire_force", "road", f), QUARTER_CAR.at(f))
    found, ideal = (np.array(sorted(one.modes())[-2:]) for one in (fit, model))
    return Findings(claims={"exact": holds(float(np.max(np.abs(found / ideal - 1.0))), 1e-6)})


COMPUTATIONS = {
    "figure-4.2": figure_4_2,
    "figure-4.3": figure_4_3,
    "figure-4.4": figure_4_4,
    "figure-4.5": figure_4_5,
    "table-4.1": table_4_1,
    "table-4.3": table_4_3,
    "table-4.4": table_4_4,
    "table-4.5": table_4_5,
    "equation-4.2": equation_4_2,
    "equation-4.6": equation_4_6,
    "equation-4.14": equation_4_14,
    "equation-4.19": equation_4_19,
    "equation-4.21": equation_4_21,
    "equation-4.26": equation_4_26,
    "equation-4.27": equation_4_27,
}
