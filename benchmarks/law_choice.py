"""Benchmark of the automatic choice of law and curve: is the choice the best on data that it never saw?

    python benchmarks/law_choice.py [--json FILE] [--configurations 1,5] [--cases WORDS] [--page FILE] [--ours]

The cases are the twelve configurations of Table 3.1 (chosen on one phase draw, judged on another) and, if
EIGHTPOST_DATA names the folder of measured records, the held-out runs of benchmarks/shock_fit.py and the first and the
last third of every measured record, each held out from the other two. Prints Markdown: the held-out error of each law
with polynomials and with a curve through knots, in percent of the force's standard deviation, the choice, what is best
in hindsight, and the excess of the choice's error; cases in which knots lose most against polynomials come first. Where
another run is predicted, a second line has the errors with the best offset and gain of each prediction: the level
between runs does not follow from the motion, so these are the errors of the laws' shapes.
Bouc-Wen (20 starts) and a small free-running NARX are fitted for comparison; they cannot be chosen, and --ours leaves
them out.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

# Small matrices: more threads are slower.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from benchmarks.shock_records import BOUC_WEN, NARX, Case, configurations, measured, thirds
from benchmarks.shock_rows import FitErrors, attempt
from benchmarks.shock_tables import grid
from benchmarks.table import number
from eightpost.ident import fit_shock
from eightpost.ident.shock.choice_verdict import ONE_SPEED_ONLY
from eightpost.ident.shock.curve import CurveKind
from eightpost.ident.shock.law_choice import LawChoice
from eightpost.shock import LAWS, law_title
from eightpost.verdict import Grade

#: Required: the chosen law is within this share of the best in hindsight, in this share of the cases.
CLOSE, SHARE = 0.05, 0.9

#: Required: error of Hysteresis over that of LPNL2 with polynomials, in the median of the measured cases.
MOST_OF_LPNL2 = 0.8

#: Error that a usable shock should not have on another record, in percent of the force's standard deviation.
POOR = 10.0

#: Kinds of curve, in the order of the cells.
CURVES: tuple[CurveKind, ...] = ("polynomial", "knots")

#: A law with a kind of curve.
Candidate = tuple[str, CurveKind]

#: Candidates whose errors are compared.
HYSTERESIS: Candidate = ("hysteresis", "knots")
LPNL2: Candidate = ("lpnl2", "polynomial")


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors on a held-out record, in percent of its force's standard deviation.

    Attributes:
        laws: Error of each law and curve.
        chosen: Chosen law and curve.
        bouc_wen: Error of Bouc-Wen; None if it was not fitted.
        narx: Error of a small free-running NARX; None if it was not fitted.
    """

    laws: Mapping[Candidate, float]
    chosen: Candidate
    bouc_wen: float | None = None
    narx: float | None = None

    @property
    def best(self) -> Candidate:
        """Law and curve with the lowest error."""
        return min(self.laws, key=lambda one: self.laws[one])

    @property
    def regret(self) -> float:
        """Excess of the choice's error over the best, over the best [1]."""
        return self.laws[self.chosen] / self.laws[self.best] - 1.0

    def ratio(self, law: str) -> float:
        """Return the error of a law with knots over that with polynomials [1]; 1 if either is missing."""
        one, other = (self.laws.get((law, curve)) for curve in CURVES)
        return 1.0 if one is None or other is None else other / one

    def row(self) -> dict[str, Any]:
        """Return the values that --json writes."""
        return {
            "best": self.best,
            "regret": self.regret,
            "errors": {f"{law}, {curve}": error for (law, curve), error in self.laws.items()},
            "bouc_wen": self.bouc_wen,
            "narx": self.narx,
        }


