"""The main piston's and the head valve's parts."""

from __future__ import annotations

from dataclasses import dataclass, field

from eightpost.errors import ParameterError
from eightpost.rig.damper.shims import ShimStack


@dataclass(frozen=True, slots=True)
class ShimValve:
    """A shim stack over ports: one way.

    Attributes:
        stack: The shims.
        port_area: Of the ports under it together [m2].
        edge: Length of the edge that the fluid leaves under [m].
        dish: How far the clamped shims are bent by the piston's dished face [m]: 0 on a linear piston; 1 to 4 degrees
            of dish on a digressive one are 0.1 to 0.6 mm.
    """

    stack: ShimStack
    port_area: float
    edge: float
    dish: float = 0.0

    @property
    def preload(self) -> float:
        """Mean pressure at which the edge leaves its seat [Pa]."""
        return self.dish / self.stack.lift


@dataclass(frozen=True, slots=True)
class Bleed:
    """The rebound bleed through the rod, set by an adjuster: open in rebound, shut in compression (3.4.3).

    Clicks are counted from fully open. So the dissertation's must be: 3.4.1 finds that the error of builds 1 and 2 grew
    with a more restrictive bleed setting, and in Table 3.5 it grows from 1 to 14 clicks.

    Attributes:
        clicks: Of the adjuster, from fully open; more clicks, more closed.
        area_per_click: That a click closes [m2].
        most: Clicks from fully open to shut.
    """

    clicks: int
    area_per_click: float
    most: int = 28

    def __post_init__(self) -> None:
        if not 0 <= self.clicks <= self.most:
            raise ParameterError(f"the bleed adjuster has 0 to {self.most} clicks, not {self.clicks}")

    @property
    def area(self) -> float:
        """What is left open [m2]."""
        return (self.most - self.clicks) * self.area_per_click


@dataclass(frozen=True, slots=True)
class MainPiston:
    """The valves between the chambers.

    Attributes:
        compression: Flow from the compression chamber to the rebound chamber.
        rebound: The way back.
        bleed: Beside the rebound stack.
        jet_area: Of the bleed jet and the leak past the piston, both ways [m2].
    """

    compression: ShimValve
    rebound: ShimValve
    bleed: Bleed
    jet_area: float


@dataclass(frozen=True, slots=True)
class HeadValve:
    """The valve between compression chamber and reservoir.

    Attributes:
        compression: Flow into the reservoir.
        jet_area: Open both ways [m2].
        return_area: Of the check valve back out of the reservoir [m2].
    """

    compression: ShimValve
    jet_area: float
    return_area: float


@dataclass(frozen=True, slots=True)
class Orifices:
    """What all openings share.

    Attributes:
        discharge: C_d [1]; 0.6 to 0.8 (Dixon, The Shock Absorber Handbook, 2007, ch. 5).
        transition: Drop at which flow turns from laminar to turbulent [Pa]; Reynolds numbers near 1000 in openings of
            a millimetre give 10 to 100 kPa.
    """

    discharge: float = 0.7
    transition: float = field(default=20e3)
