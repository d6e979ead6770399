"""Benchmark of force laws: cost of an evaluation in Python and in C, beside fmpy's wrapper in the same run.

    python -m benchmarks.force_law [--count 20000]

The shock is examples/hosts/shock.json (LPNL2). Each cost is the minimum of the processor time over passes; an
evaluation is: return to the accepted point, ramp the inputs to the trial point, step, read the force.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave, fmi2False

from builder.build import build
from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from eightpost.compilers import find_compiler
from eightpost.corners import CORNERS
from eightpost.errors import FmuError

HOSTS = Path(__file__).resolve().parents[1] / "examples" / "hosts"

PROGRAM = """
#include <time.h>
#include "force_law.h"
int main(int count, char **arguments)
{
    ForceLaw law;
    double force = 0.0, a = 0.0, b = 0.0, best[4] = {1e9, 1e9, 1e9, 1e9};
    const long n = 200000;
    if (count < 2 || force_law_open(&law, arguments[1], "velocity", "displacement", "force") != 0) {
        return 1;
    }
    for (int pass = 0; pass < 7; pass++) {
        for (int what = 0; what < 4; what++) {
            force_law_start(&law, 0.0, 0.1, 0.01, &force);
            const clock_t began = clock();
            for (long k = 0; k < n; k++) {
                const double t = 1e-3 * (double)k, v = k % 2 ? 0.1 : 0.105;
                if (what == 0) force_law_force(&law, 1e-3, v, 0.01, &force);
                if (what == 1) force_law_jacobian(&law, 1e-3, v, 0.01, &a, &b);
                if (what == 2) force_law_hold(&law, t, 1e-3, v, 0.01, &force);
                if (what == 3) force_law_extrapolate(&law, t, 1e-3, v, 0.01, &force);
            }
            const double cost = (double)(clock() - began) / CLOCKS_PER_SEC / (double)n;
            best[what] = cost < best[what] ? cost : best[what];
        }
    }
    printf("%g %g %g %g\\n", best[0], best[1], best[2], best[3]);
    return 0;
}
"""


def cost(call: Callable[[int], Any], count: int) -> float:
    """Return the minimum processor time of a call over seven passes [us]."""
    best = float("inf")
    for _ in range(7):
        began = time.process_time()
        for k in range(count):
            call(k)
        best = min(best, (time.process_time() - began) / count)
    return 1e6 * best


def with_fmpy(folder: Path, count: int) -> float:
    """Return the cost of the same evaluation with the methods of fmpy's slave [us]."""
    description = read_model_description(str(folder))
    found = {v.name: v.valueReference for v in description.modelVariables}
    ports, output = [found["velocity"], found["displacement"]], [found["force"]]
    name = description.coSimulation.modelIdentifier
    slave = FMU2Slave(guid=description.guid, unzipDirectory=str(folder), modelIdentifier=name, instanceName="shock")
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.setReal(ports, [0.1, 0.01])
    slave.exitInitializationMode()
    state = slave.getFMUstate()

    def evaluate(k: int) -> float:
        slave.setFMUstate(state)
        slave.setReal(ports, [0.1, 0.01])
        slave.setRealInputDerivatives(ports, [1, 1], [5.0 * (k % 2), 0.0])
        slave.doStep(0.0, 1e-3, fmi2False)
        return float(slave.getReal(output)[0])

    found_cost = cost(evaluate, count)
    slave.freeFMUstate(state)
    slave.terminate()
    slave.freeInstance()
    return found_cost


def with_cosim(fmu: Path, count: int) -> dict[str, float]:
    """Return the costs of the classes of cosim [us]."""
    costs = {}
    four = np.full((2, 4), 0.1), np.full(4, 0.01)
    four[0][1] = 0.105
    for engine in ("compiled", "python"):
        few = count if engine == "compiled" else max(1, count // 10)
        with ForceLaw(fmu, engine=engine) as law:
            law.start(0.0, 0.1, 0.01)
            costs[f"ForceLaw.force, one shock, {engine}"] = cost(
                lambda k, law=law: law.force(1e-3, 0.1 + 0.005 * (k % 2), 0.01), few
            )
        with ForceLaw(fmu, corners=CORNERS, engine=engine) as law:
            law.start(0.0, 0.1, 0.01)
            costs[f"ForceLaw.force, four shocks, {engine}"] = cost(
                lambda k, law=law: law.force(1e-3, four[0][k % 2], four[1]), few
            )
            if engine == "compiled":
                costs["ForceLaw.jacobian, four shocks, compiled"] = cost(
                    lambda k, law=law: law.jacobian(1e-3, four[0][k % 2], four[1]), few
                )
                costs["ForceLaw.accept, four shocks, compiled"] = cost(
                    lambda k, law=law: law.accept(law.time + 1e-3, four[0][k % 2], four[1]), few
                )
    for kind in (HeldForce, ExtrapolatedForce):
        with kind(fmu, corners=CORNERS) as loop:
            loop.start(0.0, 0.1, 0.01)
            step = [0]

            def advance(k: int, loop: Any = loop, step: list[int] = step) -> Any:
                step[0] += 1
                return loop.step(1e-3 * (step[0] - 1), 1e-3, four[0][k % 2], four[1])

            costs[f"{kind.__name__}.step, four shocks, compiled"] = cost(advance, count)
    return costs


def with_c(folder: Path, work: Path) -> dict[str, float]:
    """Return the costs of the header's functions in C [us]; none without a compiler."""
    try:
        compiler = find_compiler()
    except FmuError:
        return {}
    source, made = work / "cost.c", work / "cost"
    source.write_text(PROGRAM)
    subprocess.run([*compiler, "-O2", "-I", str(HOSTS), str(source), "-o", str(made), "-lm", "-ldl"], check=True)
    ran = subprocess.run([made, folder], check=True, capture_output=True, text=True)
    names = ("force_law_force", "force_law_jacobian", "force_law_hold", "force_law_extrapolate")
    return {f"{name}, one shock, C": 1e6 * float(x) for name, x in zip(names, ran.stdout.split(), strict=True)}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000, help="evaluations per pass; default 20000")
    count = parser.parse_args().count
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        build([HOSTS / "shock.json"], work)
        unpacked = work / "unpacked"
        extract(str(work / "shock.fmu"), str(unpacked))
        costs = with_cosim(work / "shock.fmu", count)
        costs["FMU2Slave of fmpy, one shock"] = with_fmpy(unpacked, count // 4)
        costs |= with_c(unpacked, work)
    print("| evaluation | us |\n|---|---|")
    for what, microseconds in costs.items():
        print(f"| {what} | {microseconds:.3g} |")


if __name__ == "__main__":
    main()