@dataclass(frozen=True, slots=True)
class Chosen:
    """A choice and what it is worth.

    Attributes:
        case: Records of the choice, and the record that it is judged on.
        choice: Comparison of the laws.
        raw: Errors on the held-out record.
        shape: The same with the best offset and gain, if the held-out record is another run; else None.
        seconds: Processor time of all fits of the choice [s].
        grade: Grade of the fit's verdict.
        is_one_speed: Whether the verdict says that the test has a single speed.
    """

    case: Case
    choice: LawChoice
    raw: Errors
    shape: Errors | None
    seconds: float
    grade: Grade
    is_one_speed: bool

    @property
    def gain_free(self) -> Errors:
        """Errors without the level of another run, or the only ones."""
        return self.shape or self.raw

    def row(self) -> dict[str, Any]:
        """Return the row that --json writes."""
        return {
            "record": self.case.record,
            "chosen": self.raw.chosen,
            **self.raw.row(),
            "with_best_gain": self.shape.row() if self.shape else None,
            "cross_validated": {s.law: s.held_out.percent for s in self.choice.scores if s.blocks is not None},
            "seconds": self.seconds,
            "verdict": self.grade.value,
            "single speed": self.is_one_speed,
        }


def judged(case: Case, *, with_others: bool = True) -> Chosen:
    """Choose law and curve on the fitted records of a case, and judge the choice on its held-out record."""
    started = process_time()
    fit = fit_shock(case.fitted, "auto", segment=case.segment)
    seconds, choice = process_time() - started, fit.choice
    assert choice is not None
    assert choice.chosen.curve is not None
    found = {(law, curve): attempt(case, law, "joint", curve) for law in LAWS for curve in CURVES}
    results = {one: result for one, result in found.items() if isinstance(result, FitErrors)}
    others = [attempt(case, law, "joint") if with_others else None for law in (BOUC_WEN, NARX)]
    peers = [one if isinstance(one, FitErrors) else None for one in others]

    def errors(figure: Callable[[FitErrors], float]) -> Errors:
        laws = {one: figure(result) for one, result in results.items()}
        return Errors(laws, candidate, *(figure(one) if one else None for one in peers))

    candidate = choice.law, choice.chosen.curve.kind
    shape = errors(lambda one: one.shape_percent) if case.is_run_to_run else None
    rules = {reason.rule for reason in fit.verdict.reasons}
    raw = errors(lambda one: one.validation_percent)
    return Chosen(case, choice, raw, shape, seconds, fit.verdict.grade, ONE_SPEED_ONLY.name in rules)


def cases(numbers: Sequence[int]) -> Iterator[Case]:
    """Yield all cases, virtual ones first."""
    yield from configurations(numbers, quick=True)
    yield from measured(quick=True)
    yield from thirds()


def choices_table(found: Sequence[Chosen]) -> str:
    """Return the errors of each law and curve, the choice and its excess as Markdown, worst ratio of knots first."""
    peers = any(one.raw.bouc_wen is not None for one in found)
    others = ("Bouc-Wen", "NARX") if peers else ()
    heads = ("record", *map(law_title, LAWS), *others, "auto", "best in hindsight", "excess [%]", "verdict")
    ordered = sorted(found, key=lambda one: max(map(one.raw.ratio, LAWS)), reverse=True)
    return grid(heads, [line for one in ordered for line in _lines(one, peers=peers)])


def _lines(one: Chosen, *, peers: bool) -> Iterator[list[str]]:
    speed = ", single speed" if one.is_one_speed else ""
    yield [*_cells(one.case.record, one.raw, peers=peers), f"{one.grade.value}{speed}"]
    if one.shape:
        yield [*_cells("- the same, best offset and gain", one.shape, peers=peers), ""]


def _cells(record: str, one: Errors, *, peers: bool) -> list[str]:
    errors = [" / ".join(_error(one, (law, curve)) for curve in CURVES if (law, curve) in one.laws) for law in LAWS]
    others = [number(error) for error in (one.bouc_wen, one.narx)] if peers else []
    return [record, *errors, *others, _name(one.chosen), _name(one.best), f"{100.0 * one.regret:.1f}"]


def _error(one: Errors, candidate: Candidate) -> str:
    text = number(one.laws.get(candidate))
    return f"**{text}**" if candidate == one.chosen else text


def _name(candidate: Candidate) -> str:
    return f"{law_title(candidate[0])}, {candidate[1]}"


