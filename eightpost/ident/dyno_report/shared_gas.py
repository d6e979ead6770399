"""Gas force of a slow run, subtracted from the fast runs of the same shock at the same setting.

The force of a fast sine at zero velocity is not its gas force, because it contains what the shock does not release at
the ends of the stroke. A slow run of the same build, clicks and gas pressure shows the gas force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eightpost.ident.dyno_report.cycles import cycles_of
from eightpost.ident.dyno_report.entry import Entry, advanced, strokes_of
from eightpost.ident.dyno_report.found import Unknown
from eightpost.ident.dyno_report.velocity_curve import curve_of_series
from eightpost.signals import TimeSeries


def with_gas_of_slow_runs(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Return the entries; fast runs have the gas force of a slow run of their setting subtracted, if there is one."""
    slow = [entry for entry in entries if entry.kind == "run" and isinstance(entry.slow.gas_force, float)]
    found = []
    for entry in entries:
        is_fast = entry.kind == "run" and isinstance(entry.slow.gas_force, Unknown)
        donor = next((one for one in slow if _has_same_setting(one, entry)), None) if is_fast else None
        found.append(entry if donor is None else _without_gas(entry, donor))
    return tuple(found)


def _has_same_setting(first: Entry, second: Entry) -> bool:
    a, b = first.setting, second.setting
    return (a.build, a.clicks, a.gas_pressure) == (b.build, b.clicks, b.gas_pressure)


def _middle(series: TimeSeries) -> float:
    path = series["displacement"]
    return 0.5 * float(path.max() + path.min())


def _without_gas(entry: Entry, donor: Entry) -> Entry:
    """Return a fast run whose curve and offset have the gas force and stiffness of a slow run."""
    fast, slow = entry.series, donor.series
    assert fast is not None and slow is not None  # both are runs
    preload, stiffness = donor.slow.gas_force, donor.slow.stiffness
    assert isinstance(preload, float)
    if isinstance(stiffness, Unknown) or "displacement" not in fast:
        return entry
    even = fast if fast.is_uniform else fast.resample(fast.sample_rate)
    static = even if isinstance(entry.lag, Unknown) else advanced(even, entry.lag)
    gas = preload + stiffness * (static["displacement"] - _middle(slow))
    relieved = static.with_channel("force", "N", static["force"] - gas)
    curve = curve_of_series(relieved, cycles_of(relieved), 0.0)
    offset = preload + stiffness * (_middle(fast) - _middle(slow))
    own = "unknown" if isinstance(entry.offset, Unknown) else f"{entry.offset:.4g} N"
    note = (
        f"gas: {offset:.4g} N in the middle of the stroke and {stiffness:.4g} N/m, from the slow run {donor.name}, are "
        f"subtracted; the force of this run at zero velocity is {own}"
    )
    return replace(entry, curve=curve, strokes=strokes_of(curve), shared_gas=offset, notes=(*entry.notes, note))
