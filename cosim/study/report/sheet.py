"""What the report shows, in the form that it needs: setups by measures, whatever made them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.study.report.scale import Scale
from eightpost.verdict import Verdict

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Doubt:
    """How well one measure is known, S setups; NaN where that is not known.

    Args:
        spread: (S,) two standard deviations of the value [SI].
        from_best: (S,) two standard deviations of the difference from the setup that is ranked first [SI]; what blurs
            both alike is not in it.
        from_baseline: (S,) the same of the difference from the baseline.
        tied: (S,) whether a setup is not told from the one with the best value.
    """

    spread: Array
    from_best: Array
    from_baseline: Array
    tied: Flags


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One number of every setup: a measure, or the objective.

    Args:
        name: As people say it.
        scale: Its unit.
        values: (S,) in SI; NaN where the setup has none.
        better: Which end of it is wanted.
        doubt: How well it is known; None where nothing is said of that.
    """

    name: str
    scale: Scale
    values: Array
    better: Literal["low", "high"] = "low"
    doubt: Doubt | None = None

    @property
    def extremes(self) -> tuple[float, float]:
        """Least and greatest value over all setups [SI], as in Table 7.4; zeros where no setup has one."""
        known = self.values[np.isfinite(self.values)]
        return (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)

    @property
    def levels(self) -> Array:
        """(S,) values between 0, the least of all setups, and 1, the greatest (7.2)."""
        low, high = self.extremes
        return (self.values - low) / ((high - low) or 1.0)


@dataclass(frozen=True, slots=True)
class Origin:
    """A file that the study was made from.

    Args:
        what: What it is.
        file: Its name.
        identity: Its GUID; empty for what is no FMU.
        digest: Its SHA-256; empty where not known.
        parameters: Values that differ from its own, in its own units.
    """

    what: str
    file: str
    identity: str = ""
    digest: str = ""
    parameters: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Bound:
    """A side of a constraint (G of Eq 2.3): `measure`, `at least` or `at most`, the value [SI]."""

    measure: str
    word: Literal["at least", "at most"]
    value: float
    scale: Scale

    def __str__(self) -> str:
        """As US customary units have it."""
        return f"{self.measure} {self.word} {self.scale.us(self.value):.4g} {self.scale.us.unit}"


@dataclass(frozen=True, slots=True)
class Background:
    """What stands behind the numbers.

    Args:
        title: Heading of the page.
        objective: What is minimised, as a formula in words; empty where nothing is.
        constraints: What setups must keep to.
        notes: What a reader must know before the numbers are used.
        facts: Settings and versions: what, and how much.
        origins: The files.
        trace_command: That computes the traces of a setup, with `{setup}` in place of its number; empty for none.
        verdict: On the study.
    """

    title: str = "Setup study"
    objective: str = ""
    constraints: tuple[Bound, ...] = ()
    notes: tuple[str, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    origins: tuple[Origin, ...] = ()
    trace_command: str = ""
    verdict: Verdict = field(default_factory=Verdict)


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """Setups by measures. S setups, C corners.

    Args:
        corners: Names of the corners.
        builds: Names of all builds of the bank.
        numbers: (S,) numbers of the setups, each once.
        placed: (S, C) which build each setup has at each corner.
        measures: Columns, in the order in which they are shown: what the study is about first.
        objective: What setups are ranked by; the first measure where None.
        allowed: (S,) whether a setup meets every constraint.
        failures: What went wrong, by row.
        marks: What a reader must know of a setup, by row.
        coupling_error: (S,) [%]; NaN where it is not known.
        baseline: Row of the baseline setup.
        background: What stands behind the numbers.

    Raises:
        ValueError: There are no measures, or shapes disagree.
    """

    corners: tuple[str, ...]
    builds: tuple[str, ...]
    numbers: Indices
    placed: Indices
    measures: tuple[Column, ...]
    allowed: Flags
    coupling_error: Array
    objective: Column | None = None
    failures: Mapping[int, str] = field(default_factory=dict)
    marks: Mapping[int, str] = field(default_factory=dict)
    baseline: int | None = None
    background: Background = field(default_factory=Background)

    def __post_init__(self) -> None:
        if not self.measures:
            raise ValueError("a study without measures has nothing to report; give it one or more")
        setups = self.numbers.size
        shapes = {"placed": self.placed.shape[:1], "allowed": self.allowed.shape, "errors": self.coupling_error.shape}
        shapes |= {column.name: column.values.shape for column in self.measures}
        if wrong := [name for name, shape in shapes.items() if shape != (setups,)]:
            raise ValueError(f"{', '.join(wrong)}: not one value for each of the {setups} setups")

    @property
    def ranked_by(self) -> Column:
        """The objective, or the first measure where the study has none."""
        return self.objective or self.measures[0]

    @property
    def done(self) -> Flags:
        """(S,) whether a setup has a value to rank it by."""
        return np.isfinite(self.ranked_by.values) & ~np.isin(np.arange(self.numbers.size), list(self.failures))

    @property
    def order(self) -> Indices:
        """(S,) rows from the best to the worst: those that keep the constraints, the others, those that failed."""
        wanted = self.ranked_by.values * (1.0 if self.ranked_by.better == "low" else -1.0)
        return np.lexsort((self.numbers, wanted, ~self.allowed, ~self.done)).astype(np.int64)

    def row(self, number: int) -> int | None:
        """Return the row of a setup by its number; None where the study does not have it."""
        found = np.flatnonzero(self.numbers == number)
        return int(found[0]) if found.size else None

    def remark(self, row: int) -> str:
        """Return what a reader must know of a setup: its failure, its mark, that it breaks a constraint, or nothing."""
        broken = "" if self.allowed[row] else "over a limit"
        return self.failures.get(row) or ", ".join(filter(None, (self.marks.get(row, ""), broken)))

    def fitted(self, row: int) -> str:
        """Return the builds of a setup from corner to corner.

        For example `LF C/B, RF C/B, LR AA/B, RR C/C`.
        """
        places = zip(self.corners, self.placed[row], strict=True)
        return ", ".join(f"{corner.upper()} {self.builds[build]}" for corner, build in places)
