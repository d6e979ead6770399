"""Tables of a report; the reasons of unknown figures are numbered below each table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from eightpost.ident.dyno_report.builds import DynoReport, Variant
from eightpost.ident.dyno_report.comparison import differences, heat_effect, mean_force, repeats, representatives
from eightpost.ident.dyno_report.corner import CarCorner
from eightpost.ident.dyno_report.cycles import Cycles
from eightpost.ident.dyno_report.entry import Entry
from eightpost.ident.dyno_report.found import Found, Unknown, mean_of
from eightpost.ident.dyno_report.velocity_curve import STROKES, Stroke, forces_at, ratio_at
from eightpost.report.page import Block
from eightpost.report.tables import NONE, Cell, ResultTable
from eightpost.shock import law_title

Row = Sequence[Cell | Found | None]


@dataclass
class Reasons:
    """Reasons of the unknown figures of a table, numbered in the order in which they occur."""

    _numbers: dict[str, int] = field(default_factory=dict)

    def cell(self, value: Cell | Found | None) -> Cell | float | None:
        """Return the content of a cell: an unknown figure becomes `unknown` with the number of its reason."""
        if not isinstance(value, Unknown):
            return value
        number = self._numbers.setdefault(value.reason, len(self._numbers) + 1)
        return f"unknown\N{NO-BREAK SPACE}[{number}]"

    def lines(self) -> tuple[str, ...]:
        """Return the reasons with their numbers."""
        return tuple(f"[{number}] {reason}." for reason, number in self._numbers.items())


def explained(title: str, columns: Sequence[str], rows: Iterable[Row]) -> list[Block]:
    """Return a table without its empty columns and the reasons below it; nothing if there is no row."""
    reasons = Reasons()
    cells = [tuple(reasons.cell(value) for value in row) for row in rows]
    kept = [k for k in range(len(columns)) if any(row[k] not in (None, NONE) for row in cells)]
    if not kept:
        return []
    shown = ([row[k] for k in kept] for row in cells)
    table = ResultTable.of(title, [columns[k] for k in kept], shown)
    return [table, *([reasons.lines()] if reasons.lines() else [])]


def kind_of(entry: Entry) -> str:
    """Return the kind of an entry as text."""
    return law_title(entry.shock.law_name) if entry.shock else {"run": "run", "table": "PVP table"}[entry.kind]


def _labelled(report: DynoReport) -> Iterator[tuple[Variant, Entry]]:
    return ((variant, entry) for variant in report.variants for entry in variant.entries)


# ---- Overview -------------------------------------------------------------------------------------------------------


def entry_table(report: DynoReport) -> list[Block]:
    """Return the table of what is in the report."""
    rows = [
        (variant.build, entry.name, kind_of(entry), entry.setting.clicks or NONE, entry.setting.gas_pressure,
         _celsius(entry.setting.temperature), entry.highest or None, _stroke(entry))
        for variant, entry in _labelled(report)
    ]  # fmt: skip
    columns = ("build", "entry", "kind", "clicks", "gas pressure [Pa]", "temperature", "highest speed [m/s]",
               "stroke [m]")  # fmt: skip
    return explained("", columns, rows)


def _celsius(temperature: Found | None) -> str | Unknown:
    if temperature is None:
        return NONE
    if isinstance(temperature, Unknown):
        return temperature
    celsius = temperature - 273.15
    return f"{celsius:.1f} °C ({1.8 * celsius + 32.0:.0f} °F)"


def _stroke(entry: Entry) -> float | None:
    return entry.test.stroke if entry.test else None


def overview_table(report: DynoReport) -> list[Block]:
    """Return the main figures of every build, measured and of laws: forces, slopes, ratio, gas, friction, energy."""
    middle = report.speeds[len(report.speeds) // 2]
    rows = []
    for variant in report.variants:
        for basis, entries in (("measured", variant.measured), ("law", variant.of_kind("law"))):
            if entries:
                fastest = representatives(variant, basis)
                cycles = [entry.cycles for entry in fastest]
                low = [mean_of(entry.strokes[stroke].low for entry in fastest) for stroke in STROKES]
                forces = [mean_force(fastest, middle, stroke) for stroke in STROKES]
                rows.append((
                    *_fitted(report, variant), variant.label, basis, *forces,
                    mean_of(ratio_at(entry.curve, middle) for entry in fastest), *low,
                    mean_of(entry.slow.gas_force for entry in entries),
                    mean_of(entry.slow.friction for entry in entries),
                    mean_of(one.energy if isinstance(one, Cycles) else one for one in cycles),
                ))  # fmt: skip
    corner = ("corner",) if report.fitted_to else ()
    columns = (*corner, "build", "basis", "compression [N]", "rebound [N]", "reb/comp", "low slope comp. [N.s/m]",
               "low slope reb. [N.s/m]", "gas force [N]", "friction [N]", "energy per cycle [J]")  # fmt: skip
    return explained("", columns, rows)


def _fitted(report: DynoReport, variant: Variant) -> tuple[str, ...]:
    if not report.fitted_to:
        return ()
    names = [name for name, build in report.fitted_to.items() if build in (variant.label, variant.build)]
    return (", ".join(names) or NONE,)


# ---- Curves ---------------------------------------------------------------------------------------------------------


def force_table(report: DynoReport) -> list[Block]:
    """Return forces, secant rates and the ratio of rebound to compression at the report's speeds."""
    rows = []
    for _, entry in _labelled(report):
        for speed in report.speeds_of(entry):
            compression, rebound = (forces_at(entry.curve, speed, stroke) for stroke in STROKES)
            secants = [force if isinstance(force, Unknown) else force / speed for force in (compression, rebound)]
            rows.append((entry.name, kind_of(entry), speed, compression, rebound, ratio_at(entry.curve, speed),
                         *secants))  # fmt: skip
    columns = ("entry", "kind", "speed [m/s]", "compression [N]", "rebound [N]", "reb/comp", "comp. per speed [N.s/m]",
               "reb. per speed [N.s/m]")  # fmt: skip
    return explained("", columns, rows)


