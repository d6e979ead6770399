"""Shocks of the identification benchmark: laws fitted on the virtual dynamometer, and a bank of similar laws."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from platformdirs import user_cache_path

from eightpost import __version__
from eightpost.ident import fit_shock
from eightpost.ident.shock.law_fit import LawName
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
from eightpost.shock import Lpnl2, ShockLaw, write_shock
from eightpost.shock.file import Shock as FittedShock
from eightpost.shock.file import read_shock
from eightpost.signals import write_parquet
from eightpost.units import convert

#: Duration of the dynamometer's random test [s]; it repeats every 10 s.
_DURATION = 12.0

#: Number of what kept fits contain; raised when a fit states more, so that it is repeated.
_CONTENT = 3

#: Peak displacements [m] of the two tests of `fitted_bank`: shocks move 1 to 3 mm (RMS) on a lap, as on the rig day.
_PEAKS = (convert(0.5, "in", "m"), convert(0.3, "in", "m"))

#: Bank of similar laws: scales of compression and rebound relative to build B/B, within 10 % of each other.
CLOSE = ((0.95, 0.95), (0.95, 1.05), (1.05, 0.95), (1.05, 1.05), (1.0, 1.0), (0.97, 1.02), (1.03, 0.98))


def bank() -> tuple[Lpnl2, ...]:
    """Return the seven builds of Table 7.3 as LPNL2 laws."""
    return tuple(_fitted(f"build {name}") for name in BUILDS)


def physical_bank() -> tuple[PhysicalDamper, ...]:
    """Return the dampers that `bank` was fitted to."""
    return tuple(_damper(f"build {name}") for name in BUILDS)


def fitted_shocks() -> tuple[FittedShock, ...]:
    """Return laws Hysteresis fitted to two small tests of the dampers of `physical_bank`, as a team would fit them."""
    return tuple(_fitted_shock(f"build {name}", "hysteresis", _PEAKS) for name in BUILDS)


def fitted_bank() -> tuple[ShockLaw, ...]:
    """Return the laws of `fitted_shocks`."""
    return tuple(shock.law for shock in fitted_shocks())


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
    """Return the law of a damper, fitted to one test of 1 in peak."""
    law = _fitted_shock(name, "lpnl2", (convert(1.0, "in", "m"),)).law
    assert isinstance(law, Lpnl2)
    return law


@cache
def _fitted_shock(name: str, law: LawName, peaks: tuple[float, ...]) -> FittedShock:
    """Return a damper's fitted law, from the cache if it was fitted before.

    Args:
        name: Damper.
        law: Name of the law.
        peaks: Peak displacement of each test [m].
    """
    folder = user_cache_path("eightpost") / f"benchmark_shocks_{__version__}_{_CONTENT}"
    of_tests = "" if law == "lpnl2" else f"_{law}_{len(peaks)}"
    kept = folder / f"{name.replace('/', '_').replace(' ', '_')}{of_tests}.json"
    if not kept.exists():
        _fit(name, law, peaks, kept)
    return read_shock(kept)


def _fit(name: str, law: LawName, peaks: tuple[float, ...], kept: Path) -> None:
    with TemporaryDirectory() as folder:
        records = [_record(name, seed, peak, Path(folder)) for seed, peak in enumerate(peaks, start=301)]
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_shock(fit_shock([read_dyno_test(record) for record in records], law, name=name).shock, kept)


def _record(name: str, seed: int, peak: float, folder: Path) -> Path:
    drive = Actuator().follow(random_multisine(seed, duration=_DURATION, peak=peak).series)
    record = folder / f"{seed}.parquet"
    write_parquet(read_out(_damper(name).respond(drive, rate=2000.0), seed=seed), record, note=f"SYNTHETIC: {name}")
    return record
