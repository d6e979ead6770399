"""Benchmark of the automatic choice of law and curve: is the choice the best on data that it never saw?

    python benchmarks/law_choice.py [--json FILE] [--configurations 1,5] [--cases WORDS] [--page FILE] [--ours]

The cases are the twelve configurations of Table 3.1 (chosen on one phase draw, judged on another) and, if
EIGHTPOST_DATA names the folder of measured records, the held-out runs of benchmarks/shock_fit.py and the first and the
last third of every measured record, each held out from the other two. Prints Markdown: the held-out error of each law
with polynomials and with a curve through knots, in percent of the force's standard deviation, the choice, what is best
in hindsight, and the excess of the choice's error; cases in which knots lose most against polynomials come first.
Bouc-Wen (20 starts) and a small free-running NARX are fitted for comparison; they cannot be chosen, and --ours leaves
them out.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
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
from eightpost.ident.shock.curve import CurveKind
from eightpost.ident.shock.law_choice import LawChoice
from eightpost.shock import LAWS, law_title

#: Required: the chosen law is within this share of the best in hindsight, in this share of the cases.
CLOSE, SHARE = 0.05, 0.9


#: Kinds of curve, in the order of the cells.
CURVES: tuple[CurveKind, ...] = ("polynomial", "knots")

#: A law with a kind of curve.
Candidate = tuple[str, CurveKind]


@dataclass(frozen=True, slots=True)
class Chosen:
    """A choice and what it is worth.

    Attributes:
        case: Records of the choice, and the record that it is judged on.
        choice: Comparison of the laws.
        errors: Error of each law and curve on the held-out record, in percent of the force's standard deviation.
        bouc_wen: Error of Bouc-Wen there; None if it was not fitted.
        narx: Error of a small free-running NARX there; None if it was not fitted.
        seconds: Processor time of all fits of the choice [s].
    """

    case: Case
    choice: LawChoice
    errors: Mapping[Candidate, float]
    bouc_wen: float | None
    narx: float | None
    seconds: float

    @property
    def chosen(self) -> Candidate:
        """Chosen law and curve."""
        assert self.choice.chosen.curve is not None
        return self.choice.law, self.choice.chosen.curve.kind

    @property
    def best(self) -> Candidate:
        """Law and curve with the lowest error on the held-out record."""
        return min(self.errors, key=lambda one: self.errors[one])

    @property
    def regret(self) -> float:
        """Excess of the choice's error over the best, over the best [1]."""
        return self.errors[self.chosen] / self.errors[self.best] - 1.0

    def ratio(self, law: str) -> float:
        """Return the error of a law with knots over that with polynomials [1]; 1 if either is missing."""
        one, other = (self.errors.get((law, curve)) for curve in CURVES)
        return 1.0 if one is None or other is None else other / one

    def row(self) -> dict[str, Any]:
        """Return the row that --json writes."""
        return {
            "record": self.case.record,
            "chosen": self.chosen,
            "best": self.best,
            "regret": self.regret,
            "errors": {f"{law}, {curve}": error for (law, curve), error in self.errors.items()},
            "bouc_wen": self.bouc_wen,
            "narx": self.narx,
            "cross_validated": {s.law: s.held_out.percent for s in self.choice.scores if s.blocks is not None},
            "seconds": self.seconds,
        }


def judged(case: Case, *, with_others: bool = True) -> Chosen:
    """Choose law and curve on the fitted records of a case, and judge the choice on its held-out record."""
    started = process_time()
    choice = fit_shock(case.fitted, "auto", segment=case.segment).choice
    seconds = process_time() - started
    assert choice is not None
    found = {(law, curve): attempt(case, law, "joint", curve) for law in LAWS for curve in CURVES}
    errors = {one: result.validation_percent for one, result in found.items() if isinstance(result, FitErrors)}
    others = [attempt(case, law, "joint") if with_others else None for law in (BOUC_WEN, NARX)]
    wen, narx = (one.validation_percent if isinstance(one, FitErrors) else None for one in others)
    return Chosen(case, choice, errors, wen, narx, seconds)


def cases(numbers: Sequence[int]) -> Iterator[Case]:
    """Yield all cases, virtual ones first."""
    yield from configurations(numbers, quick=True)
    yield from measured(quick=True)
    yield from thirds()


def choices_table(found: Sequence[Chosen]) -> str:
    """Return the errors of each law and curve, the choice and its excess as Markdown, worst ratio of knots first."""
    heads = ("record", *map(law_title, LAWS), "Bouc-Wen", "NARX", "auto", "best in hindsight", "excess [%]")
    ordered = sorted(found, key=lambda one: max(map(one.ratio, LAWS)), reverse=True)
    return grid(heads, map(_cells, ordered))