def knee_table(report: DynoReport) -> list[Block]:
    """Return knees and slopes of every entry."""
    rows = []
    for _, entry in _labelled(report):
        for stroke in STROKES:
            one = entry.strokes[stroke]
            rows.append((entry.name, kind_of(entry), stroke, one.knee, one.knee_force, one.low, one.high,
                         one.highest or None))  # fmt: skip
    columns = ("entry", "kind", "stroke", "knee at [m/s]", "force there [N]", "slope below [N.s/m]",
               "slope above [N.s/m]", "highest speed [m/s]")  # fmt: skip
    return explained("", columns, rows)


def peak_table(report: DynoReport) -> list[Block]:
    """Return mean peak velocities and forces of the runs, with their scatter from cycle to cycle."""
    rows: list[Row] = []
    for entry in report.runs:
        cycles = entry.cycles
        if isinstance(cycles, Unknown):
            continue
        for stroke, sign in (("compression", 1.0), ("rebound", -1.0)):
            speeds, forces = cycles.peaks(sign)
            if not cycles.is_steady or speeds.size < 2:
                none = Unknown("the peaks are not repeated: the cycles differ or are fewer than two")
                rows.append((entry.name, stroke, str(speeds.size), none, none, none, none))
            else:
                middle = sign * entry.level if not isinstance(entry.level, Unknown) else 0.0
                mean, scatter = float(forces.mean()) - middle, float(forces.std(ddof=1))
                rows.append((entry.name, stroke, str(speeds.size), float(speeds.mean()), mean, scatter,
                             100.0 * scatter / abs(mean) if mean else None))  # fmt: skip
    columns = ("run", "stroke", "peaks", "peak speed [m/s]", "peak force [N]", "standard deviation [N]",
               "deviation / force [%] .2")  # fmt: skip
    return explained("", columns, rows)


# ---- Damping ratio --------------------------------------------------------------------------------------------------


