"""Make the pictures and the numbers of docs/identification.md: python -m docs.make_identification_pictures 4 4.5 5 6.

Chapter by chapter of the dissertation, on the truths of the virtual rig; the numbers are printed as Markdown. Seeds are
those of benchmarks/identification_cases.py.
"""

import sys
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.signal import butter, sosfiltfilt, welch

from benchmarks.identification_cases import CASES, records_of
from benchmarks.identification_measures import measures_of, truth_of
from eightpost.ident.preparation import Preparation, prepare
from eightpost.ident.response import H1, Blocks, LocalPolynomial, SameDrive, estimate_response, response_of
from eightpost.ident.vehicle.baseline import find_baseline
from eightpost.ident.vehicle.experiment import experiment_of
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.ident.vehicle.rational_fit import RationalFit
from eightpost.ident.vehicle.recipes import recipe
from eightpost.rig import configuration
from eightpost.rig.post import (
    NO_DRIFT,
    Actuators,
    LinearDamper,
    RigSensors,
    bump_drive,
    quarter_random,
    run_test,
    simulate_setups,
    sine_drive,
    static_drive,
)
from eightpost.rig.post.drive import RATE
from eightpost.rig.post.drivefiles import HEAVE_SINES
from eightpost.rig.post.modes import displacement_modes, force_modes
from eightpost.units import convert
from eightpost.vehicle import add_port_damping, read_vehicle, shipped

DOCS = Path(__file__).resolve().parent
DAMPING, INCH, POUND = (convert(1.0, unit, si) for unit, si in (("lbf.s/in", "N.s/m"), ("in", "m"), ("lbf", "N")))
#: Of each rig test here [s]; the dissertation's 800 s are the benchmark's.
DURATION = 200.0
CORNERS = ("lf", "rf", "lr", "rr")


def main() -> None:
    """Make the chapters asked for."""
    for chapter in sys.argv[1:] or ("4", "5", "6"):
        started = process_time()
        {"4": chapter_4, "4.5": chapter_4_5, "5": chapter_5, "6": chapter_6}[chapter]()
        print(f"\nchapter {chapter}: {process_time() - started:.0f} s of processor\n", flush=True)


def chapter_4() -> None:
    """Figs 4.10, 4.11, 4.14 and Table 4.2."""
    case = CASES["quarter_car"]
    records, experiment = records_of(case)
    fit = recipe("boggs").identify(records, experiment)
    ideal = _ideal("quarter_car", experiment.baseline_damping)
    figure, grid = _figure(2, 3, (11.5, 6.0))
    for row, output in zip(grid, ("tire_force", "ride_height"), strict=True):
        for axes, source in zip(row, experiment.inputs, strict=True):
            _responses(axes, fit, ideal, (output, source))
    _save(figure, "quarter_car")
    _table_4_2(records, experiment, ideal)
    _fig_4_14(case, fit)


def _table_4_2(records, experiment, ideal) -> None:
    print("| road to shock velocity | mode 1 [Hz] | [%] | mode 2 [Hz] | [%] |\n|---|---|---|---|---|")
    _mode_row("ideal", ideal, None)
    recipes = {f"H1, Hamming blocks of {s:g} s": SameDrive(H1(Blocks(s, "hamming")), ("force",)) for s in (5, 9.52, 20)}
    recipes["local polynomials"] = SameDrive(LocalPolynomial(spacing=0.1), ("force",))
    for name, way in recipes.items():
        found = estimate_response(
            records, inputs=experiment.inputs, outputs=experiment.outputs, recipe=way,
            baseline_damping=experiment.baseline_damping,
        )  # fmt: skip
        _mode_row(name, None, found.band(0.5, 20.0))


def _mode_row(name, model, response) -> None:
    frequency = np.arange(0.5, 20.0, 0.05) if response is None else response.frequency
    path = response.between("velocity", "road") if model is None else _path(model, "velocity", "road", frequency)
    modes = RationalFit(4, 3).fit(frequency, path, np.ones_like(frequency)).modes()
    pairs = sorted({(round(m.frequency_hz, 6), m.damping_ratio) for m in modes})
    print(f"| {name} | {' | '.join(f'{f:.2f} | {100.0 * z:.2f}' for f, z in pairs)} |")


