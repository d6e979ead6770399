"""Tables of static curves for other tools: force over damper velocity, over clicks, over temperature."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite
from pathlib import Path

import numpy as np
from scipy.io import savemat

from eightpost import __version__
from eightpost.array_types import Array
from eightpost.errors import FileFormatError, InputError, ParameterError
from eightpost.files import atomic_path, sha256_of
from eightpost.ident.shock.simulation import simulate
from eightpost.shock import Polylinear, Shock, law_title, own_parameters, parameter_units, read_shock
from eightpost.shock.file import ABOUT as SETTING
from eightpost.shock.file import setting_text
from eightpost.shock.law import ShockLaw, valve_force
from eightpost.signals import TimeSeries
from eightpost.units import convert

# ==== Tables: force over damper velocity, and over a setting =========================================================

#: Number of velocities on each side at which a curve is computed before points are chosen, and in each transition.
_FINE, _FINE_TRANSITION = 1500, 40
#: Bounds of the interpolation error, relative to the range of force [1].
SMALLEST_ERROR, LARGEST_ERROR = 1e-5, 0.05
#: Share of the permitted error that the choice of points uses; the rest covers what lies between the fine points.
_USED = 0.8
#: Shortest distance of two velocities, relative to the length of a side [1].
_CLOSEST = 1e-9
#: Amplitude [m] of the sine on which a law without a record is compared with its table, and samples per period.
_AMPLITUDE, _SAMPLES = 0.025, 500


@dataclass(frozen=True, slots=True)
class TableSetting:
    """Name and values of the quantity in which several shocks differ, e.g. "rebound clicks" or "temperature [degC]"."""

    name: str
    values: tuple[float, ...]

    @classmethod
    def parse(cls, text: str, shocks: int) -> TableSetting:
        """Return a setting from NAME=VALUE,VALUE,... with a value for each shock, or two or more for one shock.

        Raises:
            InputError: The text has another form, or the values are not distinct finite numbers of this count.
        """
        name, equals, listed = text.rpartition("=")
        if not equals or not name.strip():
            raise InputError(f"--over {text!r} has no name; write NAME=VALUE,VALUE, e.g. --over clicks=0,4,8")
        try:
            values = tuple(float(word) for word in listed.split(","))
        except ValueError:
            raise InputError(f"--over {text!r}: {listed!r} is not a list of numbers; write e.g. clicks=0,4,8") from None
        if not all(isfinite(value) for value in values) or len(set(values)) != len(values):
            raise InputError(f"--over {text!r}: the values must be finite and different from each other")
        if shocks == 1 and len(values) < 2:
            raise InputError(f"--over {text!r} has one value; give two or more, e.g. rebound=0,4,8")
        if shocks not in (1, len(values)):
            raise InputError(f"--over {text!r} has {len(values)} values for {shocks} shocks; give one value per shock")
        return cls(name.strip(), values)

    @property
    def axis(self) -> str:
        """Name without the unit in brackets."""
        return self.name.partition("[")[0].strip()

    def in_unit(self, unit: str) -> tuple[float, ...]:
        """Return the values in a unit; they have that unit if the name states none, as in `temperature [degC]`.

        Raises:
            UnknownUnitError: The stated unit is unknown or of another dimension.
        """
        stated = self.name.partition("[")[2].rstrip("] ")
        return tuple(convert(value, stated, unit) for value in self.values) if stated else self.values


@dataclass(frozen=True, slots=True, eq=False)
class ShockTable:
    """Static curves of one or more shocks at common velocities."""

    names: tuple[str, ...]  #: Name of each shock.
    velocity: Array  #: Damper velocities (K,) [m/s], positive in compression, strictly increasing, with 0.
    force: Array  #: Static forces (S, K) [N], positive in compression.
    setting: TableSetting | None  #: Quantity in which the shocks differ, in increasing order; None for one shock.
    error: float  #: Largest error of linear interpolation by velocity, relative to the range of force of the curve [1].
    remarks: tuple[str, ...]  #: Sentences on the contents of the table and on what it omits.


def shock_table(
    sources: Sequence[Path], *, over: str | None = None, error: float = 1e-3, speed: float | None = None
) -> ShockTable:
    """Return the table of the static curves of shock files.

    Args:
        sources: Shock files.
        over: Quantity in which several shocks differ, or an adjuster (or `temperature`) of one shock that was fitted
            over its settings, as NAME=VALUE,VALUE,...; None for one shock at its reference setting.
        error: Permitted error of linear interpolation by velocity, relative to the range of force [1].
        speed: Highest velocity on both sides [m/s]; None for the fitted range, of all shocks if there are several.

    Raises:
        InputError: An argument is not possible, or several shocks have no setting.
        FileFormatError: A file is not a shock.
    """
    shocks = [read_shock(path) for path in sources]
    if len(shocks) > 1 and over is None:
        raise InputError(f"{len(shocks)} shocks make a table over a setting; give it, e.g. --over clicks=0,4,8")
    files = list(sources)
    setting = None if over is None else TableSetting.parse(over, len(shocks))
    if len(shocks) == 1 and over is not None and setting is not None:
        shocks = _at_settings(shocks[0], setting, over)
        files *= len(shocks)
    order = range(len(shocks)) if setting is None else np.argsort(setting.values).tolist()
    chosen, files = [shocks[k] for k in order], [files[k] for k in order]
    if setting is not None:
        setting = TableSetting(setting.name, tuple(setting.values[k] for k in order))
    velocity, force, found = table_points([shock.law for shock in chosen], error=error, speed=speed)
    remarks = _remarks(chosen, files, setting, found, velocity, force)
    return ShockTable(tuple(shock.name for shock in chosen), velocity, force, setting, found, remarks)


def _at_settings(shock: Shock, setting: TableSetting, over: str) -> list[Shock]:
    """Return a shock at the values of one of its settings; the others are at their reference."""
    if shock.settings is None:
        raise InputError(
            f"--over {over!r}: {shock.name!r} was measured at one setting; omit --over, name the shocks of the other "
            "settings, or fit a table of them (eightpost fit TABLE.toml)"
        )
    axes = {axis.name: axis for axis in shock.settings.axes}
    if setting.axis not in axes:
        raise InputError(f"--over {over!r}: {shock.name!r} has no {setting.axis!r}, but {', '.join(axes)}")
    axis = axes[setting.axis]
    values = setting.in_unit(axis.unit) if axis.is_temperature else setting.values
    if axis.is_temperature:
        return [shock.at(temperature=value) for value in values]
    return [shock.at(clicks={axis.name: value}) for value in values]


# ---- Choice of velocities -------------------------------------------------------------------------------------------


def table_points(
    laws: Sequence[ShockLaw], *, error: float = 1e-3, speed: float | None = None
) -> tuple[Array, Array, float]:
    """Return velocities (K,) [m/s], forces (S, K) [N] and the largest relative error of linear interpolation [1].

    The points lie on the curves and are dense where a curve bends, so a curve that rises gives a table that rises. The
    error is measured between the points at twice as many velocities as the choice used.

    Args:
        laws: Shock laws; the same velocities serve all.
        error: Permitted error relative to each curve's range of force [1].
        speed: Highest velocity on both sides [m/s]; None for the fitted range.

    Raises:
        ParameterError: The error or the speed is out of range, or a curve has no force.
    """
    if not SMALLEST_ERROR <= error <= LARGEST_ERROR:
        raise ParameterError(
            f"the interpolation error is {100.0 * error:g} %; it must be between {100.0 * SMALLEST_ERROR:g} and "
            f"{100.0 * LARGEST_ERROR:g} % of the range of force"
        )
    if speed is not None and not (isfinite(speed) and 1e-3 <= speed <= 100.0):
        raise ParameterError(f"the highest velocity is {speed:g} m/s; it must be between 0.001 and 100 m/s")
    fine = _fine_velocities(laws, speed)
    force = _forces(laws, fine)
    span = np.ptp(force, axis=1)
    if not (span > 0.0).all():
        raise ParameterError("a static curve is zero at all velocities of the table; check the scales of its port")
    scaled = force / span[:, None]
    kept = _chosen(fine, scaled, _USED * error, [0, int(np.searchsorted(fine, 0.0)), fine.size - 1])
    middle = 0.5 * (fine[1:] + fine[:-1])
    every, exact = np.concatenate((fine, middle)), np.hstack((force, _forces(laws, middle)))
    linear = np.stack([np.interp(every, fine[kept], row) for row in force[:, kept]])
    found = float((np.abs(linear - exact).max(axis=1) / span).max())
    return fine[kept], force[:, kept], found


def _forces(laws: Sequence[ShockLaw], velocity: Array) -> Array:
    return np.array([[valve_force(law.valve, one) for one in velocity.tolist()] for law in laws])


def _fine_velocities(laws: Sequence[ShockLaw], speed: float | None) -> Array:
    """Return many velocities over the range of the table, with 0 and the ends of every curve's pieces."""
    ends = [speed or max(law.curve.compression_speed for law in laws), speed or max(_rebound(laws))]
    sides = []
    for sign, end in zip((1.0, -1.0), ends, strict=True):
        places = [np.linspace(0.0, end, _FINE), end * np.linspace(0.0, 1.0, _FINE // 3) ** 3]
        for law in laws:
            curve, half = law.curve, 0.5 * law.curve.transition_width
            edges = (curve.transition_speed - half, curve.transition_speed + half)
            places += [np.linspace(*edges, _FINE_TRANSITION), np.array([curve.compression_speed, curve.rebound_speed])]
            places.append(sign * np.array(curve.knot_velocity))
        side = np.concatenate(places)
        side = np.unique(side[(side >= 0.0) & (side <= end)])
        distinct = np.concatenate(([True], np.diff(side) > _CLOSEST * end))
        sides.append(sign * side[distinct])
    return np.asarray(np.unique(np.concatenate(sides) + 0.0))


def _rebound(laws: Sequence[ShockLaw]) -> list[float]:
    return [law.curve.rebound_speed for law in laws]


def _chosen(x: Array, y: Array, error: float, needed: list[int]) -> list[int]:
    """Return the indices of points between which straight lines through rows of y (S, K) err by at most `error`."""
    kept = set(needed)
    waiting = list(pairwise(needed))
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        share = (x[first + 1 : last] - x[first]) / (x[last] - x[first])
        line = y[:, first, None] + share * (y[:, last] - y[:, first])[:, None]
        off = np.abs(y[:, first + 1 : last] - line).max(axis=0)
        worst = int(np.argmax(off))
        if off[worst] > error:
            middle = first + 1 + worst
            kept.add(middle)
            waiting += [(first, middle), (middle, last)]
    return sorted(kept)


# ---- Remarks, which every format states in its comments -------------------------------------------------------------


def _remarks(
    shocks: Sequence[Shock],
    files: Sequence[Path],
    setting: TableSetting | None,
    error: float,
    velocity: Array,
    force: Array,
) -> tuple[str, ...]:
    lines = [
        f"static curve by eightpost {__version__}: force over velocity at the damper, without the motion ratio",
        f"{velocity.size} velocities from {velocity[0]:.6g} to {velocity[-1]:.6g} m/s in compression; linear "
        f"interpolation is within {100.0 * error:.2g} % of the range of force",
    ]
    if setting is not None:
        known = (
            "is that of the tool, not of the fit" if len(set(files)) == 1 else "is an assumption: it was not measured"
        )
        lines.append(f"interpolation between the values of {setting.name} {known}")
    for k, (shock, path) in enumerate(zip(shocks, files, strict=True)):
        value = "" if setting is None else f"{setting.name} = {setting.values[k]:g}: "
        lines += [f"{value}{line}" for line in _shock_remarks(shock, path)]
        if (falls := velocity[1:][np.diff(force[k]) < 0.0]).size:
            lines.append(f"{value}the curve falls at {falls[0]:.4g} m/s, and so does the table")
    return tuple(re.sub(r"\s+", " ", line).encode("ascii", "replace").decode("ascii") for line in lines)


def _own(law: ShockLaw) -> str:
    """Return the law's own parameters with their units; those of several values have spaces between them."""
    units, found = parameter_units(type(law)), []
    for name in own_parameters(type(law)):
        value = getattr(law, name)
        numbers = " ".join(f"{one:.6g}" for one in (value if isinstance(value, tuple) else (value,)))
        found.append(f"{name} {numbers} {units[name]}")
    return ", ".join(found) or "none"


def _shock_remarks(shock: Shock, path: Path) -> list[str]:
    law = shock.law
    port, curve = law.port, law.curve
    lines = [
        f"{shock.name} ({path.name}, sha256 {sha256_of(path)})",
        f"law {law_title(shock.law_name)}; its own parameters, which have no effect on the table: {_own(law)}",
        _lost(shock),
        f"not in the table: gas force {port.gas_preload:.6g} N at the reference with {port.gas_stiffness:.6g} N/m, "
        f"seal friction {port.seal_friction:.6g} N",
        f"fitted from -{curve.rebound_speed:.6g} to {curve.compression_speed:.6g} m/s, straight lines beyond",
        f"scales {port.compression_scale:.6g} in compression and {port.rebound_scale:.6g} in rebound are applied; "
        f"motion ratio {port.motion_ratio:.6g} is not",
    ]
    if shock.validity is not None:
        reasons = (*shock.validity.edits, *shock.validity.verdict.about(SETTING).reasons)
        lines += [f"{reason.grade.value}: {reason}" for reason in reasons]
    if shock.settings is not None:
        at = setting_text(shock.settings, shock.settings.reference)
        lines.append(f"the curve is that of the reference setting, {at}; choose others with --over")
    lines += [
        f"condition: {name} {value}" for name, value in shock.conditions.items() if isinstance(value, str | float)
    ]
    return lines


def _lost(shock: Shock) -> str:
    """Return the error of the table, which has no loop, and that of the law, on the fit's records or on a sine."""
    law = shock.law
    if "percent_of_static_curve" in shock.fit:
        both = f"{shock.fit['percent_of_static_curve']:.2g} %, that of the law {shock.fit['percent']:.2g} %"
        return f"error of this table on the records of the fit: {both} of the force's standard deviation"
    speed = min(law.curve.compression_speed, law.curve.rebound_speed)
    phase = np.linspace(0.0, 4.0 * np.pi, 2 * _SAMPLES + 1)
    motion = {"velocity": ("m/s", speed * np.cos(phase)), "displacement": ("m", _AMPLITUDE * np.sin(phase))}
    series = TimeSeries.from_channels(phase * _AMPLITUDE / speed, motion)
    force, static = (simulate(one, series)[_SAMPLES:] for one in (law, Polylinear(law.curve, port=law.port)))
    share = float(np.sqrt(np.mean((static - force) ** 2)) / np.std(force))
    where = f"the law's own loop, a sine of {1e3 * _AMPLITUDE:g} mm and {speed:.3g} m/s"
    return f"error of this table on {where}: {100.0 * share:.2g} % of the force's standard deviation"


# ==== Formats; docs/how_to/exports.md states where each is from ======================================================


@dataclass(frozen=True, slots=True)
class TableFormat:
    """A file format of tables."""

    title: str  #: Tool that reads it.
    suffix: str  #: Suffix by which the format is chosen; empty if it must be named.
    is_rebound_positive: bool  #: Whether velocity and force are positive in rebound.
    has_settings: bool  #: Whether a file can contain several shocks.
    text: Callable[[ShockTable], str] | None  #: Function that returns the content of a file; None for a binary format.


def write_shock_table(path: Path, table: ShockTable, name: str | None = None) -> str:
    """Write a table, and return the name of the tool, the convention of signs and the units.

    Raises:
        FileFormatError: The suffix is not that of a format.
        InputError: The format has no name in `TABLE_FORMATS`, or takes a single shock.
    """
    chosen = table_format(path, name)
    if table.setting is not None and not chosen.has_settings:
        can = ", ".join(key for key, each in TABLE_FORMATS.items() if each.has_settings)
        raise InputError(
            f"{path}: a file for {chosen.title} has one shock, not {len(table.names)}; export each shock to a file of "
            f"its own, or choose one of the formats {can}"
        )
    signs = "positive in rebound" if chosen.is_rebound_positive else "positive in compression"
    if chosen is TABLE_FORMATS["carmaker"]:
        signs = "positive in both tables, Damp_Push in compression and Damp_Pull in rebound"
    units = "mm/s and N" if chosen is TABLE_FORMATS["dpr"] else "m/s and N"
    convention = f"velocity and force are {signs}, in {units}"
    shown = replace(_reversed(table) if chosen.is_rebound_positive else table, remarks=(*table.remarks, convention))
    with atomic_path(path) as temporary:
        if chosen.text is None:
            savemat(temporary, _variables(shown))
        else:
            temporary.write_text(chosen.text(shown), encoding="ascii", newline="\n")
    return f"{chosen.title}: {convention}"


def table_format(path: Path, name: str | None = None) -> TableFormat:
    """Return the format of a name, or of the suffix of a path.

    Raises:
        FileFormatError: No name is given, and the suffix is not that of a format.
        InputError: There is no format of this name.
    """
    if name is not None:
        if name not in TABLE_FORMATS:
            raise InputError(f"there is no table format {name!r}; the formats are {', '.join(TABLE_FORMATS)}")
        return TABLE_FORMATS[name]
    for each in TABLE_FORMATS.values():
        if each.suffix and each.suffix == path.suffix.lower():
            return each
    suffixes = ", ".join(f"{each.suffix} ({key})" for key, each in TABLE_FORMATS.items() if each.suffix)
    raise FileFormatError(
        f"a shock is exported to a file that ends in {suffixes}; change the suffix, or give --format", path=path
    )


def _reversed(table: ShockTable) -> ShockTable:
    """Return the table with velocity and force positive in rebound."""
    # 0.0 - x has no negative zero.
    return replace(table, velocity=0.0 - table.velocity[::-1], force=0.0 - table.force[:, ::-1])


# ---- Text formats ---------------------------------------------------------------------------------------------------


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(lines) + "\n"


def _comments(mark: str, table: ShockTable) -> list[str]:
    return [f"{mark} {remark}" for remark in table.remarks]


def _rows(columns: Sequence[Array], separator: str) -> list[str]:
    """Return rows of numbers with all digits that a double has."""
    return [separator.join(repr(number) for number in row) for row in np.column_stack(columns).tolist()]


def _csv(table: ShockTable) -> str:
    if table.setting is None:
        names = ["force [N]"]
    else:
        word = table.setting.name.replace(",", " ").replace("[", "(").replace("]", ")")
        names = [f"force at {word} = {value!r} [N]" for value in table.setting.values]
    header = ",".join(["velocity [m/s]", *names])
    return _lines([*_comments("#", table), header, *_rows([table.velocity, *table.force], ",")])


def _modelica(table: ShockTable) -> str:
    columns, rows = 1 + len(table.force), table.velocity.size
    first = []
    if table.setting is not None:
        first, rows = [" ".join(repr(value) for value in (0.0, *table.setting.values))], rows + 1
    body = _rows([table.velocity, *table.force], " ")
    block = "CombiTable1Ds" if table.setting is None else f"CombiTable2Ds, u1 = velocity, u2 = {table.setting.name}"
    usage = f'# for Modelica.Blocks.Tables.{block}, with tableName="shock"'
    return _lines(["#1", *_comments("#", table), usage, f"double shock({rows},{columns})", *first, *body])


def _matlab(table: ShockTable) -> str:
    lines = [*_comments("%", table), f"shock.velocity = [{'; '.join(_rows([table.velocity], ' '))}];"]
    lines += ["shock.force = [", *_rows(list(table.force), " "), "];"]
    if table.setting is not None:
        values = " ".join(repr(value) for value in table.setting.values)
        lines += [f"shock.setting = [{values}];", f"shock.setting_name = '{_quoted(table.setting.name)}';"]
    return _lines(lines)


def _quoted(text: str) -> str:
    return text.replace("'", "''")


def _adams(table: ShockTable) -> str:
    units = {"LENGTH": "mm", "ANGLE": "degrees", "FORCE": "newton", "MASS": "kg", "TIME": "second"}
    return _lines(
        [
            *_block("MDI_HEADER", {"FILE_TYPE": "'dpr'", "FILE_VERSION": "4.0", "FILE_FORMAT": "'ASCII'"}),
            *_comments("$", table),
            *_block("UNITS", {name: f"'{unit}'" for name, unit in units.items()}),
            *_block("CURVE", {}),
            "{ vel force }",
            *_rows([1e3 * table.velocity, table.force[0]], " "),
        ]
    )


def _block(name: str, values: dict[str, str]) -> list[str]:
    return [f"${name:->75}", f"[{name}]", *(f" {key} = {value}" for key, value in values.items())]


def _carmaker(table: ShockTable) -> str:
    lines = _comments("##", table)
    lines.append("## front axle; write SuspR instead of SuspF for the rear axle")
    for key, sign in (("Damp_Push", 1.0), ("Damp_Pull", -1.0)):
        side = np.flatnonzero(sign * table.velocity >= 0.0)[:: int(sign)]
        rows = _rows([sign * table.velocity[side] + 0.0, sign * table.force[0, side] + 0.0], " ")
        lines += [f"SuspF.{key}.Amplify = 1.0", f"SuspF.{key}:", *(f"\t{row}" for row in rows)]
    return _lines(lines)


# ---- MATLAB ---------------------------------------------------------------------------------------------------------


def _variables(table: ShockTable) -> dict[str, object]:
    """Return the variables of a .mat file: breakpoints and table of Simulink's lookup tables."""
    setting = {} if table.setting is None else _setting_variables(table.setting)
    comments = np.array(table.remarks, dtype=object).reshape(-1, 1)
    return {"velocity": table.velocity[:, None], "force": table.force.T, **setting, "comments": comments}


def _setting_variables(setting: TableSetting) -> dict[str, object]:
    return {"setting": np.array(setting.values)[None], "setting_name": setting.name}


#: All formats by name.
TABLE_FORMATS = {
    "csv": TableFormat("CSV", ".csv", False, True, _csv),
    "mat": TableFormat("Simulink (.mat)", ".mat", False, True, None),
    "m": TableFormat("Simulink (.m)", ".m", False, True, _matlab),
    "modelica": TableFormat("Modelica", ".txt", False, True, _modelica),
    "dpr": TableFormat("Adams (TeimOrbit)", ".dpr", True, False, _adams),
    "carmaker": TableFormat("CarMaker", "", False, False, _carmaker),
}
