"""Generation of settings_data.h: the effect of a shock's adjusters and temperature as C tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from builder.fmu.interface import Interface
from builder.native.tables import c_array
from eightpost.shock import Settings, ShockLaw
from eightpost.shock.curve import KNOTS
from eightpost.shock.settings import LAGGED_SLOPE

#: Slope of the lagged part at a knot, as in settings.py: with its own deviation, or its share of the curve's slope.
_CHANGED = """        const double slope = now->curve_knot_slope[k];
        const double part = not_negative(now->curve_lagged_slope[k] + changes[k]);""".splitlines()
_SHARED = """        const double before = given->curve_knot_slope[k], slope = now->curve_knot_slope[k];
        const double part = before > 0.0 ? now->curve_lagged_slope[k] * (slope / before) : 0.0;""".splitlines()

#: The lagged part is never steeper than the curve.
_LIMITED = """        now->curve_lagged_slope[k] = part < slope ? part : slope;
    }
    if (now->curve_lagged_slope[0] > now->curve_rebound_slope) {
        now->curve_lagged_slope[0] = now->curve_rebound_slope;
    }
    if (now->curve_lagged_slope[KNOTS - 1] > now->curve_compression_slope) {
        now->curve_lagged_slope[KNOTS - 1] = now->curve_compression_slope;
    }""".splitlines()


def settings_data(settings: Settings, law: ShockLaw, interface: Interface) -> str:
    """Return the tables of settings, and the functions that depend on the names of their variables."""
    names = [axis.name for axis in settings.axes]
    most = max(len(axis.nodes) for axis in settings.axes)
    rows = [row for term in settings.terms for row in term.deviations]
    counts = {
        "AXES": len(settings.axes),
        "TERMS": len(settings.terms),
        "TESTED": len(settings.tested),
        "MOST_NODES": most,
        "DEVIATIONS": settings.deviation_count,
        "TEMPERATURE_INPUT": _temperature_input(interface),
    }
    lines = [
        "/* Effect of the settings: generated from the shock file; do not edit. */",
        "enum {",
        *(f"    {name} = {value}," for name, value in counts.items()),
        "};",
        "",
        "/* Deviations that depend on some axes together: a row per combination of their nodes, from `first` on. */",
        "typedef struct {",
        "    int axes, axis[AXES], rows, first;",
        "} TermTable;",
        "",
        f"static const int node_counts[AXES] = {{{', '.join(str(len(axis.nodes)) for axis in settings.axes)}}};",
        "static const double axis_nodes[AXES][MOST_NODES] = {",
        *(f"    {c_array(_filled(axis.nodes, most))}," for axis in settings.axes),
        "};",
        f"static const TermTable terms[TERMS] = {{{', '.join(_terms(settings, names))}}};",
        f"static const double deviations[{len(rows)}][DEVIATIONS] = {{",
        *(f"    {c_array(row)}," for row in rows),
        "};",
        "static const double tested[TESTED][AXES] = {",
        *(f"    {c_array(row)}," for row in settings.tested),
        "};",
        "",
        "static void read_setting(const Values *v, double *setting)",
        "{",
        *_readings(settings, interface),
        "}",
        "",
        "/* Changes the law's own parameters by the deviations that follow those of the curve. */",
        "static void change_own(Parameters *now, const Parameters *given, const double *changes)",
        "{",
        *_changes(settings, law),
        "}",
        "",
    ]
    return "\n".join(lines)


def _temperature_input(interface: Interface) -> int:
    inputs = interface.names("input")
    return inputs.index("temperature") if "temperature" in inputs else -1


def _filled(nodes: Sequence[float], count: int) -> Iterable[float]:
    return (*nodes, *[0.0] * (count - len(nodes)))


def _terms(settings: Settings, names: Sequence[str]) -> Iterator[str]:
    first = 0
    for term in settings.terms:
        places = ", ".join(str(names.index(name)) for name in term.axes)
        yield f"{{{len(term.axes)}, {{{places}}}, {len(term.deviations)}, {first}}}"
        first += len(term.deviations)


def _readings(settings: Settings, interface: Interface) -> Iterator[str]:
    inputs = interface.names("input")
    for k, axis in enumerate(settings.axes):
        kind = "signals" if axis.variable in inputs else "parameters"
        yield f"    setting[{k}] = v->named.{kind}.{axis.variable.replace('.', '_')};"


def _changes(settings: Settings, law: ShockLaw) -> Iterator[str]:
    """Yield the lines that change the law's parameters: factors by their logarithms, then the lagged slopes."""
    first = KNOTS * settings.has_lagged_slope
    for k, name in enumerate(settings.factors):
        value = getattr(law, name)
        places = [f"{name}[{i}]" for i in range(len(value))] if isinstance(value, tuple) else [name]
        for place in places:
            yield f"    now->{place} *= exponential(changes[{first + k}]);"
    if not settings.parameters:
        yield "    (void)changes;"
    if settings.has_lagged_slope or not hasattr(law, LAGGED_SLOPE):
        yield "    (void)given;"
    if hasattr(law, LAGGED_SLOPE):
        yield "    for (int k = 0; k < KNOTS; k++) {"
        yield from (_CHANGED if settings.has_lagged_slope else _SHARED)
        yield from _LIMITED
    elif not settings.parameters:
        yield "    (void)now;"
