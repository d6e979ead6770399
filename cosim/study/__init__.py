"""Setup study of chapter 7: setups, response measures and their table. It needs FMUs only."""

from cosim.study.measures import Measure
from cosim.study.provenance import Provenance
from cosim.study.result import StudyResult
from cosim.study.setup import Setup, SetupSpace
from cosim.study.statistics import STATISTICS, Response
from cosim.study.study import Build, Constraint, Drive, Study, Term, Vehicle

__all__ = [
    "STATISTICS",
    "Build",
    "Constraint",
    "Drive",
    "Measure",
    "Provenance",
    "Response",
    "Setup",
    "SetupSpace",
    "Study",
    "StudyResult",
    "Term",
    "Vehicle",
]