def _cells(one: Chosen) -> list[str]:
    errors = [" / ".join(_error(one, (law, curve)) for curve in CURVES) for law in LAWS]
    others = ["-" if error is None else number(error) for error in (one.bouc_wen, one.narx)]
    return [one.case.record, *errors, *others, _name(one.chosen), _name(one.best), f"{100.0 * one.regret:.1f}"]


def _error(one: Chosen, candidate: Candidate) -> str:
    text = number(one.errors.get(candidate))
    return f"**{text}**" if candidate == one.chosen else text


def _name(candidate: Candidate) -> str:
    return f"{law_title(candidate[0])}, {candidate[1]}"


def summary(found: Sequence[Chosen]) -> str:
    """Return the share of good choices and the distributions of excess and gain, largest losses first."""
    regrets = np.array(sorted((one.regret for one in found), reverse=True))
    close = int(np.sum(regrets <= CLOSE))
    share = f"{100.0 * close / len(found):.0f} %"
    worst = ", ".join(f"{100.0 * value:.1f}" for value in regrets[:5])
    seconds = sorted(one.seconds for one in found)
    return "\n".join(
        [
            f"- {close} of {len(found)} choices ({share}) are within {100.0 * CLOSE:.0f} % of the best law and curve "
            f"in hindsight; required: {100.0 * SHARE:.0f} %.",
            f"- Largest excesses: {worst} %; median {100.0 * float(np.median(regrets)):.1f} %.",
            *(f"- {_gains(found, law)}" for law in LAWS if any(one.ratio(law) != 1.0 for one in found)),
            f"- {_hysteresis_gain(found)}",
            f"- Processor time of a choice, all laws: median {seconds[len(seconds) // 2]:.1f} s, maximum "
            f"{seconds[-1]:.1f} s.",
        ]
    )


def _gains(found: Sequence[Chosen], law: str) -> str:
    changes = np.array(sorted((100.0 * (one.ratio(law) - 1.0) for one in found), reverse=True))
    worst, best = (", ".join(f"{value:+.1f}" for value in part) for part in (changes[:3], changes[-3:]))
    return (
        f"{law_title(law)}: knots instead of polynomials change the error by {worst}, .., "
        f"{float(np.median(changes)):+.1f} (median), .., {best} %."
    )


def _hysteresis_gain(found: Sequence[Chosen]) -> str:
    """Return how Hysteresis compares with LPNL2 with polynomials on measured records, and with Bouc-Wen elsewhere."""
    mine, theirs = ("hysteresis", "knots"), ("lpnl2", "polynomial")
    pairs = [one.errors for one in found if one.case.is_measured and mine in one.errors and theirs in one.errors]
    ratios = sorted((errors[mine] / errors[theirs] for errors in pairs), reverse=True)
    many = [one for one in found if one.bouc_wen is not None and mine in one.errors and one.case.has_many_speeds]
    lost = [one.case.record for one in many if one.errors[mine] > (one.bouc_wen or 0.0)]
    worst = ", ".join(f"{ratio:.2f}" for ratio in ratios[:3])
    median = f"{float(np.median(ratios)):.2f}" if ratios else "-"
    return (
        f"Hysteresis: error over that of LPNL2 with polynomials on {len(ratios)} measured cases {worst}, .., {median} "
        f"(median). Of {len(many)} cases with more than one speed, Bouc-Wen is better on {len(lost)}"
        f"{': ' + '; '.join(lost) if lost else ''}."
    )


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
            f"{case.record}: {_name(found[-1].chosen)}, {100.0 * found[-1].regret:.1f} %", file=sys.stderr, flush=True
        )
    print(f"{choices_table(found)}\n\n{summary(found)}")
    if options.page:
        rewrite(options.page, f"{choices_table(found)}\n\n{summary(found)}")
    if options.json:
        options.json.write_text(json.dumps([one.row() for one in found], indent=1) + "\n", encoding="utf-8")


def rewrite(page: Path, text: str) -> None:
    """Put a text between the markers of the table in a page."""
    start, end = "<!-- table law_choice -->\n", "<!-- end -->"
    before, rest = page.read_text(encoding="utf-8").split(start)
    page.write_text(f"{before}{start}{text}\n{end}{rest.split(end, 1)[1]}", encoding="utf-8")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument(
        "--configurations", default=",".join(map(str, range(1, 13))), help="configurations, separated by commas"
    )
    parser.add_argument("--page", type=Path, help="rewrite the table of this page, docs/law_choice.md")
    parser.add_argument("--ours", action="store_true", help="leave out Bouc-Wen and NARX, which take most of the time")
    parser.add_argument("--cases", default="", help="run only cases whose name contains these words")
    return parser.parse_args()


if __name__ == "__main__":
    main()
