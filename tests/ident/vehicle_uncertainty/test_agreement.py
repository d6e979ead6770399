"""Rig tests are compared with each other by the balance of every wheel: known changes are found, and nothing else."""

import numpy as np
import pytest

from eightpost.corners import CORNERS
from eightpost.ident.vehicle.plan import LIMITS, Change, compare_tests
from eightpost.signals import TimeSeries

#: Springs and bars of a wheel [N/m], friction [N], damping of the shock [N.s/m], mass of the hub [kg], weight [N].
SPRING, BAR, FRICTION, DAMPING, HUB, WEIGHT = 4e4, 1e4, 60.0, 3000.0, 40.0, 3500.0
RATE, COUNT = 125.0, 3000
MEANS = {f"{corner}.{name}": mean for corner in CORNERS for name, mean in (("tire_force", WEIGHT), ("aero", 200.0))}


def record(seed, *, spring=None, bar=None, friction=None, damping=None, noise=5.0):
    """Return a record of wheels whose parameters are those above times given factors, by corner, constant or (N,)."""
    generator = np.random.default_rng(seed)
    spring, bar, friction, damping = (given or {} for given in (spring, bar, friction, damping))
    time = np.arange(COUNT) / RATE
    rows = {}
    for corner in CORNERS:
        v = np.convolve(generator.standard_normal(COUNT + 20), np.hanning(21), "valid")
        rows[f"{corner}.velocity"] = v = 0.1 * (v - v.mean()) / v.std()
        x = np.convolve(generator.standard_normal(COUNT + 60), np.hanning(61), "valid")
        rows[f"{corner}.displacement"] = 0.006 * x / x.std()
        rows[f"{corner}.force"] = DAMPING * damping.get(corner, 1.0) * 0.5 * np.tanh(2.0 * v)
        rows[f"{corner}.hub_acceleration"] = 5.0 * generator.standard_normal(COUNT)
    for place, corner in enumerate(CORNERS):
        other = CORNERS[place ^ 1]
        x, x_other = (rows[f"{name}.displacement"] for name in (corner, other))
        rows[f"{corner}.tire_force"] = (
            HUB * rows[f"{corner}.hub_acceleration"]
            + rows[f"{corner}.force"]
            + SPRING * spring.get(corner, 1.0) * x
            + BAR * bar.get(corner, 1.0) * (x - x_other)
            + FRICTION * friction.get(corner, 1.0) * np.tanh(rows[f"{corner}.velocity"] / 0.006)
            + noise * generator.standard_normal(COUNT)
        )
    units = {"velocity": "m/s", "displacement": "m", "hub_acceleration": "m/s2"}
    channels = {name: (units.get(name.rpartition(".")[2], "N"), row - row.mean()) for name, row in rows.items()}
    return TimeSeries.from_channels(time, channels)


def changes(*records, means=None):
    return compare_tests(records, means or [MEANS] * len(records)).changes


def of_all(factor):
    return dict.fromkeys(CORNERS, factor)


