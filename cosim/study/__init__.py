"""Setup study of chapter 7: setups, response measures and their table. It needs FMUs only."""

from cosim.study.definition import Build, Constraint, Drive, Setup, SetupSpace, Study, Term, Vehicle
from cosim.study.measures import STATISTICS, Measure, Response
from cosim.study.table import Provenance, StudyResult

__all__ = [
    "STATISTICS", "Build", "Constraint", "Drive", "Measure", "Provenance", "Response", "Setup", "SetupSpace",
    "Study", "StudyResult", "Term", "Vehicle",
]  # fmt: skip
