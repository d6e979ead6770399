"""HTML documentation of an FMU: its equations, variables, terminals, and pictures."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np

from builder.interface import Interface, Variable, source_folder, xml_document
from builder.reference import FOLDER, displayed_start, limits, start
from eightpost import __version__, units
from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.extras import needs
from eightpost.report.static import Column, Picture, Section, folded, paragraph, static_page, table
from eightpost.shock import Shock, ShockLaw
from eightpost.vehicle import StateSpace, Vehicle

with needs("build", "building FMUs"):
    from latex2mathml.converter import convert
    from markdown_it import MarkdownIt
    from markdown_it.renderer import RendererHTML
    from markdown_it.rules_inline import StateInline
    from markdown_it.token import Token
with needs("build", "building FMUs"):
    from eightpost.report.pictures import Axes, Figure, new_figure, plain_style, png

# ---- Text and equations: from Markdown with LaTeX to HTML with MathML, which browsers can display -------------------
# The equations use GitHub's notation: `$...$` within a line, a fenced block with the info string `math` otherwise.


#: Links between the texts are replaced by anchors, because all texts are on one page.
_PLACES = {"../common/shock.md": "#the-port"}

_TITLE = re.compile(r"\A# .*\n+")


def equations(kind: str) -> str:
    """Return the text of an interface kind as HTML: purpose, equations, signs, limits; without its title.

    The text of a shock is followed by the text that all shocks share: the port and the curve.
    """
    folder = source_folder()
    texts = [_TITLE.sub("", (folder / kind / "README.md").read_text(encoding="utf-8"))]
    if kind.startswith("shock_"):
        texts.append((folder / "common" / "shock.md").read_text(encoding="utf-8"))
    return render("\n".join(texts))


def render(text: str) -> str:
    """Return Markdown as HTML."""
    markdown = MarkdownIt("commonmark").enable("table")
    markdown.inline.ruler.before("escape", "math", _parse_math)
    markdown.add_render_rule("math", _math)
    markdown.add_render_rule("fence", _fence)
    markdown.add_render_rule("heading_open", _heading)
    markdown.add_render_rule("link_open", _link)
    return str(markdown.render(text))


def mathml(latex: str, *, display: str) -> str:
    """Return LaTeX mathematics as MathML; `display` is `inline` or `block`."""
    # HTML does not need the namespace, and without it the page contains no URL at all.
    return convert(latex, display=display).replace(' xmlns="http://www.w3.org/1998/Math/MathML"', "")


def _parse_math(state: StateInline, silent: bool) -> bool:
    if state.src[state.pos] != "$":
        return False
    end = state.src.find("$", state.pos + 1)
    if end < 0:
        return False
    if not silent:
        state.push("math", "math", 0).content = state.src[state.pos + 1 : end]
    state.pos = end + 1
    return True


def _math(_: RendererHTML, tokens: Sequence[Token], index: int, *__: Any) -> str:
    return mathml(" ".join(tokens[index].content.split()), display="inline")


def _fence(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
    if tokens[index].info.strip() != "math":
        return str(self.fence(tokens, index, options, env))
    return f'<div class="equation">{mathml(tokens[index].content.strip(), display="block")}</div>\n'


def _heading(_: RendererHTML, tokens: Sequence[Token], index: int, *__: Any) -> str:
    name = re.sub(r"\W+", "-", tokens[index + 1].content.lower()).strip("-")
    return f'<{tokens[index].tag} id="{name}">'


def _link(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
    target = str(tokens[index].attrGet("href"))
    tokens[index].attrSet("href", _PLACES.get(target, target))
    return str(self.renderToken(tokens, index, options, env))


# ---- terminalsAndIcons.xml: variables as ports, so that tools can connect whole ports -------------------------------
# The format is that of FMI 3.0, which FMI 2.0.4 adopts unchanged; `fmiVersion` is the version of the format.

#: Kind of the terminals on both sides of a connection; a leading underscore marks a kind that is not standardized.
KIND = "_eightpost.translational_port"

#: At a connection the sum of all inflows equals the sum of all outflows. The shock's force (positive in compression)
#: acts on the vehicle: it leaves the shock and enters the vehicle. Hence `force` is an outflow if it is an output, and
#: an inflow if it is an input. If both were inflows, an importer that sums flows to zero would change the sign. With
#: this rule, the forces of several elements at one port (shock and bump stop) are added.
_FLOW = {"output": "outflow", "input": "inflow"}


def _terminals(interface: Interface) -> dict[str, dict[str, Variable]]:
    """Return the variables of each port of a shock or vehicle: of the prefixes that have a velocity and a force."""
    variables, ports = {v.name: v for v in interface.variables}, {}
    for prefix in ("", *(f"{corner}." for corner in CORNERS)):
        names = [name for name in ("velocity", "displacement", "force") if f"{prefix}{name}" in variables]
        if "velocity" in names and "force" in names:
            ports[prefix.rstrip(".") or "port"] = {name: variables[f"{prefix}{name}"] for name in names}
    return ports


def terminals_and_icons(interface: Interface) -> bytes:
    """Return terminalsAndIcons.xml.

    Velocity and displacement are equal on both sides (`signal`); the force is a flow. The rule `plug` connects all
    members or no member: without the displacement, a shock would lose its gas spring.

    There is no GraphicalRepresentation. It would have to be the first element, and fmutool (2.0) only looks for
    terminals in the first element. It could only state the area of icon.png, which is the whole square by default.
    """
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    parent = ET.SubElement(root, "Terminals")
    for port, members in _terminals(interface).items():
        attributes = {
            "name": port,
            "matchingRule": "plug",
            "terminalKind": KIND,
            "description": "Velocity, displacement and force of a shock, all positive in compression",
        }
        element = ET.SubElement(parent, "Terminal", attributes)
        for member, variable in members.items():
            kind = _FLOW[variable.causality] if member == "force" else "signal"
            names = {"variableName": variable.name, "memberName": member, "variableKind": kind}
            ET.SubElement(element, "TerminalMemberVariable", names)
    return xml_document(root)


# ---- The page -------------------------------------------------------------------------------------------------------

_VARIABLES = (
    Column("name", "name"),
    Column("value reference", "number"),
    Column("unit", "tight"),
    Column("start", "number"),
    Column("displayed", "tight"),
    Column("range", "tight"),
    Column("variability", "tight"),
    Column("description"),
)

_IMPORT = """<p>A host opens <code>{identifier}.fmu</code>, sets parameters, initializes, and then sets inputs, steps
and reads outputs. With FMPy, in Python:</p>
<pre>from fmpy import simulate_fmu

