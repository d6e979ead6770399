"""Make section 4.5 of docs/explanation/identification.md: a quarter-car rig with one actuator, modelled forces.

This makes Figs 4.18 to 4.21 for the car of Table 4.1 with the physical dampers of Table 4.5, 120 s of Table 4.3, noise
of 1 %.
"""

from dataclasses import replace

import numpy as np

from benchmarks.identification_shocks import twelve
from docs.make.identification_pictures import GRAVITY, INCH, POUND, draw_pairs, draw_path, figure_of, path_of, save
from eightpost.ident.preparation import Preparation, prepare
from eightpost.ident.vehicle.experiment import experiment_of, find_baseline
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.ident.vehicle.recipes.boggs import CHAPTER_4, Boggs
from eightpost.ident.vehicle.siso_models import BandWeights, RationalFit
from eightpost.rig import configuration
from eightpost.rig.post import NO_DRIFT, Actuators, RigSensors, quarter_random, quarter_truth, run_test
from eightpost.vehicle import add_port_damping, read_vehicle, shipped

#: Numbers in Table 3.1 of the configurations of Table 4.5: three builds at 1 and 14 clicks and 50 psi.
CONFIGURATIONS = (1, 2, 5, 6, 9, 10)
#: Indices of the baseline and the alternate configuration (4.5.2), and of that in Fig 4.20.
BASELINE, ALTERNATE, SHOWN = 0, 4, 2
#: Outputs that are identified (4.5.2) and compared (Fig 4.21), with units.
MEASURES = (
    ("velocity", INCH, "in/s"), ("chassis_position", INCH, "in"), ("chassis_acceleration", GRAVITY, "g"),
    ("wheel_position", INCH, "in"), ("tire_force", POUND, "lbf"),
)  # fmt: skip
#: Settings of 4.5.2: 50 blocks, fits of fourth order from 0.5 to 15 Hz.
CHAPTER = replace(CHAPTER_4, blocks=50, roads=BandWeights(((0.5, 15.0, 1.0),)))
DRIVE_SEED = 3


def main() -> None:
    """Make plots and tables."""
    measured, drive = rig_records()
    estimated = [with_modelled_force(r, twelve()[n - 1]) for r, n in zip(measured, CONFIGURATIONS, strict=True)]
    fit = identified(estimated)
    print("\n".join(fit.notes))
    print(f"C-bar {fit.vehicle.baseline_damping[''] / (POUND / INCH):.2f} lbf/(in/s)")
    wrong = [np.std(e["force"] - m["force"]) / np.std(m["force"]) for e, m in zip(estimated, measured, strict=True)]
    print("modelled shock force, error relative to its standard deviation [%]:", np.round(100.0 * np.array(wrong), 1))
    _draw_responses(fit)
    found = simulated(fit, drive)
    _draw_prediction(measured, found)
    print(_table(measured, found))
    print(f"as identified: {_errors(measured, found)}")
    print(f"with measured forces: {_errors(measured, simulated(identified(measured), drive))}")
    print(f"Table 4.1 itself, same shock models: {_errors(measured, simulated(_ideal(fit), drive))}")
    for name, car in (("identified", fit), ("Table 4.1", _ideal(fit))):
        modes = sorted({(round(m.frequency_hz, 6), m.damping_ratio) for m in _fourth_order(car).modes()})
        print(f"modes, {name}: {', '.join(f'{f:.2f} Hz {100.0 * z:.0f} %' for f, z in modes)}")


def _ideal(fit):
    """Return the fit with the identified vehicle replaced by the car of Table 4.1 around the same damping."""
    car = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), fit.vehicle.baseline_damping)
    known = fit.vehicle.state_space
    return replace(
        fit, vehicle=replace(fit.vehicle, state_space=car.select(inputs=known.input_names, outputs=known.output_names))
    )


def _fourth_order(fit):
    """Return the fourth-order fit of chassis position over road (4.5.2)."""
    frequency = np.arange(0.5, 15.0, 0.05)
    path = path_of(fit.vehicle.state_space, "chassis_position", "road", frequency)
    return RationalFit(4, 3).fit(frequency, path, np.ones_like(frequency))


def rig_records():
    """Return the six records at 125 Hz with the string potentiometers' channels, and the motion of the actuator."""
    car, command = quarter_truth(), quarter_random(DRIVE_SEED)
    sensors = RigSensors.perfect(relative=0.01)
    tests = [
        run_test(car, command, [configuration(n)], seed=40 + n, sensors=sensors, drift=NO_DRIFT) for n in CONFIGURATIONS
    ]
    return [_with_positions(r) for r in prepare(tests, Preparation()).records], Actuators().follow(command.series, car)


