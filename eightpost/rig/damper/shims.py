"""Shim stacks, by their codes in Table 7.2."""

from __future__ import annotations

from dataclasses import dataclass

from eightpost.errors import ParameterError
from eightpost.units import convert

#: Table 7.2: thicknesses of the four shims of each code [in].
SHIM_SETS = {
    "AA": (0.004, 0.004, 0.004, 0.004),
    "AA+": (0.004, 0.004, 0.006, 0.006),
    "A-": (0.006, 0.006, 0.004, 0.004),
    "A": (0.006, 0.006, 0.006, 0.006),
    "A+": (0.006, 0.006, 0.008, 0.008),
    "B-": (0.008, 0.008, 0.006, 0.006),
    "B": (0.008, 0.008, 0.008, 0.008),
    "B+": (0.008, 0.008, 0.010, 0.010),
    "C-": (0.010, 0.010, 0.008, 0.008),
    "C": (0.010, 0.010, 0.010, 0.010),
    "C+": (0.010, 0.010, 0.012, 0.012),
    "D-": (0.012, 0.012, 0.010, 0.010),
    "D": (0.012, 0.012, 0.012, 0.012),
    "D+": (0.012, 0.012, 0.015, 0.015),
    "E-": (0.015, 0.015, 0.012, 0.012),
    "E": (0.015, 0.015, 0.015, 0.015),
    "E+": (0.015, 0.015, 0.020, 0.020),
    "F-": (0.020, 0.020, 0.015, 0.015),
    "F": (0.020, 0.020, 0.020, 0.020),
}

#: E / (1 - nu^2) of spring steel [Pa].
PLATE_MODULUS = 206e9 / (1.0 - 0.29**2)


@dataclass(frozen=True, slots=True)
class ShimStack:
    """A stack of four shims over a ring of ports.

    The shims slide on each other, so their plate stiffnesses D = E t^3 / (12 (1 - nu^2)) add up (Farjoud, Ahmadian,
    Craft & Burke, Nonlinear modeling and experimental characterization of hydraulic dampers: effects of shim stack
    and orifice parameters on damper performance, Nonlinear Dynamics 67, 2012). The lift of the edge is

        h = K dp r^4 / D_stack

    Attributes:
        code: Code in Table 7.2.
        radius: Radius r of the largest shim [m].
        deflection: Coefficient K of a plate clamped inside, free outside and uniformly loaded [1]: 0.018, 0.0035, 0.001
            for a clamp of 0.4, 0.6, 0.7 of the radius (thin-plate theory, tabulated in Roark's Formulas for Stress and
            Strain).
        backing: Thickness of the washer behind every stack, which bends with the stack [m].

    Raises:
        ParameterError: The code does not exist.
    """

    code: str
    radius: float = convert(0.65, "in", "m")
    deflection: float = 0.00254
    backing: float = convert(0.0045, "in", "m")

    def __post_init__(self) -> None:
        if self.code not in SHIM_SETS:
            raise ParameterError(f"there is no shim stack {self.code!r} in Table 7.2; codes: {', '.join(SHIM_SETS)}")

    @property
    def stiffness(self) -> float:
        """Stiffness D_stack, the sum of E t^3 / (12 (1 - nu^2)) over shims and backing [N.m]."""
        cubes = sum(convert(thickness, "in", "m") ** 3 for thickness in SHIM_SETS[self.code])
        return PLATE_MODULUS * (cubes + self.backing**3) / 12.0

    @property
    def lift(self) -> float:
        """Lift per pressure drop h / dp [m/Pa]."""
        return self.deflection * self.radius**4 / self.stiffness
