"""Benchmark of the output-error engine on two public records of nonlinear systems: Silverbox and cascaded tanks.

    python -m benchmarks.output_error [--case silverbox] [--json FILE]

The records are in the folder `nonlinear` of EIGHTPOST_DATA; they are not part of the project. Silverbox is an
electronic mass-spring-damper (610.35 Hz); the fit uses the first multisines after the arrow, and is judged on the
arrow, whose end is beyond the amplitudes of the fit, and on the later multisines. The cascaded tanks (4 s sampling)
have a record for the fit and one for the test; the initial levels are the same in both. Rows: {case, model, parameters,
fit, record, test, unit, residual_percent, adequate, converged, seconds}; fit and test are RMS errors of a free-running
simulation, residual_percent is that of the fit relative to the output. The linear model of each case is beside the
nonlinear one.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: more threads are slower

import numpy as np

from benchmarks.identification import markdown
from eightpost.ident.output_error import (
    Model,
    OutputError,
    Parameter,
    ParameterTable,
    Record,
    Shooting,
    SteppedModel,
    derivative_function,
    simulate,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

Row = dict[str, Any]

#: Sample rates [Hz].
SILVERBOX_RATE, TANKS_RATE = 1e7 / 2**14, 0.25

#: Samples of Silverbox's arrow, its first sample after the start from rest, and the samples of the fit.
_ARROW, _SETTLED, _FIT = 40_000, 200, (40_650, 92_650)

#: Resonance about which the parameters of Silverbox are of the order of one [rad/s].
_W = 2.0 * np.pi * 68.0

# ---- Silverbox: a mass on a damper and a spring with square and cubic terms, and a direct term ----------------------


@derivative_function
def silverbox_derivative(x: Array, u: Array, p: Array, dx: Array) -> None:
    """Fill dx: y'' / w^2 = gain (u + u0) - k y - k2 y^2 - k3 y^3 - 2 zeta y' / w."""
    y = x[0]
    dx[0] = x[1]
    dx[1] = _W * _W * (p[0] * (u[0] + p[1]) - p[2] * y - p[3] * y * y - p[4] * y * y * y) - 2.0 * _W * p[5] * x[1]


@derivative_function
def silverbox_output(x: Array, u: Array, p: Array, y: Array) -> None:
    """Fill y with position, offset, direct term and the lag of the measurement."""
    y[0] = x[0] + p[6] + p[7] * u[0] - p[8] * x[1]


def silverbox() -> tuple[Model, ParameterTable]:
    """Return the model of Silverbox and its parameters."""
    table = ParameterTable(
        (
            Parameter("gain", "1", 1.0, 0.1, 10.0, "logarithmic"),
            Parameter("input_offset", "V", 0.0, size=0.01),
            Parameter("stiffness", "1", 1.0, 0.1, 10.0, "logarithmic"),
            Parameter("square_stiffness", "1/V", 0.0, size=1.0),
            Parameter("cubic_stiffness", "1/V2", 3.0, size=3.0),
            Parameter("damping_ratio", "1", 0.03, 1e-3, 1.0, "logarithmic"),
            Parameter("output_offset", "V", 0.0, size=0.01),
            Parameter("direct_term", "1", 0.0, size=0.1),
            Parameter("lag", "s", 0.0, size=1e-4),
        )
    )
    model = SteppedModel(
        silverbox_derivative, silverbox_output, outputs=1, state_sizes=np.array([0.1, 0.1 * _W]), steps=4
    )
    return model, table


# ---- Cascaded tanks: a pump fills the upper tank, which empties into the lower one ----------------------------------


@derivative_function
def tanks_derivative(x: Array, u: Array, p: Array, dx: Array) -> None:
    """Fill the changes of both levels; what the upper tank spills falls partly into the lower one.

    The upper outflow is nearly proportional to the level, the lower one is k3 (x2 - outlet)^0.5 + l3 x2.
    """
    upper = p[0] * x[0]
    lower = p[1] * max(x[1] - p[2], 0.0) ** 0.5 + p[3] * x[1]
    spilled = p[6] * max(x[0] - p[5], 0.0)
    dx[0] = p[4] * u[0] - upper - spilled
    dx[1] = upper - lower + p[7] * spilled - p[6] * max(x[1] - 10.0, 0.0)


@derivative_function
def tanks_output(x: Array, _u: Array, _p: Array, y: Array) -> None:
    """Fill y with the level of the lower tank, which its rim limits to 10 V."""
    y[0] = min(x[1], 10.0)


def _levels(values: Array) -> Array:
    return values[:, 8:10]


