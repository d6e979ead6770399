"""A large space runs in single precision: its best setups are those of double, and the difference is stated."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from cosim.study import Build, Constraint, Drive, Measure, Term, Vehicle
from cosim.study.running import leaders as leading
from cosim.study.running import sweep as sweeping
from cosim.study.running.coupling import with_rounding
from cosim.study.running.evaluator import Coupling, Evaluator, Rounding, coupling_of
from cosim.study.running.sweep import Sweep
from cosim.study.table import StudyResult, error_column
from eightpost.corners import CORNERS

from ..conftest import MEASURES, WorkersHere
from .lanes import COUPLING, TRACK, study_of
from .test_rows import at

#: Number of the leaders, and of the best setups that are compared.
LEADERS, COMPARED = 60, 50


class Recorded(WorkersHere):
    """Workers in this process with a given coupling, which count the setups of each precision."""

    def __init__(self, coupling):
        super().__init__()
        self._coupling, self.precisions = coupling, Counter()

    def choose(self, _study):
        return self._coupling

    def rows(self, study, coupling, chunks, stop):
        for chunk, rows in super().rows(study, coupling, chunks, stop):
            self.precisions["single" if coupling.machine.in_single else "double"] += len(rows)
            yield chunk, rows


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    monkeypatch.setattr(leading, "_LEAST", LEADERS)
    monkeypatch.setattr("cosim.study.running.sweep.check_setup", _not_compared)


def _not_compared(*_):
    raise sweeping.NotInBatchError("comparing takes long, and has tests of its own")


@pytest.fixture(scope="module")
def study(fmus):
    scales = {"soft": ("lpnl2", 0.7, 0.8), "stiff": ("lpnl2", 1.5, 1.2), "lag": ("lpf1", 0.9, 1.6)}
    names = ("compression_scale", "rebound_scale")
    builds = {build: Build(fmus[law], dict(zip(names, own, strict=True))) for build, (law, *own) in scales.items()}
    builds["stop"] = Build(fmus["hysteresis"])
    objective = (Term(MEASURES[1].name, 1.0), Term(MEASURES[0].name, 1e5))
    return study_of(fmus, builds, measures=MEASURES, objective=objective, settling=0.3)


def ran(study, folder, monkeypatch, *, large=256):
    """Return the result of a study, and the number of setups of each precision."""
    monkeypatch.setattr(sweeping, "LARGE", large)
    workers = Recorded(at(COUPLING, 2e-3, study))
    sweep = Sweep(study, folder)
    return sweep.run(workers, sweep.coupling_of_all(workers)), workers.precisions, sweep


@pytest.mark.slow
def test_the_best_setups_are_those_of_double_precision(study, tmp_path, monkeypatch):
    """Also those that meet a constraint that half of the setups break."""
    ride = MEASURES[0].name
    whole, precisions, _ = ran(study, tmp_path / "double", monkeypatch, large=1000)
    assert precisions == {"double": 256} and not ran(study, tmp_path / "double", monkeypatch)[1]
    half = Constraint(ride, at_most=float(np.median(whole.values(ride))))
    for k, constrained in enumerate((study, replace(study, constraints=(half,)))):
        right = replace(whole, study=constrained)
        found, precisions, _ = ran(constrained, tmp_path / f"single {k}", monkeypatch)
        assert precisions["single"] == 256 and LEADERS <= precisions["double"] < 150 and not found.partial
        best = right.ranking()[:COMPARED]
        assert best.size == COMPARED and best.tolist() == found.ranking()[:COMPARED].tolist()
        for measure in MEASURES:
            exact, own = right.values(measure.name), found.values(measure.name)
            assert (exact[best] == own[best]).all()
            rounding = coupling_of(found).machine.rounding.measures[measure.name]
            assert 0.0 < np.abs(exact - own).max() < 3.0 * rounding < 1e-4 * exact.min()


@pytest.mark.slow
def test_a_study_whose_leaders_did_not_run_in_double_is_partial_and_goes_on(study, tmp_path, monkeypatch):
    class Stopped(Recorded):
        def rows(self, study, coupling, chunks, stop):
            if not coupling.machine.in_single:
                raise KeyboardInterrupt
            return super().rows(study, coupling, chunks, stop)

    with pytest.raises(KeyboardInterrupt), monkeypatch.context() as patch:
        patch.setattr(f"{__name__}.Recorded", Stopped)
        ran(study, tmp_path, monkeypatch)
    assert StudyResult.load(tmp_path / "results.parquet").partial
    found, precisions, _ = ran(study, tmp_path, monkeypatch)
    assert set(precisions) == {"double"} and not found.partial


@pytest.mark.slow
def test_a_request_after_a_run_in_single_precision_is_in_double(study, tmp_path, monkeypatch):
    found, _, sweep = ran(study, tmp_path, monkeypatch)
    again, worst = Recorded(None), int(found.setups[found.ranking()[-1]])
    exact = Sweep(study, tmp_path).request(again, coupling_of(found), [worst])
    assert again.precisions == {"double": 1}
    assert exact.values(MEASURES[0].name)[0] != found.values(MEASURES[0].name)[found.setups == worst]
    assert sweep.coupling_of_all(again) == coupling_of(found)


def test_the_note_states_the_difference_in_single_precision(study):
    found = with_rounding(Evaluator(study), at(COUPLING, 2e-3, study))
    rounding = found.machine.rounding
    assert 0.0 < rounding.percent < 1e-3 and not found.machine.in_single
    assert found.notes[-1] == (
        f"single precision differs by {rounding.percent:.2g} % in 104 setups: "
        "all setups run in it, and the best ones again in double precision"
    )


def test_the_difference_is_added_to_the_errors_of_setups_in_single_precision(study):
    evaluator, coupling = Evaluator(study), at(COUPLING, 2e-3, study)
    exact = Rounding(0.0, dict.fromkeys((measure.name for measure in study.measures), 0.0))
    rough = Rounding(3.0, dict.fromkeys(exact.measures, 5.0))
    setups = [study.space.setup(7)]
    double, without, single = (
        evaluator.rows(
            setups, replace(coupling, machine=replace(coupling.machine, rounding=own)).in_single(single=own is not None)
        )[0]
        for own in (None, exact, rough)
    )
    for column, error in {
        "coupling_error_percent": 3.0,
        **{error_column(name): 5.0 for name in exact.measures},
    }.items():
        assert single[column] - without[column] == pytest.approx(error)
        assert double[column] != without[column] == pytest.approx(double[column], rel=1e-3)


def test_a_large_static_load_is_too_coarse_for_single_precision(fmus, study):
    """The tire force is 1e9 N, of which single precision has 64 N."""
    vehicle = Vehicle(fmus["quarter_car"], inputs={"aero_force": 1e9})
    drive, measures = (
        Drive("track", TRACK, 2.0, targets={"lf.road": "car.road"}),
        (Measure("tire", ("car.tire_force",)),),
    )
    loaded = study_of(fmus, study.bank, vehicle, drives=(drive,), measures=measures)
    found = with_rounding(Evaluator(loaded), at(COUPLING, 2e-3, loaded))
    assert found.machine.rounding is None
    assert found.notes[-1].startswith("all setups run in double precision: single precision differs by ")


def test_a_study_through_the_fmus_has_no_precision(study):
    through_fmus = Coupling("gauss-seidel", 1e-3)
    assert with_rounding(Evaluator(study), through_fmus) is through_fmus
    assert through_fmus.in_single() is through_fmus


def test_a_setup_that_single_precision_does_not_finish_runs_in_double(fmus, study):
    """The limits of its lagged force are equal in single precision."""
    sharp = Build(fmus["lpnl2"], {"lag_full_force": 200.0, "lag_zero_force": 200.000001})
    bank = {**study.bank, "sharp": sharp}
    mixed = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))
    setups = [mixed.space.find(dict.fromkeys(CORNERS, name)) for name in bank]
    evaluator = Evaluator(mixed)
    double = at(COUPLING, 2e-3, mixed)
    single = with_rounding(Evaluator(study), double).in_single()
    for own, right in zip(evaluator.rows(setups, single), evaluator.rows(setups, double), strict=True):
        same = {name: own[name] == right[name] for name in (measure.name for measure in MEASURES)}
        assert set(same.values()) == {own["lf"] == "sharp"} and own["status"] == "done"
