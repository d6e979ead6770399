"""Choice of the coupling: the largest step that meets the accuracy, on the setups with the largest errors."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.session.result import difference
from cosim.session.verdict import Coupled
from cosim.study import Build
from cosim.study.running.batches import Pilot, fit_error_model, local_errors
from cosim.study.running.coupling import candidates, choose_coupling, coupling_for, finer
from cosim.study.running.evaluator import Evaluator
from eightpost.archive import read_archive, write_archive
from eightpost.corners import CORNERS
from eightpost.errors import DivergedError, StepError, WiringError


@pytest.fixture
def found_error():
    """Return a function found_error(evaluator, setup, coupling): error against a run at an eighth of the step [%]."""

    def find(evaluator, setup, coupling):
        drive, names = evaluator.study.drives[0], evaluator.decisive(setup)
        fine = evaluator.run(setup, drive, replace(coupling, step=1e-4), extra=names)
        apart = difference(evaluator.run(setup, drive, coupling, extra=names).settled(), fine.settled())
        return max(apart[name] for name in names)

    return find


@pytest.mark.nightly
def test_the_chosen_step_is_the_largest_that_meets_the_accuracy_in_every_setup(small_study, found_error):
    evaluator = Evaluator(small_study())
    coupling = choose_coupling(evaluator)
    parts = round(evaluator.study.record_step / coupling.step)
    larger = replace(coupling, step=evaluator.study.record_step / (parts - 1))
    setups = [evaluator.study.space.setup(index) for index in (0, 6, 9, 15)]
    assert max(found_error(evaluator, setup, coupling) for setup in setups) <= evaluator.study.accuracy
    assert max(found_error(evaluator, setup, larger) for setup in setups) > 0.8 * evaluator.study.accuracy


@pytest.mark.nightly
def test_the_coupling_error_of_a_row_has_the_size_of_the_actual_error(small_study, found_error):
    evaluator = Evaluator(small_study())
    coupling = choose_coupling(evaluator)
    for index in (0, 6, 9, 15):
        setup = evaluator.study.space.setup(index)
        stated = evaluator.row(setup, coupling)["coupling_error_percent"]
        assert 0.5 * stated < found_error(evaluator, setup, coupling) < 2.0 * stated


@pytest.mark.nightly
def test_the_step_needed_by_stiff_shocks_is_also_used_for_soft_ones(small_study, fmus, found_error):
    stiff = {"compression_scale": 10.0, "rebound_scale": 10.0, "time_constant": 5e-5}
    bank = {"soft": Build(fmus["lpnl2"]), "stiff": Build(fmus["lpnl2"], stiff)}
    study = small_study(bank=bank, record_step=2e-3, settling=0.04)
    study = replace(study, drives=(replace(study.drives[0], stop=0.3),))
    alone = replace(study, corners=dict.fromkeys(CORNERS, ("soft",)))
    both, soft = choose_coupling(Evaluator(study)), choose_coupling(Evaluator(alone))
    assert (both.scheme, soft.scheme) == ("implicit", "gauss-seidel")
    setup = study.space.find(dict.fromkeys(CORNERS, "stiff"))
    assert found_error(Evaluator(study), setup, both) <= study.accuracy


@pytest.mark.nightly
def test_a_build_that_fails_does_not_prevent_the_choice_of_a_coupling(small_study, fmus):
    bad = Build(fmus["lpnl2"], {"lag_full_force": 2000.0, "lag_zero_force": 1000.0})
    evaluator = Evaluator(small_study(bank={"soft": Build(fmus["lpnl2"]), "stiff": bad}))
    assert "stiff" not in choose_coupling(evaluator).notes[1]
    alone = Evaluator(small_study(bank={"soft": bad, "stiff": bad}))
    with pytest.raises(StepError, match="no setup could be run"):
        choose_coupling(alone)


# ==== Estimate of coupling errors from local errors: exact if the errors are sums of squares =========================

GAINS = np.array([4.0, 1.0, 0.25, 9.0])


def run_with(forces):
    """Return a run whose bonds report these local errors of force [N]."""
    coupled = {c: Coupled(0.0, 1.0, f, 100.0, 1.0, 100.0) for c, f in zip(CORNERS, forces, strict=True)}
    return SimpleNamespace(coupled=coupled)


def pilots(count, random):
    forces = random.uniform(0.5, 2.0, (count, 4))
    return [
        Pilot(
            local_errors(run_with(row)),
            {"car.lf.force": float(np.sqrt(row**2 @ GAINS))},
            {"grip": float(1e-3 * row[3])},
        )
        for row in forces
    ]


def test_errors_that_are_sums_of_squares_are_predicted_exactly_for_builds_that_no_pilot_had():
    random = np.random.default_rng(3)
    model = fit_error_model(pilots(12, random))
    for row in random.uniform(0.1, 5.0, (20, 4)):
        largest, errors = model.of(local_errors(run_with(row)))
        assert largest == pytest.approx(np.sqrt(row**2 @ GAINS), rel=1e-6)
        assert errors["grip"] == pytest.approx(1e-3 * row[3], rel=1e-6)


def test_ends_that_report_no_error_are_left_out():
    assert fit_error_model(pilots(5, np.random.default_rng(4))).ends == tuple(f"{c}.force" for c in CORNERS)


def test_errors_are_overstated_for_some_pilots_by_as_much_as_they_are_understated_for_others():
    found = [p._replace(channels={"a": p.channels["car.lf.force"] * s})
             for p, s in zip(pilots(8, np.random.default_rng(5)), [0.7, 1.4] * 4, strict=True)]  # fmt: skip
    model = fit_error_model(found)
    ratios = [model.of(p.local)[0] / p.channels["a"] for p in found]
    assert min(ratios) * max(ratios) == pytest.approx(1.0)


def test_errors_of_measures_are_unbiased_in_the_mean_square() -> None:
    """One error is zero by chance; the others must not be underestimated because of it."""
    found = [
        p._replace(measures={"grip": 1e-3 * k})
        for p, k in zip(pilots(8, np.random.default_rng(5)), [0, 1, 2, 3, 2, 1, 2, 1], strict=True)
    ]
    model = fit_error_model(found)
    stated = [model.of(p.local)[1]["grip"] for p in found]
    assert np.mean(np.square(stated)) == pytest.approx(np.mean([p.measures["grip"] ** 2 for p in found]))


def test_a_measure_without_any_error_has_gains_of_zero():
    found = [p._replace(measures={"mean": 0.0}) for p in pilots(5, np.random.default_rng(6))]
    model = fit_error_model(found)
    assert model.of(found[0].local)[1]["mean"] == 0.0


# ---- FMUs that make steps of one size only ---------------------------------------------------------------------------


@pytest.fixture
def of_one_step(fmus, tmp_path):
    """Return a function that makes a build of a shock which declares to make steps of one size [s] only."""

    def make(size):
        members = read_archive(fmus["lpnl2"])
        text = members["modelDescription.xml"].decode()
        text = text.replace('StepSize="true"', 'StepSize="false"').replace('stepSize="0.001"', f'stepSize="{size}"')
        write_archive(tmp_path / f"{size}.fmu", members | {"modelDescription.xml": text.encode()})
        return Build(tmp_path / f"{size}.fmu")

    return make


def test_an_fmu_with_one_step_size_is_run_at_it_only_and_the_coupling_error_is_unknown(
    small_study, of_one_step, fmus, monkeypatch
):
    bank = {"fixed": of_one_step(0.001), "any": Build(fmus["lpnl2"])}
    study = small_study(bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)), settling=0.1)
    study = replace(study, drives=(replace(study.drives[0], stop=0.3),))
    evaluator, steps = Evaluator(study), set()
    run = Evaluator.run

    def recorded(self, setup, drive, coupling, **options):
        steps.add(coupling.step)
        return run(self, setup, drive, coupling, **options)

    monkeypatch.setattr(Evaluator, "run", recorded)
    coupling = choose_coupling(evaluator)
    assert (coupling.scheme, coupling.step, coupling.errors, steps) == ("gauss-seidel", 0.001, None, {0.001})
    assert "the only step of an FMU (stepSize)" in coupling.notes[0]
    row = evaluator.row(study.space.setup(0), coupling)
    assert row["status"] == "done" and row["coupling_error_percent"] is None


def test_fmus_with_different_step_sizes_are_refused(small_study, of_one_step):
    bank = {"a": of_one_step(0.001), "b": of_one_step(0.004)}
    study = small_study(bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))
    with pytest.raises(WiringError, match=r"001\.fmu of 1 ms and .*004\.fmu of 4 ms only \(stepSize\)"):
        choose_coupling(Evaluator(study))


def test_a_step_at_which_the_study_diverges_is_run_with_the_implicit_scheme(small_study, of_one_step, monkeypatch):
    def diverges(*_, **__):
        raise DivergedError("it diverged")

    monkeypatch.setattr(Evaluator, "run", diverges)
    bank = {"fixed": of_one_step(0.001)}
    coupling = choose_coupling(Evaluator(small_study(bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))))
    assert coupling.scheme == "implicit"


# ---- Kept couplings, setups and rows --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def short(small_study):
    """A study of two builds on a fraction of a second of the track."""
    study = small_study(settling=0.1, accuracy=3.0, baseline={"lf": "soft", "rf": "soft", "lr": "stiff", "rr": "stiff"})
    return Evaluator(replace(study, drives=(replace(study.drives[0], stop=0.5),)))


def _record(coupling):
    found = asdict(coupling) | {"notes": coupling.notes[-2:]}
    return {key: value for key, value in found.items() if value is not None}


@pytest.mark.slow
def test_a_coupling_through_the_fmus_and_its_rows_are_unchanged(short, unchanged):
    coupling = choose_coupling(short)
    unchanged(_record(coupling), relative=1e-3)
    setup = short.study.space.setup(6)
    unchanged(short.row(setup, coupling) | {"seconds": 0.0}, "row", relative=1e-3)


@pytest.mark.slow
def test_a_coupling_on_the_machine_and_its_rows_are_unchanged(short, unchanged):
    coupling = coupling_for(short)
    assert coupling.machine is not None
    notes = [re.sub(r"\d+ setups at once \([^)]*\)", "setups at once", note) for note in coupling.notes]
    found = _record(coupling) | {"notes": notes}
    unchanged(found | {"machine": found["machine"] | {"errors": None}}, relative=1e-3)
    rows = short.rows([short.study.space.setup(k) for k in (0, 6, 15)], coupling)
    unchanged([row | {"seconds": 0.0} for row in rows], "rows", relative=1e-2)


@pytest.mark.parametrize(("parts", "excess", "more"), [
    (1, 1.0, 2), (4, 1.5, 5), (10, 8.0, 16), (10, 8.3, 16), (10, 20.0, 20), (10, 999.0, 20), (10, 1001.0, 20),
    (10, np.inf, 20),
    (100, 1.0, 101), (100, 3.0, 115),
])  # fmt: skip
def test_the_number_of_steps_follows_from_a_third_order_with_a_margin(parts, excess, more):
    assert finer(parts, excess) == more


def test_the_setups_on_which_a_step_is_chosen_are_the_baseline_and_those_with_one_build(small_study, fmus):
    bank = {f"b{k}": Build(fmus["lpnl2"], {"rebound_scale": 1.0 + k}) for k in range(30)}
    study = small_study(bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)), baseline=dict.fromkeys(CORNERS, "b3"))
    numbers = [setup.index for setup in candidates(SimpleNamespace(study=study))]
    same = [k * (30**3 + 30**2 + 30 + 1) for k in range(30)]
    assert numbers[0] == same[3] and set(numbers) <= set(same) and len(numbers) == len(set(numbers))
    assert [same.index(number) for number in numbers] == [3, 0, *range(6, 30, 3)]
    corners = dict(zip(CORNERS, (("b0",), ("b1",), ("b2",), ("b4", "b5")), strict=True))
    apart = replace(study, corners=corners, baseline={})
    assert [setup.index for setup in candidates(SimpleNamespace(study=apart))] == [0, 1]
