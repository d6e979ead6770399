"""Tables of the shock bank of chapter 7: numbers of setups, shim sets, and builds with their nominal dampings."""

from __future__ import annotations

from dissertation.effort import Effort
from dissertation.findings import Findings
from eightpost.units import si_factor
from eightpost.virtual import BUILDS, shim_build
from eightpost.virtual.valves import SHIM_SETS


def table_7_1(_: Effort) -> Findings:
    """N^4 setups of 30 s each."""
    counts = {n: n**4 for n in range(1, 11)}
    values: dict[str, float] = {f"setups/{n}": count for n, count in counts.items()}
    return Findings(values | {f"hours/{n}": count * 30.0 / 3600.0 for n, count in counts.items()})


def table_7_2(_: Effort) -> Findings:
    """Shim sets of the virtual dynamometer."""
    inch = si_factor("in")
    return Findings(
        {f"shim {k}/{code}": t * inch for code, row in SHIM_SETS.items() for k, t in enumerate(row, start=1)}
    )


def table_7_3(_: Effort) -> Findings:
    """Builds with their nominal dampings."""
    nominal = {code: shim_build(f"{code}/{code}").nominal_damping() for code in ("AA", "B", "C")}
    expected = {"AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C"}
    return Findings(
        {"builds": len(BUILDS)} | nominal,
        {"names": (set(BUILDS) == expected, f"{len(BUILDS)} builds: " + ", ".join(BUILDS))},
    )


COMPUTATIONS = {
    "table-7.1": table_7_1,
    "table-7.2": table_7_2,
    "table-7.3": table_7_3,
}
