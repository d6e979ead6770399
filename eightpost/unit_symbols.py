"""Translation of unit symbols from files and users into pint's notation."""

from __future__ import annotations

import re

# Spellings in file headers that pint would read differently. Here lb is a pound-force, and lbm is the mass.
_SPELLINGS = {
    "lb": "lbf", "lbs": "lbf", "lbsf": "lbf", "#": "lbf", "sec": "s", "secs": "s", "seconds": "s", "msec": "ms",
    "inch": "in", "inches": "in", '"': "in", "ips": "in/s", "in/sec": "in/s", "mm/sec": "mm/s", "m/sec": "m/s",
    "g": "g_0", "g's": "g_0", "gs": "g_0", "c": "degC", "degc": "degC", "°c": "degC", "f": "degF", "degf": "degF",
    "°f": "degF", "°": "deg", "-": "1", "": "1", "newton": "N", "newtons": "N",
    "click": "1", "clicks": "1",
}  # fmt: skip


def expression(unit: str) -> str:
    """Return a unit symbol in pint's notation: `N.m` -> `N*m`, `m/s2` -> `m/s**2`; empty for a dimensionless unit."""
    text = unit.strip()
    text = _SPELLINGS.get(text.lower() if text.lower() in _SPELLINGS and text not in ("C", "F") else text, text)
    # Upper and lower case differ: Nm is a torque, nm a length.
    text = {"C": "degC", "F": "degF", "Nm": "N.m", "kNm": "kN.m", "Nmm": "N.mm"}.get(text, text)
    text = re.sub(r"\b(lbs|lb)\b(?!m|f)", "lbf", text)
    text = re.sub(r"(?<![\w.])g(?![\w])", "g_0", text)
    text = text.replace("²", "2").replace("³", "3").replace("·", ".").replace("^", "")
    text = re.sub(r"(?<=[A-Za-z)])\s*[.\-]\s*(?=[A-Za-z(])", "*", text)
    text = re.sub(
        r"(?<=[A-Za-z])(\d)",
        r"**\1",
        text.replace("g_0", "standard_gravity").replace("g_n", "standard_gravity"),
    )
    text = re.sub(r"(?<=[a-z])\s+(?=[a-z])", "*", text)
    return "" if text == "1" else text
