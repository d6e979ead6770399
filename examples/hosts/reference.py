"""The same car for every host program: its matrices, its road, its exact solution, and the table of errors.

The car is the seven-DOF car of examples/car.toml (Table 5.1 of the dissertation) with four LPNL2 shocks. All damping is
in the shocks, which were fitted to examples/data/dyno_A.csv (shock.json). It drives over the demo's track:

    M q'' + C q' + K q = sum_roads k_t road + loads - S^T F,    v = S q',    d = S q
    q = (heave, roll, pitch, wheels lf, rf, lr, rr): changes from the static state, positive up; roll is positive if
    the left side rises, pitch if the rear rises; v, d and F are positive in compression

A host program builds this car in the host, runs it once for each loop and step, and calls `main`, which prints the
error of each. The exact solution below shares nothing with the coupling: it integrates car and shocks as one system.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from builder.build import build
from eightpost.cache import digest, keep, recall
from eightpost.corners import CORNERS
from eightpost.errors import EightpostError
from eightpost.shock import read_shock
from eightpost.signals import Drivefile
from eightpost.vehicle import read_vehicle

HERE = Path(__file__).resolve().parent
CAR, SHOCK, TRACK = HERE.parent / "car.toml", HERE / "shock.json", HERE.parent / "data" / "track.parquet"

#: Steps of the table [s], and the step of the reference solution and of all comparisons [s].
STEPS = (8e-3, 4e-3, 2e-3, 1e-3)
GRID = 1e-3

#: Errors are those after this time [s], or after half of a shorter run. A larger error counts as diverged [%].
SETTLING, DIVERGED = 1.0, 300.0


# ---- The car --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Car:
    """Matrices of the car, SI units, and its parameters for hosts that build bodies and springs.

    Attributes:
        M: Mass matrix (7, 7), diagonal.
        K: Stiffness matrix (7, 7) of suspension springs and tires.
        C: Damping matrix (7, 7): zero, because all damping is in the shocks.
        S: Shock displacement per coordinate (4, 7): wheel minus chassis at each corner.
        tire_stiffness: Stiffness of each tire (4,) [N/m].
        parameters: Track width, distances, masses, inertias and spring rates, as in examples/car.toml.
    """

    M: Any
    K: Any
    C: Any
    S: Any
    tire_stiffness: Any
    parameters: Any

    def load(self, time: float) -> Any:
        """Return the generalized forces (7,) of the road and the external loads."""
        road = track()(time)
        return np.concatenate([road[4:], self.tire_stiffness * road[:4]])

    def tire_force(self, time: float, q: Any) -> Any:
        """Return the changes of the tire forces (4,) [N]."""
        return self.tire_stiffness * (track()(time)[:4] - q[3:])

    def acceleration(self, time: float, q: Any, speed: Any, force: Any) -> Any:
        """Return q'' (7,) with the shock forces (4,) [N]."""
        return (self.load(time) - self.K @ q - self.C @ speed - self.S.T @ force) / np.diag(self.M)

    def equilibrium(self) -> Any:
        """Return q (7,) at rest under the first road and loads: the shocks have no force at rest."""
        return np.linalg.solve(self.K, self.load(0.0))


@cache
def car() -> Car:
    """Return the car, assembled spring by spring: each adds `k b b^T`, where b is its compression per coordinate."""
    p = read_vehicle(CAR).parameters
    S, K = np.zeros((4, 7)), np.zeros((7, 7))
    for i, (left, ahead) in enumerate(
        ((1, p.cg_to_front_axle), (-1, p.cg_to_front_axle), (1, -p.cg_to_rear_axle), (-1, -p.cg_to_rear_axle))
    ):
        S[i, :3] = -1.0, -left * p.track_width / 2.0, ahead
        S[i, 3 + i] = 1.0
        K += p.spring_rate[i] * np.outer(S[i], S[i])
        K[3 + i, 3 + i] += p.tire_stiffness[i]
    M = np.diag([p.sprung_mass, p.roll_inertia, p.pitch_inertia, *p.unsprung_mass])
    return Car(M, K, np.zeros((7, 7)), S, np.array(p.tire_stiffness), p)


@cache
def track() -> Callable[[float], Any]:
    """Return a function of time: road under lf, rf, lr, rr [m], heave force [N], roll and pitch moment [N.m]."""
    drive = Drivefile.read(TRACK).series
    names = (*(f"{corner}.road" for corner in CORNERS), "heave_force", "roll_moment", "pitch_moment")
    rows, rate = np.stack([drive[name] for name in names], axis=1), 1.0 / (drive.time[1] - drive.time[0])
    slopes = np.diff(rows, axis=0)
    last = len(slopes) - 1

    def inputs(time: float) -> Any:
        k = min(int(time * rate + 1e-9), last)
        return rows[k] + (time * rate - k) * slopes[k]

    return inputs


# ---- The exact solution ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Motion:
    """Motion of the car: time (K,) [s], shock velocity (4, K) [m/s], change of the tire force (4, K) [N].

    `microseconds` is the processor time of a step of the host, if the host is another process [us]. `exact` is the
    exact motion, if the car is not the one of this module.
    """

    time: Any
    velocity: Any
    tire_force: Any
    microseconds: float | None = None
    exact: Motion | None = None


@cache
def reference(seconds: float) -> Motion:
    """Return the exact motion at every GRID; it is stored, so that other programs need not compute it again."""
    files = (CAR, SHOCK, TRACK, Path(__file__))
    key = digest([f"{seconds!r}", *(path.read_bytes() for path in files)])
    content = recall("hosts", key)
    if content is None:
        file, found = io.BytesIO(), solve(seconds)
        np.savez(file, time=found.time, velocity=found.velocity, tire_force=found.tire_force)
        content = file.getvalue()
        keep("hosts", key, content, most=20)
    stored = np.load(io.BytesIO(content))
    return Motion(stored["time"], stored["velocity"], stored["tire_force"])


def solve(seconds: float, step: float = 0.25e-3) -> Motion:
    """Integrate car and shocks as one system, with a Runge-Kutta method of fourth order.

    The state is (q, q', F_lag); the shocks are F = alpha F_lag + (1 - alpha) F_s, tau F_lag' = F_s(v) - F_lag.
    """
    law, own = read_shock(SHOCK).law, car()
    inverse = 1.0 / np.diag(own.M)

    def slope(time: float, state: Any) -> Any:
        velocity = own.S @ state[7:14]
        static = np.array([law.static_force(one) for one in velocity.tolist()])
        weight = np.array([law.lag_weight(one) for one in static.tolist()])
        force = static + weight * (state[14:] - static)
        pull = own.load(time) - own.K @ state[:7] - own.S.T @ force
        return np.concatenate([state[7:14], inverse * pull, (static - state[14:]) / law.time_constant])

    state = np.concatenate([own.equilibrium(), np.zeros(11)])
    count, every = round(seconds / step), round(GRID / step)
    rows = [state]
    for k in range(count):
        state = runge_kutta(slope, k * step, state, step)
        if (k + 1) % every == 0:
            rows.append(state)
    return motion(own, np.arange(len(rows)) * GRID, np.array(rows))


def runge_kutta(slope: Callable[[float, Any], Any], time: float, state: Any, step: float) -> Any:
    """Return the state after one classical Runge-Kutta step of fourth order."""
    half = 0.5 * step
    a = slope(time, state)
    b = slope(time + half, state + half * a)
    c = slope(time + half, state + half * b)
    d = slope(time + step, state + step * c)
    return state + step / 6.0 * (a + 2.0 * (b + c) + d)


def motion(own: Car, time: Any, states: Any) -> Motion:
    """Return the motion from states (K, 14 or more) at times (K,): q, q', and anything else."""
    tires = np.array([own.tire_force(t, row[:7]) for t, row in zip(time.tolist(), states, strict=True)])
    return Motion(time, own.S @ states[:, 7:14].T, tires.T)


# ---- Errors, and the program around a host --------------------------------------------------------------------------


def errors(found: Motion, seconds: float) -> tuple[float, float]:
    """Return the errors of shock velocity and tire force, % of the exact signal's standard deviation, worst corner.

    Args:
        found: Motion at any multiples of GRID; it need not be complete.
        seconds: Duration of the run [s].
    """
    exact = reference(seconds) if found.exact is None else found.exact
    places = np.rint(np.asarray(found.time) / GRID).astype(int)
    on_grid = (np.abs(found.time - places * GRID) < 1e-7) & (places < len(exact.time))
    kept = on_grid & (np.asarray(found.time) >= min(SETTLING, 0.5 * seconds))
    if kept.sum() < 10:
        raise ValueError(f"only {kept.sum()} points of the run are multiples of {GRID} s; record every step")
    pairs = ((found.velocity, exact.velocity), (found.tire_force, exact.tire_force))
    worst = []
    for ours, rows in pairs:
        true = rows[:, places[kept]]
        with np.errstate(all="ignore"):
            missed = np.sqrt(np.mean((np.asarray(ours)[:, kept] - true) ** 2, axis=1)) / np.std(true, axis=1)
        percent = 100.0 * float(np.max(missed))
        worst.append(percent if percent < DIVERGED else float("inf"))
    return (float("inf"),) * 2 if max(worst) == float("inf") else (worst[0], worst[1])


@dataclass(frozen=True)
class Case:
    """One run that a host must make.

    Attributes:
        step: Size of the step [s].
        seconds: Duration [s].
        shock: Shock FMU for all corners.
        car_fmu: FMU of the car, for hosts that couple FMUs only.
    """

    step: float
    seconds: float
    shock: Path
    car_fmu: Path

    @property
    def count(self) -> int:
        """Number of steps."""
        return round(self.seconds / self.step)


@dataclass(frozen=True)
class Row:
    """Result of one loop at one step: errors [%], and processor time per step of the host [us]."""

    host: str
    loop: str
    step: float
    velocity: float
    tire_force: float
    microseconds: float


#: A way to couple: it runs one case and returns the motion.
Loop = Callable[[Case], Motion]


def measure(host: str, loops: Mapping[str, Loop], steps: Any, seconds: float, folder: Path) -> list[Row]:
    """Run every loop at every step with the FMUs in a folder, and return the errors."""
    rows = []
    for name, loop in loops.items():
        loop(Case(steps[-1], 2.0 * steps[-1], folder / "shock.fmu", folder / "car.fmu"))  # compiles and loads
        for step in steps:
            case = Case(step, seconds, folder / "shock.fmu", folder / "car.fmu")
            began = clock.process_time()
            try:
                found = loop(case)
            except (ArithmeticError, EightpostError, np.linalg.LinAlgError):  # it diverged
                found = None
            cost = 1e6 * (clock.process_time() - began) / case.count
            worst = (float("inf"), float("inf")) if found is None else errors(found, seconds)
            own = None if found is None else found.microseconds
            rows.append(Row(host, name, step, *worst, cost if own is None else own))
    return rows


def table(rows: list[Row]) -> str:
    """Return one line for each loop and step."""
    lines = [f"{rows[0].host}: errors at the worst corner, % of the standard deviation"]
    lines.append(f"{'loop':24} {'step [ms]':>9} {'shock velocity':>15} {'tire force':>11} {'us per step':>12}")
    for row in rows:
        cells = [f"{x:.3g}" if np.isfinite(x) else "diverges" for x in (row.velocity, row.tire_force)]
        lines.append(f"{row.loop:24} {1e3 * row.step:9g} {cells[0]:>15} {cells[1]:>11} {row.microseconds:12.3g}")
    return "\n".join(lines)


def main(host: str, loops: Mapping[str, Loop], *, package: str = "", sources: Sequence[str] = ()) -> None:
    """Run a host program: parse the options, run every loop at every step, print the table.

    Args:
        host: Name of the host, with its integrator.
        loops: Functions that run one case, by the name of the loop: A, B, C, J (Jacobi) or anything else.
        package: Package of the host, whose version is recorded.
        sources: Further files of the program in this folder, whose lines count.
    """
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("--steps", type=float, nargs="+", default=[1e3 * step for step in STEPS], help="steps [ms]")
    parser.add_argument("--seconds", type=float, default=10.0, help="duration of each run [s]; default 10")
    parser.add_argument(
        "--loops", nargs="+", choices=list(loops), default=list(loops), help="loops to run; default all"
    )
    parser.add_argument("--json", type=Path, help="file for the results")
    options = parser.parse_args()
    chosen = {name: loops[name] for name in options.loops}
    with tempfile.TemporaryDirectory() as folder:
        build([CAR, SHOCK], folder)
        rows = measure(host, chosen, [1e-3 * step for step in options.steps], options.seconds, Path(folder))
    print(table(rows))
    if options.json:
        program = Path(sys.modules["__main__"].__file__ or "")
        record = {"host": host, "package": package, "version": _version(package), "program": program.name}
        lines = sum(_lines(path) for path in (program, *(HERE / name for name in sources)))
        record |= {"lines": lines, "seconds": options.seconds, "rows": [_finite(row) for row in rows]}
        options.json.write_text(json.dumps(record, indent=1) + "\n")


def _finite(row: Row) -> dict[str, Any]:
    """Return the entries of a row; an infinite error is null in JSON."""
    return {key: None if value == float("inf") else value for key, value in asdict(row).items()}


def _version(package: str) -> str:
    try:
        return version(package) if package else ""
    except PackageNotFoundError:
        return ""


def _lines(program: Path) -> int:
    """Return the number of lines of a program that are not empty."""
    lines = program.read_text(encoding="utf-8").splitlines() if program.is_file() else []
    return sum(bool(line.strip()) for line in lines)
