"""What a shock file says about its measurement and its fit."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from eightpost.ident.shock.parameters import Parameter
    from eightpost.ident.shock.preparation import Prepared
    from eightpost.ident.shock.solution import Solution
    from eightpost.rig.dyno_test import DynoTest

    Array = NDArray[np.float64]

#: Share of the velocity's power that the stated frequency range leaves out at either end.
_LEFT_OUT = 0.005


def conditions_of(test: DynoTest, prepared: Prepared, *, gas: str, gas_force: tuple[float, float]) -> dict[str, Any]:
    """Return what was measured, under which conditions and over which ranges; units in the keys, SI.

    Args:
        test: The record.
        prepared: What of it was fitted.
        gas: The treatment of the gas force.
        gas_force: Its preload [N] and stiffness [N/m], estimated.
    """
    known = test.conditions
    stated: dict[str, Any] = {"build": known.build, "clicks": known.clicks, "gas_pressure [Pa]": known.gas_pressure}
    described: dict[str, Any] = {key: value for key, value in stated.items() if value is not None}
    described |= _temperature(test, prepared)
    described |= {
        "velocity_range [m/s]": _range(prepared.record["velocity"][prepared.inside]),
        "frequency_range [Hz]": _frequency_range(prepared),
        "gas_treatment": gas,
        "gas_preload_estimate [N]": gas_force[0],
        "gas_stiffness_estimate [N/m]": gas_force[1],
    }
    if "displacement" in prepared.record:
        absolute = prepared.record["displacement"][prepared.inside] + prepared.reference
        described["displacement_range [m]"] = _range(absolute)
        described["displacement_reference [m]"] = prepared.reference
    if test.derived:
        described["derived"] = list(test.derived)
    return described


def fit_of(solution: Solution, parameters: Iterable[Parameter], *, recipe: str, rms: float) -> dict[str, Any]:
    """Return what the fit said: JSON values, units in the keys, SI."""
    prepared = solution.model.prepared
    time = prepared.record.time[prepared.inside]
    return {
        "recipe": recipe,
        "rms [N]": rms,
        "standard_deviation [N]": prepared.deviation,
        "percent": 100.0 * rms / prepared.deviation,
        "segment [s]": _range(time),
        "cutoff [Hz]": prepared.cutoff,
        "converged": solution.converged,
        "status": solution.status,
        "parameters": {parameter.name: _entry(parameter) for parameter in parameters},
    }


def digest_of(test: DynoTest) -> str:
    """Return the SHA-256 of a test's file, or of its samples where it has none."""
    return test.sha256 or hashlib.sha256(test.series.time.tobytes() + test.series.values.tobytes()).hexdigest()


def _entry(parameter: Parameter) -> dict[str, Any]:
    bounds = [bound if np.isfinite(bound) else None for bound in parameter.bounds or ()] or None
    return {
        "value": parameter.value,
        "unit": parameter.unit,
        "standard_error": parameter.error,
        "bounds": bounds,
        "at_bound": parameter.at_bound,
    }


def _temperature(test: DynoTest, prepared: Prepared) -> dict[str, Any]:
    if "temperature" not in test.series:
        return {}
    time = prepared.record.time[prepared.inside] + test.series.time[0]
    here = (test.series.time >= time[0]) & (test.series.time <= time[-1])
    return {"temperature_range [K]": _range(test.series["temperature"][here])}


def _range(values: Array) -> list[float]:
    return [float(values.min()), float(values.max())]


def _frequency_range(prepared: Prepared) -> list[float]:
    """Return the frequencies [Hz] between which 99 % of the velocity's power lies."""
    velocity = prepared.record["velocity"][prepared.inside]
    power = np.cumsum(np.abs(np.fft.rfft(velocity - velocity.mean())) ** 2)
    frequency = np.fft.rfftfreq(velocity.size, prepared.step)
    ends = np.searchsorted(power, np.array([_LEFT_OUT, 1.0 - _LEFT_OUT]) * power[-1])
    return [float(frequency[end]) for end in ends]
