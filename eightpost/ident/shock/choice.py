"""Choice of a law's dynamics for the fit: a closed form where one exists, else the law file's functions, stepped."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.ident.shock.closed import FadingLag, FullLag, NoLag
from eightpost.shock import Lpf1, Lpnl2, Maxwell, Polylinear

if TYPE_CHECKING:
    from eightpost.ident.shock.force import Dynamics, Limits
    from eightpost.shock import ShockLaw


def dynamics_for(law: type[ShockLaw], limits: Limits) -> Dynamics:
    """Return the dynamics of a law."""
    if law is Polylinear:
        return NoLag(limits)
    if law is Lpf1:
        return FullLag(limits)
    if law is Lpnl2:
        return FadingLag(limits)
    # The compiler takes a second to load.
    from eightpost.ident.shock.stepped import SeriesSpring, SteppedLaw  # noqa: PLC0415

    return SeriesSpring(limits, law) if law is Maxwell else SteppedLaw(limits, law)