result = simulate_fmu("{identifier}.fmu", stop_time=1.0, output_interval=1e-3)</pre>
<p>All values at the interface are in SI units; tools that support display units show US customary units. Any positive
step size is allowed.</p>
"""

_CURVE = (
    "Fixed parameters can be set until initialization ends. The knots can be set at any time: set all that "
    "change before the next step. Without knots (all velocities 0) the curve is that of the polynomials."
)

_CONNECT = """<p><code>terminalsAndIcons/terminalsAndIcons.xml</code> groups the variables of each port into a terminal,
so that tools which support terminals connect a shock and a vehicle in one step: {ports}. To connect them manually,
connect velocity and displacement from the vehicle to the shock and force from the shock to the vehicle, without a
change of sign.</p>
"""

_REFERENCE = """<p>The archive contains reference inputs and outputs in the format of the FMI cross-check rules:
<code>{folder}/{identifier}_in.csv</code>, <code>_ref.csv</code> and <code>_ref.opt</code>. To compare the results of a
host, start at 0, take steps of 1 ms for 1 s, set each row of inputs before the step that starts at its time, and hold
it over that step: they are results of co-simulation. Model exchange with inputs interpolated between the rows differs
from them, for a shock by up to 8 %. The outputs were computed from the equations above, independently of the
binaries.</p>
"""


def page(
    described: tuple[str, str, Interface],
    picture: Picture,
    origin: Sequence[Section],
    *,
    has_reference: bool,
    fmi: int,
) -> bytes:
    """Return documentation/index.html.

    Args:
        described: C name of the FMU, one-line description, and disclosed variables.
        picture: Picture at the top.
        origin: Sections about the source of the FMU.
        has_reference: Whether the archive has reference results.
        fmi: FMI version, 2 or 3.
    """
    identifier, text, interface = described
    sections = [*_variables(interface), *origin, *_usage(identifier, interface, has_reference=has_reference)]
    places = [("equations", "Equations"), ("limits", "Limits"), *((s.name, s.heading) for s in sections)]
    body = equations(interface.kind) + "".join(str(section) for section in sections)
    exchange = " and model exchange" if interface.states or interface.kind == "shock_polylinear" else ""
    facts = (
        f"Interface {interface.kind} {interface.version} · FMI {fmi}.0 co-simulation{exchange} · "
        f"SI at the interface · built with eightpost {__version__}"
    )
    return static_page(identifier, text, facts, places, picture, body).encode()


def _variables(interface: Interface) -> list[Section]:
    """Return the tables of variables; each variable is in one of them."""
    kinds = {
        "Inputs": [v for v in interface.variables if v.causality == "input"],
        "Outputs": [v for v in interface.variables if v.causality == "output"],
        "Parameters": [v for v in interface.variables if v.causality == "parameter" and not _is_curve(v)],
        "Local variables": [v for v in interface.variables if v.causality == "local"],
    }
    sections = [Section(heading, _table(variables)) for heading, variables in kinds.items() if variables]
    if curve := [v for v in interface.variables if _is_curve(v)]:
        html = folded(f"{len(curve)} variables", _table(curve))
        sections.insert(3, Section("Curve", paragraph(_CURVE) + html))
    return sections


def _is_curve(variable: Variable) -> bool:
    return "curve" in variable.name.split(".")[:2]


def _table(variables: Sequence[Variable]) -> str:
    return table(_VARIABLES, [_row(v) for v in variables])


def _row(variable: Variable) -> tuple[str, ...]:
    is_parameter = variable.causality == "parameter"  # inputs start at 0, outputs have no start value
    return (
        variable.name,
        str(variable.reference),
        "" if variable.unit in (None, "1") else str(variable.unit),
        start(variable) if is_parameter else "",
        (displayed_start(variable) if is_parameter else variable.display) or "",
        limits(variable),
        variable.variability if is_parameter else "",
        variable.description,
    )


def _usage(identifier: str, interface: Interface, *, has_reference: bool) -> list[Section]:
    ports = ", ".join(f"<code>{port}</code>" for port in _terminals(interface))
    connecting = _CONNECT.format(ports=ports) if ports else ""
    sections = [Section("Import", _IMPORT.format(identifier=escape(identifier)) + connecting)]
    if has_reference:
        html = _REFERENCE.format(folder=FOLDER, identifier=escape(identifier))
        sections.append(Section("Reference results", html))
    return sections


# ==== The picture model.png: a shock's force-velocity curve or a vehicle's frequency responses =======================

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
        _draw_zero(axes)
        for k, (law, names) in enumerate(alike.items()):
            velocity, style = np.linspace(*_range(law), 1001), _STYLES[k % len(_STYLES)]
            force = _pounds(_static(law, velocity))
            axes.plot(_inches(velocity), force, **style, linewidth=3.0, label=", ".join(names))
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
    return replace(law, port=replace(law.port, gas_stiffness=0.0, gas_preload=0.0))


def _draw_curve(axes: Axes, law: ShockLaw) -> None:
    """Draw the static curve at the port, the fitted range and, if the law has lag, a loop."""
    low, high = _range(law)
    velocity = np.linspace(1.3 * low, 1.3 * high, 1001)
    fitted = (velocity >= low) & (velocity <= high)
    axes.axvspan(*_inches([low, high]), color="#eef3f9", zorder=0)
    _draw_zero(axes)
    if law.lag_weight(0.0) > 0.0:
        loop = _loop(law, 0.95 * min(-low, high))
        axes.plot(_inches(loop[0]), _pounds(loop[1]), color=_ORANGE, linewidth=2.4, label=f"{LOOP_FREQUENCY:g} Hz sine")
    curve = _pounds(_static(law, velocity))
    axes.plot(
        _inches(velocity), curve, color=_BLUE, linewidth=2.2, linestyle=(0, (3, 1.5)), label="outside the fitted range"
    )
    axes.plot(_inches(velocity), np.where(fitted, curve, np.nan), color=_BLUE, linewidth=3.6, label="static curve")
    _label_curve(axes)


def _range(law: ShockLaw) -> tuple[float, float]:
    ratio = law.port.motion_ratio
    return -law.curve.rebound_speed / ratio, law.curve.compression_speed / ratio


def _draw_zero(axes: Axes) -> None:
    axes.axhline(0.0, color="0.45", linewidth=0.9)
    axes.axvline(0.0, color="0.45", linewidth=0.9)


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
