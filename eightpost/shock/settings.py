"""A shock over its adjusters and temperature: the static curve and the law's parameters at any setting.

Standard library only: the FMU contains a copy of this file.

The curve at the reference setting belongs to the shock's law. A setting changes the slopes of the curve at its knots,
the law's positive parameters by a factor, and the gas preload:

    a_k(s) = max(a_k + sum over terms of d_k(s), 0),   p(s) = p exp(sum of d_p(s)),   F_0(s) = F_0 + sum of d_0(s)

The slopes c_k of the lagged part of the law `hysteresis` have deviations of their own, c_k(s) = max(c_k + sum of
d_ck(s), 0), but are never above a_k(s), so the law is passive at every setting. Without such deviations the lagged part
keeps its share of the curve at each knot.

Each term is interpolated in the settings of its adjusters by piecewise cubics, whose tangents at a measured setting are
those of the parabola through it and its neighbours. All slopes at all knots use the same weights, so the curves
themselves are interpolated. No slope becomes negative, so the force rises with velocity at every setting. Beyond
the measured settings, each term continues as a straight line.
"""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, inf, isfinite, prod
from typing import Any

from .curve import KNOTS, StaticCurve
from .law import ShockLaw

TEMPERATURE = "temperature"  #: Name of the axis of the temperature; all others are adjusters.
#: Name of the law's parameter that changes by a slope at each knot instead of by a factor.
LAGGED_SLOPE = "lagged_slope"


def node_weights(nodes: tuple[float, ...], value: float) -> tuple[float, ...]:
    """Return the weights (n,) of the values at n ascending nodes in their interpolant at a value.

    >>> node_weights((0.0, 1.0, 2.0), 1.0)
    (0.0, 1.0, 0.0)
    """
    count = len(nodes)
    weights = [0.0] * count
    if count == 1:
        return (1.0,)
    if value <= nodes[0]:
        weights[0] = 1.0
        _add_tangent(weights, nodes, 0, value - nodes[0])
    elif value >= nodes[-1]:
        weights[-1] = 1.0
        _add_tangent(weights, nodes, count - 1, value - nodes[-1])
    else:
        j = bisect_right(nodes, value) - 1
        width = nodes[j + 1] - nodes[j]
        w = (value - nodes[j]) / width
        weights[j] += (1.0 + 2.0 * w) * (1.0 - w) * (1.0 - w)
        weights[j + 1] += w * w * (3.0 - 2.0 * w)
        _add_tangent(weights, nodes, j, width * w * (1.0 - w) * (1.0 - w))
        _add_tangent(weights, nodes, j + 1, width * w * w * (w - 1.0))
    return tuple(weights)


def _add_tangent(weights: list[float], nodes: tuple[float, ...], j: int, factor: float) -> None:
    """Add the weights of the tangent at a node times a factor: the slope there of a parabola through three nodes."""
    last = len(nodes) - 1
    if last == 1:
        _add_chord(weights, nodes, 0, factor)
    elif j == 0:
        _add_chord(weights, nodes, 0, 2.0 * factor)
        _add_tangent(weights, nodes, 1, -factor)
    elif j == last:
        _add_chord(weights, nodes, last - 1, 2.0 * factor)
        _add_tangent(weights, nodes, last - 1, -factor)
    else:
        before, after = nodes[j] - nodes[j - 1], nodes[j + 1] - nodes[j]
        _add_chord(weights, nodes, j - 1, factor * (after / (before + after)))
        _add_chord(weights, nodes, j, factor * (before / (before + after)))


def _add_chord(weights: list[float], nodes: tuple[float, ...], j: int, factor: float) -> None:
    """Add the weights of the chord's slope from node j to the next one, times a factor."""
    share = factor / (nodes[j + 1] - nodes[j])
    weights[j] -= share
    weights[j + 1] += share


