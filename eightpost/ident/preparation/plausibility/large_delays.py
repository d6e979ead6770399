"""Delays of potentiometers and velocities that a linearised law does not describe: they explain little without them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.attribution import Fault
from eightpost.ident.preparation.plausibility.comparison import SIGNIFICANT, Kind
from eightpost.ident.preparation.plausibility.laws.pairs import across
from eightpost.ident.preparation.plausibility.laws.tire import tire_fit
from eightpost.ident.preparation.plausibility.laws.travel import LAW, SAME_TIME, SLOPE
from eightpost.ident.preparation.plausibility.regression import Regression, regress
from eightpost.ident.preparation.plausibility.spectra import DIRECTION, TWIST_DIRECTION, Spectra

#: Explained share of the variance [1] below which a delay is searched; sound channels have more than 0.99.
POOR = 0.85
#: Explained share [1] that a delay must reach, and that the tire's law must have: the hub's accelerometer is in step.
GOOD, IN_STEP = 0.9, 0.95
#: Smallest delay that is large, largest one that is searched, and distance of the delays that are tried [s].
SHORTEST, LONGEST, STEP = 10e-3, 0.1, 2e-3


def large_delays(spectra: Spectra, corners: Sequence[str]) -> tuple[Fault, ...]:
    """Return the potentiometers, and velocities against their potentiometers, that are in step with a large delay.

    A delay of 30 ms turns the phase by half a turn at 15 Hz: the linear term of a delay does not describe it, and the
    search for the channel that explains the laws would name others.

    Args:
        spectra: Spectra of a broadband record.
        corners: Names of its corners.
    """
    found: list[Fault] = []
    for corner in corners:
        velocity = channel(corner, "velocity")
        shares = [_share(law, spectra, corner) for law in (_travel, _slope)]
        if all(share is None or share > POOR for share in shares):
            continue
        tire = tire_fit(spectra, corner)
        own = []
        if tire is not None and tire.explained > IN_STEP:
            own = _searched(spectra, corner, channel(corner, "displacement"), _travel, LAW)
        found += [*own, *_searched(without_delays(spectra, own), corner, velocity, _slope, SLOPE)]
    return tuple(found)


def without_delays(spectra: Spectra, faults: Sequence[Fault]) -> Spectra:
    """Return the spectra with late channels advanced, and the directions that follow from late velocities."""
    for fault in faults:
        directions = [f"{fault.name.removesuffix('velocity')}{DIRECTION}"] if fault.name.endswith("velocity") else []
        spectra = spectra.corrected([*fault.channels, *directions], delay=fault.value)
        if directions:  # the difference of two velocities, one of them late, is no direction of a bar
            spectra = spectra.without([name for name in spectra.rows if name.endswith(TWIST_DIRECTION)])
    return spectra


#: A regression of a channel of a corner without delays, None if a channel is missing.
_Law = Callable[[Spectra, str], Regression | None]


def _travel(spectra: Spectra, corner: str) -> Regression | None:
    """Return the travel of the shock from the accelerations of its hub and chassis, and from those across the axle."""
    pot, accelerometers = channel(corner, "displacement"), ("hub_acceleration", "chassis_acceleration")
    sides = [side for side in (corner, across(corner)) if side is not None]
    names = [channel(side, name) for side in sides for name in accelerometers]
    known = [name for name in names if name in spectra]
    if pot not in spectra or not known:
        return None
    return regress(spectra.derivative(pot, 2), [spectra.derivative(name) for name in known])


def _slope(spectra: Spectra, corner: str) -> Regression | None:
    """Return the velocity from the slope of the displacement."""
    pot, velocity = channel(corner, "displacement"), channel(corner, "velocity")
    if not spectra.has((pot, velocity)):
        return None
    return regress(spectra.derivative(velocity), [spectra.derivative(pot, 1)])


def _share(law: _Law, spectra: Spectra, corner: str) -> float | None:
    """Return the explained share of a law, 0 if its first coefficient is negative; None without its channels."""
    fit = law(spectra, corner)
    if fit is None:
        return None
    return fit.explained if fit.values[0] > 0.0 else 0.0


def _searched(spectra: Spectra, corner: str, name: str, law: _Law, text: str) -> list[Fault]:
    """Return the delay of a channel with which a law explains most, if it is large."""
    if _share(law, spectra, corner) is None:
        return []
    delays = STEP * np.arange(-round(LONGEST / STEP), round(LONGEST / STEP) + 1)
    shares = [_share(law, spectra.corrected([name], delay=float(delay)), corner) or 0.0 for delay in delays]
    best = int(np.argmax(shares))
    if shares[best] < GOOD or not 0 < best < delays.size - 1:
        return []
    before, top, after = shares[best - 1 : best + 2]
    delay = float(delays[best] + 0.5 * STEP * (before - after) / (before - 2.0 * top + after))
    if abs(delay) < SHORTEST:
        return []
    return [Fault(Kind.DELAY, name, (name,), delay, SAME_TIME / SIGNIFICANT, text)]
