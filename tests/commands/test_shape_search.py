"""The search for target curves: what runs, where it starts, what may vary, what it verifies, and states of a target."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.study.choice.shape_search import Band, Evaluation, Range, Robustness, ShapeOptimum, ShockSpace
from cosim.study.definition import Build
from eightpost.api import shapes as shape_search
from eightpost.api.shapes import Curves, Request, _find_curves, _shapes_of_bank, bank_plan, searched_groups, targets_of
from eightpost.errors import InputError
from eightpost.shock import Shock, read_shock, write_shock
from eightpost.shock.shape import Shape, ShapeFit, Side
from eightpost.virtual.damper import NearestValving, Valving

CORNERS = ("lf", "rf", "lr", "rr")
SOFT = Shape(Side(3e3, 1500.0, 0.1, 600.0, 100.0), Side(4e3, 1500.0, 0.1, 600.0, 100.0))
STIFF = SOFT.with_numbers({"rebound.low": 3000.0, "compression.low": 2500.0})
EXACT = Robustness()
FITS = {"soft": ShapeFit(SOFT, 1.0, 0.01), "stiff": ShapeFit(STIFF, 1.0, 0.01)}


def requested(count, **others):
    """Return a request of a bank with a number of setups."""
    space = type("Space", (), {"__len__": lambda _self: count, "indices": np.arange(3)})()
    return SimpleNamespace(study=SimpleNamespace(space=space), left=f"{count} setups", **others)


def test_a_bank_of_5000_setups_is_run_completely_and_a_larger_one_is_searched(monkeypatch):
    assert bank_plan(requested(5000)) == "5000 setups to be run; then the curves are searched"
    assert bank_plan(requested(5001)) == "at most 400 to be evaluated; then the curves are searched"
    ranked = SimpleNamespace(ranking=lambda name: np.array([7, 2] if name == "grip" else [2, 7]))
    run, searched = [], []
    request = lambda _workers, _coupling, numbers: run.append(numbers) or ranked  # noqa: E731
    monkeypatch.setattr(
        shape_search, "search_study", lambda *given: searched.append(given[-1].objectives) or (ranked, 0)
    )
    assert shape_search._best_of_bank(requested(5000, request=request), None, None, "") == (ranked, 2)
    assert (run, searched) == ([[0, 1, 2]], [])
    assert shape_search._best_of_bank(requested(5001, request=request), None, None, "grip") == (ranked, 7)
    assert (run, searched) == ([[0, 1, 2]], [("grip",)])
    shape_search._best_of_bank(requested(5001), None, None, "")
    assert searched[-1] == ()  # the objective of the study


def test_a_bank_without_a_setup_that_runs_is_refused():
    none = SimpleNamespace(ranking=lambda _name: np.array([], dtype=int))
    with pytest.raises(InputError, match="no setup of the bank runs"):
        shape_search._best_of_bank(requested(3, request=lambda *_: none), None, None, "")


def test_a_bank_without_shock_files_is_refused():
    with pytest.raises(InputError, match=r"no build of the bank is a shock file \(\.json\)"):
        _shapes_of_bank({})


def test_the_groups_of_the_named_corners_are_searched(monkeypatch):
    monkeypatch.setattr(shape_search, "groups_of", lambda _study: (("lf", "rf"), ("lr",), ("rr",)))
    study = SimpleNamespace(corners=CORNERS)
    assert searched_groups(study, ()) == (("lf", "rf"), ("lr",), ("rr",))
    assert searched_groups(study, ("rf", "rr")) == (("lf", "rf"), ("rr",))
    with pytest.raises(InputError, match="there is no corner 'front'; the corners are lf, rf, lr, rr"):
        searched_groups(study, ("front",))


def space(request, bases):
    study = SimpleNamespace(bank={"soft": Build(Path("soft.fmu")), "stiff": Build(Path("stiff.fmu"))})
    bank = dict(zip(CORNERS, ("soft", "soft", "stiff", "soft"), strict=True))
    return shape_search._space(study, bank, bases, FITS, Path("any.fmu"), request)


def test_numbers_range_over_the_bank_or_as_stated_and_other_corners_keep_their_builds():
    request = Request(vary=("rebound.low", "gas"), limits={"gas": (-5.0, 5.0)}, tolerance=0.04)
    made = space(request, {("lf", "rf"): STIFF})
    assert [(one.name, one.low, one.high, one.tolerance) for one in made.ranges] == [
        ("rebound.low", 1500.0, 3000.0, 0.04),
        ("gas", -5.0, 5.0, 0.04),
    ]
    builds = made.trial(np.array([[2000.0, 1.0]]))
    assert (builds["lr"].fmu, builds["rr"].fmu) == (Path("stiff.fmu"), Path("soft.fmu"))
    wanted = STIFF.with_numbers({"rebound.low": 2000.0, "gas": 1.0}).parameters()
    assert builds["lf"] == builds["rf"] == Build(Path("any.fmu"), wanted)


@pytest.mark.parametrize(
    ("starts", "baseline", "count"), [(1, True, 1), (2, True, 2), (3, True, 3), (2, False, 2), (5, True, 5)]
)
def test_a_search_starts_at_the_best_of_the_bank_the_baseline_and_random_points(starts, baseline, count):
    made = space(Request(vary=("rebound.low",)), {("lf", "rf"): SOFT, ("lr", "rr"): SOFT})
    study = SimpleNamespace(
        baseline=dict(zip(CORNERS, ("stiff", "stiff", "soft", "soft"), strict=True)) if baseline else {}
    )
    own = np.array([0.25, 0.75])
    found = shape_search._starts(made, own, study, FITS, Request(starts=starts, seed=4))
    assert len(found) == count and found[0] is own
    if baseline and starts > 1:
        assert found[1] == pytest.approx([1.0, 0.0])
    again = shape_search._starts(made, own, study, FITS, Request(starts=starts, seed=4))
    assert np.array_equal(found, again) and ((np.array(found) >= 0.0) & (np.array(found) <= 1.0)).all()


def test_a_build_without_a_shock_file_starts_from_the_first_one_with():
    assert shape_search._base(FITS, "stiff") is STIFF
    assert shape_search._base(FITS, "foreign") is SOFT


@pytest.mark.parametrize(("assured", "has_band"), [(9.4, True), (10.0, False)])
def test_gains_are_counted_from_the_best_of_the_bank_and_a_band_needs_an_assured_one(assured, has_band, monkeypatch):
    """The search without draws is polished with them; gains are those of the polished point."""
    best, polished = np.array([0.2]), np.array([0.3])
    one = lambda value: np.array([value])  # noqa: E731
    reference = Evaluation(one(10.5), np.zeros((1, 0)), one(10.0), one(0.2), one(10.8))

    class Problem:
        def __init__(self, _trials, _space, robustness=EXACT, objective="", car=None):
            self.given = robustness.draws, robustness.weight, objective, car

        def evaluate(self, points):
            assert points.tolist() == [[1.0]]  # the stiff build is the upper end of the range
            return reference

        def drawn(self, points):
            assert (points == polished).all()
            return np.array([[9.0, 9.5, 11.0]])

    def search(problem, starts, iterations=None, progress=None):
        point, status = (best, ("planned",)) if iterations is None else (polished, ("polished",))
        assert problem.given == ((0, 1.0, "grip", None) if iterations is None else (6, 2.0, "grip", "cars"))
        assert iterations is None or (len(starts) == 1 and starts[0] is best)
        return ShapeOptimum(
            point, 9.2, 9.0, 0.1, assured, True, ((10.0, 9.0),) if iterations is None else (), 9, status
        )

    def band(problem, optimum, start, share):
        assert (problem.given, optimum.point is polished, start, share) == ((0, 2.0, "grip", "cars"), True, 10.0, 0.7)
        return "band"

    counted = []
    for name, stub in {
        "Problem": Problem, "search": search, "band": band, "_shapes_of_bank": lambda _sources: FITS,
        "_best_of_bank": lambda *_: (SimpleNamespace(setup=lambda row: SimpleNamespace(builds=dict.fromkeys(
            CORNERS, "stiff" if row == 3 else "soft"))), 3),
        "_drawn_car": lambda *_: "cars", "searched_groups": lambda *_: (CORNERS,), "_fmu": lambda *_: Path("any.fmu"),
        "Trials": lambda *_: SimpleNamespace(count=77),
    }.items():  # fmt: skip
        monkeypatch.setattr(shape_search, name, stub)
    asked = Request(vary=("rebound.low",), robustness=Robustness(6, 2.0), keep=0.7, objective="grip")
    study = SimpleNamespace(bank={}, baseline={})
    found = _find_curves(
        SimpleNamespace(study=study, folder=Path("out"), units={}), {}, None, None, asked, None, counted.append
    )
    assert found.gains.tolist() == [1.0, 0.5, -1.0]
    assert (found.predicted_gain, found.chance, found.car) == (1.0, pytest.approx(2.0 / 3.0), "cars")
    assert (found.band, counted) == (("band", [77]) if has_band else (None, []))
    assert (found.optimum.starts, found.optimum.status) == (((10.0, 9.0),), ("planned", "polished"))
    assert found.shapes_at(np.array([0.0]))[CORNERS].numbers() == STIFF.with_numbers({"rebound.low": 1500.0}).numbers()


def test_the_assured_gain_is_exceeded_by_95_percent_of_the_draws():
    found = Curves(None, None, {}, {}, {}, None, None, None, np.arange(101.0) - 3.0, None)
    assert found.assured_gain == pytest.approx(2.0)
    assert found.chance == pytest.approx(97.0 / 101.0)  # a gain of zero does not count


@dataclass(frozen=True)
class Bank:
    """A study, as far as its setups go."""

    bank: dict
    corners: dict
    name: str = "lap"
    alike: tuple = (CORNERS,)
    baseline: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Results:
    setups: np.ndarray
    table: object
    _cache: dict = field(default_factory=dict)


def test_targets_nearest_builds_and_valvings_are_run_as_fmus_of_their_own_beside_the_best_of_the_bank(
    monkeypatch, tmp_path
):
    """A setup's number is made from its builds; the rows are in the order of VERIFIED, not of their numbers."""
    (tmp_path / "shapes").mkdir()
    targets = [
        SimpleNamespace(name="+".join(group), corners=group, shape=shape, valving_shape=valving,
                        neighbours=[SimpleNamespace(build=near)])
        for group, shape, valving, near in ((("lf", "rf"), STIFF, SOFT, "stiff"), (("lr",), SOFT, STIFF, "soft"))
    ]  # fmt: skip
    study = Bank({"soft": Build(Path("soft.fmu")), "stiff": Build(Path("stiff.fmu"))}, dict.fromkeys(CORNERS, ()))
    setups, checked = [], []

    def find(_self):
        return SimpleNamespace(find=lambda one: setups.append(one) or SimpleNamespace(index=40 - 10 * len(setups)))

    def variant(study, folder):
        checked.append((study, folder))
        table = SimpleNamespace(take=lambda rows: np.array(["e", "d", "c", "b"])[rows].tolist())
        return SimpleNamespace(request=lambda _w, _c, numbers: Results(np.sort(numbers), table))

    monkeypatch.setattr(Bank, "space", property(find), raising=False)
    monkeypatch.setattr(
        shape_search, "build", lambda paths, _to: [SimpleNamespace(path=one.with_suffix(".fmu")) for one in paths]
    )
    whole = SimpleNamespace(study=study, folder=tmp_path, variant=variant)
    found = shape_search._verified(whole, None, None, dict.fromkeys(CORNERS, "soft"), targets)
    assert [list(one.values()) for one in setups] == [
        ["soft", "soft", "soft", "soft"],
        ["target lf+rf", "target lf+rf", "target lr", "soft"],
        ["stiff", "stiff", "soft", "soft"],
        ["valving lf+rf", "valving lf+rf", "valving lr", "soft"],
    ]
    assert found.table == ["b", "c", "d", "e"]  # numbers 30, 20, 10, 0 in ascending rows
    ((made, folder),) = checked
    assert (made.name, made.alike, folder) == ("lap: targets", (), tmp_path / "shapes")
    assert made.corners["lf"] == ("soft", "target lf+rf", "stiff", "valving lf+rf") and made.corners["rr"] == ("soft",)
    assert made.bank["valving lr"].fmu.name == "lr_valving.fmu"
    for name, shape in (("lf+rf", STIFF), ("lf+rf_valving", SOFT), ("lr", SOFT), ("lr_valving", STIFF)):
        law = read_shock(tmp_path / "shapes" / f"{name}.json").law
        assert law.curve.force(-0.3) == pytest.approx(shape.curve().force(-0.3))


