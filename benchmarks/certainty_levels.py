"""Levels of the certainty benchmark: true and predicted measures of random setups, and effects of uncertain shocks."""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from benchmarks.identification_cases import truths_of
from benchmarks.identification_measures import TOTAL, measures_of
from benchmarks.identification_shocks import bank, fitted_bank, fitted_shocks, physical_bank
from benchmarks.vehicle_uncertainty_truths import LAP, Outcome, truth
from cosim.study.certainty.certainty import Effect
from cosim.study.certainty.effects import correlated
from eightpost.corners import CORNERS
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.rig import BUILDS
from eightpost.rig.post import Actuators, track_drive
from eightpost.rig.post.drivefiles import STEPS
from eightpost.shock.fit_uncertainty import fitted_parameters
from eightpost.uncertainty import LeftOutBlocks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.rig.post import AnyCar, Shock
    from eightpost.shock import ShockLaw
    from eightpost.shock.file import Shock as FittedShock
    from eightpost.signals import TimeSeries
    from eightpost.vehicle import IdentifiedVehicle

    Array = NDArray[np.float64]

Knowledge = Literal["known", "fitted"]

#: Outputs of the simulation are kept at every fifth sample of 1250 Hz.
_EVERY, _RATE = 5, 1250.0

#: Number of integration steps per sample that physical dampers need on the flexible car.
_FINE = 8


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """True and predicted levels of the setups of one truth."""

    setups: NDArray[np.int64]  #: Numbers of the setups (S,).
    names: tuple[str, ...]  #: Names of the measures.
    true: Array  #: True levels (S, M).
    predicted: Array  #: Predicted levels (S, M).
    effects: tuple[Effect, ...] = ()  #: Effects of the uncertain parameters of fitted shocks.


class Shocks(NamedTuple):
    """Shocks of the true car, and the laws of the same builds that the prediction uses."""

    true: Sequence[Shock]
    laws: Sequence[ShockLaw]


def shocks_of(knowledge: Knowledge) -> Shocks:
    """Return the builds of Table 7.3: laws that are known, or physical dampers known from dynamometer fits."""
    return Shocks(bank(), bank()) if knowledge == "known" else Shocks(physical_bank(), fitted_bank())


def levels_of(one: Outcome, count: int, folder: Path | None, knowledge: Knowledge = "known") -> Levels:
    """Return the levels of random setups of a truth, or read them from a folder where they were kept."""
    suffix = "" if knowledge == "known" else f"_{knowledge}"
    kept = None if folder is None else folder / f"{one.kind}_{one.seed}_choice_{count}{suffix}.pickle"
    if kept is not None and kept.exists():
        found: Levels = pickle.loads(kept.read_bytes())
        return found
    made = _of_truth(one, count, knowledge)
    if kept is not None:
        kept.write_bytes(pickle.dumps(made))
    return made


def _of_truth(one: Outcome, count: int, knowledge: Knowledge) -> Levels:
    car, shocks = truth(one.kind, one.seed), shocks_of(knowledge)
    shape = (len(shocks.laws),) * len(CORNERS)
    numbers = np.sort(np.random.default_rng([11, one.seed]).choice(int(np.prod(shape)), count, replace=False))
    lap = Actuators().follow(track_drive(car, 40000 + one.seed, duration=LAP).series, car)
    steps = _FINE if one.kind == "flexible" and knowledge == "fitted" else STEPS
    levels = simulated_levels(car, one.fit.vehicle, shocks, lap, numbers, steps=steps)
    if knowledge == "known":
        return levels
    return replace(levels, effects=shock_effects(one.fit.vehicle, levels, lap, fitted_shocks()))


