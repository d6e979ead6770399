"""HTML documentation of an FMU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from builder.documents.equations import equations
from builder.documents.reference import FOLDER, displayed_start, limits, start
from builder.documents.terminals import terminals
from builder.fmu.interface import Interface, Variable
from eightpost import __version__
from eightpost.report.static import Column, Picture, Section, folded, paragraph, static_page, table

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
it over that step. The outputs were computed from the equations above, independently of the binaries.</p>
"""


@dataclass(frozen=True)
class Contents:
    """Contents of a page: the disclosed information about one FMU."""

    identifier: str
    text: str
    interface: Interface
    picture: Picture
    origin: Sequence[Section]
    has_reference: bool
    fmi: int = 2


def page(contents: Contents) -> bytes:
    """Return documentation/index.html."""
    sections = [*_variables(contents.interface), *contents.origin, *_usage(contents)]
    places = [("equations", "Equations"), ("limits", "Limits"), *((s.name, s.heading) for s in sections)]
    body = equations(contents.interface.kind) + "".join(str(section) for section in sections)
    text, facts = contents.text, _facts(contents)
    return static_page(contents.identifier, text, facts, places, contents.picture, body).encode()


def _facts(contents: Contents) -> str:
    interface = contents.interface
    return (
        f"Interface {interface.kind} {interface.version} · FMI {contents.fmi}.0 {_kinds(interface)} · "
        f"SI at the interface · built with eightpost {__version__}"
    )


def _kinds(interface: Interface) -> str:
    is_exchanged = bool(interface.states) or interface.kind == "shock_polylinear"
    return "co-simulation and model exchange" if is_exchanged else "co-simulation"


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


def _usage(contents: Contents) -> list[Section]:
    ports = ", ".join(f"<code>{escape(terminal.name)}</code>" for terminal in terminals(contents.interface))
    connecting = _CONNECT.format(ports=ports) if ports else ""
    sections = [Section("Import", _IMPORT.format(identifier=escape(contents.identifier)) + connecting)]
    if contents.has_reference:
        html = _REFERENCE.format(folder=FOLDER, identifier=escape(contents.identifier))
        sections.append(Section("Reference results", html))
    return sections