def tanks() -> tuple[Model, ParameterTable]:
    """Return the model of the cascaded tanks and its parameters."""
    table = ParameterTable(
        (
            Parameter("upper_outflow", "1/s", 0.006, 1e-4, 1.0, "logarithmic"),
            Parameter("lower_outflow", "V0.5/s", 0.06, 1e-3, 1.0, "logarithmic"),
            Parameter("outlet_level", "V", 2.0, -5.0, 2.2, size=1.0),
            Parameter("lower_linear_outflow", "1/s", 0.0, size=0.01),
            Parameter("pump", "1/s", 0.06, 1e-3, 1.0, "logarithmic"),
            Parameter("upper_rim", "V", 33.0, 5.0, 100.0, "logarithmic"),
            Parameter("spilling", "1/s", 0.5, 0.01, 2.0, "logarithmic"),
            Parameter("spilled_share", "1", 0.6, 0.0, 1.0),
            Parameter("upper_start", "V", 25.0, 0.0, 100.0),
            Parameter("lower_start", "V", 5.2, 0.0, 10.0),
        )
    )
    model = SteppedModel(
        tanks_derivative, tanks_output, outputs=1, state_sizes=np.array([10.0, 3.0]), start=_levels, steps=4, hold=True
    )
    return model, table


# ---- The cases ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Case:
    """A case of the benchmark."""

    name: str  #: Name of the case.
    model: Callable[[], tuple[Model, ParameterTable]]  #: Function that returns the model and its parameters.
    linear: Mapping[str, float]  #: Values of the parameters that make the model linear.
    #: Function that returns the record of the fit and those of the tests by name, from a folder.
    records: Callable[[Path], tuple[Record, dict[str, Record]]]
    size: float  #: Factor from volts to the unit of the rows.
    unit: str  #: Unit of the rows.
    engine: OutputError  #: Settings of the fit.


def _table_of(path: Path, columns: int) -> Array:
    values = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=range(columns))
    return np.asarray(values[np.isfinite(values).all(axis=1)])


def _silverbox_records(folder: Path) -> tuple[Record, dict[str, Record]]:
    data = _table_of(folder / "silverbox_SNLS80mV.csv", 2)
    arrow, fit, later = data[:_ARROW], data[slice(*_FIT)], data[_FIT[1] : 127_400]
    fit_record, *tests = [
        Record(rows[:, :1], rows[:, 1:], SILVERBOX_RATE, settling=_SETTLED) for rows in (fit, arrow, later)
    ]
    return fit_record, dict(zip(("arrow", "later multisines"), tests, strict=True))


def _tanks_records(folder: Path) -> tuple[Record, dict[str, Record]]:
    data = _table_of(folder / "cascaded_tanks.csv", 4)
    fit, test = (Record(data[:, [k]], data[:, [k + 2]], TANKS_RATE) for k in (0, 1))
    return fit, {"test": test}


CASES = {
    case.name: case
    for case in (
        Case(
            "silverbox", silverbox, {"square_stiffness": 0.0, "cubic_stiffness": 0.0},
            _silverbox_records, 1e3, "mV", OutputError(passes=1, difference=1e-4),
        ),
        Case(
            "cascaded_tanks", tanks, {"lower_outflow": 1e-12, "spilling": 1e-12},
            _tanks_records, 1.0, "V", OutputError(passes=1, shooting=Shooting(evaluations=200)),
        ),
    )
}  # fmt: skip


def run(case: Case, folder: Path) -> list[Row]:
    """Return the rows of the linear and of the nonlinear model."""
    record, tests = case.records(folder)
    model, table = case.model()
    return [
        row
        for name, fixed in (("linear", case.linear), ("nonlinear", {}))
        for row in _rows(case, name, model, _with_fixed(table, fixed), record, tests)
    ]


def _with_fixed(table: ParameterTable, values: Mapping[str, float]) -> ParameterTable:
    """Return the table in which parameters are fixed at values, which may be outside of their bounds."""
    return ParameterTable(
        tuple(Parameter(p.name, p.unit, values[p.name], fixed=True) if p.name in values else p for p in table)
    )


def _rows(
    case: Case, name: str, model: Model, table: ParameterTable, record: Record, tests: Mapping[str, Record]
) -> Sequence[Row]:
    fit = case.engine.fit(model, table, [record], outputs=["y"])
    error = fit.simulated[0] - record.outputs
    rows = []
    for test, other in tests.items():
        left = simulate(model, fit.values, table, other) - other.outputs
        rows.append(
            {
                "case": case.name, "model": name, "parameters": len(table.free),
                "fit": case.size * _rms(record.counted(error)),
                "record": test,
                "test": case.size * _rms(other.counted(left)),
                "unit": case.unit,
                "residual_percent": 100.0 * fit.residual["y"],
                "adequate": fit.gate.is_adequate, "converged": fit.converged, "seconds": round(fit.seconds, 1),
            }
        )  # fmt: skip
    return rows


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Print the rows of all cases."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", choices=tuple(CASES), action="append", help="case to run (default: all)")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    options = parser.parse_args()
    if "EIGHTPOST_DATA" not in os.environ:
        parser.error("EIGHTPOST_DATA does not name the folder of measured records")
    folder = Path(os.environ["EIGHTPOST_DATA"]) / "nonlinear"
    rows = [row for name in options.case or CASES for row in run(CASES[name], folder)]
    print(markdown(rows))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