def damping_tables(report: DynoReport) -> list[Block]:
    """Return the damping ratio of every build at every corner: below and above the knee, and of both strokes."""
    rows = []
    for corner in report.corners:
        for variant in report.variants:
            if not _belongs(report, corner, variant):
                continue
            for entry in variant.entries:
                slopes = [entry.strokes[stroke] for stroke in STROKES]
                low, high = [one.low for one in slopes], [one.high for one in slopes]
                ratios = [corner.damping_ratio(rate) for rate in (*low, _both(low), *high, _both(high))]
                rows.append((corner.name, variant.label, entry.name, kind_of(entry), *map(_percent, ratios)))
    columns = ("corner", "build", "entry", "kind", "comp. below knee [%]", "reb. below knee [%]", "mean below knee [%]",
               "comp. above knee [%]", "reb. above knee [%]", "mean above knee [%]")  # fmt: skip
    return explained("", columns, rows)


def corner_table(report: DynoReport) -> list[Block]:
    """Return masses and rates of the corners."""
    rows = [(corner.name, corner.mass, corner.wheel_rate, corner.motion_ratio) for corner in report.corners]
    return explained("", ("corner", "sprung mass [kg]", "wheel rate [N/m]", "motion ratio"), rows)


def _belongs(report: DynoReport, corner: CarCorner, variant: Variant) -> bool:
    build = report.fitted_to.get(corner.name)
    return build is None or build in (variant.label, variant.build)


def _both(rates: Sequence[Found]) -> Found:
    """Return the mean of both strokes; unknown if either is unknown."""
    return next((rate for rate in rates if isinstance(rate, Unknown)), None) or mean_of(rates)


def _percent(ratio: Found) -> Found:
    return ratio if isinstance(ratio, Unknown) else 100.0 * ratio


# ---- Loops, gas, warming --------------------------------------------------------------------------------------------


def loop_table(report: DynoReport) -> list[Block]:
    """Return frequency, stroke, energy, width and lag of the runs."""
    rows = []
    for entry in report.runs:
        cycles = entry.cycles
        if not isinstance(cycles, Unknown):
            rows.append((entry.name, str(cycles.count), cycles.frequency, cycles.stroke, cycles.energy,
                         cycles.energy_scatter, cycles.width, entry.offset, _milliseconds(entry.lag)))  # fmt: skip
    columns = ("run", "cycles", "frequency [Hz]", "stroke [m]", "energy per cycle [J]", "its standard deviation [J]",
               "width at zero velocity [N]", "force at zero velocity [N]", "lag of force (ms)")  # fmt: skip
    return explained("", columns, rows)


def _milliseconds(lag: Found) -> Found:
    return lag if isinstance(lag, Unknown) else 1e3 * lag


def lag_table(report: DynoReport) -> list[Block]:
    """Return the lag time constants of the laws."""
    rows = [
        (entry.name, kind_of(entry), *_time_constants(entry), _fit_error(entry))
        for entry in report.entries if entry.kind == "law"
    ]  # fmt: skip
    columns = (
        "law",
        "kind",
        "lag time constant (ms)",
        "in rebound (ms)",
        "in compression (ms)",
        "error of the fit [%]",
    )
    return explained("", columns, rows)


def _time_constants(entry: Entry) -> tuple[Found, Found | None, Found | None]:
    """Return the time constant of a law [ms], and those in rebound and compression of a law with several ones."""
    known = getattr(entry.shock.law, "time_constant", None) if entry.shock else None
    if not isinstance(known, tuple):
        return _milliseconds(entry.lag), None, None
    return _milliseconds(entry.lag), 1e3 * known[0], 1e3 * known[-1]


def _fit_error(entry: Entry) -> Found:
    value = entry.shock.fit.get("percent") if entry.shock else None
    if isinstance(value, int | float):
        return float(value)
    return Unknown("the shock file states no error in percent of the force's standard deviation")


def gas_table(report: DynoReport) -> list[Block]:
    """Return gas force, gas stiffness and friction of every entry."""
    rows = [
        (entry.name, kind_of(entry), entry.slow.gas_force, entry.slow.stiffness, entry.slow.friction,
         entry.slow.residual if entry.kind == "run" else None,
         entry.slow.duration if entry.kind == "run" else None)
        for _, entry in _labelled(report)
    ]  # fmt: skip
    columns = ("entry", "kind", "gas force [N]", "gas stiffness [N/m]", "friction [N]", "RMS about the equation [N]",
               "slow parts [s] .2")  # fmt: skip
    return explained("", columns, rows)