def gains_table(found: Sequence[Chosen]) -> str:
    """Return what Hysteresis gains over LPNL2 and over the best other law as Markdown, largest gain over LPNL2 first.

    Other runs count with their best offset and gain.
    """
    heads = (
        "record", "Hysteresis [%]", "LPNL2, polynomials [%]", "best other law [%]", "over LPNL2 [%]",
        "over the best other [%]",
    )  # fmt: skip
    lines = []
    for one in found:
        errors = one.gain_free.laws
        if _hysteresis_ratio(one.gain_free) is None:
            continue
        ours, lpnl2 = errors[HYSTERESIS], errors[LPNL2]
        other = min((candidate for candidate in errors if candidate != HYSTERESIS), key=lambda one: errors[one])
        over, over_best = (100.0 * (ours / error - 1.0) for error in (lpnl2, errors[other]))
        name = one.case.record + (" (best offset and gain)" if one.shape else "")
        best = f"{number(errors[other])} ({_name(other)})"
        lines.append((over, [name, number(ours), number(lpnl2), best, f"{over:+.0f}", f"{over_best:+.0f}"]))
    return grid(heads, [cells for _, cells in sorted(lines, key=lambda line: line[0])])


def summary(found: Sequence[Chosen]) -> str:
    """Return the share of good choices and the distributions of excess and gain, largest losses first."""
    raw = [one.raw for one in found]
    seconds = sorted(one.seconds for one in found)
    lines = [
        f"Other runs with their best offset and gain: {_share([one.gain_free for one in found])}",
        f"Other runs with their level: {_share(raw)}",
        _graded(found),
        *(_gains(raw, law) for law in LAWS if any(one.ratio(law) != 1.0 for one in raw)),
        *_hysteresis_gains(found),
        *_against_bouc_wen(found),
        f"Processor time of a choice, all laws: median {seconds[len(seconds) // 2]:.1f} s, maximum "
        f"{seconds[-1]:.1f} s.",
    ]
    return "\n".join(f"- {line}" for line in lines)


def _graded(found: Sequence[Chosen]) -> str:
    """Return the verdicts of the choices that miss, and how many choices with an error above 10 % were usable."""
    missed = [one for one in found if max(one.raw.regret, one.gain_free.regret) > CLOSE]
    grades = ", ".join(f"{sum(one.grade is grade for one in missed)} {grade.value}" for grade in Grade)
    poor = [one for one in found if min(one.raw.laws[one.raw.chosen], one.gain_free.laws[one.raw.chosen]) > POOR]
    green = sum(one.grade is Grade.USABLE for one in poor)
    return (
        f"Verdicts of the {len(missed)} choices that miss: {grades}. Of {len(poor)} choices whose error is above "
        f"{POOR:g} % on the held-out record, {green} had the verdict usable."
    )


def _share(errors: Sequence[Errors]) -> str:
    regrets = np.array(sorted((one.regret for one in errors), reverse=True))
    close, all_of = int(np.sum(regrets <= CLOSE)), len(errors)
    worst = ", ".join(f"{100.0 * value:.1f}" for value in regrets[:6])
    return (
        f"{close} of {all_of} choices ({100.0 * close / all_of:.0f} %) are within {100.0 * CLOSE:.0f} % of the best "
        f"law and curve in hindsight; required: {100.0 * SHARE:.0f} %. Largest excesses: {worst} %; median "
        f"{100.0 * float(np.median(regrets)):.1f} %."
    )


def _gains(found: Sequence[Errors], law: str) -> str:
    changes = np.array(sorted((100.0 * (one.ratio(law) - 1.0) for one in found), reverse=True))
    worst, best = (", ".join(f"{value:+.1f}" for value in part) for part in (changes[:3], changes[-3:]))
    return (
        f"{law_title(law)}: knots instead of polynomials change the error by {worst}, .., "
        f"{float(np.median(changes)):+.1f} (median), .., {best} %."
    )


