"""`eightpost whatif`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import FilePath, Quantity, argument, option, setting, verb
from eightpost.errors import InputError
from eightpost.report.console import Table, console_table

if TYPE_CHECKING:
    from cosim.components.component import Variable
    from cosim.study.choice.what_if import Effect
    from cosim.study.study import Build
    from eightpost.shock import StaticCurve

#: Parameters before and after a change, by name.
Change = tuple[dict[str, float], dict[str, float]]


@verb
def whatif(
    folder: Path = argument("STUDY", kind=FilePath()),
    corners: tuple[str, ...] = option(
        "Corner whose shock changes, e.g. lr; may be repeated.", "--at", default=..., metavar="CORNER"
    ),
    rebound: int = option("Clicks of the rebound adjuster, e.g. +1; default: 0.", default=0, metavar="CLICKS"),
    compression: int = option("Clicks of the compression adjuster, e.g. -2; default: 0.", default=0, metavar="CLICKS"),
    setup: int | None = option("Setup to change; default: the baseline, or else the best setup.", metavar="NUMBER"),
    share: float = setting(
        "Change of the slope that counts as a click, for shocks without a fitted adjuster.",
        "click",
        kind=Quantity("1", positive=True),
        default="5 %",
    ),
    speeds: str = setting(
        "Speeds at which the slope changes, for shocks without a fitted adjuster; low and high overlap near 0.1 m/s.",
        kind=("low", "high", "all"),
        default="low",
    ),
    workers: int | None = setting("Number of processes that run setups; default: 1.", kind=click.IntRange(min=1)),
) -> None:
    """Show what a click more or less at a corner would do to every measure of a study.

    STUDY is a folder that `eightpost study` wrote. The setup is run with and without the change. A shock that was
    fitted over its adjusters (docs/how_to/settings.md) changes its setting, counted as in its file; for others a click
    changes the slope of the curve on that side by a stated share, and + is stiffer. Changes that are within the
    coupling error of a run are in brackets.

    \b
    Examples:
      eightpost study whatif out/ --at lr --rebound +1
      eightpost study whatif out/ --at lf --at rf --compression -2 --set click='10 %' --set speeds=high
    """
    from cosim.study.choice.what_if import shock_at, what_if
    from cosim.study.folder import RESULTS
    from cosim.study.result import StudyResult
    from cosim.study.running.workers import ProcessWorkers

    console = Console()
    steps = {side: count for side, count in (("rebound", rebound), ("compression", compression)) if count}
    if not steps:
        raise InputError("nothing changes; give --rebound or --compression, e.g. --rebound +1")
    result = StudyResult.load(folder / RESULTS)
    before, after = {}, {}
    for corner in corners:
        build, variables = shock_at(result, corner, setup)
        before[corner], after[corner], words = change_of(build, variables, steps, share=share, speeds=speeds)
        console.print(escape(f"{corner}: {words}"), highlight=False, soft_wrap=True)
    pool = ProcessWorkers(workers or 1)
    try:
        effects = what_if(result, pool, after, setup=setup, before=before)
    finally:
        pool.close()
    console.print(effect_table(effects))


def change_of(
    build: Build, variables: Mapping[str, Variable], steps: Mapping[str, float], *, share: float, speeds: str
) -> tuple[dict[str, float], dict[str, float], str]:
    """Return a shock's parameters without and with a change of clicks, and a description of the change.

    Args:
        build: Build of the shock.
        variables: Variables of its FMU.
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
) -> Change:
    from eightpost.shock.shape import curve_parameters, with_slope

    same = after = _curve(build, variables)
    for place, (side, count) in enumerate(steps.items()):
        unchanged, after = with_slope(after, side, share * count, speeds)
        same = unchanged if place == 0 else same
    return curve_parameters(same), curve_parameters(after)


def _curve(build: Build, variables: Mapping[str, Variable]) -> StaticCurve:
    """Return the curve of a shock FMU of this project from its parameters."""
    from eightpost.shock import StaticCurve
    from eightpost.shock.curve import INNER_ORDER, KNOTS, OUTER_ORDER

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


def effect_table(effects: Sequence[Effect]) -> Table:
    """Return a table of effects; a change that is within the coupling error is in brackets."""
    rows = []
    for one in effects:
        change = f"{one.change:+.3g}"
        relative = "" if one.before == 0.0 else f"{100.0 * one.relative:+.2f} %"
        shown = (change, relative) if one.is_clear else (f"({change})", f"({relative})" if relative else "")
        name = f"{one.measure} [{one.unit}]" if one.unit else one.measure
        rows.append((escape(name), f"{one.before:.5g}", f"{one.after:.5g}", *shown, f"{one.noise:.1g}"))
    return console_table(["measure", "before", "after", "change", "relative", "coupling error"], rows)
