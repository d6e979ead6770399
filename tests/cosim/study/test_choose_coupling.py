"""Choice of the coupling: the largest step that meets the accuracy, on the setups with the largest errors."""

from dataclasses import replace

import pytest

from cosim.session.result import difference
from cosim.study import Build
from cosim.study.running.coupling import choose_coupling
from cosim.study.running.evaluator import Evaluator
from eightpost.corners import CORNERS
from eightpost.errors import StepError


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
def test_a_higher_accuracy_needs_a_smaller_step(small_study):
    steps = [choose_coupling(Evaluator(small_study(accuracy=a))).step for a in (2.0, 0.2, 0.06)]
    assert steps == sorted(steps, reverse=True) and steps[0] > steps[2]


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