@pytest.mark.parametrize(
    "changed",
    [{}, {"spring": of_all(1.06)}, {"friction": {"lf": 1.5}}, {"bar": {"lr": 0.9, "rr": 0.9}}, {"damping": of_all(1.4)},
     {"spring": {"rf": np.where(np.arange(COUNT) < COUNT // 2, 1.0, 1.1)}}],
    ids=["none", "springs", "friction", "bar", "damping", "within"],
)  # fmt: skip
def test_the_comparison_of_tests_is_the_kept_one(changed, unchanged):
    records = [record(0), record(1), record(2), record(3, **changed)]
    means = [MEANS] * 3 + [MEANS | {"lf.tire_force": 1.005 * WEIGHT, "rr.tire_force": 1.02 * WEIGHT}]
    found = compare_tests(records, means)
    kept = {f"{one.quantity} within {one.within}": f"{one.where} {one.tests} {one.size:.4g}" for one in found.changes}
    unchanged({**kept, "rubbing": found.rubbing}, relative=1e-3)


def test_tests_of_one_car_agree_and_friction_is_that_of_the_car():
    records = [record(seed) for seed in range(4)]
    found = compare_tests(records, [MEANS] * 4)
    assert found.changes == ()
    for corner in CORNERS:
        force = np.mean([test[f"{corner}.force"].std() for test in records])
        assert found.rubbing[corner] == pytest.approx(FRICTION / force, rel=0.02)


@pytest.mark.parametrize(
    ("quantity", "where", "given", "size"),
    [
        ("friction", "lr", {"friction": {"lr": 0.6}}, -0.4),
        ("friction", "rf", {"friction": {"rf": 1.5}}, 0.5),
        ("spring rate", "rf", {"spring": {"rf": 1.08}}, 0.08),
        ("anti-roll bar", "front", {"bar": {"lf": 0.0, "rf": 0.0}}, -BAR / (SPRING + BAR)),
        ("anti-roll bar", "rear", {"bar": {"lr": 1.3, "rr": 1.3}}, 0.3 * BAR / (SPRING + BAR)),
    ],
)
def test_a_changed_part_is_named_with_its_tests_and_its_size(quantity, where, given, size):
    found = changes(record(0), record(1), record(2, **given), record(3), record(4))
    assert found == (Change(quantity, where, (2,), pytest.approx(size, rel=0.06), False),)
    assert found[0].is_unusable == (abs(size) > LIMITS[quantity].unusable)


def test_friction_that_falls_within_tests_is_found_in_each_of_them():
    falling = of_all(np.linspace(1.0, 0.6, COUNT))
    (found,) = changes(record(0, friction=falling), record(1), record(2, friction=falling))
    assert (found.quantity, found.tests, found.within) == ("friction", (0, 2), True)
    assert found.size == pytest.approx(-0.2 / 0.9, abs=0.05)
    assert not found.is_unusable


def test_changes_below_the_limits_are_not_reported():
    gentle = {"spring": of_all(1.03), "bar": of_all(1.1), "friction": of_all(1.15)}
    assert changes(record(0), record(1), record(2, **gentle), record(3)) == ()


def test_changes_within_noise_are_not_reported():
    noisy = [record(seed, noise=2000.0) for seed in range(4)]
    other = record(4, noise=2000.0, friction={"lf": 0.6})
    assert changes(*noisy, other) == ()


def test_a_wheel_with_another_shock_is_not_compared_with_the_others():
    other = record(2, damping={"rf": 0.6}, friction={"rf": 0.5}, spring={"rf": 1.1})
    assert changes(record(0), record(1), other, record(3)) == ()
    (found,) = changes(record(0), record(1), record(2, damping={"rf": 0.6}, friction=of_all(0.5)), record(3))
    assert found.tests == (2,)
    assert found.where != "rf"


def test_the_tests_that_most_others_agree_with_are_those_that_did_not_change():
    low, other = of_all(0.5), record(2, damping={"lf": 0.6})
    (found,) = changes(record(0), record(1, friction=low), other, record(3, friction=low), record(4))
    assert found.tests == (1, 3)
    assert found.size == pytest.approx(-0.5, abs=0.06)


def test_weight_is_compared_by_axle_without_the_loads_that_the_rig_applies():
    def means(front, rear, aero=200.0):
        loads = {f"{c}.aero": aero for c in CORNERS}
        return loads | {f"{c}.tire_force": 0.5 * (front if c in CORNERS[:2] else rear) + aero for c in CORNERS}

    tests = [record(seed) for seed in range(4)]
    assert changes(*tests, means=[means(6000.0, 7000.0, aero) for aero in (0.0, 200.0, 400.0, 100.0)]) == ()
    (found,) = changes(*tests, means=[means(6000.0, 7000.0 * part) for part in (1.0, 1.0, 1.03, 1.0)])
    assert found == Change("weight", "rear", (2,), pytest.approx(0.03), False)
    assert changes(*tests, means=[means(6000.0, 7000.0 * part) for part in (1.0, 1.0, 1.008, 1.0)]) == ()


def test_tire_forces_that_are_changes_from_rest_have_no_weight():
    means = [{name: 0.01 * (k + 1) * mean for name, mean in MEANS.items()} for k in range(3)]
    assert changes(*[record(seed) for seed in range(3)], means=means) == ()


def test_without_hub_accelerations_only_weights_are_compared():
    tests = [record(0), record(1), record(2, spring=of_all(2.0))]
    found = compare_tests(
        [test.select([name for name in test.names if "hub" not in name]) for test in tests], [MEANS] * 3
    )
    assert found == ((), {})
