"""Shocks of the identification benchmark: laws fitted on the virtual dynamometer, and a bank of similar laws."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from platformdirs import user_cache_path

from eightpost import __version__
from eightpost.ident import fit_shock
from eightpost.rig import (
    BUILDS,
    Actuator,
    PhysicalDamper,
    configuration,
    random_multisine,
    read_dyno_test,
    read_out,
    shim_build,
)
from eightpost.shock import Lpnl2, write_shock
from eightpost.shock.file import read_shock
from eightpost.signals import write_parquet

#: Duration of the dynamometer's random test [s]; it repeats every 10 s.
_DURATION = 12.0

#: Bank of similar laws: scales of compression and rebound relative to build B/B, within 10 % of each other.
CLOSE = ((0.95, 0.95), (0.95, 1.05), (1.05, 0.95), (1.05, 1.05), (1.0, 1.0), (0.97, 1.02), (1.03, 0.98))


def bank() -> tuple[Lpnl2, ...]:
    """Return the seven builds of Table 7.3 as LPNL2 laws."""
    return tuple(_fitted(f"build {name}") for name in BUILDS)


def physical_bank() -> tuple[PhysicalDamper, ...]:
    """Return the dampers that `bank` was fitted to."""
    return tuple(_damper(f"build {name}") for name in BUILDS)


def close_bank() -> tuple[Lpnl2, ...]:
    """Return seven laws within 10 % of each other."""
    middle = _fitted("build B/B")
    return tuple(replace(middle, port=replace(middle.port, compression_scale=c, rebound_scale=r)) for c, r in CLOSE)


def twelve() -> tuple[Lpnl2, ...]:
    """Return the twelve configurations of Table 3.1 as LPNL2 laws."""
    return tuple(_fitted(f"configuration {number}") for number in range(1, 13))


@cache
def _damper(name: str) -> PhysicalDamper:
    kind, _, which = name.partition(" ")
    return configuration(int(which)) if kind == "configuration" else shim_build(which)


@cache
def _fitted(name: str) -> Lpnl2:
    """Return a damper's law, from the cache if it was fitted before."""
    folder = user_cache_path("eightpost") / f"benchmark_shocks_{__version__}"
    kept = folder / f"{name.replace('/', '_').replace(' ', '_')}.json"
    if not kept.exists():
        _fit(name, kept)
    law = read_shock(kept).law
    assert isinstance(law, Lpnl2)
    return law


def _fit(name: str, kept: Path) -> None:
    drive = Actuator().follow(random_multisine(301, duration=_DURATION).series)
    response = _damper(name).respond(drive, rate=2000.0)
    with TemporaryDirectory() as folder:
        record = Path(folder) / "record.parquet"
        write_parquet(read_out(response, seed=301), record, note=f"SYNTHETIC: {name}")
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_shock(fit_shock(read_dyno_test(record), "lpnl2", name=name).shock, kept)
