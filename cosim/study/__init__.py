"""Setup study of chapter 7: setups, response measures and their table. It needs FMUs only."""

from cosim.study.measures import Measure
from cosim.study.result import StudyResult
from cosim.study.statistics import STATISTICS, Response
from cosim.study.study import Build, Constraint, Drive, Setup, SetupSpace, Study, Term, Vehicle
from cosim.study.table import Provenance

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
