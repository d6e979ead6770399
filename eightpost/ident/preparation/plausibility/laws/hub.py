"""Balance of forces at a hub: tire force against shock, springs, friction and inertia."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.comparison import Comparison, Kind, delay, ratio
from eightpost.ident.preparation.plausibility.laws.pairs import AXLES, across, axles, difference
from eightpost.ident.preparation.plausibility.laws.travel import travel_fit
from eightpost.ident.preparation.plausibility.regression import Regression, regress
from eightpost.ident.preparation.plausibility.spectra import DIRECTION, TWIST_DIRECTION, Spectra

LAW = "the balance of forces at the hub"

#: Tolerance of the motion ratio from forces over that from motions [1]: friction elsewhere than along the shock adds up
#: to 0.11 of it; and of left and right [1].
VIRTUAL_WORK, SYMMETRIC = 0.2, 0.1
#: Usual delay of the shock force and its tolerance [s]: friction that sticks looks like a lead of up to 1 ms.
LEAD, TIME = -0.5e-3, 2.5e-3


def hub_fit(spectra: Spectra, corner: str) -> Regression | None:
    """Return the coefficients of the tire force.

        T = n (F + t F') + n_o (F_o + t F_o') + m w'' + m_o w_o'' + k x + k_o x_o + f sign(v) + f_b sign(v_l - v_r)

    T is the tire force, F the shock force, w'' the hub's acceleration, x the travel and v the velocity of the shock;
    `o` is the other side of the axle. By virtual work, n is the motion ratio. f is friction along the shock, f_b
    that in the anti-roll bar; without f_b, a soft shock's n would be up to 0.3 too large.
    """
    first = [(channel(corner, "force"), 0), (channel(corner, "force"), 1)]
    rest = [(channel(corner, name), 0) for name in ("hub_acceleration", "displacement", DIRECTION)]
    tire = channel(corner, "tire_force")
    if not spectra.has((tire, *(name for name, _ in (*first, *rest)))):
        return None
    other = across(corner)
    if other is not None:
        more = ("force", "hub_acceleration", "displacement")
        far = [(channel(other, name), order) for name in more for order in ((0, 1) if name == "force" else (0,))]
        bar = next(channel(axle[0], TWIST_DIRECTION) for axle in AXLES if corner in axle)
        rest += [entry for entry in (*far, (bar, 0)) if entry[0] in spectra]
    return regress(spectra.derivative(tire), [spectra.derivative(*entry) for entry in (*first, *rest)])


def hub_comparisons(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of each shock's force with the tire force and the motion ratio."""
    works = {}
    for corner in corners:
        force, tire = channel(corner, "force"), channel(corner, "tire_force")
        balance, travel = hub_fit(spectra, corner), travel_fit(spectra, corner)
        if balance is None:
            continue
        if travel is not None:
            works[corner] = _work(corner, balance, travel)
        yield delay(LAW, balance, lambda c: c[:, 1] / c[:, 0], effect={force: 1.0, tire: -1.0}, tolerance=TIME,
                    over=(0,), expected=LEAD)  # fmt: skip
    yield from works.values()
    for left, right in axles(works):
        yield difference(works[left], works[right], SYMMETRIC)


def _work(corner: str, balance: Regression, travel: Regression) -> Comparison:
    force, tire, pot, hub = (channel(corner, n) for n in ("force", "tire_force", "displacement", "hub_acceleration"))
    effect = {force: -1.0, tire: 1.0, pot: -1.0, hub: 1.0}
    from_forces, from_motions = (
        ratio(LAW, fit, lambda c: c[:, 0], effect=effect, tolerance=VIRTUAL_WORK) for fit in (balance, travel)
    )
    deviation = float(np.hypot(from_forces.deviation, from_motions.deviation))
    return Comparison(LAW, Kind.GAIN, from_forces.value - from_motions.value, VIRTUAL_WORK, deviation, effect)