def simulated_levels(
    car: AnyCar,
    vehicle: IdentifiedVehicle,
    shocks: Shocks,
    lap: TimeSeries,
    numbers: NDArray[np.int64],
    *,
    steps: int = STEPS,
) -> Levels:
    """Simulate setups with a true car and with an identified vehicle.

    Args:
        car: True car.
        vehicle: Identified vehicle.
        shocks: Builds.
        lap: Motion of the actuators.
        numbers: Numbers of the setups (S,): positions of the builds at the corners, the last corner fastest.
        steps: Number of integration steps of the true car per sample.
    """
    setups = _places(numbers, len(shocks.laws))
    true = list(truths_of(car, lap, [tuple(shocks.true[place] for place in row) for row in setups], steps=steps))
    predicted = _predicted(vehicle, shocks.laws, lap, setups)
    names = tuple(true[0])
    first, second = (np.array([[row[name] for name in names] for row in table]) for table in (true, predicted))
    return Levels(numbers, names, first, second)


def shock_effects(
    vehicle: IdentifiedVehicle, levels: Levels, lap: TimeSeries, shocks: Sequence[FittedShock]
) -> tuple[Effect, ...]:
    """Return the effects of the uncertain parameters of fitted shocks, at the setup with the lowest total tire force.

    As in a study, the setup gets each build at one corner at a time, with one changed parameter.
    """
    laws = [shock.law for shock in shocks]
    base = _places(levels.setups, len(laws))[int(np.argmin(levels.predicted[:, levels.names.index(TOTAL)]))]
    bank_of_all, effects, setups = list(laws), list[tuple[str, str, float, float, int]](), list[tuple[int, ...]]()
    left_out = list[LeftOutBlocks | None]()
    for place, shock in enumerate(shocks):
        found = fitted_parameters(shock)
        assert found is not None
        left_out += [found.left_out] * len(found.names)
        for name, value, deviation, high in zip(
            found.names, found.values, np.sqrt(found.covariance.diagonal()), found.highest, strict=True
        ):
            sign = 1.0 if value + deviation <= high else -1.0
            effects.append((BUILDS[place], name, float(deviation), sign, len(bank_of_all)))
            bank_of_all.append(changed_law(laws[place], name, value + sign * deviation))
    for corner in range(len(CORNERS)):
        setups += [(*base[:corner], k, *base[corner + 1 :]) for k in range(len(bank_of_all))]
    rows = np.array([list(row.values()) for row in _predicted(vehicle, bank_of_all, lap, setups)])
    logarithms = np.log(rows).reshape(len(CORNERS), len(bank_of_all), -1)
    found = [_effect(one, levels.names, logarithms) for one in effects]
    return tuple(correlated(found, left_out))


def _effect(one: tuple[str, str, float, float, int], names: Sequence[str], logarithms: Array) -> Effect:
    """Return an effect from logarithms of the measures with each law at each corner (C, L, M)."""
    build, name, deviation, sign, place = one
    apart = sign * (logarithms[:, place] - logarithms[:, BUILDS.index(build)])
    changes = {
        corner: {build: dict(zip(names, row.tolist(), strict=True))} for corner, row in zip(CORNERS, apart, strict=True)
    }
    return Effect(build, name, deviation, 0.0, {}, changes)


def changed_law(law: ShockLaw, name: str, value: float) -> ShockLaw:
    """Return a law with another value of a parameter, by the name that its FMU has for it."""
    if name.endswith("_scale"):
        return replace(law, port=replace(law.port, **{name: value * getattr(law.port, name)}))
    whole, _, index = name.removesuffix("]").partition("[")
    if not index:
        return replace(law, **_field(name, value))
    values = list(getattr(law, whole))
    values[int(index) - 1] = value
    return replace(law, **_field(whole, tuple(values)))


def _field(name: str, value: object) -> dict[str, Any]:
    return {name: value}


def _predicted(
    vehicle: IdentifiedVehicle, laws: Sequence[ShockLaw], lap: TimeSeries, setups: Sequence[Sequence[int]]
) -> list[Mapping[str, float]]:
    simulation, names = ManySetups(vehicle, laws, lap, _EVERY), vehicle.state_space.output_names
    return [measures_of(names, simulation.run([setup])[0], _RATE / _EVERY) for setup in setups]


def _places(numbers: NDArray[np.int64], builds: int) -> list[tuple[int, ...]]:
    """Return the positions of the builds at the corners of each setup."""
    rows = np.array(np.unravel_index(numbers, (builds,) * len(CORNERS))).T
    return [tuple(int(place) for place in row) for row in rows]
