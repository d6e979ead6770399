"""How much is computed: the lengths of the records and the numbers of setups."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Effort:
    """Lengths and counts of the computations."""

    name: str  #: Name of the effort.
    configurations: tuple[int, ...]  #: Configurations of Table 3.1 that are fitted.
    quarter_seconds: float  #: Duration of the simulated tests of 4.4 [s]; 100 in the dissertation.
    quarter_rig_seconds: float  #: Duration of the quarter-car rig's tests [s]; 120 in the dissertation.
    car_seconds: float  #: Duration of each simulated test of chapter 5 [s]; 800 in the dissertation.
    rig_seconds: float  #: Duration of each identification test of chapter 6 [s]; 800 in the dissertation.
    single_seconds: float  #: Duration of each test with one actuator [s]; 100 in the dissertation.
    lap_seconds: float  #: Duration of the lap [s].
    builds: int  #: Number of builds per corner in chapter 7; 7 in the dissertation, with 2401 setups.


#: The dissertation's program, with shorter random tests in chapters 5 and 6 (docs/evidence/reproduce.md).
FULL = Effort("full", tuple(range(1, 13)), 100.0, 120.0, 200.0, 200.0, 100.0, 33.0, 7)

#: A program of about a minute.
QUICK = Effort("quick", (1, 2, 5, 7, 9), 100.0, 60.0, 60.0, 60.0, 30.0, 13.0, 3)
