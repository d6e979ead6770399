"""A shock at one setting of its adjusters and temperature: its validity there, and the band of its curve."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

from eightpost.shock.curve import KNOTS
from eightpost.shock.law import ShockLaw
from eightpost.shock.settings import Axis, Settings, is_tested
from eightpost.verdict import Grade, Reason, Rules

# ---- Where a setting is, relative to the measured ones --------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Beyond:
    """A setting of an axis outside the measured ones."""

    axis: Axis  #: Axis.
    value: float  #: Setting.
    distance: float  #: Distance from the nearest measured setting.
    intervals: float  #: The same, in multiples of the nearest interval between measured settings; infinite without one.


def settings_beyond(settings: Settings, setting: Sequence[float]) -> tuple[Beyond, ...]:
    """Return the axes on which a setting (a value per axis) is outside the measured settings."""
    return tuple(
        Beyond(axis, value, axis.beyond(value), axis.intervals_beyond(value))
        for axis, value in zip(settings.axes, setting, strict=True)
        if axis.beyond(value)
    )


# ---- The verdict on a setting ---------------------------------------------------------------------------------------

#: Subject of the reasons.
ABOUT = "setting"

#: Distance beyond the measured settings, in intervals between them, up to which the continuation can be used.
FARTHEST = 1.0

RULES = Rules()

UNTESTED = RULES.add("untested combination of settings", ABOUT, Grade.UNKNOWN,
    condition="two or more adjusters (or an adjuster and the temperature) differ from the reference, and no files were "
    "measured in this combination",
    why="the effects of the adjusters are added there; whether one changes the effect of another is not known",
    remedy="measure the shock at this combination and add the file to the table",
)  # fmt: skip
FAR_BEYOND = RULES.add("far beyond the measured settings", ABOUT, Grade.UNKNOWN,
    condition=f"a setting is beyond the measured ones by more than {FARTHEST:g} of the nearest interval between them",
    why="adjusters act progressively near their stops; the continuation is a straight line",
    remedy="measure the shock at this setting and add the file to the table",
)  # fmt: skip
BEYOND = RULES.add("beyond the measured settings", ABOUT, Grade.LIMITED,
    condition="a setting is beyond the measured ones by less than that",
    why="there is no measurement beyond; the curve is continued in a straight line over the setting",
    remedy="measure the shock at this setting and add the file to the table",
)  # fmt: skip
INSIDE = RULES.add("within the measured settings", ABOUT, Grade.USABLE,
    condition="the setting is between measured settings, in a combination that was measured",
    why="the curve is interpolated between measured curves; its band includes the error of the interpolation",
)  # fmt: skip


def setting_reasons(settings: Settings, setting: Sequence[float], origin: str) -> tuple[Reason, ...]:
    """Return the reasons of a verdict on a setting (a value per axis)."""
    return tuple(_reasons(settings, setting, origin))


def _reasons(settings: Settings, setting: Sequence[float], origin: str) -> Iterator[Reason]:
    where = setting_text(settings, setting)
    outside = settings_beyond(settings, setting)
    for one in outside:
        rule = FAR_BEYOND if one.intervals > FARTHEST else BEYOND
        figure = (
            f"{one.axis.name} {one.value:g}; measured {one.axis.nodes[0]:g} to {one.axis.nodes[-1]:g} {one.axis.unit}"
        )
        yield rule.reason("the setting is beyond the measured ones", figure=figure, origin=origin)
    if not is_tested(settings, setting):
        yield UNTESTED.reason("this combination of settings was not measured", figure=where, origin=origin)
    elif not outside:
        yield INSIDE.reason("the setting is within the measured ones", figure=where, origin=origin)


def setting_text(settings: Settings, setting: Sequence[float]) -> str:
    """Return a setting as text, such as `rebound 12, temperature 313 K`."""
    parts = []
    for axis, value in zip(settings.axes, setting, strict=True):
        unit = "" if axis.unit in ("click", "1", "") else f" {axis.unit}"
        parts.append(f"{axis.name} {value:.4g}{unit}")
    return ", ".join(parts)


# ---- The band of the curve ------------------------------------------------------------------------------------------

#: Error of the interpolation in the middle between two settings, as a multiple of the error with which a straight line
#: between its neighbours predicts a measured setting (the larger of the two). Calibrated on random shocks so that the
#: band covers 95 % (docs/how_to/settings.md).
_CURVATURE = 0.5

#: The same as a share of the difference between the two curves; it counts alone where there are only two settings.
_DIFFERENCE = 0.02
_DIFFERENCE_OF_TWO = 0.3

#: Half-width for an untested combination, as a share of the smaller effects of its adjusters.
_INTERACTION = 0.5


def force_half_width(settings: Settings, law: ShockLaw, setting: Sequence[float]) -> tuple[float, ...]:
    """Return the half-width of the 95 % band of the curve's force at the knots (25,) [N] at a setting.

    The band includes the scatter of the measurements, the error of the interpolation between settings, the growth of
    that error beyond the measured settings, and the unknown interaction of an untested combination.

    Args:
        settings: Effect of the settings.
        law: Law at the reference setting.
        setting: Value per axis.
    """
    squares = [0.0] * KNOTS
    base = law.curve.knot_force
    effects: list[list[float]] = []
    for number, value in enumerate(setting):
        axis = settings.axes[number]
        if value == axis.reference and len(setting) > 1:
            continue
        curves = {node: _force_on_axis(settings, law, number, node) for node in axis.nodes}
        between = _interpolation_error(axis, curves, value)
        scatter = _scatter(settings, number, value)
        here = _force_on_axis(settings, law, number, value)
        effects.append([abs(a - b) for a, b in zip(here, base, strict=True)])
        for k in range(KNOTS):
            squares[k] += between[k] ** 2 + scatter[k] ** 2
    if not effects:
        squares = [width**2 for width in _scatter(settings, 0, setting[0])]
    if len(effects) > 1 and not is_tested(settings, setting):
        for k in range(KNOTS):
            sizes = sorted(effect[k] for effect in effects)
            squares[k] += (_INTERACTION * sum(sizes[:-1])) ** 2
    return tuple(sqrt(square) for square in squares)


def _force_on_axis(settings: Settings, law: ShockLaw, number: int, value: float) -> tuple[float, ...]:
    """Return the force at the knots (25,) [N] with one axis at a value and the others at their reference."""
    setting = list(settings.reference)
    setting[number] = value
    return settings.law_at(law, tuple(setting)).curve.knot_force


def _scatter(settings: Settings, number: int, value: float) -> tuple[float, ...]:
    """Return the half-width (25,) [N] of the measurements next to a value of one axis, interpolated between them."""
    axis = settings.axes[number]
    near = axis.neighbours(value)
    low, high = _scatter_at(settings, number, near[0]), _scatter_at(settings, number, near[-1])
    share = 0.0 if len(near) == 1 else (value - near[0]) / (near[1] - near[0])
    return tuple((1.0 - share) * a + share * b for a, b in zip(low, high, strict=True))


def _scatter_at(settings: Settings, number: int, node: float) -> tuple[float, ...]:
    """Return the half-width (25,) [N] at a node with the other axes at their reference, or the largest at the node."""
    reference = list(settings.reference)
    reference[number] = node
    rows = dict(zip(settings.tested, settings.half_width, strict=True))
    if tuple(reference) in rows:
        return rows[tuple(reference)]
    there = [row for at, row in rows.items() if at[number] == node]
    return tuple(max(column) for column in zip(*(there or settings.half_width), strict=True))


def _interpolation_error(axis: Axis, curves: Mapping[float, Sequence[float]], value: float) -> list[float]:
    """Return the half-width (25,) [N] for the interpolation at a value of one axis, given the curves at its nodes."""
    nodes = axis.nodes
    if value in nodes or len(nodes) == 1:
        return [0.0] * KNOTS
    j = axis.interval(value)
    width = nodes[j + 1] - nodes[j]
    w = (value - nodes[j]) / width
    # Within the interval the error is like 4 w (1 - w); beyond, it grows with the distance.
    shape = 4.0 * w * (1.0 - w) if 0.0 <= w <= 1.0 else 4.0 * max(-w, w - 1.0) * (1.0 + max(-w, w - 1.0))
    bends = [_bend(nodes, curves, i) for i in (j, j + 1) if 0 < i < len(nodes) - 1]
    share = _DIFFERENCE if bends else _DIFFERENCE_OF_TWO
    error = []
    for k in range(KNOTS):
        difference = abs(curves[nodes[j + 1]][k] - curves[nodes[j]][k])
        error.append(shape * (_CURVATURE * max((bend[k] for bend in bends), default=0.0) + share * difference))
    return error


def _bend(nodes: Sequence[float], curves: Mapping[float, Sequence[float]], i: int) -> list[float]:
    """Return the error (25,) [N] with which a straight line between its neighbours predicts node i."""
    w = (nodes[i] - nodes[i - 1]) / (nodes[i + 1] - nodes[i - 1])
    before, here, after = (curves[nodes[n]] for n in (i - 1, i, i + 1))
    return [abs((1.0 - w) * a + w * c - b) for a, b, c in zip(before, here, after, strict=True)]


def band_section(law: ShockLaw, half_width: Sequence[float], level: float) -> dict[str, Any]:
    """Return a curve's band as in the fit section of a shock file."""
    return {
        "level": level,
        "velocity [m/s]": list(law.curve.knot_velocity),
        "force [N]": list(law.curve.knot_force),
        "half_width [N]": list(half_width),
    }