def _fig_4_14(case, fit) -> None:
    lap, setups = case.lap(), case.chosen(None)
    car, shocks = case.car, case.shocks()
    true = [truth_of(car, m) for m in simulate_setups(car, lap, [(shocks[i],) for (i,) in setups])]
    wanted = [convert(measures_of(*t, RATE)["tire_force"], "N", "lbf") for t in true]
    names = fit.vehicle.state_space.output_names
    found = ManySetups(fit.vehicle, case.laws(), lap, 5).run(setups)
    got = [convert(measures_of(names, y, RATE / 5)["tire_force"], "N", "lbf") for y in found]
    figure, grid = _figure(1, 1, (7.0, 4.0))
    axes = grid[0, 0]
    axes.plot(range(1, 13), wanted, "o-", color="0.4", label="truth")
    axes.plot(range(1, 13), got, "s--", color="tab:red", label="identified")
    axes.set(xlabel="configuration of Table 3.1", ylabel="tire force std [lbf]")
    axes.legend()
    _save(figure, "tire_force_of_twelve")
    wrong = np.array(got) - np.array(wanted)
    print(f"\nFig 4.14: deviation RMS {np.sqrt(np.mean(wrong**2)):.2f} lbf, mean {wrong.mean():.2f}, largest "
          f"{np.abs(wrong).max():.2f} of {np.mean(wanted):.0f} lbf")  # fmt: skip


def chapter_4_5() -> None:
    """The quarter-car rig of 4.5: one actuator, shock forces estimated by shock models."""
    case = CASES["quarter_car"]
    laws, car = case.laws(), case.car
    drive = quarter_random(3)
    numbers = (1, 2, 5, 6, 9, 10)  # Table 4.5: three builds at 1 and 14 clicks, 50 psi
    tests = [
        run_test(car, drive, [configuration(n)], seed=40 + n, sensors=RigSensors.perfect(relative=0.01), drift=NO_DRIFT)
        for n in numbers
    ]
    records = prepare(tests, Preparation()).records
    estimated = [_with_modelled_force(r, laws[n - 1]) for r, n in zip(records, numbers, strict=True)]
    pair = [estimated[0], estimated[4]]
    damping = find_baseline(pair, ("",), test=0).damping
    experiment = replace(
        experiment_of(records[0].names, damping, name="rig").of("tire_force", "chassis_acceleration", "ride_height"),
        rig=("road",),
    )
    fit = recipe("boggs").identify(pair, experiment)
    lap = Actuators().follow(drive.series, car)
    names = fit.vehicle.state_space.output_names
    found = ManySetups(fit.vehicle, [laws[n - 1] for n in numbers], lap.select(["road"]), 5).run(
        [[k] for k in range(len(numbers))]
    )
    shown = ("velocity", "tire_force", "chassis_acceleration", "ride_height")
    print("| shock | " + " | ".join(f"{n}: measured | identified" for n in shown) + " |\n|" + "---|" * 9)
    for number, record, y in zip(numbers, records, found, strict=True):
        cells = [f"{record[n].std():.4g} | {y[names.index(n)].std():.4g}" for n in shown]
        print(f"| {number} | {' | '.join(cells)} |")


def _with_modelled_force(record, law):
    v, dt = record["velocity"], 1.0 / record.sample_rate
    lagged, force = 0.0, np.zeros(len(record))
    for k in range(1, len(record)):
        lagged = law.follow(lagged, float(v[k - 1]), float(v[k]), dt)
        force[k] = law.response(lagged, float(v[k]), float(record["displacement"][k])).force
    return record.with_channel("force", "N", force)


def chapter_5() -> None:
    """Figs 5.9 to 5.17."""
    case = replace(CASES["seven_dof_800s"], duration=DURATION)
    records, experiment = records_of(case)
    fit = recipe("boggs").identify(records, experiment)
    ideal = _ideal("seven_dof", experiment.baseline_damping)
    figure, grid = _figure(3, 4, (13.0, 8.0))
    for row, output in zip(grid, ("lf.velocity", "lf.tire_force", "front.ride_height"), strict=True):
        for axes, corner in zip(row, CORNERS, strict=True):
            _responses(axes, fit, ideal, (output, f"{corner}.force"))
    _save(figure, "seven_dof_responses")
    print("\n".join(fit.notes), f"\nidentified in {fit.seconds:.1f} s of processor")
    lap, setups = case.lap(), [(0, 0, 0, 0), (6, 0, 0, 0), (0, 6, 0, 0), (0, 0, 6, 0), (0, 0, 0, 6)]
    _time_and_spectrum(case, fit, lap, setups, "seven_dof_simulation")


