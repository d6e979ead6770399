"""Chapter 6.1 and the equations of 6.3: channels, drive files, shocks, modes, zeroed and feedback paths."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from dissertation.chapter_5_model import baseline_car
from dissertation.checks import difference_by_output, holds
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import TIME, Line, Plot, figure_of
from dissertation.rig_bench import EIGHT_POST, tests
from eightpost.array_types import Array, Complex
from eightpost.ident.vehicle.siso_models import AEROLOADERS, WHEELLOADERS
from eightpost.report.charts import Axis
from eightpost.report.tables import ResultTable
from eightpost.rig.geometry import displacement_modes, force_modes
from eightpost.units import si_factor
from eightpost.vehicle import CORNERS
from eightpost.virtual import random_drive, shim_build, static_drive
from eightpost.virtual.drivefiles import AEROLOADER, HEAVE_SINES, TILT_SINES, WHEELLOADER

_INCH, _POUND, _DAMPING = (si_factor(unit) for unit in ("in", "lbf", "lbf/(in/s)"))


# ---- Figures --------------------------------------------------------------------------------------------------------


def figure_6_7(_: Effort) -> Findings:
    """Static test in heave."""
    drive = static_drive(EIGHT_POST.car, "heave").series
    force = drive["lf.aero"]
    steady = np.flatnonzero(np.abs(np.diff(force)) < 1e-9)
    levels = np.unique(np.round(force[steady], 3))
    first = float(np.count_nonzero(np.abs(force - levels[1]) < 1e-3)) / drive.sample_rate / 2.0
    plot = Plot("", TIME, Axis("force of each aeroloader", "N"), [Line("drive", drive.time, force)])
    down = bool(np.argmax(force) < force.size - 1 and force[-1] < 0.5 * force.max())
    return Findings(
        {"levels": levels.size - 1, "hold": first},
        {"back": (down, f"from {force.max() / _POUND:.0f} lbf back to {force[-1] / _POUND:.0f} lbf")},
        [figure_of("Aeroloader force in the static heave test.", [plot], columns=1)],
    )


def figure_6_8(_: Effort) -> Findings:
    """Static curves of the builds B/B and AA/AA."""
    velocity = np.linspace(-0.6, 0.6, 121)
    builds = {"B/B": "baseline", "AA/AA": "alternate"}
    lines, rates = [], {}
    for build, name in builds.items():
        damper = shim_build(build)
        force = np.array([damper.static_force(v) for v in velocity.tolist()])
        force -= damper.static_force(0.0)
        rates[name] = float(velocity @ force / (velocity @ velocity))
        lines.append(Line(f"{build} ({name})", velocity, force))
    ratio = rates["alternate"] / rates["baseline"]
    plot = Plot("", Axis("velocity", "m/s"), Axis("force", "N"), lines)
    return Findings(
        {**rates, "removed": rates["baseline"]},
        {"half": (ratio < 0.7, f"{ratio:.2g} of the baseline's damping")},
        [figure_of("Force at constant velocity.", [plot], columns=1)],
        "Damping is the slope of the best line through the origin up to 24 in/s. The rig tests here have linear "
        "dampers of 20.74 and 9 lb/(in/s) (6.3.1).",
    )


# ---- Tables ---------------------------------------------------------------------------------------------------------


def table_6_1(_: Effort) -> Findings:
    """Channels of a record of the virtual rig."""
    names = set(next(tests(EIGHT_POST, 2.0)).series.names)

    def count(*quantities: str) -> int:
        return len([n for n in names if n.rpartition(".")[2] in quantities or n in quantities])

    modes = [name for name in names if name.startswith("aero.")]
    return Findings(
        {
            "wheelloaders": count("road", "road_command"),
            "aeroloaders": count("aero_position", "aero", "aero_command"),
            "shocks": count("displacement", "force"),
            "accelerations": len([name for name in names if "acceleration" in name]),
            "modes": len(modes),
            "heights": count("ride_height"),
            "velocities": count("velocity"),
        },
        note=f"{len(names)} channels in all. The table has 24 of the rig, 20 of the vehicle (not 24) and 18 computed, "
        "of which the table lists twelve modes, two ride heights and four shock velocities.",
    )


def table_6_2(_: Effort) -> Findings:
    """Amplitudes of the sine program."""
    tables = {"heave": HEAVE_SINES, "pitch and roll": TILT_SINES}
    return Findings({f"{name}/{f:g} Hz": a * _INCH for name, table in tables.items() for f, a in table})


def table_6_3(_: Effort) -> Findings:
    """Spectra of the random drive file."""
    tables = {"aeroloader": AEROLOADER, "wheelloader": WHEELLOADER}
    drive = random_drive(EIGHT_POST.car, 1, duration=60.0).series
    road = drive["lf.road"]
    return Findings(
        {f"{name}/{f:g} Hz": a for name, table in tables.items() for f, a in table},
        note=f"Peak of the wheelloaders {np.abs(road).max() / _INCH:.2g} in with {road.std() / _INCH:.2g} in RMS; "
        "6.1.3 prints 0.4 in and approximately 0.11 in.",
    )


@cache
def zeroed_table() -> tuple[tuple[str, ...], NDArray[np.bool_]]:
    """Return the outputs and the mask (14, 12) of the kept paths of Table 6.5."""
    text = files("dissertation").joinpath("printed/table_6_5.toml").read_text(encoding="utf-8")
    rows = tomllib.loads(text)["paths"]
    mask = np.array([[digit == "1" for digit in row.replace(" ", "")] for row in rows.values()])
    return tuple(rows), mask


def inputs_of_table() -> tuple[str, ...]:
    """Return the inputs of Table 6.5 in its order."""
    return tuple(f"{corner}.{kind}" for kind in ("road", "aero", "force") for corner in CORNERS)


def table_6_6(_: Effort) -> Findings:
    """Apply Eq 6.8 to Table 6.5, as printed and with one cell moved."""
    names, mask = zeroed_table()
    printed = _feedback(mask)
    moved = mask.copy()
    moved[names.index("lr.velocity"), [8, 10]] = [False, True]
    counts = _feedback(moved)
    wanted = tuple((output, corner) for output in names for corner in CORNERS)
    values = {
        f"{output}/{corner}": float(counts[names.index(output), CORNERS.index(corner)]) for output, corner in wanted
    }
    same = int(np.sum(printed == counts))
    rows = [
        (output, *(f"{a} ({b})" for a, b in zip(row, own, strict=True)))
        for output, row, own in zip(names, counts, printed, strict=True)
    ]
    return Findings(
        values,
        {"printed": (same == counts.size, f"{same} of {counts.size} values")},
        [ResultTable.of("With the cell moved (and as printed)", ("output", *CORNERS), rows)],
        "Our copy of Table 6.5 zeroes the left rear shock velocity over its own shock force, its largest path. With "
        "that zero under the left front shock, as for the other three corners (front and rear of one side), Eq 6.8 "
        "gives every value of Table 6.6.",
    )


def _feedback(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the number of feedback paths from each shock to each output through the shock velocities (Eq 6.8).

        sum_k h_ik h_kj over the shock velocities k, where h_ik is the response of output i to the force of shock k

    (In the printed sum k = 9 to 12 are column numbers of Table 6.5 for h_ik and row numbers for h_kj.)
    """
    paths = mask[:, 8:].astype(np.intp)
    return np.asarray(paths @ paths[:4], dtype=np.intp)


