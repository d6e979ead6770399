"""Make the static loading of docs/explanation/identification.md (6.4.4): the spring matrix of Eq 6.10 and 6.11.

F_aero = K X_aero + F_zero is fitted to five levels up and down in heave, pitch, roll, warp and of single aeroloaders.
"""

from dataclasses import replace

import numpy as np

from docs.make.identification_pictures import CORNERS, DAMPING, INCH, POUND, figure_of, save
from eightpost.rig.post import NO_DRIFT, LinearDamper, RigSensors, Tires, run_test, stand_in_truth, static_drive
from eightpost.rig.post.car import displacement_modes, force_modes
from eightpost.units import convert

#: Duration of a level [s], of its hold after a ramp of 1 s, and of the end of the hold that is used (6.4.4 uses all).
PERIOD, HOLD, COUNTED = 6.0, 5.0, 2.0
MODES = ("heave", "pitch", "roll", "warp")
KINDS = (*MODES, *(f"{corner}.aero" for corner in CORNERS))
LEVELS = 11
#: Units of Eq 6.11: displacements in inches and degrees, forces in 1000 lbf and 1000 ft.lbf.
SIZES = np.array([INCH, *[np.pi / 180.0] * 3])
FORCES = 1e3 * np.array([POUND, *[convert(1.0, "lbf.ft", "N.m")] * 3])


def main() -> None:
    """Print the matrix and its residual for the car as it is and without its nonlinear effects."""
    car = stand_in_truth()
    straight = replace(car.springs, progression=0.0 * car.springs.progression)
    _report("1000 lbf at each aeroloader", car, most=1000.0)
    _report("the same without tires that lift", _grounded(car), most=1000.0)
    _report("500 lbf", car, shown=True)
    _report("without friction", car.without_friction())
    _report("without noise", car, sensors=RigSensors.perfect())
    _report("without progressive springs", replace(car, springs=straight))
    _report("without bump stops", replace(car, springs=replace(car.springs, stop_rate=0.0 * car.springs.stop_rate)))
    _report("without tires that lift", _grounded(car))
    _report("without any of them", _linear(car), sensors=RigSensors.perfect())
    print("\nlinear truth, from its stiffness matrix:\n", _shown(_analytic(_linear(car))))


def _report(name, car, *, shown=False, **options) -> None:
    x, force, kind = levels(car, **options)
    K, left = fitted(x, force)
    print(f"\n{name}: unexplained of each force's deviation, heave, pitch, roll, warp [%]:", _percent(left, force))
    own = [_percent(left[:, kind == k], force)[m] for m, k in enumerate(MODES)]
    print("  in the tests of each mode alone:", own)
    if shown:
        print(_shown(K))
        _draw(x, force, left, kind)


def levels(car, *, most=500.0, sensors=None):
    """Return means over every level: displacements (4, L) and forces (4, L) of the modes, and the test names (L,)."""
    rows, kind = [], []
    for test in KINDS:
        drive = static_drive(car, test, most=most * POUND)
        record = run_test(car, drive, [LinearDamper(20.74 * DAMPING)] * 4, drift=NO_DRIFT, sensors=sensors).series
        for k in range(LEVELS):
            end = PERIOD * k + HOLD
            held = record.window(end - COUNTED, end)
            rows.append([held[f"{c}.{q}"].mean() for q in ("aero_position", "aero") for c in CORNERS])
            kind.append(test)
    x, force = np.split(np.array(rows).T, 2)
    g = car.geometry
    return displacement_modes(g) @ x, -force_modes(g) @ force, np.array(kind)  # positive up, like the displacements


def fitted(x, force):
    """Return K (4, 4) of Eq 6.10 and the residual forces (4, L)."""
    design = np.vstack([x, np.ones(x.shape[1])])
    factors = np.linalg.lstsq(design.T, force.T, rcond=None)[0].T
    return factors[:, :4], force - factors @ design


def _percent(left, force):
    return [round(float(100.0 * np.sqrt(np.mean(a**2)) / b.std()), 1) for a, b in zip(left, force, strict=True)]


def _shown(K) -> str:
    return np.array2string(K * SIZES / FORCES[:, None], precision=2, suppress_small=True)


def _grounded(car):
    tires = car.tires
    return replace(car, tires=Tires(tires.stiffness, tires.damping, np.full_like(tires.static_load, np.inf)))


def _linear(car):
    springs = replace(car.springs, progression=0.0 * car.springs.progression, stop_rate=0.0 * car.springs.stop_rate)
    return replace(_grounded(car.without_friction()), springs=springs)


def _analytic(car):
    """Return K of the linear car in modes: the inverse of its compliance at the aeroloaders."""
    stiffness = car.stiffness + car.spring.T @ (car.springs.rate * car.spring)
    stiffness = stiffness + car.wheel.T @ (car.tires.stiffness * car.wheel)
    flexibility = car.load @ np.linalg.solve(stiffness, car.load.T)
    g = car.geometry
    return force_modes(g) @ np.linalg.inv(flexibility) @ np.linalg.inv(displacement_modes(g))


def _draw(x, force, left, kind) -> None:
    """Draw Fig 6.32: measured and estimated force of each mode over its displacement in the static test of the mode."""
    figure, grid = figure_of(1, 4, (14.0, 3.4))
    for k, (axes, mode) in enumerate(zip(grid[0], MODES, strict=True)):
        test = kind == mode
        shown, size = x[k, test] / SIZES[k], FORCES[k]
        axes.plot(shown, force[k, test] / size, "o-", color="0.5", label="measured")
        axes.plot(shown, (force - left)[k, test] / size, "s--", color="tab:red", label="Eq 6.10")
        axes.set(
            title=f"static {mode}", xlabel="in" if k == 0 else "deg", ylabel="1000 lbf" if k == 0 else "1000 ft.lbf"
        )
    grid[0, 0].legend()
    save(figure, "eight_post_static")


if __name__ == "__main__":
    main()