def _time_and_spectrum(case, fit, lap, setups, name) -> None:
    """Time traces (Fig 5.15, 6.26), spectra (5.16), measures (5.17, 6.27, 6.28)."""
    car, shocks = case.car, case.shocks()
    motions = simulate_setups(car, lap, [tuple(shocks[i] for i in s) for s in setups])
    true = [truth_of(car, m) for m in motions]
    names = fit.vehicle.state_space.output_names
    found = ManySetups(fit.vehicle, case.laws(), lap, 5).run(setups)
    shown = (("lf.tire_force", POUND, "lbf"), ("front.ride_height", INCH, "in"))
    figure, grid = _figure(2, 3, (13.5, 6.5))
    band = butter(4, (1.0, 20.0), "bandpass", fs=RATE / 5, output="sos")
    for row, (channel, unit, word) in zip(grid, shown, strict=True):
        t = true[0][1][true[0][0].index(channel), ::5] / unit
        y = found[0][names.index(channel)] / unit
        t, y = (sosfiltfilt(band, x - x.mean()) for x in (t, y))
        time = np.arange(t.size) / (RATE / 5)
        part = (time > 10.0) & (time < 13.0)
        for values, style in ((t, {"color": "0.5", "lw": 2}), (y, {"color": "tab:red", "lw": 1})):
            row[0].plot(time[part], values[part], **style)
        for values, label in ((t, "truth"), (y, "identified"), (y - t, "error")):
            row[1].semilogy(*welch(values[750:], RATE / 5, nperseg=1024), label=label)
        row[0].set(ylabel=f"{channel} [{word}]", xlabel="time [s]")
        row[1].set(xlim=(0, 25), xlabel="frequency [Hz]", ylabel=f"{word}2/Hz")
        row[1].legend()
        pairs = [(measures_of(*a, RATE)[channel] / unit, measures_of(names, b, RATE / 5)[channel] / unit)
                 for a, b in zip(true, found, strict=True)]  # fmt: skip
        row[2].plot(*np.array(pairs).T, "o")
        row[2].axline(pairs[0][:1] * 2, slope=1.0, color="0.6")
        row[2].set(xlabel=f"true RMS [{word}]", ylabel=f"identified [{word}]")
    _save(figure, name)
    _measure_table(true, found, names)


def _measure_table(true, found, names) -> None:
    print("\n| measure | truth: baseline, other shock lf, rf, lr, rr | identified |\n|---|---|---|")
    for channel, unit, word in (
        ("lr.velocity", INCH, "in/s"), ("total_tire_force", POUND, "lbf"), ("front.ride_height", INCH, "in"),
        ("lr.hub_acceleration", 9.80665, "g"),
    ):  # fmt: skip
        a = [measures_of(*t, RATE)[channel] / unit for t in true]
        b = [measures_of(names, y, RATE / 5)[channel] / unit for y in found]
        print(f"| {channel} [{word}] | {_numbers(a)} | {_numbers(b)} |")


def chapter_6() -> None:
    """Figs 6.19 to 6.32."""
    case = replace(CASES["eight_post_known"], duration=DURATION)
    records, experiment = records_of(case)
    fit = recipe("boggs").identify(records, experiment)
    figure, grid = _figure(4, 4, (13.5, 10.5))
    for row, output in zip(
        grid, ("rf.velocity", "rf.tire_force", "front.ride_height", "rf.hub_acceleration"), strict=True
    ):
        axes = row[0]
        axes.plot(fit.response.frequency, fit.response.coherence[fit.response.output_names.index(output)])
        axes.set(xlim=(0, 20), ylim=(0, 1.05), ylabel=f"{output}\ncoherence", xlabel="frequency [Hz]")
        for place, source in zip(row[1:], ("rf.road", "rf.aero", "rf.force"), strict=True):
            _responses(place, fit, None, (output, source))
    _save(figure, "eight_post_responses")
    print("\n".join(fit.notes), f"\nidentified in {fit.seconds:.1f} s of processor")
    setups = [(0, 0, 0, 0), (6, 0, 0, 0), (0, 6, 0, 0), (0, 0, 6, 0), (0, 0, 0, 6)]
    _time_and_spectrum(case, fit, case.lap(), setups, "eight_post_simulation")
    _sines_and_bump(case, fit)
    _static(case)


