"""One virtual record in the layouts of dynamometer rooms: each writer makes a file from the same samples."""

import datetime
from pathlib import Path

import h5py
import numpy as np
import scipy.io
import xlsxwriter
from nptdms import ChannelObject, TdmsWriter

RATE, COUNT = 400.0, 480
T = np.arange(COUNT) / RATE
_PHASE = 2.0 * np.pi * 2.5 * T
X = 0.02 * np.sin(_PHASE)  # [m]
V = 0.02 * 2.0 * np.pi * 2.5 * np.cos(_PHASE)  # [m/s]
F = 120.0 + 900.0 * np.tanh(V / 0.08) + 1500.0 * V  # [N]
HEAT = 300.0 + 0.5 * T  # [K]

FACTORS = {
    "s": 1.0, "ms": 1e3, "mm": 1e3, "m": 1.0, "in": 1 / 0.0254, "cm": 100.0,
    "mm/s": 1e3, "m/s": 1.0, "in/s": 1 / 0.0254,
    "N": 1.0, "kN": 1e-3, "lbf": 1 / 4.4482216152605, "kgf": 1 / 9.80665, "K": 1.0,
}  # fmt: skip


def values(channel, unit):
    """Return a channel in a unit."""
    si = {"t": T, "x": X, "v": V, "F": F, "T": HEAT}[channel]
    if unit == "degC":
        return si - 273.15
    if unit == "degF":
        return (si - 273.15) * 1.8 + 32.0
    return si * FACTORS[unit]


def rows(columns):
    """Return the cells of the rows; each column is (channel, unit) or a list of cells."""
    found = [c if isinstance(c, list) else [f"{x:.12g}" for x in values(*c)] for c in columns]
    return [list(row) for row in zip(*found, strict=True)]


SI = [("t", "s"), ("x", "mm"), ("v", "mm/s"), ("F", "N")]
US = [("t", "s"), ("x", "in"), ("v", "in/s"), ("F", "lbf"), ("T", "degF")]


def text(header, columns=SI, *, sep=",", above="", below="", decimal=".", encoding="utf-8", suffix=".csv"):
    """Return a writer of a text file; `header` is a line or a list of lines."""

    def write(folder: Path) -> Path:
        path = folder / f"run{suffix}"
        lines = [sep.join(row) for row in rows(columns)]
        body = "\n".join(lines)
        body = body if decimal == "." else body.replace(".", decimal)
        header_text = "\n".join(header) if isinstance(header, list) else header
        path.write_bytes(f"{above}{header_text}\n{body}\n{below}".encode(encoding))
        return path

    return write


def clock(start=datetime.datetime(2024, 5, 3, 10, 59, 59, 500000), pattern="%H:%M:%S.%f"):
    """Return the times as texts."""
    return [(start + datetime.timedelta(seconds=float(t))).strftime(pattern) for t in T]


def column(cell):
    """Return a column with the same cell in every row."""
    return [cell] * COUNT


def grouped(channel, unit, *, group=",", mark=".", quote='"'):
    """Return a channel with thousands separators."""
    cells = [f"{x:,.9f}" for x in values(channel, unit)]
    swapped = [c.replace(",", "#").replace(".", mark).replace("#", group) for c in cells]
    return [f"{quote}{c}{quote}" for c in swapped]


def matlab(content):
    """Return a writer of a .mat file."""

    def write(folder: Path) -> Path:
        path = folder / "run.mat"
        scipy.io.savemat(path, content)
        return path

    return write


def matlab73(content):
    """Return a writer of a MATLAB 7.3 file: HDF5 with the attributes that MATLAB writes, matrices transposed."""

    def write(folder: Path) -> Path:
        path = folder / "run.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, value in content.items():
                _hdf5(file, name, value)
        head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
        with path.open("r+b") as stream:
            stream.write(head.ljust(512, b"\0"))
        return path

    return write


def _hdf5(group, name, value):
    if isinstance(value, dict):
        child = group.create_group(name)
        child.attrs["MATLAB_class"] = np.bytes_("struct")
        for key, one in value.items():
            _hdf5(child, key, one)
    elif isinstance(value, str):
        data = group.create_dataset(name, data=np.array([[ord(letter)] for letter in value], dtype=np.uint16))
        data.attrs["MATLAB_class"] = np.bytes_("char")
    else:
        data = group.create_dataset(name, data=np.atleast_2d(value).T if np.ndim(value) == 2 else np.atleast_2d(value))
        data.attrs["MATLAB_class"] = np.bytes_("double")


def cells(channel, unit, form=".12g", *, comma=False):
    """Return a channel in a number format, with a decimal comma if wanted."""
    found = [format(value, form) for value in values(channel, unit)]
    return [cell.replace(".", ",") for cell in found] if comma else found


def file_with(folder, name, content, encoding="utf-8"):
    path = folder / name
    path.write_bytes(content.encode(encoding))
    return path


def sheets(contents, *, merged=(), hidden=()):
    """Return a writer of a workbook with rows of cells by sheet, merged ranges of the first sheet and hidden sheets."""

    def write(folder):
        path = folder / "run.xlsx"
        with xlsxwriter.Workbook(path, {"default_date_format": "hh:mm:ss.000"}) as book:
            made = [(book.add_worksheet(name), grid) for name, grid in contents.items()]
            for sheet, grid in made:
                for i, row in enumerate(grid):
                    for j, cell in enumerate(row):
                        if cell is not None:
                            sheet.write(i, j, cell)
                if sheet.name in hidden:
                    sheet.hide()
                else:
                    sheet.activate()
                    sheet.set_first_sheet()
            for one in merged:
                made[0][0].merge_range(*one)
        return path

    return write


def grid(factors=(1.0, 1.0, 1.0, 1.0)):
    return [[factor * value for factor, value in zip(factors, row, strict=True)]
            for row in zip(*(values(*one) for one in SI), strict=True)]  # fmt: skip


def groups(contents):
    """Return a writer of a .tdms file with (name, unit, samples) by group, and properties if there are more."""

    def write(folder):
        path = folder / "run.tdms"
        with TdmsWriter(path) as writer:
            writer.write_segment([
                ChannelObject(group, name, np.asarray(samples),
                              properties=({"unit_string": unit} if unit else {}) | dict(*more))
                for group, channels in contents.items() for name, unit, samples, *more in channels
            ])  # fmt: skip
        return path

    return write


#: A table of peak velocities: speeds [mm/s], forces in compression and rebound [N].
SPEED = 1e3 * np.array([0.05, 0.1, 0.15, 0.2, 0.25])
BUMP, DROOP = np.array([300.0, 520.0, 700.0, 850.0, 1000.0]), np.array([-420.0, -780.0, -1080.0, -1330.0, -1560.0])


def peak_velocity_file(folder, header, columns):
    """Write a table of peak velocities below a header of one line or more."""
    lines = [",".join(f"{cell:.9g}" for cell in row) for row in zip(*columns, strict=True)]
    return file_with(folder, "run.csv", "\n".join([header, *lines]) + "\n")