@dataclass(frozen=True, slots=True)
class Axis:
    """An adjuster or the temperature, with its measured settings.

    Raises:
        ValueError: A value is not possible; the message names it.
    """

    name: str  #: Name of the adjuster, or `temperature`.
    nodes: tuple[float, ...]  #: Measured settings (n,), ascending; clicks, `unit`, or temperatures [K].
    reference: float  #: Setting of the shock's own law; one of the nodes.
    unit: str = "click"  #: Unit of the setting: `click`, `K`, or that of the valving.
    counted: str = ""  #: Description of how clicks are counted, such as `from full hard`.
    lowest: float | None = None  #: Lowest possible setting; None: unknown.
    highest: float | None = None  #: Highest possible setting; None: unknown.

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise ValueError(f"settings: an adjuster's name must consist of letters, digits and _, not {self.name!r}")
        if not self.nodes or not all(isfinite(node) for node in self.nodes):
            raise ValueError(f"settings: {self.name}: nodes must be finite numbers, not {self.nodes!r}")
        if not all(low < high for low, high in itertools.pairwise(self.nodes)):
            raise ValueError(f"settings: {self.name}: nodes must be ascending, not {self.nodes!r}")
        if self.reference not in self.nodes:
            raise ValueError(
                f"settings: {self.name}: the reference {self.reference!r} must be one of the nodes {self.nodes!r}"
            )

    @property
    def is_temperature(self) -> bool:
        """Whether the axis is the temperature."""
        return self.name == TEMPERATURE

    @property
    def is_whole(self) -> bool:
        """Whether only whole numbers can be set, as with clicks."""
        return self.unit == "click"

    @property
    def variable(self) -> str:
        """Name of the variable in an FMU."""
        return self.name if self.is_temperature else f"clicks.{self.name}"

    def beyond(self, value: float) -> float:
        """Return the distance of a value from the measured settings; 0 inside."""
        return max(self.nodes[0] - value, value - self.nodes[-1], 0.0)

    def interval(self, value: float) -> int:
        """Return the number of the interval between nodes that contains a value, or of the nearest one."""
        return min(max(bisect_right(self.nodes, value) - 1, 0), max(len(self.nodes) - 2, 0))

    def intervals_beyond(self, value: float) -> float:
        """Return the distance from the measured settings in multiples of the nearest interval between them."""
        distance = self.beyond(value)
        if distance == 0.0 or len(self.nodes) < 2:
            return 0.0 if distance == 0.0 else inf
        j = self.interval(value)
        return distance / (self.nodes[j + 1] - self.nodes[j])

    def neighbours(self, value: float) -> tuple[float, ...]:
        """Return the measured settings next to a value: one at a node or beyond the nodes, else two."""
        if self.beyond(value):
            return (self.nodes[0] if value < self.nodes[0] else self.nodes[-1],)
        if value in self.nodes:
            return (value,)
        j = self.interval(value)
        return self.nodes[j : j + 2]

    def choices(self) -> tuple[float, ...]:
        """Return all possible settings of an adjuster with clicks: within its stops, or else as far as measured."""
        low = self.nodes[0] if self.lowest is None else self.lowest
        high = self.nodes[-1] if self.highest is None else self.highest
        return tuple(float(k) for k in range(round(low), round(high) + 1)) if self.is_whole else self.nodes


@dataclass(frozen=True, slots=True)
class Term:
    """Deviations from the reference that depend on some axes together."""

    axes: tuple[str, ...]  #: Names of the axes.
    #: Row (P,) per combination of the axes' nodes, the last axis varying fastest; P is that of `Settings`.
    deviations: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class Settings:
    """Effect of all adjusters and of the temperature on a shock.

    Raises:
        ValueError: A table has the wrong size, or names an unknown axis.
    """

    axes: tuple[Axis, ...]  #: Adjusters, and the temperature if it was varied.
    #: Names of the law's own parameters that change with the setting, each by a factor; `lagged_slope`, which changes
    #: at each knot, comes first.
    parameters: tuple[str, ...]
    #: Deviations: the slopes at the 25 knots [N.s/m], then those of `lagged_slope` (25,) [N.s/m] if it is one of the
    #: parameters, the logarithms of the factors, the gas preload [N].
    terms: tuple[Term, ...]
    tested: tuple[tuple[float, ...], ...]  #: Measured combinations; a value per axis each.
    #: Half-width of the 95 % band of each tested combination's force (T, 25) at the knots [N].
    half_width: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        names = [axis.name for axis in self.axes]
        if len(set(names)) != len(names) or not names:
            raise ValueError(f"settings: the axes must have different names, not {names!r}")
        if LAGGED_SLOPE in self.parameters[1:]:
            raise ValueError(f"settings: {LAGGED_SLOPE} must be the first of the parameters {self.parameters!r}")
        count = self.deviation_count
        for term in self.terms:
            if unknown := sorted(set(term.axes) - set(names)):
                raise ValueError(f"settings: a term names the unknown axis {unknown[0]!r}; known are {names!r}")
            rows = prod(len(self.axis(name).nodes) for name in term.axes)
            if len(term.deviations) != rows or any(len(row) != count for row in term.deviations):
                raise ValueError(
                    f"settings: the term of {', '.join(term.axes)} must have {rows} rows of {count} numbers"
                )
            if not all(isfinite(value) for row in term.deviations for value in row):
                raise ValueError(f"settings: the term of {', '.join(term.axes)} has a value that is not finite")
        if any(len(row) != len(names) for row in self.tested) or not self.tested:
            raise ValueError(f"settings: each tested combination must have {len(names)} values: {self.tested!r}")
        if len(self.half_width) != len(self.tested) or any(len(row) != KNOTS for row in self.half_width):
            raise ValueError(f"settings: half_width must have a row of {KNOTS} numbers per tested combination")

    def axis(self, name: str) -> Axis:
        """Return an axis by its name.

        Raises:
            KeyError: There is no such axis.
        """
        return {axis.name: axis for axis in self.axes}[name]

    @property
    def has_lagged_slope(self) -> bool:
        """Whether the slopes of a law's lagged part have deviations of their own."""
        return LAGGED_SLOPE in self.parameters

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the law's own parameters that change by a factor."""
        return self.parameters[1:] if self.has_lagged_slope else self.parameters

    @property
    def deviation_count(self) -> int:
        """Number P of values in a row of deviations."""
        return KNOTS * (1 + self.has_lagged_slope) + len(self.factors) + 1

    @property
    def reference(self) -> tuple[float, ...]:
        """The setting of the shock's own law, a value per axis."""
        return tuple(axis.reference for axis in self.axes)

    def deviations(self, setting: tuple[float, ...]) -> tuple[float, ...]:
        """Return the sum of all terms (P,) at a setting."""
        weights = {axis.name: node_weights(axis.nodes, value) for axis, value in zip(self.axes, setting, strict=True)}
        total = [0.0] * self.deviation_count
        for term in self.terms:
            combinations = itertools.product(*(weights[name] for name in term.axes))
            for shares, row in zip(combinations, term.deviations, strict=True):
                share = prod(shares)
                if share != 0.0:
                    for k, value in enumerate(row):
                        total[k] += share * value
        return tuple(total)

    def law_at(self, law: ShockLaw, setting: tuple[float, ...]) -> ShockLaw:
        """Return the law at a setting; at the reference it is the given law.

        Args:
            law: Law at the reference setting, whose curve has knots.
            setting: Value per axis.
        """
        deviations = self.deviations(setting)
        own = {
            name: _scaled(getattr(law, name), exp(deviation))
            for name, deviation in zip(self.factors, deviations[-1 - len(self.factors) : -1], strict=True)
        }
        curve = _curve_with_slopes(law.curve, deviations[:KNOTS])
        if hasattr(law, LAGGED_SLOPE):
            changes = deviations[KNOTS : 2 * KNOTS] if self.has_lagged_slope else None
            own[LAGGED_SLOPE] = _lagged_slope(law, curve, changes)
        port = replace(law.port, gas_preload=law.port.gas_preload + deviations[-1])
        return replace(law, curve=curve, port=port, **own)