def _sines_and_bump(case, fit) -> None:
    car, names = case.car, fit.vehicle.state_space.output_names
    shown = (
        ("lf.velocity", INCH),
        ("lf.tire_force", POUND),
        ("front.ride_height", INCH),
        ("lf.hub_acceleration", 9.80665),
    )
    print("\n| heave sine | " + " | ".join(n for n, _ in shown) + " |\n|---|---|---|---|---|")
    for frequency, amplitude in HEAVE_SINES:
        t, y = _one(case, fit, sine_drive(car, frequency, amplitude * INCH))
        cells = [f"{_std(t, n) / u:.3g}, {y[names.index(n), 750:].std() / u:.3g}" for n, u in shown]
        print(f"| {frequency:g} Hz, {amplitude:g} in | {' | '.join(cells)} |")
    t, y = _one(case, fit, bump_drive(car))
    figure, grid = _figure(1, 4, (14.0, 3.4))
    for axes, (n, u) in zip(grid[0], shown, strict=True):
        time = np.arange(y.shape[1]) / (RATE / 5)
        part = (time > 19.8) & (time < 21.0)
        low = butter(4, 60.0, fs=RATE, output="sos")
        measured = sosfiltfilt(low, t[1][t[0].index(n)])[::5] / u
        axes.plot(time[part], (measured - measured.mean())[part], color="0.5", lw=2)
        axes.plot(time[part], (y[names.index(n)] / u)[part], color="tab:red", lw=1)
        axes.set(title=n, xlabel="time [s]")
    _save(figure, "eight_post_bump")


def _one(case, fit, drivefile):
    car, law = case.car, 3
    lap = Actuators().follow(drivefile.series, car)
    shocks = case.shocks()
    motion = next(iter(simulate_setups(car, lap, [(shocks[law],) * 4])))
    return truth_of(car, motion), ManySetups(fit.vehicle, case.laws(), lap, 5).run([(law,) * 4])[0]


def _std(truth, name) -> float:
    return float(truth[1][truth[0].index(name), 3750:].std())


def _static(case) -> None:
    """Eq 6.10 and 6.11: the spring matrix of the aeroloaders' modes."""
    car, rows = case.car, []
    for kind in ("heave", "pitch", "roll", "warp"):
        drive = static_drive(car, kind)
        record = run_test(car, drive, [LinearDamper(20.74 * DAMPING)] * 4, drift=NO_DRIFT).series
        for k in range(11):
            held = record.window(5.0 * k + 2.0, 5.0 * k + 3.9) if k else record.window(1.0, 3.9)
            rows.append([held[f"{c}.{q}"].mean() for q in ("aero_position", "aero") for c in CORNERS])
    x, force = np.split(np.array(rows), 2, axis=1)
    g = car.geometry
    X, F = displacement_modes(g) @ x.T, force_modes(g) @ force.T
    design = np.vstack([X, np.ones(X.shape[1])]).T
    K = np.linalg.lstsq(design, F.T, rcond=None)[0]
    left = F.T - design @ K
    scale_x, scale_f = np.array([INCH, *[np.pi / 180] * 3]), np.array([POUND, *[convert(1.0, "lbf.ft", "N.m")] * 3])
    print("\nEq 6.11 [1e3 lbf, ft.lbf per in, deg], heave, pitch, roll, warp:")
    print(np.array2string(K[:4].T * scale_x / scale_f[:, None] / 1e3, precision=2, suppress_small=True))
    print("unexplained, of each force's std [%]:", np.round(100.0 * left.std(axis=0) / F.T.std(axis=0), 1))


def _ideal(name, damping):
    return add_port_damping(read_vehicle(shipped(name)).coupled(), damping)


def _path(model, output, source, frequency):
    return model.select(inputs=[source], outputs=[output]).frequency_response(frequency)[0, 0]


def _responses(axes, fit, ideal, path) -> None:
    estimate = fit.response.band(0.3, 20.0)
    output, source = path
    lines = [(estimate.between(output, source), {"color": "0.7", "lw": 2.4, "label": "estimate"})]
    if ideal is not None:
        lines.append((_path(ideal, output, source, estimate.frequency), {"color": "k", "lw": 1.0, "label": "ideal"}))
    model = response_of(fit.vehicle.state_space, estimate.frequency).between(output, source)
    lines.append((model, {"color": "tab:red", "lw": 1.0, "ls": "--", "label": "model"}))
    for values, style in lines:
        axes.plot(estimate.frequency, 20.0 * np.log10(np.maximum(np.abs(values), 1e-300)), **style)
    top = 20.0 * np.log10(np.abs(model).max())
    axes.set(title=f"{output} / {source}", xlabel="frequency [Hz]", ylabel="dB", ylim=(top - 70.0, top + 8.0))
    axes.legend(fontsize="x-small")


def _figure(rows, columns, size):
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.ravel():
        axes.grid(visible=True, color="0.92")
    return figure, grid


def _save(figure, name) -> None:
    figure.savefig(DOCS / f"identification_{name}.png", dpi=80)


def _numbers(values) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


if __name__ == "__main__":
    main()
