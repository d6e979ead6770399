"""A constructed study: formulas instead of FMUs, with the trends of chapter 7 and seeded noise."""

from pathlib import Path

import numpy as np
import pytest

from cosim.study.choice.certainty import OBJECTIVE, Certainty, Contribution, Levels, NextTest, Status, TradeOff
from cosim.study.definition import Build, Constraint, Drive, Term
from cosim.study.measures import Measure
from cosim.study.table import Provenance, StudyResult, result_table, study_schema
from eightpost.corners import CORNERS
from eightpost.signals import TimeSeries

from .. import constructed

# Nominal damping of the shim stacks of Table 7.3 (7.1) [lb/(in/s)].
_DAMPING = {"AA": 9.0, "B": 20.0, "C": 30.0}
FRONT, TIRE, HUB = "front ride height, RMS", "total tire force, RMS", "rf hub acceleration, RMS"

_MEASURES = (
    Measure(TIRE, tuple(f"car.{corner}.tire_force" for corner in CORNERS), display="lbf"),
    Measure(FRONT, ("car.front.ride_height",), display="in"),
    Measure("rear ride height, RMS", ("car.rear.ride_height",), display="in"),
    Measure(HUB, ("car.rf.hub_acceleration",), display="g"),
    Measure("lr hub acceleration, RMS", ("car.lr.hub_acceleration",), display="g"),
    Measure("<b>own</b> & measure", ("car.lf.velocity",)),
)
_UNITS = ("N", "m", "m", "m/s2", "m/s2", "m/s")

_OBJECTIVE = (Term(TIRE, 1.0, "lbf"), Term(FRONT, 900.0, "in"))


def _responses(damping, rng):
    """Return the measures (S, 6) in SI for damping at four corners (S, 4) between 0 and 1."""
    lf, rf, lr, rr = damping.T
    front, rear = 0.5 * (lf + rf), 0.5 * (lr + rr)
    tire = 720.0 + 150.0 * (front - 0.35) ** 2 + 200.0 * (1.0 - rear) ** 2 + 120.0 * lf * (1.0 - lr)
    front_height = 1e-3 * (4.55 - 0.5 * front + 0.02 * rear)
    rear_height = 1e-3 * (2.45 - 0.3 * rear + 0.1 * front)
    hub = (2.6 - 0.9 * rf + 0.7 * rf**2 + 0.05 * lf, 4.2 - 1.0 * lr + 0.4 * rear)
    values = np.column_stack([tire, front_height, rear_height, *hub, 0.1 + 0.02 * (lf - lr) ** 2])
    return values * (1.0 + 0.002 * rng.standard_normal(values.shape))


def _row(study, setup, values, rng):
    row = {"setup": setup.index, **setup.builds, **dict(zip([m.name for m in study.measures], values, strict=True))}
    row |= {"status": "done", "message": "", "marks": "", "seconds": 0.03}
    return row | {"coupling_error_percent": 0.1 + 0.05 * rng.random()}


@pytest.fixture(scope="session")
def surrogate():
    """Return a function that gives the result for some builds of Table 7.3; setup 40 fails, setup 7 is marked."""

    def made(builds=constructed.BUILDS, objective=_OBJECTIVE):
        rng = np.random.default_rng(7)
        names = dict.fromkeys((*constructed.BUILDS, *builds))
        study = constructed.study(
            (), builds=builds, name="Surrogate of chapter 7 (synthetic)", measures=_MEASURES, objective=objective,
            bank={name: Build(Path("bank", f"{name.replace('/', '_')}.fmu")) for name in names},
            drives=(Drive("lap", Path("lap.csv"), stop=33.0),), constraints=(Constraint(HUB, at_most=2.45),),
            baseline=dict.fromkeys(CORNERS, "B/B"),
        )  # fmt: skip
        force = {name: np.mean([_DAMPING[part] for part in name.split("/")]) for name in builds}
        damping = np.array([[force[build] for build in setup.builds.values()] for setup in study.space])
        responses = _responses((damping - 9.0) / 21.0, rng)
        rows = [_row(study, setup, values, rng) for setup, values in zip(study.space, responses, strict=True)]
        rows[40] |= dict.fromkeys([measure.name for measure in _MEASURES])
        rows[40] |= {"status": "failed", "message": "the FMU of rf discards the step", "coupling_error_percent": None}
        rows[7] |= {"marks": "beyond fitted range: lf"}
        units = dict(zip([measure.name for measure in _MEASURES], _UNITS, strict=True))
        source = Provenance("d1" * 32, {"car.fmu": "{guid-of-car}"}, {"car.fmu": "ab" * 32}, {"step": "1 ms"}, units)
        return StudyResult(study, result_table(rows, study_schema(study, units)), source)

    return made


@pytest.fixture(scope="session")
def certain():
    """Return a function of a result that gives a certainty: the true objective is the predicted one plus noise."""

    def made(result, ties=None, **fields):
        noise = np.random.default_rng(5).normal(0.0, 0.5, (500, len(result)))
        true = np.where(result.feasible, result.objective, np.inf) + noise
        best = np.bincount(np.argmin(true, axis=1), minlength=len(result)) / 500.0
        order = np.argsort(-best, kind="stable")
        count = int(np.searchsorted(np.cumsum(best[order]), 0.95)) + 1 if ties is None else ties
        half = np.array([0.7, 1.3, 2.0])[:, None] * np.full(len(result), 0.01)
        levels = {m.name: Levels(result.values(m.name), half, best, True, "stated") for m in result.measures}
        levels[OBJECTIVE] = Levels(result.objective, half, best, True, "terms")
        numbers = tuple(result.setups[order[:count]].tolist())
        given = {
            "contributions": (Contribution("vehicle", Status.INCLUDED, "a test was left out"),),
            "tests": (NextTest(numbers[0], 0.5),),
            "trade_offs": (TradeOff(HUB, 0.02, 0.01, 0.03, 0.0), TradeOff(FRONT, -0.01, -0.02, 0.01, 0.0)),
        }
        feasible = result.feasible.astype(float)
        return Certainty(
            result.provenance.digest,
            OBJECTIVE,
            3,
            result.setups,
            best,
            best,
            feasible,
            numbers,
            levels,
            **given | fields,
        )

    return made


@pytest.fixture(scope="session")
def lap():
    """Return a function of a seed that gives traces of three channels over 10 s at 500 Hz."""

    def made(seed):
        time, rng = np.arange(0.0, 10.001, 0.002), np.random.default_rng(seed)
        channels = {f"car.{corner}.velocity": ("m/s", 0.1 * rng.standard_normal(time.size)) for corner in ("lf", "rf")}
        force = ("N", 800.0 * np.sin(2.0 * np.pi * (1.0 + seed) * time))
        return TimeSeries.from_channels(time, channels | {"car.lf.tire_force": force})

    return made
