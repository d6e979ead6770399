"""Newton's law of the whole car: tire forces minus aeroloader forces against all accelerations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.comparison import Comparison, delay, ratio
from eightpost.ident.preparation.plausibility.laws.pairs import AXLES
from eightpost.ident.preparation.plausibility.regression import Regression, regress
from eightpost.ident.preparation.plausibility.spectra import Spectra, Spectrum

LAW = "Newton's law of the car"

#: Upper end of the band [Hz]: engine and chassis bending follow the corners of the chassis below it.
HIGH = 8.0
#: Tolerance of the ratio of left and right tire forces, and of aeroloader and tire forces [1].
LEFT_RIGHT, AERO = 0.08, 0.1
#: Tolerance of the delay between left and right tire forces, and of aeroloader forces [s].
LEFT_RIGHT_TIME, AERO_TIME = 1.5e-3, 2e-3
#: Usual mass of a car [kg] and its tolerance as a logarithm: 300 to 3600 kg.
MASS, MASS_RANGE = 1040.0, float(np.log(3.5))
#: Tolerance of the mass if it is given [1].
GIVEN_MASS_RANGE = 0.1


class _Terms:
    """Regressors with their names."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.rows: list[Spectrum] = []

    def add(self, name: str, row: Spectrum) -> None:
        self.names.append(name)
        self.rows.append(row)

    def place(self, name: str) -> int:
        return self.names.index(name)


def newton_comparisons(spectra: Spectra, corners: Sequence[str], mass: float | None) -> Iterator[Comparison]:
    """Yield the comparisons of forces with each other and with accelerations.

        sum T + sum_axles d (T_l - T_r) = sum_j a_j (A_j + t_j A_j') + sum_axles m(s) (z_l'' + z_r'') + ...

    T are the tire forces, A_j the aeroloader forces, d is 0 and a_j is 1. The masses are unknown. The inertia of the
    chassis at an axle is m + c s + e s^2, because the engine on its mounts and a chassis that bends do not follow the
    corners exactly.
    """
    forces = [channel(corner, "tire_force") for corner in corners]
    hubs, bodies = (
        [channel(corner, name) for corner in corners] for name in ("hub_acceleration", "chassis_acceleration")
    )
    if not spectra.has((*forces, *hubs, *bodies)) or _is_load_unknown(spectra, corners):
        return
    loads = _loads(spectra, corners)
    terms = _terms(spectra, corners, loads)
    total = sum((spectra.derivative(name) for name in forces), start=np.zeros_like(spectra.rows[forces[0]]))
    fit = regress(total, terms.rows, spectra.frequencies <= HIGH)
    if fit is None:
        return
    yield from _left_right(fit, terms, corners)
    yield from _aero(fit, terms, loads, forces)
    yield _mass(fit, terms, forces, (*hubs, *bodies), mass)


def _loads(spectra: Spectra, corners: Sequence[str]) -> dict[str, float]:
    """Return the sign in the balance of each load on the chassis."""
    down = [name for name in (*(channel(corner, "aero") for corner in corners), "aero_force") if name in spectra]
    return dict.fromkeys(down, 1.0) | ({"heave_force": -1.0} if "heave_force" in spectra else {})


def _is_load_unknown(spectra: Spectra, corners: Sequence[str]) -> bool:
    """Return whether a load on the chassis has no usable channel, although there is one or a command of it."""
    names = [*(channel(corner, "aero") for corner in corners), "aero_force", "heave_force"]
    return any(name in spectra.left_out or (f"{name}_command" in spectra and name not in spectra) for name in names)


def _terms(spectra: Spectra, corners: Sequence[str], loads: dict[str, float]) -> _Terms:
    terms = _Terms()
    for axle in AXLES if len(corners) > 1 else ():
        left, right = (channel(corner, "tire_force") for corner in axle)
        for order in (0, 1):
            pair = spectra.derivative(left, order) - spectra.derivative(right, order)
            terms.add(f"{left}'" if order else left, pair)
    for load in loads:
        for order in (0, 1):
            terms.add(f"{load}'" if order else load, spectra.derivative(load, order))
    for place in AXLES if len(corners) > 1 else (tuple(corners),):
        terms.add(f"{place[0]} hub", _sum(spectra, place, "hub_acceleration"))
        for order, primes in enumerate(("", "'", "''")):
            terms.add(f"{place[0]} chassis{primes}", _sum(spectra, place, "chassis_acceleration", order))
    return terms


def _sum(spectra: Spectra, corners: Sequence[str], quantity: str, order: int = 0) -> Spectrum:
    rows = [spectra.derivative(channel(corner, quantity), order) for corner in corners]
    return np.asarray(np.sum(rows, axis=0))


def _left_right(fit: Regression, terms: _Terms, corners: Sequence[str]) -> Iterator[Comparison]:
    for axle in AXLES if len(corners) > 1 else ():
        left, right = (channel(corner, "tire_force") for corner in axle)
        at, slope = terms.place(left), terms.place(f"{left}'")
        # The total is sum T = -d (T_l - T_r) + ..., so the left force counts 1 + d and the right one 1 - d.
        effect = {left: 1.0, right: -1.0}
        yield ratio(LAW, fit, lambda c, k=at: (1.0 + c[:, k]) / np.maximum(1.0 - c[:, k], 1e-3), effect=effect,  # type: ignore[misc]
                    tolerance=LEFT_RIGHT)  # fmt: skip
        yield delay(LAW, fit, lambda c, k=slope: -2.0 * c[:, k], effect=effect, tolerance=LEFT_RIGHT_TIME)  # type: ignore[misc]


def _aero(fit: Regression, terms: _Terms, loads: dict[str, float], forces: Sequence[str]) -> Iterator[Comparison]:
    share = {name: 1.0 / len(forces) for name in forces}
    for load, sign in loads.items():
        at = terms.place(load)
        yield ratio(LAW, fit, lambda c, k=at, s=sign: s * c[:, k], effect={load: -1.0, **share}, tolerance=AERO)  # type: ignore[misc]
        less = {name: -part for name, part in share.items()}
        yield delay(LAW, fit, lambda c, k=at: c[:, k + 1] / c[:, k], effect={load: 1.0, **less},  # type: ignore[misc]
                    tolerance=AERO_TIME, over=(at,))  # fmt: skip


def _mass(
    fit: Regression, terms: _Terms, forces: Sequence[str], accelerometers: Sequence[str], mass: float | None
) -> Comparison:
    """Return the comparison of the mass with the given one, or with those of usual cars."""
    places = [k for k, name in enumerate(terms.names) if name.endswith((" hub", " chassis"))]
    sides = 2.0 if len(forces) > 1 else 1.0
    effect = {name: 1.0 / len(forces) for name in forces} | {n: -1.0 / len(accelerometers) for n in accelerometers}
    law = f"{LAW} of {mass:.4g} kg" if mass else "the usual mass of a car"
    return ratio(law, fit, lambda c: sides * c[:, places].sum(axis=1), effect=effect, expected=mass or MASS,
                 tolerance=GIVEN_MASS_RANGE if mass else MASS_RANGE)  # fmt: skip
