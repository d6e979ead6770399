"""Tables of static curves in the formats of other tools; docs/how_to/exports.md states where each format is from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.io import savemat

from eightpost.array_types import Array
from eightpost.errors import FileFormatError, InputError
from eightpost.files import atomic_path
from eightpost.ident.exports.shock_table import Setting, ShockTable


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

    Args:
        path: Path of the file; it is replaced completely or not at all.
        table: Table to write.
        name: Name of the format; None chooses it by the suffix of the path.

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


def _setting_variables(setting: Setting) -> dict[str, object]:
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