def test_the_objective_is_the_named_measure_the_studys_or_its_first_measure():
    values = {"grip": np.array([1.0]), "heave": np.array([2.0])}
    result = SimpleNamespace(values=values.get, objective=np.array([3.0]), measures=[SimpleNamespace(name="heave")])
    assert shape_search._objectives(result, "grip") == [1.0]
    assert shape_search._objectives(result, "") == [3.0]
    result.objective = None
    assert shape_search._objectives(result, "") == [2.0]


def test_shapes_of_a_bank_are_fitted_to_its_shock_files(tmp_path):
    write_shock(Shock("stiff", STIFF.law()), tmp_path / "stiff.json")
    found = _shapes_of_bank({"stiff": tmp_path / "stiff.json"})["stiff"]
    assert found.relative < 1e-3
    assert found.shape.numbers()["rebound.low"] == pytest.approx(3000.0, rel=0.02)


LAGGED = Shape(Side(3e3, 1500.0, 0.1, 600.0, 100.0), Side(4e3, 1500.0, 0.1, 600.0, 100.0), lag=2e-3, gas=20.0)
STIFFER = LAGGED.with_numbers({"rebound.low": 3000.0, "compression.high": 900.0})
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
        return own or {10.0: 3, LAGGED.gas: 4}[build.parameters["gas_preload"]]

    return float("".join(str(digit(trial[corner])) for corner in FRONT + REAR))


