"""Tables and plots of a shock over its settings: curves over clicks, and forces at speeds over clicks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eightpost.ident.shock.curve import curve_forces
from eightpost.ident.shock.settings.clicks import ClickAnswer, TargetCurve
from eightpost.ident.shock.settings.result import SettingsFit
from eightpost.report.console import Table, console_table, right, unbroken
from eightpost.report.pictures import Axes, new_figure, panels_of, save
from eightpost.shock import Axis, Shock
from eightpost.shock.at_setting import force_half_width, setting_text

#: Speeds of the map [m/s], as far as they were measured; at most this many settings have a curve.
_SPEEDS = (0.025, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
_CURVES = 9

_VELOCITY, _FORCE = "velocity [m/s], positive in compression", "force without gas force [N]"


def settings_table(fit: SettingsFit) -> Table:
    """Return a table of the measured settings: error of the fit, and error with which the other settings predict it."""
    columns = [*unbroken("setting"), "files", *right("fit, % of std", "predicted by the others, % of std")]
    rows = [
        (
            setting_text(fit.settings, group.setting),
            ", ".join(group.names),
            f"{one.percent:.2f}",
            "-" if predicted is None else f"{predicted:.2f}",
        )
        for group, one, predicted in zip(fit.groups, fit.fits, fit.predicted, strict=True)
    ]
    return console_table(columns, rows, title=f"{fit.shock.name}: {fit.shock.law_name} over its settings")


def answer_table(answer: ClickAnswer) -> Table:
    """Return a table of the best settings with their errors per range of speed [N]."""
    names = [part.name for part in answer.best.ranges]
    columns = [*unbroken("setting"), *right("RMS, N", "% of target"), *right(*names), "note"]
    rows = [
        (
            choice.text,
            f"{choice.rms:.1f}",
            f"{choice.percent:.1f}",
            *(f"{part.mean:+.0f} ({part.rms:.0f})" for part in choice.ranges),
            _note(choice.is_tested, choice.is_same and choice is not answer.best),
        )
        for choice in answer.choices
    ]
    return console_table(columns, rows, title="Mean (RMS) of setting minus target [N]")


def _note(is_tested: bool, is_same: bool) -> str:
    notes = [
        *([] if is_tested else ["untested combination"]),
        *(["within the band of the first"] if is_same else []),
    ]
    return ", ".join(notes)


def plot_click_map(shock: Shock, path: str | Path) -> None:
    """Write a picture with two panels for each adjuster: curves over clicks, and forces at speeds over clicks.

    The other adjusters are at their reference. Dots are measured settings, shaded areas the 95 % bands, dashed lines
    are beyond the measured settings.

    Args:
        shock: Shock with settings.
        path: File to write; an existing file is replaced only when the new one is complete.
    """
    assert shock.settings is not None
    count = len(shock.settings.axes)
    figure = new_figure(13.0, 5.2 * count)
    panels = panels_of(figure, 2 * count, 2)
    for number, axis in enumerate(shock.settings.axes):
        _curves(panels[2 * number], shock, number, axis)
        _forces(panels[2 * number + 1], shock, number, axis)
    figure.suptitle(f"{shock.name}: force over velocity and setting")
    save(figure, path, format="png")


def plot_answer(shock: Shock, target: TargetCurve, answer: ClickAnswer, path: str | Path) -> None:
    """Write a picture of a target curve and the curve of the best setting with its band."""
    assert shock.settings is not None
    figure = new_figure(7.2, 6.0)
    axes = figure.subplots()
    setting = answer.best.setting
    law = shock.settings.law_at(shock.law, setting)
    velocity = np.linspace(-law.curve.rebound_speed, law.curve.compression_speed, 401)
    force = curve_forces(law.curve, velocity)
    half = np.interp(velocity, law.curve.knot_velocity, force_half_width(shock.settings, shock.law, setting))
    axes.fill_between(
        velocity, force - half, force + half, color="tab:blue", alpha=0.25, linewidth=0, label="95 % band"
    )
    axes.plot(velocity, force, color="tab:blue", label=answer.best.text)
    axes.plot(target.velocity, target.force, "k.", markersize=4.0, label=f"target {target.name}")
    axes.set_title(f"best setting: {answer.best.rms:.0f} N RMS, {answer.best.percent:.1f} % of the target")
    _decorate(axes, _VELOCITY, _FORCE)
    save(figure, path, format="png")


def _on_axis(shock: Shock, number: int, value: float) -> tuple[float, ...]:
    assert shock.settings is not None
    return tuple(value if k == number else reference for k, reference in enumerate(shock.settings.reference))


def _values(axis: Axis, count: int) -> list[float]:
    low = axis.nodes[0] if axis.lowest is None else axis.lowest
    high = axis.nodes[-1] if axis.highest is None else axis.highest
    spread = np.linspace(low, high, count)
    return sorted({*axis.nodes, *(np.round(spread) if axis.is_whole else spread).tolist()})


def _curves(panel: Axes, shock: Shock, number: int, axis: Axis) -> None:
    assert shock.settings is not None
    values = list(axis.nodes) if len(axis.nodes) >= _CURVES else _values(axis, _CURVES)
    for value in values:
        law = shock.settings.law_at(shock.law, _on_axis(shock, number, value))
        velocity = np.linspace(-law.curve.rebound_speed, law.curve.compression_speed, 401)
        color = _color(value, values)
        is_node = value in axis.nodes
        style = "-" if not axis.beyond(value) else "--"
        panel.plot(
            velocity, curve_forces(law.curve, velocity), style, color=color, linewidth=1.8 if is_node else 0.8,
            label=f"{value:.4g}" + (" measured" if is_node else ""),
        )  # fmt: skip
    panel.set_title(f"static curves over {_title(axis)}")
    _decorate(panel, _VELOCITY, _FORCE)


def _forces(panel: Axes, shock: Shock, number: int, axis: Axis) -> None:
    assert shock.settings is not None
    values = _values(axis, 57)
    velocity = np.array(shock.law.curve.knot_velocity)
    laws = [shock.settings.law_at(shock.law, _on_axis(shock, number, value)) for value in values]
    widths = [force_half_width(shock.settings, shock.law, _on_axis(shock, number, value)) for value in values]
    speeds = [speed for speed in _SPEEDS if speed < min(-velocity[0], velocity[-1])]
    for place, speed in enumerate(speeds):
        color = _color(place, range(len(speeds)))
        for sign in (1.0, -1.0):
            force = np.array([law.curve.force(sign * speed) for law in laws])
            half = np.array([np.interp(sign * speed, velocity, width) for width in widths])
            label = f"{speed:g} m/s" if sign > 0.0 else None
            panel.fill_between(values, force - half, force + half, color=color, alpha=0.2, linewidth=0)
            panel.plot(values, force, color=color, linewidth=1.4, label=label)
            at = [values.index(node) for node in axis.nodes]
            panel.plot(list(axis.nodes), force[at], "o", color=color, markersize=4.0)
    panel.set_title("force at speeds, compression above and rebound below")
    _decorate(panel, _title(axis), _FORCE)
    panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)


def _title(axis: Axis) -> str:
    unit = "clicks" if axis.is_whole else axis.unit
    return f"{axis.name} [{unit}{' ' + axis.counted if axis.counted else ''}]"


def _color(value: float, values: Sequence[float]) -> tuple[float, float, float]:
    """Return a colour from blue, the first value, to red, the last."""
    low, high = min(values), max(values)
    share = (value - low) / (high - low) if high > low else 0.0
    return (0.1 + 0.8 * share, 0.3 + 0.25 * (1.0 - abs(2.0 * share - 1.0)), 0.9 - 0.8 * share)


def _decorate(panel: Axes, horizontal: str, vertical: str) -> None:
    panel.set_xlabel(horizontal)
    panel.set_ylabel(vertical)
    panel.axhline(0.0, color="0.7", linewidth=0.6, zorder=0)
    panel.grid(visible=True, color="0.92")
    panel.set_axisbelow(True)
    panel.legend(loc="upper left", framealpha=0.9, fontsize=8)
