"""The picture model.png: a shock's force-velocity curve or a vehicle's frequency responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eightpost import units
from eightpost.array_types import Array
from eightpost.extras import needs
from eightpost.shock import Port, Shock, ShockLaw
from eightpost.vehicle import StateSpace, Vehicle

with needs("build", "building FMUs"):
    from eightpost.report.pictures import Axes, Figure, new_figure, plain_style, png

#: 900 x 600 pixels; tools show the picture at 600 x 400 or smaller.
_SIZE, _DOTS = (6.0, 4.0), 150

#: Frequency of the hysteresis loop [Hz]: the highest at which a dynamometer reaches race speeds, so lag shows best.
LOOP_FREQUENCY = 5.0

#: Colours of Okabe and Ito, which people with colour blindness can distinguish.
_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072b2", "#d55e00", "#009e73", "#8e5a9b"

#: Responses in a vehicle's picture, if the model has both channels: input, output, title.
_RESPONSES = (
    ("road", "tire_force", "road → tire force"),
    ("road", "velocity", "road → shock velocity"),
    ("force", "velocity", "shock force → shock velocity"),
    ("aero", "tire_force", "aero load → tire force"),
)
#: Name, colour and line style of each port: left and right coincide for a symmetric car, so one of them is dashed.
_PORTS = {
    "lf.": ("lf", _BLUE, "-"),
    "rf.": ("rf", _ORANGE, "--"),
    "lr.": ("lr", _GREEN, "-"),
    "rr.": ("rr", _PURPLE, "--"),
}
#: Line styles of several curves in one picture.
_STYLES: Sequence[dict[str, Any]] = tuple({"color": color, "linestyle": dash} for _, color, dash in _PORTS.values())
_FREQUENCIES = np.geomspace(0.3, 40.0, 600)


def shock_picture(shock: Shock) -> bytes:
    """Return the force-velocity curve of a shock as PNG, without gas force; the same shock gives the same bytes."""
    with plain_style():
        figure, (axes,) = _figure(1)
        _draw_curve(axes, _without_gas(shock.law))
        axes.set_title(shock.name, fontsize=13, parse_math=False)  # a name may hold a dollar sign
        return png(figure)


def curves_picture(title: str, laws: Mapping[str, ShockLaw]) -> bytes:
    """Return the static curves of several shocks as PNG, without gas force; equal curves are drawn once."""
    alike: dict[ShockLaw, list[str]] = {}
    for name, law in laws.items():
        alike.setdefault(_without_gas(law), []).append(name)
    with plain_style():
        figure, (axes,) = _figure(1)
        axes.axhline(0.0, color="0.45", linewidth=0.9)
        axes.axvline(0.0, color="0.45", linewidth=0.9)
        for k, (law, names) in enumerate(alike.items()):
            ratio = law.port.motion_ratio
            velocity = np.linspace(-law.curve.rebound_speed / ratio, law.curve.compression_speed / ratio, 1001)
            style = _STYLES[k % len(_STYLES)]
            axes.plot(
                _inches(velocity), _pounds(_static(law, velocity)), **style, linewidth=3.0, label=", ".join(names)
            )
        _label_curve(axes)
        axes.set_title(title, fontsize=13, parse_math=False)
        return png(figure)


def vehicle_picture(vehicle: Vehicle) -> bytes:
    """Return frequency responses of a vehicle with its linear dampers as PNG; equal vehicles give equal bytes."""
    model = vehicle.with_damper()
    chosen = [row for row in _RESPONSES if _responding_ports(model, row[0], row[1])][:2]
    with plain_style():
        figure, panels = _figure(max(1, len(chosen)))
        for axes, (cause, effect, title) in zip(panels, chosen, strict=False):
            _draw_responses(axes, model, cause, effect)
            axes.set_title(title, fontsize=12)
        if not chosen:  # a model without roads and tires: show the first input to the first output
            _draw_response(panels[0], model, (model.inputs[0].name, model.outputs[0].name), (_BLUE, "-", ""))
        return png(figure)


def _figure(panels: int) -> tuple[Figure, Sequence[Axes]]:
    figure = new_figure(*_SIZE, dpi=_DOTS, layout=None)
    # Fixed margins, because a layout engine would take longer than the rest of the build.
    figure.subplots_adjust(left=0.125, right=0.975, bottom=0.135, top=0.915, wspace=0.36)
    axes = [figure.add_subplot(1, panels, k + 1) for k in range(panels)]
    for each in axes:
        each.grid(color="0.88", linewidth=0.8)
        each.set_axisbelow(True)
        each.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _without_gas(law: ShockLaw) -> ShockLaw:
    port: Port = replace(law.port, gas_stiffness=0.0, gas_preload=0.0)
    return replace(law, port=port)


def _draw_curve(axes: Axes, law: ShockLaw) -> None:
    """Draw the static curve at the port, the fitted range and, if the law has lag, a loop."""
    ratio = law.port.motion_ratio
    low, high = -law.curve.rebound_speed / ratio, law.curve.compression_speed / ratio
    velocity = np.linspace(1.3 * low, 1.3 * high, 1001)
    fitted = (velocity >= low) & (velocity <= high)
    axes.axvspan(*_inches([low, high]), color="#eef3f9", zorder=0)
    axes.axhline(0.0, color="0.45", linewidth=0.9)
    axes.axvline(0.0, color="0.45", linewidth=0.9)
    if law.lag_weight(0.0) > 0.0:
        loop = _loop(law, 0.95 * min(-low, high))
        axes.plot(_inches(loop[0]), _pounds(loop[1]), color=_ORANGE, linewidth=2.4, label=f"{LOOP_FREQUENCY:g} Hz sine")
    curve = _pounds(_static(law, velocity))
    axes.plot(
        _inches(velocity), curve, color=_BLUE, linewidth=2.2, linestyle=(0, (3, 1.5)), label="outside the fitted range"
    )
    axes.plot(_inches(velocity), np.where(fitted, curve, np.nan), color=_BLUE, linewidth=3.6, label="static curve")
    _label_curve(axes)


def _label_curve(axes: Axes) -> None:
    axes.margins(x=0.0)
    axes.set_xlabel("velocity at the port [in/s], compression positive", fontsize=11)
    axes.set_ylabel("force at the port [lbf]", fontsize=11)
    axes.legend(loc="upper left", fontsize=10, frameon=False)


def _static(law: ShockLaw, velocity: Array) -> Array:
    """Return the port force [N] of the static curve and the seals, (K,)."""
    port = law.port
    return np.array(
        [port.motion_ratio * (law.static_force(v) + port.seal_force(port.motion_ratio * v)) for v in velocity.tolist()]
    )


def _loop(law: ShockLaw, amplitude: float) -> tuple[Array, Array]:
    """Return velocity [m/s] and force [N] over one period of a sine, (K,) each, after one period of settling."""
    steps = 800
    time = np.arange(2 * steps + 1) / (steps * LOOP_FREQUENCY)
    velocity = amplitude * np.sin(2.0 * np.pi * LOOP_FREQUENCY * time)
    lagged, forces = law.start(0.0), []
    for before, after in zip(velocity[:-1].tolist(), velocity[1:].tolist(), strict=True):
        lagged = law.follow(lagged, before, after, float(time[1]))
        forces.append(law.response(lagged, after, 0.0).force)
    return velocity[steps:], np.array(forces[steps - 1 :])


def _responding_ports(model: StateSpace, cause: str, effect: str) -> list[str]:
    """Return the ports at which a model has both an input and an output."""
    ports = [name.removesuffix(cause) for name in model.input_names if name.rpartition(".")[2] == cause]
    return [port for port in ports if f"{port}{effect}" in model.output_names]


def _draw_responses(axes: Axes, model: StateSpace, cause: str, effect: str) -> None:
    ports = _responding_ports(model, cause, effect)
    for port in ports:
        name, color, dash = _PORTS.get(port, ("", _BLUE, "-"))
        _draw_response(axes, model, (f"{port}{cause}", f"{port}{effect}"), (color, dash, name))
    if len(ports) > 1:
        axes.legend(fontsize=9, frameon=False, loc="lower right")


def _draw_response(axes: Axes, model: StateSpace, channels: tuple[str, str], style: tuple[str, str, str]) -> None:
    chosen = model.select(inputs=[channels[0]], outputs=[channels[1]])
    source, target = chosen.inputs[0].unit, chosen.outputs[0].unit
    shown_source, shown_target = units.us_customary(source), units.us_customary(target)
    factor = units.conversion(target, shown_target)[0] / units.conversion(source, shown_source)[0]
    gain = factor * np.abs(chosen.frequency_response(_FREQUENCIES)[0, 0])
    axes.loglog(_FREQUENCIES, gain, color=style[0], linestyle=style[1], label=style[2], linewidth=3.0)
    axes.set_xlim(_FREQUENCIES[0], _FREQUENCIES[-1])
    axes.set_xticks([0.5, 1.0, 2.0, 5.0, 10.0, 20.0], ["0.5", "1", "2", "5", "10", "20"], minor=False)
    axes.set_xticks([], minor=True)
    axes.set_xlabel("frequency [Hz]", fontsize=11)
    axes.set_ylabel(f"{shown_target} per {shown_source}", fontsize=11)


def _inches(values: Array | list[float]) -> Array:
    return units.convert(np.asarray(values, dtype=np.float64), "m/s", "in/s")


def _pounds(values: Array) -> Array:
    return units.convert(values, "N", "lbf")
