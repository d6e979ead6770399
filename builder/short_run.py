"""A short simulation of one FMU, for `builder.check`.

`python -m builder.short_run X.fmu` prints JSON on its last line.
"""

from __future__ import annotations

import json
import os
import sys
from typing import Any

import fmpy
import numpy as np
from numpy.typing import NDArray

_ERROR = 3  # fmi2Error
_DURATION, _STEP, _FREQUENCY = 0.5, 1e-3, 4.0

#: Size of the sine on an input, by its SI unit: what a race car sees.
_AMPLITUDES = {"m/s": 0.2, "m": 0.005, "N": 200.0, "N.m": 200.0, "rad": 0.01}


def main(path: str) -> dict[str, Any]:
    """Simulate the FMU twice with a sine on every real input; return what was done and what was found."""
    description = fmpy.read_model_description(path, validate=False)
    inputs = [v for v in description.modelVariables if v.causality == "input" and v.type == "Real"]
    outputs = [v.name for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
    signals = _signals(inputs)
    errors: list[str] = []
    try:
        first, second = (_simulate(path, signals, outputs, errors) for _ in range(2))
    except Exception as error:  # whatever fmpy raises is the finding
        return {"done": "a short simulation, which failed", "findings": [f"{type(error).__name__}: {error}"]}
    findings = [f"it logged an error: {message}" for message in dict.fromkeys(errors)]
    findings += [f"output {name} is not finite" for name in outputs if not np.isfinite(first[name]).all()]
    if first["time"][-1] < _DURATION - _STEP / 2:
        findings.append(f"it ended at {first['time'][-1]:g} s, before the stop time of {_DURATION:g} s")
    if first.tobytes() != second.tobytes():
        findings.append("a second run in the same process gave other outputs")
    done = (
        f"simulation with fmpy, twice: {_DURATION} s in steps of {_STEP * 1e3:g} ms, a {_FREQUENCY:g} Hz sine on "
        f"{len(inputs)} inputs; {len(outputs)} outputs must be finite and the same twice"
    )
    return {"done": done, "findings": findings}


def _signals(inputs: list[Any]) -> NDArray[Any]:
    time = np.arange(0.0, _DURATION + _STEP / 2, _STEP)
    signals = np.zeros(time.size, dtype=[("time", "f8")] + [(v.name, "f8") for v in inputs])
    signals["time"] = time
    for variable in inputs:
        signals[variable.name] = _AMPLITUDES.get(variable.unit or "", 1.0) * np.sin(2 * np.pi * _FREQUENCY * time)
    return signals


def _simulate(path: str, signals: NDArray[Any], outputs: list[str], errors: list[str]) -> NDArray[Any]:
    def log(_environment: Any, _instance: Any, status: int, _category: Any, message: bytes) -> None:
        if status >= _ERROR:
            errors.append(message.decode("utf-8", "replace").strip())

    result = fmpy.simulate_fmu(
        path,
        stop_time=_DURATION,
        output_interval=_STEP,
        input=signals,
        output=outputs,
        fmi_type="CoSimulation",
        logger=log,
        debug_logging=True,
    )
    return np.asarray(result)


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1])), flush=True)  # noqa: T201 - its parent process reads this line
    os._exit(0)  # what loaded libraries do while an interpreter ends is not the FMU's doing
