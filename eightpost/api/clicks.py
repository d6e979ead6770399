"""Clicks of a shock's adjusters as parameters of its FMU; without adjusters, changes of the slopes of its curve."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from eightpost.errors import InputError
from eightpost.shock import StaticCurve
from eightpost.shock.curve import INNER_ORDER, KNOTS, OUTER_ORDER
from eightpost.shock.shape import curve_parameters, with_slope

if TYPE_CHECKING:
    from cosim.components.component import Variable
    from cosim.study.definition import Build


def change_of(
    build: Build, variables: Mapping[str, Variable], steps: Mapping[str, float], *, share: float, speeds: str
) -> tuple[dict[str, float], dict[str, float], str]:
    """Return a shock's parameters without and with a change of clicks, and a description of the change.

    Args:
        steps: Clicks by side, `rebound` and `compression`.
        share: Change of the slope that counts as a click, if the shock has no such adjuster [1].
        speeds: Speeds at which the slope changes: `low`, `high` or `all`.

    Raises:
        InputError: An adjuster is at its stop, or the shock has neither an adjuster nor a curve.
    """
    adjusters = {side: f"clicks.{side}" for side in steps if f"clicks.{side}" in variables}
    after, words = {}, []
    for side, name in adjusters.items():
        own, variable = _value(build, variables, name), variables[name]
        after[name] = own + steps[side]
        low, high = variable.minimum, variable.maximum
        if (low is not None and after[name] < low) or (high is not None and after[name] > high):
            raise InputError(
                f"{name} would be {after[name]:g}, beyond its stops {'-' if low is None else f'{low:g}'} to "
                f"{'-' if high is None else f'{high:g}'}; use fewer clicks"
            )
        words.append(f"{name} from {own:g} to {after[name]:g}")
    left = {side: count for side, count in steps.items() if side not in adjusters}
    if not left:
        return {}, after, ", ".join(words)
    before, changed = _slopes(build, variables, left, share, speeds)
    words += [f"{side} slope at {speeds} speeds {100.0 * share * count:+g} %" for side, count in left.items()]
    return before, {**changed, **after}, ", ".join(words)


def _slopes(
    build: Build, variables: Mapping[str, Variable], steps: Mapping[str, float], share: float, speeds: str
) -> tuple[dict[str, float], dict[str, float]]:
    same = after = _curve(build, variables)
    for place, (side, count) in enumerate(steps.items()):
        unchanged, after = with_slope(after, side, share * count, speeds)
        same = unchanged if place == 0 else same
    return curve_parameters(same), curve_parameters(after)


def _curve(build: Build, variables: Mapping[str, Variable]) -> StaticCurve:
    """Return the curve of a shock FMU of this project from its parameters."""
    sizes = {"inner": INNER_ORDER, "compression": OUTER_ORDER + 1, "rebound": OUTER_ORDER + 1}
    sizes |= dict.fromkeys(("knot_velocity", "knot_force", "knot_slope"), KNOTS)
    single = ("transition_speed", "transition_width", "compression_speed", "rebound_speed", "compression_slope",
              "rebound_slope")  # fmt: skip
    if "curve.compression_slope" not in variables:
        raise InputError(
            f"{build.fmu} has neither an adjuster of this name nor the curve of an eightpost FMU; run the change as "
            "another build of the study with its own parameters"
        )
    arrays: dict[str, Any] = {
        name: tuple(_value(build, variables, f"curve.{name}[{k}]") for k in range(1, size + 1))
        for name, size in sizes.items()
    }
    return StaticCurve(**arrays | {name: _value(build, variables, f"curve.{name}") for name in single})


def _value(build: Build, variables: Mapping[str, Variable], name: str) -> float:
    own = build.parameters.get(name, variables[name].start if name in variables else 0.0)
    return float(own or 0.0)
