"""Estimate of coupling errors from local errors: exact if the errors are sums of squares."""

from types import SimpleNamespace

import numpy as np
import pytest

from cosim.session.verdict import Coupled
from cosim.study.running.evaluator import Pilot, fit_error_model, local_errors
from eightpost.corners import CORNERS

GAINS = np.array([4.0, 1.0, 0.25, 9.0])


def run_with(forces):
    """Return a run whose bonds report these local errors of force [N]."""
    coupled = {c: Coupled(0.0, 1.0, f, 100.0, 1.0, 100.0) for c, f in zip(CORNERS, forces, strict=True)}
    return SimpleNamespace(coupled=coupled)


def pilots(count, random):
    forces = random.uniform(0.5, 2.0, (count, 4))
    return [
        Pilot(run_with(row), {"car.lf.force": float(np.sqrt(row**2 @ GAINS))}, {"grip": float(1e-3 * row[3])})
        for row in forces
    ]


def test_errors_that_are_sums_of_squares_are_predicted_exactly_for_builds_that_no_pilot_had():
    random = np.random.default_rng(3)
    model = fit_error_model(pilots(12, random))
    for row in random.uniform(0.1, 5.0, (20, 4)):
        run = run_with(row)
        assert model.worst_channel(run) == pytest.approx(np.sqrt(row**2 @ GAINS), rel=1e-6)
        assert model.of_measures(run)["grip"] == pytest.approx(1e-3 * row[3], rel=1e-6)


def test_ends_that_report_no_error_are_left_out():
    assert fit_error_model(pilots(5, np.random.default_rng(4))).ends == tuple(f"{c}.force" for c in CORNERS)


def test_errors_are_overstated_for_some_pilots_by_as_much_as_they_are_understated_for_others():
    found = [p._replace(channels={"a": p.channels["car.lf.force"] * s})
             for p, s in zip(pilots(8, np.random.default_rng(5)), [0.7, 1.4] * 4, strict=True)]  # fmt: skip
    model = fit_error_model(found)
    ratios = [model.worst_channel(p.result) / p.channels["a"] for p in found]
    assert min(ratios) * max(ratios) == pytest.approx(1.0)


def test_errors_of_measures_are_unbiased_in_the_mean_square() -> None:
    """One error is zero by chance; the others must not be underestimated because of it."""
    found = [
        p._replace(measures={"grip": 1e-3 * k})
        for p, k in zip(pilots(8, np.random.default_rng(5)), [0, 1, 2, 3, 2, 1, 2, 1], strict=True)
    ]
    model = fit_error_model(found)
    stated = [model.of_measures(p.result)["grip"] for p in found]
    assert np.mean(np.square(stated)) == pytest.approx(np.mean([p.measures["grip"] ** 2 for p in found]))


def test_a_measure_without_any_error_has_gains_of_zero():
    found = [p._replace(measures={"mean": 0.0}) for p in pilots(5, np.random.default_rng(6))]
    model = fit_error_model(found)
    assert model.of_measures(found[0].result)["mean"] == 0.0


def test_local_errors_are_named_by_bond_and_way():
    assert local_errors(run_with([1.0, 2.0, 3.0, 4.0]))["rf.force"] == 2.0
