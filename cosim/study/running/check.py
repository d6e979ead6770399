"""Checks of a study before any simulation."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.algorithm import GaussSeidel
from cosim.session.setup import Setup as SessionSetup
from cosim.study.measures import Measure
from cosim.study.own_measure import own_function
from cosim.study.running.evaluator import Evaluator, ports
from cosim.study.setup import Setup
from cosim.study.study import Drive, Study
from cosim.system import System
from eightpost import units
from eightpost.errors import InputError

#: Signals whose mean is zero in any steady state.
_MOVING = ("m/s", "m/s2", "W")


def check_study(evaluator: Evaluator) -> None:
    """Raise an error if a study cannot be run.

    Raises:
        FmuError: An FMU cannot be used.
        WiringError: A build does not fit a corner, or a channel or parameter does not exist.
        InputError: A corner has no shock, or a measure, its unit or its window is invalid.
    """
    study = evaluator.study
    first = study.space.setup(int(_indices(study)[0]))
    system = evaluator.system(first)
    _check_ports(study, system)
    for setup in _every_build(study, first):
        evaluator.system(setup)
    found = evaluator.measure_units
    for measure in study.measures:
        _check_measure(study, measure, found[measure.name])
    _check_objective(study, found)
    for drive in study.drives:
        SessionSetup.of(system, evaluator.scenario(drive), GaussSeidel(), study.record_step)


def _indices(study: Study) -> list[int]:
    indices: list[int] = study.space.indices.tolist()
    if not indices:
        raise InputError("the study has no setups: no builds are allowed at all corners of a group in alike")
    return indices


def _check_ports(study: Study, system: System) -> None:
    """Raise an error if a port has no shock: the car would have no damping there."""
    known = ports(system.components[study.vehicle.name])
    if missing := [corner for corner in known if corner not in study.corners]:
        raise InputError(
            f"corners: {missing[0]} has no shock; {study.vehicle.fmu} has ports at {', '.join(known)}. Name the builds "
            f"allowed at {missing[0]}"
        )


def _every_build(study: Study, first: Setup) -> list[Setup]:
    """Return setups in which every build is once at every corner where it is allowed."""
    return [Setup(-1, {**first.builds, corner: build}) for corner, builds in study.corners.items() for build in builds]


def _check_measure(study: Study, measure: Measure, unit: str) -> None:
    what = f"measure {measure.name!r}"
    if measure.display and not (units.is_unit(measure.display) and units.compatible(measure.display, unit)):
        raise InputError(
            f"{what}: its unit is {unit}, which cannot be converted to the display unit {measure.display!r}"
        )
    if measure.function:
        own_function(measure.function)
    elif measure.absolute and not study.vehicle.means_trusted and unit not in _MOVING:
        raise InputError(
            f"{what}: its {measure.statistic} depends on the mean, and {study.vehicle.fmu.name} has no trusted gain at "
            "0 Hz (means_trusted = false); use rms, peak or range, or a band that begins above 0 Hz"
        )
    for drive in study.drives:
        if measure in study.measures_of(drive):
            _check_window(study, measure, drive)


def _check_window(study: Study, measure: Measure, drive: Drive) -> None:
    rate = 1.0 / study.record_step
    if measure.section and not (study.settling <= measure.section[0] and measure.section[1] <= drive.stop + 1e-9):
        raise InputError(
            f"measure {measure.name!r}: its section {measure.section[0]:g} to {measure.section[1]:g} s must lie "
            f"between the settling time and the stop, {study.settling:g} to {drive.stop:g} s"
        )
    if measure.band and (measure.band[0] >= 0.5 * rate or rate * 0.5 <= measure.band[1] < float("inf")):
        raise InputError(
            f"measure {measure.name!r}: the band {measure.band[0]:g} to {measure.band[1]:g} Hz must be below half the "
            f"sample rate of {rate:g} Hz; use a smaller record_step"
        )


def _check_objective(study: Study, found: Mapping[str, str]) -> None:
    for term in study.objective:
        unit = found[term.measure]
        if term.unit and not (units.is_unit(term.unit) and units.compatible(term.unit, unit)):
            raise InputError(
                f"objective: the unit of {term.measure!r} is {unit}, which cannot be converted to {term.unit!r}, the "
                "unit of its weight"
            )