def _hysteresis_gains(found: Sequence[Chosen]) -> Iterator[str]:
    """Yield how Hysteresis compares with LPNL2 with polynomials, per group of cases."""
    groups = {
        "virtual configurations": [one.raw for one in found if not one.case.is_measured],
        "measured cases, other runs with their best offset and gain": [
            one.gain_free for one in found if one.case.is_measured
        ],
        "measured cases, other runs with their level": [one.raw for one in found if one.case.is_measured],
        "measured cases in which a part of the same record is held out": [
            one.raw for one in found if one.case.is_measured and not one.case.is_run_to_run
        ],
        "other runs, best offset and gain": [one.shape for one in found if one.shape],
    }
    for name, errors in groups.items():
        ratios = [_hysteresis_ratio(one) for one in errors]
        ordered = sorted((ratio for ratio in ratios if ratio is not None), reverse=True)
        if ordered:
            first, last = (", ".join(f"{ratio:.2f}" for ratio in part) for part in (ordered[:3], ordered[-3:]))
            yield (
                f"Hysteresis over LPNL2 with polynomials, {len(ordered)} {name}: {first}, .., "
                f"{float(np.median(ordered)):.2f} (median), .., {last}; required: at most {MOST_OF_LPNL2} in the "
                "median of the measured cases."
            )


def _hysteresis_ratio(errors: Errors) -> float | None:
    """Return the error of Hysteresis over that of LPNL2 with polynomials [1]; None if either is missing."""
    one, other = errors.laws.get(HYSTERESIS), errors.laws.get(LPNL2)
    return None if one is None or other is None else one / other


def _against_bouc_wen(found: Sequence[Chosen]) -> Iterator[str]:
    """Yield the cases with more than one speed on which Bouc-Wen is better than Hysteresis."""
    many = [
        one for one in found if one.raw.bouc_wen is not None and HYSTERESIS in one.raw.laws and one.case.has_many_speeds
    ]
    lost = [one.case.record for one in many if one.raw.laws[HYSTERESIS] > (one.raw.bouc_wen or 0.0)]
    if many:
        named = f": {'; '.join(lost)}" if lost else ""
        cases_found = f"Of {len(many)} cases with more than one speed"
        yield f"{cases_found}, Bouc-Wen is better than Hysteresis on {len(lost)}{named}."


def main() -> None:
    """Run the benchmark and print its tables."""
    options = _options()
    numbers = tuple(int(number) for number in options.configurations.split(",") if number)
    found: list[Chosen] = []
    for case in cases(numbers):
        if options.cases not in case.record:
            continue
        if not found:
            fit_shock(case.fitted, "auto", segment=case.segment)  # compile before the time is measured
        found.append(judged(case, with_others=not options.ours))
        print(
            f"{case.record}: {_name(found[-1].raw.chosen)}, {100.0 * found[-1].raw.regret:.1f} %",
            file=sys.stderr,
            flush=True,
        )
    tables = {"law_choice": f"{choices_table(found)}\n\n{summary(found)}", "hysteresis": gains_table(found)}
    print("\n\n".join(tables.values()))
    for name, text in tables.items() if options.page else ():
        rewrite(options.page, name, text)
    if options.json:
        options.json.write_text(json.dumps([one.row() for one in found], indent=1) + "\n", encoding="utf-8")


def rewrite(page: Path, name: str, text: str) -> None:
    """Put a text between the markers of a table in a page."""
    start, end = f"<!-- table {name} -->\n", "<!-- end -->"
    before, rest = page.read_text(encoding="utf-8").split(start)
    page.write_text(f"{before}{start}{text}\n{end}{rest.split(end, 1)[1]}", encoding="utf-8")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument(
        "--configurations", default=",".join(map(str, range(1, 13))), help="configurations, separated by commas"
    )
    parser.add_argument("--page", type=Path, help="rewrite the tables of this page, docs/explanation/law_choice.md")
    parser.add_argument("--ours", action="store_true", help="leave out Bouc-Wen and NARX, which take most of the time")
    parser.add_argument("--cases", default="", help="run only cases whose name contains these words")
    return parser.parse_args()


if __name__ == "__main__":
    main()