def _lagged_slope(law: Any, curve: StaticCurve, changes: tuple[float, ...] | None) -> tuple[float, ...]:
    """Return the slopes of the lagged part on another curve, never above it; without changes it keeps its share."""
    if changes is not None:
        parts = zip(law.lagged_slope, changes, curve.knot_slope, strict=True)
        found = [min(max(part + change, 0.0), now) for part, change, now in parts]
    else:
        shares = zip(law.lagged_slope, curve.knot_slope, law.curve.knot_slope, strict=True)
        found = [min(part * (now / before), now) if before > 0.0 else 0.0 for part, now, before in shares]
    found[0], found[-1] = min(found[0], curve.rebound_slope), min(found[-1], curve.compression_slope)
    return tuple(found)


def _scaled(value: Any, factor: float) -> Any:
    return tuple(part * factor for part in value) if isinstance(value, tuple) else value * factor


def _curve_with_slopes(curve: StaticCurve, deviations: tuple[float, ...]) -> StaticCurve:
    """Return a curve whose slopes at the knots deviate (25,) [N.s/m]; none becomes negative.

    The forces at the knots change by the trapezoids of the changes in slope, from zero velocity outwards. A spline of
    quadratic cells remains one.
    """
    slope = tuple(max(a + d, 0.0) for a, d in zip(curve.knot_slope, deviations, strict=True))
    change = [after - before for after, before in zip(slope, curve.knot_slope, strict=True)]
    velocity, middle = curve.knot_velocity, KNOTS // 2
    force = list(curve.knot_force)
    total = 0.0
    for k in range(middle + 1, KNOTS):
        total += 0.5 * (change[k - 1] + change[k]) * (velocity[k] - velocity[k - 1])
        force[k] += total
    total = 0.0
    for k in range(middle - 1, -1, -1):
        total -= 0.5 * (change[k] + change[k + 1]) * (velocity[k + 1] - velocity[k])
        force[k] += total
    return replace(
        curve,
        knot_force=tuple(force),
        knot_slope=slope,
        compression_slope=max(curve.compression_slope + deviations[-1], 0.0),
        rebound_slope=max(curve.rebound_slope + deviations[0], 0.0),
    )


def is_tested(settings: Settings, setting: Sequence[float]) -> bool:
    """Return whether all measured neighbours of a setting were measured in this combination of the adjusters.

    If only one adjuster differs from the reference, its own measurements suffice. An effect of one adjuster on that of
    another is known only where both were changed.
    """
    corners = itertools.product(*(axis.neighbours(value) for axis, value in zip(settings.axes, setting, strict=True)))
    return all(corner in settings.tested for corner in corners)


def setting_of(settings: Settings, values: Mapping[str, float]) -> tuple[float, ...]:
    """Return a setting, a value per axis, from values by the names of axes; others are at the reference.

    Raises:
        ValueError: A name is unknown or a value is not finite.
    """
    known = [axis.name for axis in settings.axes]
    if unknown := sorted(set(values) - set(known)):
        raise ValueError(f"unknown setting {unknown[0]!r}; this shock has: {', '.join(known)}")
    setting = tuple(float(values.get(axis.name, axis.reference)) for axis in settings.axes)
    for name, value in zip(known, setting, strict=True):
        if not isfinite(value):
            raise ValueError(f"the setting of {name} must be finite, not {value!r}")
    return setting
