"""Range of shock slopes for which an identified car is proved stable (circle criterion).

Let M be the port mobility (velocity per opposing force) with dampers of c_low at all ports. A shock whose slope dF/dv
is everywhere between c_low and c_high cannot make the loop unstable if

    M(j w) + M(j w)* + 2 / (c_high - c_low)  is positive definite at every frequency, and M itself is stable

This circle criterion covers any curve with slopes in the range and any mix of shocks, so it is stricter than stability
with some linear dampers.

Source: H. K. Khalil, "Nonlinear Systems", 3rd ed., 2002, section 7.1 (multivariable circle criterion).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.ident.vehicle.experiment import channel
from eightpost.vehicle import add_port_damping

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eightpost.vehicle import StateSpace


#: Lower slopes that are tested, and the upper slope, relative to the baseline dampers [1].
SOFTEST, STIFFEST = (0.0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5), 10.0

#: Frequencies at which the criterion is evaluated [Hz].
_FREQUENCIES = np.geomspace(0.01, 2000.0, 700)


class SafeSlopes(NamedTuple):
    """Range of shock slopes with proved stability.

    Attributes:
        softest: Lowest safe slope relative to the baseline damper [1]; None if no tested slope is safe.
        stiffest: Highest safe slope relative to the baseline damper [1].
        worst: Frequency at which the criterion is closest to failing, or fails for the last tested slope [Hz].
    """

    softest: float | None
    stiffest: float
    worst: float

    def summary(self) -> str:
        """Return the result as a sentence."""
        if self.softest is None:
            return (
                f"Stability with any shocks is not proved: the circle criterion fails near {self.worst:.3g} Hz even "
                f"for slopes from {SOFTEST[-1]:g} to {self.stiffest:g} times the baseline dampers; simulate every "
                "bank at its lowest and highest slopes."
            )
        return (
            f"The car is stable with any shocks whose slopes are from {self.softest:g} to {self.stiffest:g} times the "
            f"baseline dampers (circle criterion, closest to failing at {self.worst:.3g} Hz)."
        )


def safe_slopes(model: StateSpace, baseline: Mapping[str, float]) -> SafeSlopes:
    """Return the range of shock slopes with which the car is proved stable.

    Args:
        model: Identified model around the baseline damping.
        baseline: Baseline damping C-bar [N.s/m] by port.
    """
    ports = model.select(
        inputs=[channel(port, "force") for port in baseline], outputs=[channel(port, "velocity") for port in baseline]
    )
    worst = 0.0
    for softest in SOFTEST:
        safe, worst = _criterion(ports, baseline, softest)
        if safe:
            return SafeSlopes(softest, STIFFEST, worst)
    return SafeSlopes(None, STIFFEST, worst)


def _criterion(ports: StateSpace, baseline: Mapping[str, float], softest: float) -> tuple[bool, float]:
    """Return whether the criterion is satisfied, and the frequency at which it is closest to failing [Hz]."""
    soft = add_port_damping(ports, {port: (softest - 1.0) * rate for port, rate in baseline.items()})
    poles = soft.poles()
    if (poles.real >= 0.0).any():
        return False, float(np.abs(poles[np.argmax(poles.real)]) / (2.0 * np.pi))
    rates = np.sqrt(np.array(list(baseline.values())))
    # Mobility times damping is dimensionless; 1 is a port whose motion only its damper resists.
    M = -soft.frequency_response(_FREQUENCIES).transpose(2, 0, 1) * np.outer(rates, rates)
    slack = 2.0 / (STIFFEST - softest) * np.eye(rates.size)
    smallest = np.linalg.eigvalsh(M + M.conj().transpose(0, 2, 1) + slack)[:, 0]
    return bool(smallest.min() > 0.0), float(_FREQUENCIES[np.argmin(smallest)])
