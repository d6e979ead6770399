"""What `eightpost shapes` states about a target: its band, its limits, the builds near it, and its valving."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.study.choice.shape_search import Band, Range, ShockSpace
from cosim.study.definition import Build
from eightpost.api import shapes as shape_search
from eightpost.api.shapes import targets_of
from eightpost.shock import Shock, write_shock
from eightpost.shock.shape import Shape, Side
from eightpost.virtual.damper import NearestValving, Valving

SOFT = Shape(Side(3e3, 1500.0, 0.1, 600.0, 100.0), Side(4e3, 1500.0, 0.1, 600.0, 100.0), lag=2e-3, gas=20.0)
STIFF = SOFT.with_numbers({"rebound.low": 3000.0, "compression.high": 900.0})
FRONT, REAR = ("lf", "rf"), ("lr", "rr")
RANGES = (Range("rebound.low", 1000.0, 4000.0), Range("gas", -10.0, 30.0))
PARTS = Valving("A", "B", "C")

#: Points of the band: the numbers of the front, then those of the rear.
POINTS = np.array([[0.2, 0.5, 0.9, 0.5], [0.7, 0.5, 1.0, 0.5]])
ALONE = np.array([[0.0, 0.5], [0.25, 0.75], [0.5, 1.0], [0.0, 1.0]])


def objective(trial):
    """Return a number with a digit for each corner, lf first: 1 soft, 2 stiff, 3 planned, 4 with a target's gas."""

    def digit(build):
        own = {"soft.fmu": 1, "stiff.fmu": 2}.get(build.fmu.name)
        return own or {10.0: 3, SOFT.gas: 4}[build.parameters["gas_preload"]]

    return float("".join(str(digit(trial[corner])) for corner in FRONT + REAR))


@pytest.fixture(scope="module")
def targets(tmp_path_factory):
    """Targets of two groups: the front is as the stiff build, the rear as the soft one."""
    folder = tmp_path_factory.mktemp("bank")
    sources = {name: folder / f"{name}.json" for name in ("soft", "stiff")}
    for name, shape in (("soft", SOFT), ("stiff", STIFF)):
        write_shock(Shock(name, shape.law()), sources[name])
    space = ShockSpace(
        (FRONT, REAR), RANGES, lambda _group, own: Build(Path("any.fmu"), SOFT.with_numbers(own).parameters())
    )
    study = SimpleNamespace(bank={name: Build(Path(f"{name}.fmu")) for name in sources})
    scores = lambda trials: SimpleNamespace(objectives=np.array([[objective(one)] for one in trials]))  # noqa: E731
    problem = SimpleNamespace(space=space, trials=SimpleNamespace(study=study), scores=scores)
    optimum = SimpleNamespace(point=np.array([0.5, 0.5, 0.995, 0.5]))
    velocity = np.linspace(-1.3, 1.3, 261)
    force = np.array([STIFF.curve().force(v) for v in velocity.tolist()])
    valving = NearestValving(PARTS, 0.0, 0.0, 0.0, velocity, force, 1, ())

    def found(kept, *groups):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(shape_search, "nearest_valving", lambda _force: valving)
            shapes = {group: {FRONT: STIFF, REAR: SOFT}[group] for group in groups}
            bases = dict.fromkeys(groups, SOFT)
            return targets_of(problem, optimum, kept, shapes, bases, dict.fromkeys(sources), sources)

    return found(Band(0.8, 0.2, 1.0, POINTS, ALONE), FRONT, REAR), found(None, FRONT)


def test_forces_are_stated_up_to_1_m_s_on_both_sides_closest_at_rest(targets):
    (front, _), _ = targets
    velocity = front.velocity
    assert (velocity[0], velocity[-1]) == (-1.0, 1.0) and velocity == pytest.approx(-velocity[::-1])
    assert np.count_nonzero(velocity == 0.0) == 1 and (np.diff(velocity, 2)[velocity[1:-1] > 0.0] > 0.0).all()


def test_the_band_reaches_from_the_softest_to_the_stiffest_shape_in_it(targets):
    (front, rear), (alone,) = targets

    def force(shape, **numbers):
        curve = shape.with_numbers({name.replace("_", "."): value for name, value in numbers.items()}).curve()
        return [curve.force(v) for v in front.velocity.tolist()]

    rebound = front.velocity <= 0.0
    low, high = 1000.0 * 4.0**0.2, 1000.0 * 4.0**0.7
    assert front.high[rebound] == pytest.approx(np.array(force(SOFT, rebound_low=low))[rebound])
    assert front.low[rebound] == pytest.approx(
        np.array(force(STIFF))[rebound]
    )  # 3000 N.s/m are beyond 0.7 of the range
    assert high < 3000.0
    assert front.high[~rebound] == pytest.approx(np.array(force(STIFF))[~rebound])  # compression does not vary
    assert front.low[~rebound] == pytest.approx(np.array(force(SOFT))[~rebound])
    assert rear.low[rebound] == pytest.approx(np.array(force(SOFT, rebound_low=4000.0))[rebound])
    assert rear.high == pytest.approx(force(SOFT))
    assert alone.low == pytest.approx(force(STIFF)) and (alone.low == alone.high).all()


def test_intervals_are_stated_in_the_units_of_the_numbers_and_limits_by_name(targets):
    (front, rear), (alone,) = targets
    assert front.alone == {"rebound.low": pytest.approx((1000.0, 2000.0)), "gas": (0.0, 20.0)}
    assert rear.alone == {"rebound.low": pytest.approx((2000.0, 4000.0)), "gas": (-10.0, 30.0)}
    assert alone.alone == {"rebound.low": pytest.approx((2000.0, 2000.0)), "gas": (10.0, 10.0)}
    assert (front.at_limit, rear.at_limit) == ((), ("rebound.low",))  # 0.995 of the range


def test_builds_near_a_target_are_run_at_its_corners_with_the_targets_elsewhere(targets):
    (front, rear), _ = targets
    assert [(one.build, one.objective) for one in front.neighbours] == [("stiff", 2233.0), ("soft", 1133.0)]
    assert [(one.build, one.objective) for one in rear.neighbours] == [("soft", 3311.0), ("stiff", 3322.0)]
    assert (front.valving_objective, rear.valving_objective) == (4433.0, 3344.0)
    assert front.neighbours[0].difference == pytest.approx(0.0, abs=1e-9)
    assert front.neighbours[1].relative == pytest.approx(front.neighbours[1].difference / rms(STIFF), rel=0.05)


def rms(shape):
    """RMS force of a shape's curve at equal steps of the root of the speed."""
    speed = 1.3 * np.linspace(0.0, 1.0, 200) ** 2
    return np.sqrt(np.mean([shape.curve().force(v) ** 2 for v in [*speed.tolist(), *(-speed).tolist()]]))


def test_the_shape_of_a_valving_has_its_curve_and_the_lag_and_gas_of_the_target(targets):
    (front, rear), _ = targets
    for one in (front, rear):
        found, wanted = one.valving_shape.curve(), STIFF.curve()
        for v in (-1.2, -0.3, -0.05, 0.05, 0.3, 1.2):
            assert found.force(v) == pytest.approx(wanted.force(v), rel=0.02)
        assert (one.valving_shape.lag, one.valving_shape.gas) == (2e-3, 20.0)
        assert one.valving.valving is PARTS
    assert (front.name, rear.name) == ("lf+rf", "lr+rr")
