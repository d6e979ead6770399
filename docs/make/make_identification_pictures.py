"""Make the plots and numbers of docs/explanation/identification.md.

    python -m docs.make_identification_pictures 4 4.5 5 6 6.4.4

The arguments are chapters and sections of the dissertation; default all. The truths are those of the virtual rig, and
the seeds are those of benchmarks/identification_cases.py. Numbers are printed as Markdown.
"""

import sys
from dataclasses import replace
from time import process_time

import numpy as np
from scipy.signal import butter, sosfiltfilt, welch

from benchmarks.identification_cases import CASES, records_of
from benchmarks.identification_measures import measures_of, truth_of
from docs.make import make_identification_quarter_rig, make_identification_stand_in, make_identification_static
from docs.make.identification_pictures import (
    CORNERS,
    GRAVITY,
    INCH,
    POUND,
    draw_pairs,
    draw_path,
    figure_of,
    numbers,
    path_of,
    save,
)
from eightpost.ident.response import H1, Blocks, LocalPolynomial, SameDrive, estimate_response
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.ident.vehicle.recipes import recipe
from eightpost.ident.vehicle.siso_models import RationalFit
from eightpost.rig.post import simulate_setups
from eightpost.rig.post.drivefiles import RATE
from eightpost.units import convert
from eightpost.vehicle import add_port_damping, read_vehicle, shipped

#: Duration of each rig test [s]; the benchmark uses the dissertation's 800 s.
DURATION = 200.0


def main() -> None:
    """Make the requested chapters."""
    for chapter in sys.argv[1:] or CHAPTERS:
        started = process_time()
        CHAPTERS[chapter]()
        print(f"\nchapter {chapter}: {process_time() - started:.0f} s of processor time\n", flush=True)


def chapter_4() -> None:
    """Make Figs 4.10, 4.11, 4.14 and Table 4.2."""
    case = CASES["quarter_car"]
    records, experiment = records_of(case)
    fit = recipe("boggs").identify(records, experiment)
    ideal = _ideal("quarter_car", experiment.baseline_damping)
    figure, grid = figure_of(2, 3, (11.5, 6.0))
    for row, output in zip(grid, ("tire_force", "ride_height"), strict=True):
        for axes, source in zip(row, experiment.inputs, strict=True):
            draw_path(axes, fit, (output, source), ideal=ideal)
    save(figure, "quarter_car")
    _table_4_2(records, experiment, ideal)
    _fig_4_14(case, fit)


def _table_4_2(records, experiment, ideal) -> None:
    print("| road to shock velocity | mode 1 [Hz] | [%] | mode 2 [Hz] | [%] |\n|---|---|---|---|---|")
    _mode_row("ideal", ideal, None)
    recipes = {f"H1, Hamming blocks of {s:g} s": SameDrive(H1(Blocks(s, "hamming")), ("force",)) for s in (5, 9.52, 20)}
    recipes["local polynomials"] = SameDrive(LocalPolynomial(spacing=0.1), ("force",))
    for name, method in recipes.items():
        found = estimate_response(
            records, inputs=experiment.inputs, outputs=experiment.outputs, recipe=method,
            baseline_damping=experiment.baseline_damping,
        )  # fmt: skip
        _mode_row(name, None, found.band(0.5, 20.0))


def _mode_row(name, model, response) -> None:
    frequency = np.arange(0.5, 20.0, 0.05) if response is None else response.frequency
    path = response.between("velocity", "road") if model is None else path_of(model, "velocity", "road", frequency)
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
    figure, grid = figure_of(1, 1, (7.0, 4.0))
    axes = grid[0, 0]
    axes.plot(range(1, 13), wanted, "o-", color="0.4", label="truth")
    axes.plot(range(1, 13), got, "s--", color="tab:red", label="identified")
    axes.set(xlabel="configuration of Table 3.1", ylabel="tire force std [lbf]")
    axes.legend()
    save(figure, "tire_force_of_twelve")
    wrong = np.array(got) - np.array(wanted)
    print(f"\nFig 4.14: error RMS {np.sqrt(np.mean(wrong**2)):.2f} lbf, mean {wrong.mean():.2f}, largest "
          f"{np.abs(wrong).max():.2f} of {np.mean(wanted):.0f} lbf")  # fmt: skip


def chapter_5() -> None:
    """Make Figs 5.9 to 5.17."""
    case = replace(CASES["seven_dof_800s"], duration=DURATION)
    records, experiment = records_of(case)
    fit = recipe("boggs").identify(records, experiment)
    ideal = _ideal("seven_dof", experiment.baseline_damping)
    figure, grid = figure_of(3, 4, (13.0, 8.0))
    for row, output in zip(grid, ("lf.velocity", "lf.tire_force", "front.ride_height"), strict=True):
        for axes, corner in zip(row, CORNERS, strict=True):
            draw_path(axes, fit, (output, f"{corner}.force"), ideal=ideal)
    save(figure, "seven_dof_responses")
    print("\n".join(fit.notes), f"\nidentified in {fit.seconds:.1f} s of processor time")
    lap, setups = case.lap(), [(0, 0, 0, 0), (6, 0, 0, 0), (0, 6, 0, 0), (0, 0, 6, 0), (0, 0, 0, 6)]
    _time_and_spectrum(case, fit, lap, setups, "seven_dof_simulation")


def _time_and_spectrum(case, fit, lap, setups, name) -> None:
    """Draw time traces (Figs 5.15, 6.26), spectra (5.16) and measures (5.17, 6.27, 6.28), and print the measures."""
    car, shocks = case.car, case.shocks()
    motions = simulate_setups(car, lap, [tuple(shocks[i] for i in s) for s in setups])
    true = [truth_of(car, m) for m in motions]
    names = fit.vehicle.state_space.output_names
    found = ManySetups(fit.vehicle, case.laws(), lap, 5).run(setups)
    shown = (("lf.tire_force", POUND, "lbf"), ("front.ride_height", INCH, "in"))
    figure, grid = figure_of(2, 3, (13.5, 6.5))
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
        draw_pairs(row[2], pairs, word)
    save(figure, name)
    _measure_table(true, found, names)


def _measure_table(true, found, names) -> None:
    print("\n| measure | truth: baseline, other shock lf, rf, lr, rr | identified |\n|---|---|---|")
    for channel, unit, word in (
        ("lr.velocity", INCH, "in/s"), ("total_tire_force", POUND, "lbf"), ("front.ride_height", INCH, "in"),
        ("lr.hub_acceleration", GRAVITY, "g"),
    ):  # fmt: skip
        a = [measures_of(*t, RATE)[channel] / unit for t in true]
        b = [measures_of(names, y, RATE / 5)[channel] / unit for y in found]
        print(f"| {channel} [{word}] | {numbers(a)} | {numbers(b)} |")


def _ideal(name, damping):
    return add_port_damping(read_vehicle(shipped(name)).coupled(), damping)


CHAPTERS = {
    "4": chapter_4,
    "4.5": make_identification_quarter_rig.main,
    "5": chapter_5,
    "6": make_identification_stand_in.main,
    "6.4.4": make_identification_static.main,
}


if __name__ == "__main__":
    main()
