"""Layouts of a fourth attack on the reader: units behind blanks, texts between blanks, words in dates, ControlDesk."""

import datetime

import numpy as np
import pytest

from eightpost.rig import read_peak_velocity

from .layouts import (
    BUMP,
    COUNT,
    DROOP,
    SI,
    SPEED,
    US,
    F,
    T,
    V,
    X,
    cells,
    clock,
    column,
    matlab,
    peak_velocity_file,
    text,
)

H = "t [s],x [mm],v [mm/s],F [N]"
AT = datetime.datetime(2026, 11, 12, 10, 59, 59, 500000)
METRIC = [("t", "s"), ("x", "m"), ("v", "m/s"), ("F", "kN")]


def blanks(header, columns=SI, **options):
    """Return a writer of a table whose columns are separated by blanks."""
    return text(header, columns, sep=options.pop("sep", " "), suffix=".txt", **options)


def padded(header, columns=SI):
    """Return a writer of a table of a fixed width, aligned on the right."""
    return text(header, [[f"{c:>22}" for c in cells(*one)] if isinstance(one, tuple) else [f"{c:>22}" for c in one]
                         for one in columns], sep="", suffix=".txt")  # fmt: skip


def dated(pattern, *, start=AT, sep=",", header="Time,x [mm],v [mm/s],F [N]", quote="", days=0):
    """Return a writer of a table with dates and times, the second half of it some days later."""
    later = start + datetime.timedelta(days=days)
    stamps = [*clock(start, pattern)[: COUNT // 2], *clock(later, pattern)[COUNT // 2 :]]
    stamps = [f"{quote}{stamp}{quote}" for stamp in stamps]
    return text(header, [stamps, *SI[1:]], sep=sep)


def signal(name, samples, unit="", **more):
    return {"Name": name, "Type": "float64", "Data": samples, "Unit": unit, **more}


SIGNALS = [("Disp", 1e3 * X, "mm"), ("Vel", 1e3 * V, "mm/s"), ("Force", F, "N")]


def controldesk(names=("Disp", "Vel", "Force"), *, unit="s", axes=1, name="rec_001", has_index=True,
                empty_index=False, slow_first=False):  # fmt: skip
    """Return a writer of a recording of ControlDesk."""
    index = {"XIndex": np.zeros((0, 0)) if empty_index else 1.0} if has_index else {}
    signals = [signal(own, s, u, **index) for own, (_, s, u) in zip(names, SIGNALS, strict=True)]
    times = [signal("", T, unit), signal("", 2.0 * T, unit)][:axes]
    if axes > 1:
        slow = [signal("slow", F, "N", XIndex=2.0)]
        signals = [*slow, *signals] if slow_first else [*signals, *slow]
    content = {"X": times[0] if axes == 1 else np.array(times, dtype=object), "Y": np.array(signals, dtype=object),
               "Description": "run", "Capture": {"DateTime": "2026-11-12", "Length": float(COUNT)}}  # fmt: skip
    return matlab({name: content})


#: Read and refused in test_attacked_layouts.py.
READ = {
    # Units behind a blank
    "names and units, commas": text("Time s,Disp mm,Vel mm/s,Force N"),
    "names and units, semicolons": text("Time s;Disp mm;Vel mm/s;Force N", sep=";", decimal=","),
    "names and units, tabs": text("Time s\tDisp mm\tVel mm/s\tForce N", sep="\t"),
    "US units behind a blank": text("Time s,Position in,Velocity in/s,Load lbf,Temp F", US),
    "pounds behind a blank": text("Time sec,Disp in,Vel in/s,Load lbs", US[:4]),
    "words of two parts": text("Time s,Shock Disp in,Shock Vel in/sec,Damper Force lb,Temp deg F", US),
    "capitals behind a blank": text("TIME S,DISP MM,VEL MM/S,FORCE N"),
    "metres and kilonewtons behind a blank": text("t s,Position m,Speed m/s,Load kN", METRIC),
    "German with units behind a blank": text("Zeit s;Weg mm;Geschwindigkeit mm/s;Kraft N", sep=";", decimal=","),
    "kilograms behind a blank": text("Time s,Disp mm,Vel mm/s,Force kgf", [*SI[:3], ("F", "kgf")]),
    "milliseconds behind a blank": text("Time ms,Disp mm,Force N", [("t", "ms"), ("x", "mm"), ("F", "N")]),
    "a count beside a force in a unit": text("Time s,Disp mm,Vel mm/s,Load cell N,Load 2", [*SI, column("1")]),
    # Columns between blanks
    "blanks between names and units": blanks("Time s Disp mm Vel mm/s Force N"),
    "blanks, units in a row": blanks(["Time Disp Vel Force", "s mm mm/s N"]),
    "two blanks between names and units": text("Time s  Disp mm  Vel mm/s  Force N", sep="  ", suffix=".txt"),
    "fixed width": padded("Time [s]  Disp [mm]  Vel [mm/s]  Force [N]"),
    "fixed width, units behind a blank": padded("Time s  Disp mm  Vel mm/s  Force N"),
    "a word behind the numbers": blanks("t[s] x[mm] v[mm/s] F[N] Phase", [*SI, column("up")]),
    "a word before the numbers": blanks("Phase t[s] x[mm] v[mm/s] F[N]", [column("up"), *SI]),
    "a word between the numbers": blanks("t[s] Status x[mm] v[mm/s] F[N]", [SI[0], column("OK"), *SI[1:]]),
    "two words, decimal comma": blanks("t[s] x[mm] v[mm/s] F[N] A B", [*SI, column("a"), column("b")], decimal=","),
    "words, fixed width": padded("Time [s]  Disp [mm]  Vel [mm/s]  Force [N]  Stroke", [*SI, column("comp")]),
    "words that change": blanks("t[s] x[mm] v[mm/s] F[N] Side", [*SI, ["comp" if v > 0 else "reb" for v in V]]),
    "words below a preamble": blanks("t[s] x[mm] v[mm/s] F[N] Phase", [*SI, column("up")], above="Test 5 of 9\nA 2\n"),
    "words above a footer": blanks("t[s] x[mm] v[mm/s] F[N] Phase", [*SI, column("up")], below="End of test\n"),
    "date and time in two columns": blanks(
        "Date Time x[mm] v[mm/s] F[N]", [clock(AT, "%d.%m.%Y"), clock(AT), *SI[1:]]),
    "a time between blanks": blanks("Time x[mm] v[mm/s] F[N]", [clock(AT), *SI[1:]]),
    # Dates
    "day, month as a word": dated("%d-%b-%Y %H:%M:%S.%f"),
    "day, month as a word, blanks": dated("%d %b %Y %H:%M:%S.%f"),
    "day, whole month": dated("%d %B %Y %H:%M:%S.%f"),
    "month as a word, day": dated("%b %d %Y %H:%M:%S.%f"),
    "month as a word, day, comma": dated("%b %d, %Y %H:%M:%S.%f", quote='"'),
    "month as a word, tabs": dated("%b %d, %Y %H:%M:%S.%f", sep="\t", header="Time\tx [mm]\tv [mm/s]\tF [N]"),
    "weekday": dated("%A, %d %B %Y %H:%M:%S.%f", quote='"'),
    "short weekday": dated("%a %b %d %Y %H:%M:%S.%f"),
    "capitals": dated("12-NOV-2026 %H:%M:%S.%f"),
    "German month": dated("12. M\u00e4rz 2026 %H:%M:%S.%f"),
    "French month": dated("12 ao\u00fbt 2026 %H:%M:%S.%f"),
    "Spanish month": dated("12 dic 2026 %H:%M:%S.%f"),
    "year of two digits, dots": dated("%d.%m.%y %H:%M:%S.%f"),
    "year of two digits, slashes": dated("%m/%d/%y %H:%M:%S.%f"),
    "year of two digits, dashes": dated("%y-%m-%d %H:%M:%S.%f"),
    "year of two digits, month as a word": dated("%d-%b-%y %H:%M:%S.%f"),
    "half days": dated("%d-%b-%y %I:%M:%S.%f %p"),
    "half days past noon": dated("%m/%d/%y %I:%M:%S.%f %p", start=AT.replace(hour=12)),
    "slashes, year first": dated("%Y/%m/%d %H:%M:%S.%f"),
    "month as a word past midnight": dated("%d-%b-%Y %H:%M:%S.%f", start=AT.replace(hour=23, minute=59, second=59)),
    "year of two digits past midnight": dated("%d.%m.%y %H:%M:%S.%f", start=AT.replace(hour=23, minute=59, second=59)),
    "a T before the time": dated("%d-%b-%YT%H:%M:%S.%f"),
    # ControlDesk
    "a recording": controldesk(),
    "a recording with paths": controldesk(['"Model Root"/"Disp"/"Out1"', '"Model Root"/"Vel"/"Out1"',
                                           '"Model Root"/"Force"/"Out1"']),
    "a recording with paths of a platform": controldesk(
        ["Platform()://Rig/Disp/Value", "Platform()://Rig/Vel/Value", "Platform()://Rig/Force/Value"]),
    "a recording with two axes of time": controldesk(axes=2),
    "a recording of another name": controldesk(name="Dyno_5_mat"),
    "a recording with empty numbers of axes": controldesk(empty_index=True),
    "a recording with a slow signal first": controldesk(axes=2, slow_first=True),
    "a footer with a date": text(H, below="12-Nov-2026 11:00:01,end,,\n"),
}  # fmt: skip

REFUSED = {
    "a unit of another quantity behind a blank": (text("Time s,Disp N,Vel mm/s,Force mm"), "Force mm"),
    "a number behind a blank": (text("Time s,Disp mm,Vel mm/s,Force 2"), "has no unit"),
    "a factor before the unit": (text("Time s,Disp mm,Vel mm/s,Force 10 N"), "has no unit|Force 10 N"),
    "an unknown unit behind a blank": (text("Time s,Disp mm,Vel mm/s,Force Nm"), "--channel force=COLUMN.*Force Nm"),
    "a word in a row of numbers": (
        blanks("t[s] x[mm] v[mm/s] F[N]", [*SI[:3], ["x" if i == 300 else c for i, c in enumerate(cells("F", "N"))]]),
        "not a number"),
    "words with blanks": (
        blanks("t[s] x[mm] v[mm/s] F[N] Phase", [*SI, ["going up" if i % 7 else "up" for i in range(COUNT)]]),
        "columns"),
    "a date of three words between blanks": (
        blanks("Time x[mm] v[mm/s] F[N]", [clock(AT, "%d %b %Y %H:%M:%S.%f"), *SI[1:]]), "columns"),
    "no month": (dated("%d-Foo-%Y %H:%M:%S.%f"), "neither a number nor a time"),
    "a record over days": (dated("%d-%b-%Y %H:%M:%S.%f", days=2), "at other times than midnight"),
    "a record over days, year first": (dated("%Y/%m/%d %H:%M:%S.%f", days=2), "at other times than midnight"),
    "a date without a time": (dated("%d-%b-%Y"), "neither a number nor a time"),
    "day and month without a year": (dated("%d-%b %H:%M:%S.%f"), "neither a number nor a time"),
    "a month above twelve is a word": (dated("%d-Mon-%y %H:%M:%S.%f"), "neither a number nor a time"),
    "a recording without a unit of time": (controldesk(unit=""), "'time' has no unit"),
    "a recording without names": (controldesk(["a", "b", "c"]), "force"),
    "a recording without the axis of time of a signal": (controldesk(axes=2, has_index=False), "--channel time=COLUMN"),
    "a recording with equal names": (controldesk(["Rig/Force/Out1", "Rig2/Force/Out1", "x"]), "force|Force"),
}  # fmt: skip


# ---- Clicks above the names of peak-velocity tables -----------------------------------------------------------------

COLUMNS = [SPEED, BUMP, DROOP, 1.2 * BUMP, 1.3 * DROOP]
NAMES = "Speed [mm/s],Comp [N],Reb [N],Comp [N],Reb [N]"

#: Rows above the names, and the settings that they give.
ABOVE = {
    "each column": (",3 clicks,3 clicks,6 clicks,6 clicks", ["3 clicks", "6 clicks"]),
    "merged cells": (",3 clicks,,6 clicks,", ["3 clicks", "6 clicks"]),
    "a name of the row": ("Setting,3,3,6,6", ["3", "6"]),
    "words": (",soft,,hard,", ["soft", "hard"]),
    "no settings, a line of a fact": ("Date,12.11.2026", [None, "(2)"]),
    "below a line of facts": ("Shock ID: 7\n,3 clicks,,6 clicks,", ["3 clicks", "6 clicks"]),
}


@pytest.mark.parametrize("layout", ABOVE)
def test_row_above_repeated_names_is_the_setting_of_its_columns(layout, tmp_path):
    above, settings = ABOVE[layout]
    first, second = read_peak_velocity(peak_velocity_file(tmp_path, f"{above}\n{NAMES}", COLUMNS))
    assert [first.clicks, second.clicks] == settings
    np.testing.assert_allclose(first.compression, BUMP)
    np.testing.assert_allclose(second.rebound, 1.3 * DROOP)
