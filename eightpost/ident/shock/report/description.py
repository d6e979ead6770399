"""The sections of a shock file that describe its measurement and its fit."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.ident.shock.solvers.uncertainty import LEVEL

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from eightpost.ident.shock.force.gas import GasColumns
    from eightpost.ident.shock.record.preparation import Prepared
    from eightpost.ident.shock.record.runs import Runs
    from eightpost.ident.shock.report.parameters import Parameter
    from eightpost.ident.shock.solvers.solution import Solution
    from eightpost.ident.shock.solvers.uncertainty import CurveBand
    from eightpost.rig.dyno_test import DynoTest

    Array = NDArray[np.float64]

#: Share of the velocity's power that is outside the stated frequency range at either end.
_LEFT_OUT = 0.005


def conditions_of(
    tests: Sequence[DynoTest], runs: Runs, columns: GasColumns, *, gas: str, gas_force: tuple[float, float]
) -> dict[str, Any]:
    """Return the conditions and ranges of the measurement; units in the keys, SI.

    Args:
        tests: Records; build, clicks and pressure are the first's.
        runs: Fitted part of the records.
        columns: Columns of the gas force, with its reference.
        gas: Treatment of the gas force.
        gas_force: Estimated preload [N] and stiffness [N/m] of the gas force.
    """
    known = tests[0].conditions
    stated: dict[str, Any] = {"build": known.build, "clicks": known.clicks, "gas_pressure [Pa]": known.gas_pressure}
    described: dict[str, Any] = {key: value for key, value in stated.items() if value is not None}
    described |= _temperature(tests, runs)
    described |= {
        "velocity_range [m/s]": _range(runs.velocity[runs.inside]),
        "frequency_range [Hz]": _widest([_frequency_range(p) for p in runs.prepared]),
        "gas_treatment": gas,
        "gas_preload_estimate [N]": gas_force[0],
        "gas_stiffness_estimate [N/m]": gas_force[1],
    }
    moved = [p.record["displacement"][p.inside] + p.reference for p in runs.prepared if "displacement" in p.record]
    if moved:
        described["displacement_range [m]"] = _range(np.concatenate(moved))
        described["displacement_reference [m]"] = columns.reference
    if derived := sorted({what for test in tests for what in test.derived}):
        described["derived"] = derived
    return described


def fit_of(
    solution: Solution, parameters: Iterable[Parameter], band: CurveBand, *, recipe: str, rms: float
) -> dict[str, Any]:
    """Return the results of the fit as JSON values, units in the keys, SI."""
    runs = solution.model.runs
    return {
        "recipe": recipe,
        "runs": len(runs.prepared),
        "rms [N]": rms,
        "standard_deviation [N]": runs.deviation,
        "percent": 100.0 * rms / runs.deviation,
        "segment [s]": _range(runs.first.record.time[runs.first.inside]),
        "cutoff [Hz]": runs.first.cutoff,
        "converged": solution.converged,
        "status": solution.status,
        "parameters": {parameter.name: _entry(parameter) for parameter in parameters},
        "curve_band": {
            "level": LEVEL,
            "velocity [m/s]": band.velocity.tolist(),
            "force [N]": band.force.tolist(),
            "half_width [N]": band.half_width.tolist(),
        },
    }


def digest_of(test: DynoTest) -> str:
    """Return the SHA-256 of a test's file, or of its samples if it has none."""
    return test.sha256 or hashlib.sha256(test.series.time.tobytes() + test.series.values.tobytes()).hexdigest()


def inputs_of(tests: Sequence[DynoTest]) -> tuple[dict[str, str], ...]:
    """Return name and digest of each file that tests come from; a file with several runs is listed once."""
    files = dict.fromkeys((test.source.name, digest_of(test)) for test in tests if test.source)
    return tuple({"name": name, "sha256": digest} for name, digest in files)


def notes_of(tests: Sequence[DynoTest]) -> list[str]:
    """Return the notes on the records, with the number of the run if there are several."""
    numbered = enumerate(tests, start=1)
    return [note if len(tests) == 1 else f"run {number}: {note}" for number, test in numbered for note in test.notes]


def _entry(parameter: Parameter) -> dict[str, Any]:
    bounds = [bound if np.isfinite(bound) else None for bound in parameter.bounds or ()] or None
    return {
        "value": parameter.value,
        "unit": parameter.unit,
        "standard_error": parameter.error,
        "interval_95": list(parameter.interval) if parameter.interval else None,
        "bounds": bounds,
        "at_bound": parameter.at_bound,
    }


def _temperature(tests: Sequence[DynoTest], runs: Runs) -> dict[str, Any]:
    ranges = []
    for test, prepared in zip(tests, runs.prepared, strict=True):
        if "temperature" in test.series:
            time = prepared.record.time[prepared.inside] + test.series.time[0]
            here = (test.series.time >= time[0]) & (test.series.time <= time[-1])
            ranges.append(_range(test.series["temperature"][here]))
    return {"temperature_range [K]": _widest(ranges)} if ranges else {}


def _widest(ranges: list[list[float]]) -> list[float]:
    return [min(low for low, _ in ranges), max(high for _, high in ranges)]


def _range(values: Array) -> list[float]:
    return [float(values.min()), float(values.max())]


def _frequency_range(prepared: Prepared) -> list[float]:
    """Return the range of frequencies [Hz] that contains 99 % of the velocity's power."""
    velocity = prepared.record["velocity"][prepared.inside]
    power = np.cumsum(np.abs(np.fft.rfft(velocity - velocity.mean())) ** 2)
    frequency = np.fft.rfftfreq(velocity.size, prepared.step)
    ends = np.searchsorted(power, np.array([_LEFT_OUT, 1.0 - _LEFT_OUT]) * power[-1])
    return [float(frequency[end]) for end in ends]