# ---- Equations ------------------------------------------------------------------------------------------------------


def equation_6_2(_: Effort) -> Findings:
    """Check both transformations on the geometry of the stand-in."""
    geometry = EIGHT_POST.car.geometry
    assert geometry is not None
    a, b = geometry.front_aero, geometry.rear_aero
    generator = np.random.default_rng(0)
    heave, pitch, roll, warp = modes = generator.standard_normal((4, 20))
    front, rear = roll + a / (a + b) * warp, roll - b / (a + b) * warp
    half = 0.5 * np.array([geometry.front_aero_track, geometry.rear_aero_track])
    heights = np.stack(
        [
            heave - a * pitch + half[0] * front, heave - a * pitch - half[0] * front,
            heave + b * pitch + half[1] * rear, heave + b * pitch - half[1] * rear,
        ]
    )  # fmt: skip
    found = displacement_modes(geometry) @ heights
    work = force_modes(geometry).T[:, :2] @ modes[:2]
    rigid = np.stack([heave - a * pitch, heave - a * pitch, heave + b * pitch, heave + b * pitch])
    return Findings(
        claims={
            "displacement": holds(difference_by_output(found, modes)),
            "work": holds(difference_by_output(work, rigid)),
        }
    )


def _damped(rate: float, frequency: Array) -> Complex:
    """Return the responses (p, 11, K) of the car of Table 5.1 around a damping [lbf/(in/s)]."""
    car = baseline_car(dict.fromkeys(CORNERS, rate * _DAMPING))
    return car.frequency_response(frequency)


