"""Records and fits of the virtual dynamometer, which replaces the dynamometer records of chapter 3."""

from __future__ import annotations

from functools import cache

from eightpost.ident import ShockFit, fit_shock
from eightpost.rig import DynoTest
from eightpost.shock import Lpnl2
from eightpost.signals import Drivefile
from eightpost.virtual import Actuator, configuration, random_multisine, read_out

#: Seeds of the random tests that are fitted and compared with; the damper was calibrated with others.
FITTED, HELD_OUT = 11, 12

#: Duration of a random test [s], of which 1 to 10 s are used (3.3). The multisine repeats every 10 s.
_DURATION = 10.5

#: Sample rate of the dynamometer [Hz] (3.2.1).
RATE = 2000.0

#: Laws of chapter 3 with their names in print.
LAWS = {"polylinear": "Polylinear", "lpf1": "LPF1", "lpnl2": "LPNL2"}


@cache
def random_record(number: int, seed: int) -> DynoTest:
    """Return the record of a random test of a configuration of Table 3.1."""
    return record(number, random_multisine(seed, duration=_DURATION), seed)


def record(number: int, drive: Drivefile, seed: int) -> DynoTest:
    """Return the record of a configuration on a drive."""
    response = configuration(number).respond(Actuator().follow(drive.series), rate=RATE)
    return DynoTest(read_out(response, seed=seed))


@cache
def fitted(number: int, law: str) -> ShockFit:
    """Return the dissertation's fit (3.3) of a law to the random record of a configuration."""
    return fit_shock(random_record(number, FITTED), law, recipe="boggs")


@cache
def lpnl2_of(number: int) -> Lpnl2:
    """Return the dissertation's LPNL2 fit of a configuration."""
    law = fitted(number, "lpnl2").shock.law
    assert isinstance(law, Lpnl2)
    return law