def _with_positions(record):
    """Add the positions of both masses, which 4.5.1 measures with string potentiometers."""
    chassis = record["ride_height"] + record["road"]
    with_chassis = record.with_channel("chassis_position", "m", chassis)
    return with_chassis.with_channel("wheel_position", "m", chassis + record["displacement"])


def with_modelled_force(record, law):
    """Return the record with the measured force replaced by that of the shock law at the measured velocity."""
    v, dt = record["velocity"], 1.0 / record.sample_rate
    lagged, force = 0.0, np.zeros(len(record))
    for k in range(1, len(record)):
        lagged = law.follow(lagged, float(v[k - 1]), float(v[k]), dt)
        force[k] = law.response(lagged, float(v[k]), float(record["displacement"][k])).force
    return record.with_channel("force", "N", force - force.mean())


def identified(records):
    """Return the boggs fit to the baseline and the alternate record (4.5.2)."""
    pair = [records[BASELINE], records[ALTERNATE]]
    damping = find_baseline(pair, ("",), test=0).damping
    experiment = replace(
        experiment_of(pair[0].names, damping, name="rig"),
        rig=("road",),
        outputs=tuple(name for name, _, _ in MEASURES),
    )
    return Boggs(CHAPTER).identify(pair, experiment)


def simulated(fit, drive):
    """Return the outputs (N,) by name of the identified rig with each configuration's shock law."""
    laws = [twelve()[n - 1] for n in CONFIGURATIONS]
    outputs = ManySetups(fit.vehicle, laws, drive.select(["road"]), 10).run([[k] for k in range(len(laws))])
    return [dict(zip(fit.vehicle.state_space.output_names, y, strict=True)) for y in outputs]


def _draw_responses(fit) -> None:
    figure, grid = figure_of(2, 3, (12.0, 6.0))
    for row, output in zip(grid, ("chassis_position", "wheel_position"), strict=True):
        for axes, source in zip(row, ("road", "force"), strict=False):
            draw_path(axes, fit, (output, source), band=(0.3, 15.0))
        place = fit.response.output_names.index(output)
        row[2].plot(fit.response.frequency, fit.response.coherence[place])
        row[2].set(xlim=(0, 15), ylim=(0, 1.05), title=f"coherence of {output}", xlabel="frequency [Hz]")
    save(figure, "quarter_rig_responses")


def _draw_prediction(measured, found) -> None:
    figure, grid = figure_of(1, 5, (17.0, 3.4))
    record, name = measured[SHOWN], "chassis_position"
    part = (record.time > 60.0) & (record.time < 65.0)
    shown = record[name] - record[name].mean()
    size = min(len(record), found[SHOWN][name].size)
    grid[0, 0].plot(record.time[part], shown[part] / INCH, color="0.5", lw=2, label="measured")
    grid[0, 0].plot(
        record.time[:size][part[:size]], found[SHOWN][name][:size][part[:size]] / INCH, color="tab:red", lw=1
    )
    grid[0, 0].set(title=f"{name} [in], configuration 3", xlabel="time [s]")
    for axes, (name, unit, word) in zip(grid[0, 1:], MEASURES, strict=False):
        draw_pairs(
            axes, [(_rms(m[name]) / unit, _rms(f[name]) / unit) for m, f in zip(measured, found, strict=True)], word
        )
        axes.set(title=f"RMS of {name}")
    save(figure, "quarter_rig_simulation")


def _table(measured, found) -> str:
    lines = [
        f"| measure | {' | '.join(str(k + 1) for k in range(len(measured)))} |",
        "|---" * (len(measured) + 1) + "|",
    ]
    for name, unit, word in MEASURES:
        pairs = [(_rms(m[name]) / unit, _rms(f[name]) / unit) for m, f in zip(measured, found, strict=True)]
        lines.append(f"| {name} [{word}] | {' | '.join(f'{a:.3g}, {b:.3g}' for a, b in pairs)} |")
    return "\n".join(lines)


def _errors(measured, found) -> str:
    ranges = []
    for name, _, _ in MEASURES:
        wrong = [100.0 * (_rms(f[name]) / _rms(m[name]) - 1.0) for m, f in zip(measured, found, strict=True)]
        ranges.append(f"{name} {min(wrong):+.1f} to {max(wrong):+.1f} %")
    return ", ".join(ranges)


def _rms(values) -> float:
    """Return the standard deviation from 6 s on."""
    return float(values[750:].std())


if __name__ == "__main__":
    main()