def _undamped(H: Complex, rate: float) -> Complex:
    """Return the responses without baseline damping from those with it, the inverse of Eq 6.5."""
    car = baseline_car({})
    rows = [car.output_names.index(f"{corner}.velocity") for corner in CORNERS]
    C = rate * _DAMPING
    found = []
    for k in range(H.shape[2]):
        forces = H[:, -4:, k] @ np.linalg.inv(np.eye(4) + C * H[np.ix_(rows, range(7, 11))][:, :, k])
        found.append(H[:, :, k] - C * forces @ H[rows, :, k])
    return np.stack(found, axis=2)


def equation_6_5(_: Effort) -> Findings:
    """Remove two different baseline dampings."""
    f = np.geomspace(0.5, 20.0, 60)
    low, high = (_undamped(_damped(rate, f), rate) for rate in (9.0, 20.74))
    return Findings(claims={"any": holds(difference_by_output(low, high), 1e-6)})


def equation_6_7(_: Effort) -> Findings:
    """Solve Eq 6.7 for noise-free blocks at one frequency."""
    f, baseline = np.array([4.5]), 20.74
    exact = _damped(baseline, f)[:, :, 0]
    generator = np.random.default_rng(0)
    scale = np.array([_INCH] * 4 + [500.0 * _POUND] * 3)[:, None]
    blocks = scale * (generator.standard_normal((7, 12)) + 1j * generator.standard_normal((7, 12)))
    car = baseline_car({})
    rows = [car.output_names.index(f"{corner}.velocity") for corner in CORNERS]
    U, Y = [], []
    for setup in range(5):
        rates = {corner: (9.0 if k == setup - 1 else baseline) * _DAMPING for k, corner in enumerate(CORNERS)}
        y = baseline_car(rates).frequency_response(f)[:, :7, 0] @ blocks
        change = np.array([rates[corner] - baseline * _DAMPING for corner in CORNERS])[:, None] * y[rows]
        U.append(np.vstack([blocks, change]))
        Y.append(y)
    together = np.hstack(U)
    found = np.linalg.lstsq((together / np.abs(together).max(axis=1, keepdims=True)).T, np.hstack(Y).T, rcond=None)[0].T
    found = found / np.abs(together).max(axis=1)
    forces = _plain_forces(rows, f, blocks, baseline)
    rank = int(np.linalg.matrix_rank(np.vstack([blocks / scale, forces / np.abs(forces).max()]), tol=1e-9))
    return Findings(
        claims={
            "exact": holds(difference_by_output(found * _sizes(), exact * _sizes()), 1e-6),
            "rank": (rank == 7, f"rank {rank} of 11 inputs without an alternate shock"),
        }
    )


def _plain_forces(rows: list[int], f: Array, blocks: Complex, rate: float) -> Complex:
    """Return the shock forces (4, blocks) of the baseline setup."""
    return rate * _DAMPING * (_damped(rate, f)[rows, :7, 0] @ blocks)


def _sizes() -> Array:
    """Return plausible amplitudes of the eleven inputs, so that errors are compared in outputs."""
    return np.array([_INCH] * 4 + [500.0 * _POUND] * 3 + [100.0 * _POUND] * 4)


def equation_6_8(_: Effort) -> Findings:
    """Count the feedback paths one by one."""
    _names, mask = zeroed_table()
    h = mask[:, 8:].astype(int)
    by_hand = np.array([[sum(h[i, k] * h[k, j] for k in range(4)) for j in range(4)] for i in range(len(h))])
    same = int(np.sum(by_hand == _feedback(mask)))
    return Findings(claims={"count": (same == by_hand.size, f"{same} of {by_hand.size} counts")})


def equation_6_9(_: Effort) -> Findings:
    """Weights of both kinds of inputs at some frequencies."""
    frequencies = np.array([0.3, 0.7, 4.0, 6.0, 8.0, 11.0, 14.0, 18.0, 25.0])
    bands = {"aeroloaders": AEROLOADERS, "wheelloaders and shocks": WHEELLOADERS}
    return Findings(
        {
            f"{name}/{f:g} Hz": float(weight)
            for name, one in bands.items()
            for f, weight in zip(frequencies.tolist(), one.at(frequencies), strict=True)
        }
    )


COMPUTATIONS = {
    "figure-6.7": figure_6_7,
    "figure-6.8": figure_6_8,
    "table-6.1": table_6_1,
    "table-6.2": table_6_2,
    "table-6.3": table_6_3,
    "table-6.6": table_6_6,
    "equation-6.2": equation_6_2,
    "equation-6.5": equation_6_5,
    "equation-6.7": equation_6_7,
    "equation-6.8": equation_6_8,
    "equation-6.9": equation_6_9,
}