@pytest.fixture(scope="module")
def targets(tmp_path_factory):
    """Targets of two groups: the front is as the stiff build, the rear as the soft one."""
    folder = tmp_path_factory.mktemp("bank")
    sources = {name: folder / f"{name}.json" for name in ("soft", "stiff")}
    for name, shape in (("soft", LAGGED), ("stiff", STIFFER)):
        write_shock(Shock(name, shape.law()), sources[name])
    space = ShockSpace(
        (FRONT, REAR), RANGES, lambda _group, own: Build(Path("any.fmu"), LAGGED.with_numbers(own).parameters())
    )
    study = SimpleNamespace(bank={name: Build(Path(f"{name}.fmu")) for name in sources})
    scores = lambda trials: SimpleNamespace(objectives=np.array([[objective(one)] for one in trials]))  # noqa: E731
    problem = SimpleNamespace(space=space, trials=SimpleNamespace(study=study), scores=scores)
    optimum = SimpleNamespace(point=np.array([0.5, 0.5, 0.995, 0.5]))
    velocity = np.linspace(-1.3, 1.3, 261)
    force = np.array([STIFFER.curve().force(v) for v in velocity.tolist()])
    valving = NearestValving(PARTS, 0.0, 0.0, 0.0, velocity, force, 1, ())

    def found(kept, *groups):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(shape_search, "nearest_valving", lambda _force: valving)
            shapes = {group: {FRONT: STIFFER, REAR: LAGGED}[group] for group in groups}
            bases = dict.fromkeys(groups, LAGGED)
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
    assert front.high[rebound] == pytest.approx(np.array(force(LAGGED, rebound_low=low))[rebound])
    assert front.low[rebound] == pytest.approx(
        np.array(force(STIFFER))[rebound]
    )  # 3000 N.s/m are beyond 0.7 of the range
    assert high < 3000.0
    assert front.high[~rebound] == pytest.approx(np.array(force(STIFFER))[~rebound])  # compression does not vary
    assert front.low[~rebound] == pytest.approx(np.array(force(LAGGED))[~rebound])
    assert rear.low[rebound] == pytest.approx(np.array(force(LAGGED, rebound_low=4000.0))[rebound])
    assert rear.high == pytest.approx(force(LAGGED))
    assert alone.low == pytest.approx(force(STIFFER)) and (alone.low == alone.high).all()


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
    assert front.neighbours[1].relative == pytest.approx(front.neighbours[1].difference / rms(STIFFER), rel=0.05)


def rms(shape):
    """RMS force of a shape's curve at equal steps of the root of the speed."""
    speed = 1.3 * np.linspace(0.0, 1.0, 200) ** 2
    return np.sqrt(np.mean([shape.curve().force(v) ** 2 for v in [*speed.tolist(), *(-speed).tolist()]]))


def test_the_shape_of_a_valving_has_its_curve_and_the_lag_and_gas_of_the_target(targets):
    (front, rear), _ = targets
    for one in (front, rear):
        found, wanted = one.valving_shape.curve(), STIFFER.curve()
        for v in (-1.2, -0.3, -0.05, 0.05, 0.3, 1.2):
            assert found.force(v) == pytest.approx(wanted.force(v), rel=0.02)
        assert (one.valving_shape.lag, one.valving_shape.gas) == (2e-3, 20.0)
        assert one.valving.valving is PARTS
    assert (front.name, rear.name) == ("lf+rf", "lr+rr")
