"""Certainties of constructed studies, kept number by number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cosim.study.choice.assess import Knowledge, certainty_of
from cosim.study.choice.certainty import Certainty, Effect, TradeOff, VehicleSource, certainty_reasons, summary_lines
from cosim.study.choice.posterior import half_width, probability_below
from cosim.study.definition import Constraint, Term
from cosim.study.table import StudyResult, error_column
from eightpost.corners import CORNERS

from .assessed import assessed, lag, paired, run, stating, two_setups
from .constructed import edited

BUILDS = ("A", "B", "C")
PLACES = {"lf": BUILDS[:2], "rf": BUILDS, "lr": BUILDS[1:], "rr": BUILDS}

FITS = paired(lag("C", 0.01, 0.5), replace(lag("B", -0.02, 0.25, "lr", "b"), parameter="lag"), 0.6)
CAR = Effect("car", "k", 1.0, 0.0, {"a": 0.01, "c": -0.02}, {"rf": {"B": {"a": 0.004}}})


def levels(digits: np.ndarray) -> dict[str, np.ndarray]:
    lf, rf, lr, rr = digits.T.astype(float)
    return {
        "a": np.exp(0.01 * lf - 0.02 * rr + 0.015 * rf * lr),
        "b": 2.0 + 0.05 * lr - 0.03 * rf + 0.01 * (lf - rr) ** 2,
        "c": 0.5 + 0.02 * (lf - 1.0) ** 2 + 0.01 * rr * rf,
    }


def study(**fields: object) -> StudyResult:
    """Return a study of 36 setups, of which one failed, with errors of the coupling of two measures."""
    given = {"builds": BUILDS, "corners": PLACES, "baseline": dict.fromkeys(CORNERS, "B")}
    responses = {name: lambda digits, name=name: levels(digits)[name] for name in "abc"}
    found = assessed(responses, (0.01, 0.2), failed=(17,), **given | fields)
    shares = {"a": 2e-4, "b": 5e-4}
    columns = {error_column(n): [share * (1.0 + k % 7) for k in range(len(found))] for n, share in shares.items()}
    return edited(found, **columns)


OBJECTIVE = (Term("a", 2.0, "m"), Term("b", -1.0, "in"))
LIMITS = (Constraint("b", at_most=2.11), Constraint("c", at_least=0.5, at_most=0.55))
RUNS = (run(0, a=1.012, b=2.004), run(5, a=1.0, b=2.01, c=0.51), replace(run(30, a=1.3), digest="other"))


@cache
def weighted() -> Certainty:
    noise = {"a": 0.002, "b": 0.004}
    return certainty_of(
        study(objective=OBJECTIVE, constraints=LIMITS), Knowledge((*FITS, CAR), (), noise, RUNS), draws=1024
    )


@cache
def by_one_measure() -> Certainty:
    """Rig runs of unknown repeatability, builds whose uncertainty is unknown, and a file that adds the vehicle's."""
    known = Knowledge((*FITS, CAR), ("A",), {}, RUNS[:2], ("a note",), VehicleSource.ADDED)
    return certainty_of(study(constraints=LIMITS[:1]), known, criterion="c", top=3, tests=5, draws=256)


def replaced() -> Certainty:
    known = Knowledge((CAR, *(lag(b, 0.004, 1.0, m, "b") for b in BUILDS for m in ("lr", "rf"))), (), {"b": 0.01},
                      vehicle=VehicleSource.REPLACED)  # fmt: skip
    return certainty_of(study(baseline={}), known, criterion="b", draws=1000)


def infeasible() -> Certainty:
    return certainty_of(study(constraints=(Constraint("a", at_most=0.1),)))


def doubtful_limits() -> Certainty:
    """A limit that few draws meet."""
    return certainty_of(study(constraints=(Constraint("b", at_most=1.935),)), Knowledge((*FITS, CAR)), draws=1024)


def negative_levels() -> Certainty:
    found = assessed(
        {"a": lambda d: d[:, 0] - 1.0, "b": lambda d: levels(d)["b"]}, builds=BUILDS,
        corners=PLACES, objective=(Term("a", 1.0, "in"), Term("b", 1.0, "m")),
    )  # fmt: skip
    return certainty_of(found, Knowledge((CAR,)))


def many_setups() -> Certainty:
    """More setups than are compared, and a vehicle that states nothing about one measure."""
    found = assessed(
        {"a": lambda d: np.exp(1e-3 * (d[:, 0] - d[:, 3])), "b": lambda d: 1.0 + 0.01 * d[:, 1]}, (0.0, 0.3)
    )
    return certainty_of(stating(found, {"o0": (0.02, 0.3)}), Knowledge((lag("C/C", 0.01),)), draws=256)


@pytest.mark.parametrize("made", [
    pytest.param(weighted, marks=pytest.mark.slow), by_one_measure, replaced, infeasible, doubtful_limits,
    negative_levels, many_setups,
], ids=lambda made: made.__name__)  # fmt: skip
def test_a_certainty_is_unchanged(made: Callable[[], Certainty], unchanged: Callable[..., None]) -> None:
    found = made()
    short = replace(found, effects=(), runs=(), ties=())
    if made is many_setups:  # rounding decides among setups that are equally good
        short = replace(short, among=np.zeros_like(found.among), tests=())
    unchanged({"certainty": short, "ties": np.array(found.ties)}, relative=1e-4)


@pytest.mark.slow
def test_what_is_said_of_a_certainty_is_unchanged(unchanged: Callable[..., None]) -> None:
    result = study(objective=OBJECTIVE, constraints=LIMITS)
    found = weighted()
    changes = 0.01 * (np.arange(10.0) - 4.5)
    offs = tuple(TradeOff(f"m{k}", one, one - 2e-3, one + 2e-3, 0.0) for k, one in enumerate(changes.tolist()))
    many = replace(found, ties=tuple(range(8)), trade_offs=offs)
    unchanged({
        name: [*summary_lines(result, one), *(str(reason) for reason in certainty_reasons(one))]
        for name, one in {"weighted": found, "many": many, "one measure": by_one_measure()}.items()
    })  # fmt: skip


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lower_objective_is_a_negative_change_whatever_its_sign(sign: float) -> None:
    """The levels are 1.00 and 1.02; minus a measure, which rewards a high one, is an objective below zero."""
    found = two_setups(0.02, (0.0, 0.001), objective=(Term("a", sign, "m"),))
    lead, other = ("C/C", "B/B") if sign < 0.0 else ("B/B", "C/C")
    known = replace(found, study=replace(found.study, baseline=dict.fromkeys(CORNERS, "B/B") | {"rr": other}))
    (whole,) = [one for one in certainty_of(known).trade_offs if one.measure == "objective"]
    assert lead != other and whole.high < 0.0 and whole.lowest == 0.0


def test_a_sum_without_an_error_is_below_a_value_or_not() -> None:
    none = np.zeros(3)
    assert probability_below(np.array([-1e-9, 0.0, 1e-9]), none, none, 4.0).tolist() == [0.0, 0.5, 1.0]
    assert half_width(0.95, none, none, 4.0).tolist() == [0.0, 0.0, 0.0]
