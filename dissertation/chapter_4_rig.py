"""Chapter 4.5: the quarter-car rig with six shocks, whose forces are computed by their fitted laws."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.stats import spearmanr

from dissertation.checks import response
from dissertation.dyno_bench import lpnl2_of
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import (
    COHERENCE,
    LINEAR_FREQUENCY,
    TIME,
    TRUTH,
    Line,
    Plot,
    decibel_axis,
    decibels,
    figure_of,
)
from eightpost.array_types import Array
from eightpost.ident import simulate
from eightpost.ident.preparation import Preparation, prepare
from eightpost.ident.vehicle.boggs import CHAPTER_4, Boggs
from eightpost.ident.vehicle.experiment import experiment_of, find_baseline
from eightpost.ident.vehicle.simulation import ManySetups
from eightpost.ident.vehicle.siso_models import BandWeights, RationalFit
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.report.charts import Axis
from eightpost.signals import TimeSeries
from eightpost.units import si_factor
from eightpost.virtual import NO_DRIFT, Actuators, RigSensors, configuration, quarter_random, quarter_truth, run_test

#: Numbers in Table 3.1 of the configurations of Table 4.5, in its order.
_CONFIGURATIONS = (1, 2, 5, 6, 9, 10)

#: Indices of the baseline and the alternate configuration (4.5.2), and of that in Fig 4.20.
_BASELINE, _ALTERNATE, _SHOWN = 0, 4, 2

#: Identified outputs with SI units; the first four are those compared.
_OUTPUTS = {
    "velocity": "m/s",
    "chassis_position": "m",
    "chassis_acceleration": "m/s2",
    "tire_force": "N",
    "wheel_position": "m",
}
#: 4.5.2: 50 blocks, fits of fourth order from 0.5 to 15 Hz.
_CHAPTER = replace(CHAPTER_4, blocks=50, roads=BandWeights(((0.5, 15.0, 1.0),)))
_SEED = 3

#: Interval of the model's output samples; the rig's records are resampled to 125 Hz.
_EVERY = 10

#: Samples at 125 Hz that are left out at the start of a record.
_SETTLING = 750


@dataclass(frozen=True, slots=True, eq=False)
class _Rig:
    """Records with six shocks, the identified rig, and its simulation with their laws at 125 Hz."""

    records: tuple[TimeSeries, ...]
    fit: VehicleFit
    found: tuple[dict[str, Array], ...]


@cache
def _rig(seconds: float) -> _Rig:
    car, command = quarter_truth(), quarter_random(_SEED, duration=seconds)
    sensors = RigSensors.perfect(relative=0.01)
    tests = [
        run_test(car, command, [configuration(n)], seed=40 + n, sensors=sensors, drift=NO_DRIFT)
        for n in _CONFIGURATIONS
    ]
    records = tuple(_with_positions(record) for record in prepare(tests, Preparation()).records)
    laws = [lpnl2_of(n) for n in _CONFIGURATIONS]
    pair = [_with_modelled_force(records[k], _CONFIGURATIONS[k]) for k in (_BASELINE, _ALTERNATE)]
    damping = find_baseline(pair, ("",), test=0).damping
    experiment = replace(experiment_of(pair[0].names, damping, name="rig"), rig=("road",), outputs=tuple(_OUTPUTS))
    fit = Boggs(_CHAPTER).identify(pair, experiment)
    drive = Actuators().follow(command.series, car).select(["road"])
    outputs = ManySetups(fit.vehicle, laws, drive, _EVERY).run([[k] for k in range(len(laws))])
    names = fit.vehicle.state_space.output_names
    return _Rig(records, fit, tuple(dict(zip(names, rows, strict=True)) for rows in outputs))


def _with_positions(record: TimeSeries) -> TimeSeries:
    """Add the positions of both masses, which 4.5.1 measures with string potentiometers."""
    chassis = record["ride_height"] + record["road"]
    with_chassis = record.with_channel("chassis_position", "m", chassis)
    return with_chassis.with_channel("wheel_position", "m", chassis + record["displacement"])


def _with_modelled_force(record: TimeSeries, number: int) -> TimeSeries:
    """Replace the measured force by that of the fitted law at the measured velocity (4.5.1)."""
    force = simulate(lpnl2_of(number), record)
    return record.with_channel("force", "N", force - force.mean())


def figure_4_18(effort: Effort) -> Findings:
    """Responses of both masses, C-bar and modes."""
    rig = _rig(effort.quarter_rig_seconds)
    estimate = rig.fit.response.band(0.3, 15.0)
    f, plots = estimate.frequency, []
    for output in ("chassis_position", "wheel_position"):
        for source, unit in (("road", "in"), ("force", "lbf")):
            scale = si_factor("in") / si_factor(unit)
            model = response(rig.fit.vehicle.state_space, output, source, f)
            rows = {"estimate": estimate.between(output, source), "fit": model}
            lines = [Line(name, f, decibels(row, scale)) for name, row in rows.items()]
            plots.append(Plot(f"{output} over {source}", LINEAR_FREQUENCY, decibel_axis(f"in/{unit}"), lines))
    band = np.arange(0.5, 15.0, 0.05)
    path = response(rig.fit.vehicle.state_space, "chassis_position", "road", band)
    modes = [mode for mode in RationalFit(4, 3).fit(band, path, np.ones_like(band)).modes() if mode.damping_ratio < 1.0]
    values = {"damping": rig.fit.vehicle.baseline_damping[""], "resolution": 51.0 / (2.0 * 120.0)}
    for number, mode in enumerate(modes[:2], start=1):
        values |= {f"f{number}": mode.frequency_hz, f"z{number}": 100.0 * mode.damping_ratio}
    return Findings(
        values,
        blocks=[figure_of("Estimate and fit of fourth order.", plots, columns=4)],
        note="Modes are those of a fourth-order fit of road to chassis position. Our dampers are steeper near zero "
        "velocity than the dissertation's, so both masses move almost together, and the other poles are real.",
        is_partial=True,
    )


def figure_4_19(effort: Effort) -> Findings:
    """Coherence of both positions."""
    found = _rig(effort.quarter_rig_seconds).fit.response
    estimate = found.band(0.5, 15.0)
    assert estimate.coherence is not None
    rows = {name: estimate.coherence[found.output_names.index(name)] for name in ("chassis_position", "wheel_position")}
    plots = [
        Plot(n, LINEAR_FREQUENCY, COHERENCE, [Line("coherence", estimate.frequency, row)]) for n, row in rows.items()
    ]
    means = {name: float(row.mean()) for name, row in rows.items()}
    text = ", ".join(f"{name} {mean:.3f}" for name, mean in means.items())
    return Findings(
        claims={"good": (min(means.values()) > 0.9, f"mean: {text}")},
        blocks=[figure_of("Coherence.", plots, columns=2)],
    )


def _pair(rig: _Rig, name: str, setup: int) -> tuple[Array, Array]:
    """Return a channel about its mean, measured and simulated, at 125 Hz without settling time."""
    size = min(len(rig.records[setup]), rig.found[setup][name].size)
    rows = (rig.records[setup][name][_SETTLING:size], rig.found[setup][name][_SETTLING:size])
    measured, found = (row - row.mean() for row in rows)
    return measured, found


def figure_4_20(effort: Effort) -> Findings:
    """Chassis position with the third configuration over 5 s."""
    rig = _rig(effort.quarter_rig_seconds)
    measured, found = _pair(rig, "chassis_position", _SHOWN)
    error = float(np.std(found - measured) / np.std(measured))
    part = slice(1250, 1875)
    time = np.arange(part.start, part.stop) / 125.0
    lines = [Line(TRUTH, time, measured[part]), Line("simulated", time, found[part])]
    return Findings(
        claims={"good": (error < 0.2, f"error {100.0 * error:.1f} % of the standard deviation")},
        blocks=[
            figure_of(
                "Chassis position: virtual rig (truth) and simulated.",
                [Plot("", TIME, Axis("position", "m"), lines)],
                columns=1,
            )
        ],
    )


def figure_4_21(effort: Effort) -> Findings:
    """RMS of four responses with six shocks."""
    rig = _rig(effort.quarter_rig_seconds)
    numbers = np.arange(1.0, 7.0)
    plots, ranks, errors = [], [], []
    for name in tuple(_OUTPUTS)[:4]:
        levels = np.array([[row.std() for row in _pair(rig, name, k)] for k in range(len(_CONFIGURATIONS))])
        ranks.append(float(spearmanr(*levels.T).statistic))
        errors.append(100.0 * float(np.abs(levels[:, 1] / levels[:, 0] - 1.0).max()))
        lines = [Line(TRUTH, numbers, levels[:, 0], "marks"), Line("simulated", numbers, levels[:, 1], "marks")]
        plots.append(Plot(name, Axis("configuration of Table 4.5"), Axis("RMS", _OUTPUTS[name]), lines))
    text = ", ".join(f"{name} {rank:.2f}" for name, rank in zip(_OUTPUTS, ranks, strict=False))
    return Findings(
        claims={"trend": (float(np.mean(ranks)) > 0.7, f"Spearman: {text}")},
        blocks=[figure_of("RMS of four responses: virtual rig (truth) and simulated.", plots, columns=4)],
        note=f"Largest error of a level: {max(errors):.1f} %.",
    )


COMPUTATIONS = {
    "figure-4.18": figure_4_18,
    "figure-4.19": figure_4_19,
    "figure-4.20": figure_4_20,
    "figure-4.21": figure_4_21,
}
