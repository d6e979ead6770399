"""Whether an identified car stays stable however its shocks are swapped.

A shock whose slope dF/dv lies between c_low and c_high everywhere cannot make the loop unstable where, with dampers of
c_low at all ports and M the port mobility (velocity per force against it),

    M(j w) + M(j w)* + 2 / (c_high - c_low)  is positive definite at every frequency, and M itself is stable

the circle criterion. It covers any curve within the slopes and any mix of shocks, so it asks for more than that some
linear dampers are stable.

Source: H. K. Khalil, "Nonlinear Systems", 3rd ed., 2002, section 7.1 (multivariable circle criterion).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.ident.vehicle.experiment import channel
from eightpost.vehicle import add_port_damping

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eightpost.vehicle import StateSpace

    Array = NDArray[np.float64]

#: Softest slopes that are tried, and the stiffest, as parts of the baseline's dampers.
SOFTEST, STIFFEST = (0.0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5), 10.0

#: Where the criterion is looked at [Hz].
_FREQUENCIES = np.geomspace(0.01, 2000.0, 700)


class Swapping(NamedTuple):
    """What came out.

    Attributes:
        softest: The softest slope that is safe, as a part of the baseline's damper [1]; None where none of those tried.
        stiffest: The stiffest, alike [1].
        worst: Where the criterion is nearest to failing at that slope, or fails for the last one tried [Hz].
    """

    softest: float | None
    stiffest: float
    worst: float

    def said(self) -> str:
        """Return it as a sentence."""
        if self.softest is None:
            return (
                f"Stability with any shocks is not proved: the circle criterion fails near {self.worst:.3g} Hz even "
                f"for slopes from {SOFTEST[-1]:g} to {self.stiffest:g} times the baseline dampers; try every bank "
                "at its softest and stiffest slopes."
            )
        return (
            f"Any shocks whose slopes lie from {self.softest:g} to {self.stiffest:g} times the baseline dampers keep "
            f"the car stable (circle criterion, nearest to failing at {self.worst:.3g} Hz)."
        )


def swapping(model: StateSpace, baseline: Mapping[str, float]) -> Swapping:
    """Return the slopes between which shocks may be swapped.

    Args:
        model: As identified, around the baseline damping.
        baseline: C-bar [N.s/m] by port.
    """
    ports = model.select(
        inputs=[channel(port, "force") for port in baseline], outputs=[channel(port, "velocity") for port in baseline]
    )
    worst = 0.0
    for softest in SOFTEST:
        safe, worst = _criterion(ports, baseline, softest)
        if safe:
            return Swapping(softest, STIFFEST, worst)
    return Swapping(None, STIFFEST, worst)


def _criterion(ports: StateSpace, baseline: Mapping[str, float], softest: float) -> tuple[bool, float]:
    """Say whether the criterion holds, and where it is nearest to failing [Hz]."""
    soft = add_port_damping(ports, {port: (softest - 1.0) * rate for port, rate in baseline.items()})
    poles = soft.poles()
    if (poles.real >= 0.0).any():
        return False, float(np.abs(poles[np.argmax(poles.real)]) / (2.0 * np.pi))
    rates = np.sqrt(np.array(list(baseline.values())))
    # Mobilities times dampers have no unit: 1 is a port that moves as its damper lets it.
    M = -soft.frequency_response(_FREQUENCIES).transpose(2, 0, 1) * np.outer(rates, rates)
    slack = 2.0 / (STIFFEST - softest) * np.eye(rates.size)
    smallest = np.linalg.eigvalsh(M + M.conj().transpose(0, 2, 1) + slack)[:, 0]
    return bool(smallest.min() > 0.0), float(_FREQUENCIES[np.argmin(smallest)])
