"""One true car, identified from its rig tests and judged by the true measures of setups: a row of the tables.

A row has the predicted and the true measures and what the fit states about them, so tables can be made again without
another identification. The functions behind the commands are used: `eightpost.api.identify` on files with a channel
map, and the batch engine of setups.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cars.car import CORNERS
from benchmarks.cars.draw import draw
from benchmarks.cars.rig import RATE, Motion, lap_drive, lap_series, run, write_tests
from cosim.study.measures import shares_of
from eightpost.api.models import fit, identify, simulate
from eightpost.errors import EightpostError
from eightpost.ident.vehicle.port_search import about_loads
from eightpost.ident.vehicle.simulation import ManySetups
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.rig import DynoTest
from eightpost.shock import Shock, ShockLaw
from eightpost.signals import TimeSeries
from eightpost.uncertainty import TOTAL
from eightpost.virtual.dynamometer import Actuator, random_multisine, read_out

#: Time at the start of a lap that is not evaluated [s].
SETTLING = 2.0

QUANTITIES = ("tire_force", "hub_acceleration", "velocity", "displacement", "chassis_acceleration")
NAMES = (
    TOTAL,
    "front.ride_height",
    "rear.ride_height",
    *(f"{corner}.{quantity}" for quantity in QUANTITIES for corner in CORNERS),
)

#: Measures that are judged: those of a study's family ride.
RIDE = tuple(n for n in NAMES if not n.endswith(("displacement", "chassis_acceleration")))


def measures(motion: Motion) -> dict[str, float]:
    """Return the RMS value of each measure."""
    total = np.sum([motion.settled(f"{corner}.tire_force", SETTLING) for corner in CORNERS], axis=0)
    return {n: float((total if n == TOTAL else motion.settled(n, SETTLING)).std()) for n in NAMES}


#: Duration of a lap [s], and number of setups.
LAP, SETUPS = 30.0, 24

#: Samples of a prediction per sample of a record.
_FINER = 4


@dataclass(frozen=True, slots=True)
class Case:
    """What is identified and judged."""

    kind: str
    seed: int
    seconds: float = 200.0  #: Length of each test [s].
    lap: str = "track"
    shocks: str = "known"  #: "known", or "fitted" to dynamometer records.

    @property
    def name(self) -> str:
        """Name of the row's file."""
        parts = (self.kind, self.seed, f"{self.seconds:g}", self.lap)
        return "_".join(map(str, parts if self.shocks == "known" else (*parts, self.shocks)))


def row_of(case: Case, folder: Path) -> dict[str, Any]:
    """Return the row of a case: read from the folder if it was made before."""
    path = folder / f"{case.name}.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(_row(case, folder), indent=1) + "\n", encoding="utf-8")
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def setups_of(seed: int) -> list[tuple[int, ...]]:
    """Return setups as indices of the corners' shocks in the bank."""
    drawn = np.random.default_rng([46, seed]).integers(0, 7, (SETUPS, 4))
    return [tuple(int(k) for k in row) for row in drawn]


#: Duration of a dynamometer record [s], at 2 kHz.
_DYNO = 10.0


def fitted(shocks: Sequence[Shock], seed: int) -> list[Shock]:
    """Return the fits of shocks, with the defaults of `fit`, to random dynamometer tests with ripple and noise."""
    motion = Actuator().follow(random_multisine(seed, duration=_DYNO).series)
    motion = motion.with_channel("velocity", "m/s", np.gradient(motion["displacement"], motion.time))
    records = [read_out(motion.with_channel("force", "N", simulate(one, motion)["force"]), seed=seed) for one in shocks]
    return [fit(DynoTest(record), name=one.name).shock for one, record in zip(shocks, records, strict=True)]


def _row(case: Case, folder: Path) -> dict[str, Any]:
    car = draw(case.kind, case.seed)
    row: dict[str, Any] = asdict(case)
    records = folder / f"{case.name}_records"
    paths = write_tests(car, records, case.seconds, case.seed)
    shocks = [Shock(one.name, one.law) for one in (*car.bank, car.alternate)]
    if case.shocks == "fitted":
        shocks = fitted(shocks, case.seed)
    laws, tested = [shock.law for shock in shocks[:-1]], [shocks[car.baseline], shocks[-1]]
    try:
        found = identify(paths, channel_map=records / "map.toml", name=case.name, shocks=tested)
    except EightpostError as error:
        return row | {"error": f"{type(error).__name__}: {error}"}
    finally:
        shutil.rmtree(records)
    verdict = found.verdict
    row |= {"cpu": round(found.seconds, 1), "notes": found.notes}
    row["verdict"] = {"grade": verdict.grade, "reasons": [[r.rule, r.grade, str(r)] for r in verdict.reasons]}
    setups = setups_of(case.seed)
    lap = lap_drive(car, LAP, case.seed, case.lap)
    row["true"] = [measures(run(car, [car.bank[k] for k in setup], lap)) for setup in setups]
    try:
        row["predicted"], shares = predicted(found, laws, setups, lap_series(lap, _FINER * RATE))
        trusted = {} if found.trust is None else found.trust.measures
        on_lap = {n: one.on_drive(shares[n]) for n, one in trusted.items() if n in shares}
        row["stated"] = {n: {"common": one.common, "own": one.own, "bias": one.bias} for n, one in on_lap.items()}
    except EightpostError as error:
        row["error"] = f"{type(error).__name__}: {error}"
    return row


def predicted(
    fit: VehicleFit, laws: Sequence[ShockLaw], setups: Sequence[Sequence[int]], lap: TimeSeries
) -> tuple[list[dict[str, float]], dict[str, list[float]]]:
    """Return the predicted measures of setups, and the shares of the first one's power in bands."""
    names, rows = fit.vehicle.state_space.output_names, []
    shares: dict[str, list[float]] = {}
    means = dict(zip(lap.names, lap.values.mean(axis=1).tolist(), strict=True))
    loads = {name: mean for name, mean in means.items() if not name.endswith("road")}
    for outputs in ManySetups(about_loads(fit.vehicle, loads), laws, lap, _FINER).run(setups):
        kept = dict(zip(names, outputs[:, round(SETTLING * RATE) :], strict=True))
        kept[TOTAL] = np.sum([y for n, y in kept.items() if n.endswith("tire_force")], axis=0)
        rows.append({n: float(kept[n].std()) for n in NAMES if n in kept})
        shares = shares or {n: shares_of(kept[n][None], RATE).tolist() for n in rows[0]}
    return rows, shares
