"""Parts of the main piston and of the head valve."""

from __future__ import annotations

from dataclasses import dataclass, field

from eightpost.errors import ParameterError
from eightpost.rig.damper.shims import ShimStack


@dataclass(frozen=True, slots=True)
class ShimValve:
    """A shim stack over ports, for one flow direction.

    Attributes:
        stack: Shim stack.
        port_area: Total area of the ports under the stack [m2].
        edge: Length of the edge under which the fluid leaves [m].
        dish: Deflection of the clamped shims by the dished face of the piston [m]: 0 on a linear piston; 1 to 4 degrees
            of dish on a digressive piston are 0.1 to 0.6 mm.
    """

    stack: ShimStack
    port_area: float
    edge: float
    dish: float = 0.0

    @property
    def preload(self) -> float:
        """Mean pressure at which the edge opens [Pa]."""
        return self.dish / self.stack.lift


@dataclass(frozen=True, slots=True)
class Bleed:
    """Rebound bleed through the rod with an adjuster, open in rebound and closed in compression (3.4.3).

    Clicks are counted from fully open. The dissertation must use the same convention: section 3.4.1 reports that the
    error of builds 1 and 2 increased with a more restrictive bleed setting, and in Table 3.5 it increases from 1 to 14
    clicks.

    Attributes:
        clicks: Clicks of the adjuster from fully open.
        area_per_click: Area that a click closes [m2].
        most: Number of clicks from fully open to closed.
    """

    clicks: int
    area_per_click: float
    most: int = 28

    def __post_init__(self) -> None:
        if not 0 <= self.clicks <= self.most:
            raise ParameterError(f"the clicks of the bleed adjuster must be 0 to {self.most}, not {self.clicks}")

    @property
    def area(self) -> float:
        """Open area [m2]."""
        return (self.most - self.clicks) * self.area_per_click


@dataclass(frozen=True, slots=True)
class MainPiston:
    """Valves between the compression and the rebound chamber.

    Attributes:
        compression: Valve for flow from the compression chamber to the rebound chamber.
        rebound: Valve for flow from the rebound chamber to the compression chamber.
        bleed: Bleed in parallel with the rebound stack.
        jet_area: Area of the bleed jet and the leakage past the piston, in both directions [m2].
    """

    compression: ShimValve
    rebound: ShimValve
    bleed: Bleed
    jet_area: float


@dataclass(frozen=True, slots=True)
class HeadValve:
    """Valve between compression chamber and reservoir.

    Attributes:
        compression: Valve for flow into the reservoir.
        jet_area: Area of the jet, which is open in both directions [m2].
        return_area: Area of the check valve for flow out of the reservoir [m2].
    """

    compression: ShimValve
    jet_area: float
    return_area: float


@dataclass(frozen=True, slots=True)
class Orifices:
    """Common properties of all orifices.

    Attributes:
        discharge: Discharge coefficient C_d [1]; 0.6 to 0.8 (Dixon, The Shock Absorber Handbook, 2007, ch. 5).
        transition: Pressure drop of the transition from laminar to turbulent flow [Pa]; Reynolds numbers near 1000 in
            openings of a millimetre give 10 to 100 kPa.
    """

    discharge: float = 0.7
    transition: float = field(default=20e3)