def warming_table(report: DynoReport) -> list[Block]:
    """Return temperature, energy and power of the runs."""
    rows = [
        (entry.name, _celsius(entry.warming.start), _kelvin(entry.warming.drift), entry.warming.energy,
         entry.warming.power, _per_kilojoule(entry))
        for entry in report.runs
    ]  # fmt: skip
    columns = ("run", "start", "warming", "energy [J]", "mean power [W]", "warming per energy (K/kJ)")
    return explained("", columns, rows)


def _kelvin(drift: Found) -> Cell | Unknown:
    return drift if isinstance(drift, Unknown) else f"{drift:+.2f} K ({1.8 * drift:+.1f} °F)".replace("-", "−")


def _per_kilojoule(entry: Entry) -> Found:
    drift, energy = entry.warming.drift, entry.warming.energy
    if isinstance(drift, Unknown):
        return drift
    if isinstance(energy, Unknown) or energy <= 0.0:
        return Unknown("the record dissipates no energy")
    return 1e3 * drift / energy


def heat_lines(report: DynoReport) -> tuple[str, ...]:
    """Return a sentence on the effect of temperature for each build that has repeated runs at two temperatures."""
    found = ((variant.label, heat_effect(variant)) for variant in report.variants)
    return tuple(f"{label}: {effect}." for label, effect in found if effect)


# ---- Comparisons ----------------------------------------------------------------------------------------------------


def repeat_table(report: DynoReport) -> list[Block]:
    """Return mean and scatter of repeated runs."""
    rows = [
        (one.variant, str(len(one.runs)), one.stroke, one.speed, one.mean, one.deviation, one.spread,
         _share(one.deviation, one.mean))
        for one in repeats(report)
    ]  # fmt: skip
    columns = ("build", "runs", "stroke", "speed [m/s]", "mean force [N]", "standard deviation [N]",
               "largest minus smallest [N]", "deviation / mean [%] .2")  # fmt: skip
    return explained("", columns, rows)


def _share(part: Found, whole: Found) -> Found:
    if isinstance(part, Unknown) or isinstance(whole, Unknown) or whole == 0.0:
        return Unknown("the mean force is 0")
    return 100.0 * part / abs(whole)


def difference_table(report: DynoReport) -> list[Block]:
    """Return the forces of every build relative to the reference."""
    rows = [
        (one.variant, one.basis, one.stroke, one.speed, one.reference, one.force, one.change, one.percent)
        for one in differences(report)
    ]  # fmt: skip
    columns = (
        "build",
        "basis",
        "stroke",
        "speed [m/s]",
        "reference [N]",
        "force [N]",
        "difference [N]",
        "difference [%]",
    )
    return explained("", columns, rows)


def slope_differences(report: DynoReport) -> list[Block]:
    """Return the knees and slopes of every build relative to the reference."""
    rows = []
    base = report.reference
    for variant in report.variants[1:]:
        for basis in ("measured", "law"):
            entries, base_entries = representatives(variant, basis), representatives(base, basis)
            for stroke in STROKES if entries and base_entries else ():
                changes = [_change(entries, base_entries, stroke, name) for name in ("knee", "low", "high")]
                rows.append((variant.label, basis, stroke, *changes))
    columns = ("build", "basis", "stroke", "knee [m/s]", "slope below [N.s/m]", "slope above [N.s/m]")
    return explained("", columns, rows)


def _change(entries: Sequence[Entry], base_entries: Sequence[Entry], stroke: Stroke, name: str) -> Found:
    groups = (entries, base_entries)
    means = [mean_of(getattr(entry.strokes[stroke], name) for entry in group) for group in groups]
    for mean in means:
        if isinstance(mean, Unknown):
            return mean
    return float(means[0]) - float(means[1])  # type: ignore[arg-type]
