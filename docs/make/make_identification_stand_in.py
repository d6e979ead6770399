"""Make the plots and tables of chapter 6 of docs/explanation/identification.md: Figs 6.19 to 6.31, Tables 6.5 and 6.6.

The car is the 8-post stand-in. docs/make/make_identification_static.py makes the static loading of 6.4.4.
"""

from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt, welch

from benchmarks.identification_cases import CASES, records_of
from benchmarks.identification_measures import measures_of, truth_of
from docs.make.identification_pictures import (
    CORNERS,
    GRAVITY,
    INCH,
    POUND,
    draw_pairs,
    draw_path,
    figure_of,
    numbers,
    save,
)
from eightpost.ident.response.frequency_response import Preconditioning, feedback_paths
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.ident.vehicle.recipes.boggs import CHAPTER_6, Boggs
from eightpost.rig.post import Actuators, bump_drive, simulate_setups, sine_drive
from eightpost.rig.post.drivefiles import HEAVE_SINES, RATE

#: Duration of each rig test [s]; the benchmark uses the dissertation's 800 s.
DURATION = 200.0
#: Interval of the model's output samples, in samples of 1250 Hz.
EVERY = 5
#: Setups: the baseline shock at all corners, then another shock at lf, rf, lr, rr (6.1.5).
SETUPS = [(0, 0, 0, 0), (6, 0, 0, 0), (0, 6, 0, 0), (0, 0, 6, 0), (0, 0, 0, 6)]
#: Outputs of Figs 6.26 to 6.28, and of Figs 6.29 to 6.31.
TRENDS = (("lr.velocity", INCH, "in/s"), ("total_tire_force", POUND, "lbf"), ("front.ride_height", INCH, "in"),
          ("lr.hub_acceleration", GRAVITY, "g"))  # fmt: skip
SIGNALS = (("lf.velocity", INCH, "in/s"), ("lf.tire_force", POUND, "lbf"), ("front.ride_height", INCH, "in"),
           ("lf.hub_acceleration", GRAVITY, "g"))  # fmt: skip
#: Bank index of the shock of the sine and bump tests.
SINE_SHOCK = 3
#: Energy of a path, relative to the largest path of its output, below which it may be zeroed [1]: -20 dB.
LOW = 0.01


def main() -> None:
    """Make plots and tables."""
    case = replace(CASES["eight_post_known"], duration=DURATION)
    records, experiment = records_of(case)
    fit = Boggs().identify(records, experiment)
    print("\n".join(fit.notes), f"\nidentified in {fit.seconds:.1f} s of processor time")
    _draw_responses(fit)
    zeroed = zeroed_paths(fit)
    print(zeroed_tables(fit, zeroed))
    conditioned = replace(CHAPTER_6, preconditioning=Preconditioning(zeroed=tuple(zeroed)))
    without = Boggs(conditioned).identify(records, experiment)
    _lap(case, fit, without)
    _sines(case, fit)
    _bump(case, fit)


def _draw_responses(fit) -> None:
    """Draw Figs 6.19 to 6.24."""
    figure, grid = figure_of(4, 4, (13.5, 10.5))
    outputs = ("rf.velocity", "rf.tire_force", "front.ride_height", "rf.hub_acceleration")
    for row, output in zip(grid, outputs, strict=True):
        coherence = fit.response.coherence[fit.response.output_names.index(output)]
        row[0].plot(fit.response.frequency, coherence)
        row[0].set(xlim=(0, 20), ylim=(0, 1.05), ylabel=f"{output}\ncoherence", xlabel="frequency [Hz]")
        for place, source in zip(row[1:], ("rf.road", "rf.aero", "rf.force"), strict=True):
            draw_path(place, fit, (output, source))
    save(figure, "eight_post_responses")


def zeroed_paths(fit):
    """Return the paths (output, input) of low response, which Table 6.5 would list (6.3.2, 6.2).

    The responses from 0.5 to 15 Hz are compared among inputs of the same kind, whose drives are similar.
    """
    response = fit.response.band(0.5, 15.0)
    energy = np.mean(np.abs(response.H) ** 2, axis=2)
    kinds = np.array([name.partition(".")[2] for name in response.input_names])
    low = []
    for i, output in enumerate(response.output_names):
        for j, source in enumerate(response.input_names):
            if energy[i, j] < LOW * energy[i, kinds == kinds[j]].max():
                low.append((output, source))
    return low


def zeroed_tables(fit, zeroed) -> str:
    """Return Tables 6.5 and 6.6 as Markdown."""
    names, sources = fit.response.output_names, fit.response.input_names
    active = np.array([[(output, source) not in zeroed for source in sources] for output in names])
    shocks = [sources.index(f"{corner}.force") for corner in CORNERS]
    velocities = [names.index(f"{corner}.velocity") for corner in CORNERS]
    count = feedback_paths(active[:, shocks], velocities)
    lines = [
        f"{len(zeroed)} of {active.size} paths are low",
        "| output | zeroed inputs | feedback paths |",
        "|---|---|---|",
    ]
    for k, output in enumerate(names):
        without = ", ".join(s for j, s in enumerate(sources) if not active[k, j]) or "none"
        lines.append(f"| {output} | {without} | {' '.join(str(n) for n in count[k])} |")
    return "\n".join(lines)


def _lap(case, fit, without) -> None:
    """Make Figs 6.26 to 6.28: traces, spectra, trends and correlation of RMS levels."""
    lap, car, shocks = case.lap(), case.car, case.shocks()
    true = [truth_of(car, m) for m in simulate_setups(car, lap, [tuple(shocks[i] for i in s) for s in SETUPS])]
    names = fit.vehicle.state_space.output_names
    found = ManySetups(fit.vehicle, case.laws(), lap, EVERY).run(SETUPS)
    zeroed = ManySetups(without.vehicle, case.laws(), lap, EVERY).run(SETUPS)
    _draw_traces(true[0], names, found[0])
    expected = [measures_of(*t, RATE) for t in true]
    identified, conditioned = ([measures_of(names, y, RATE / EVERY) for y in run] for run in (found, zeroed))
    print("\n| RMS over a lap | truth | identified | with the low paths zeroed |\n|---|---|---|---|")
    figure, grid = figure_of(2, 4, (14.0, 6.2))
    for column, (channel, unit, word) in zip(grid.T, TRENDS, strict=True):
        rows = [[m[channel] / unit for m in measures] for measures in (expected, identified, conditioned)]
        print(f"| {channel} [{word}] | {' | '.join(numbers(row) for row in rows)} |")
        column[0].plot(("all", *CORNERS), rows[0], "o-", color="0.5", label="truth")
        column[0].plot(("all", *CORNERS), rows[1], "s--", color="tab:red", label="identified")
        column[0].set(title=channel, ylabel=f"RMS [{word}]", xlabel="corner of the other shock")
        draw_pairs(column[1], list(zip(rows[0], rows[1], strict=True)), word)
    grid[0, 0].legend()
    save(figure, "eight_post_trends")


def _draw_traces(true, names, found) -> None:
    shown = (("lf.tire_force", POUND, "lbf"), ("front.ride_height", INCH, "in"))
    figure, grid = figure_of(2, 2, (11.0, 6.0))
    band = butter(4, (1.0, 20.0), "bandpass", fs=RATE / EVERY, output="sos")
    for row, (channel, unit, word) in zip(grid, shown, strict=True):
        both = true[1][true[0].index(channel), ::EVERY] / unit, found[names.index(channel)] / unit
        t, y = (sosfiltfilt(band, x - x.mean()) for x in both)
        time = np.arange(t.size) / (RATE / EVERY)
        part = (time > 10.0) & (time < 13.0)
        row[0].plot(time[part], t[part], color="0.5", lw=2)
        row[0].plot(time[part], y[part], color="tab:red", lw=1)
        row[0].set(ylabel=f"{channel} [{word}]", xlabel="time [s]")
        for values, label in ((t, "truth"), (y, "identified"), (y - t, "error")):
            row[1].semilogy(*welch(values[750:], RATE / EVERY, nperseg=1024), label=label)
        row[1].set(xlim=(0, 25), xlabel="frequency [Hz]", ylabel=f"{word}2/Hz")
        row[1].legend()
    save(figure, "eight_post_simulation")


def _sines(case, fit) -> None:
    """Make Figs 6.29 and 6.30: heave sines of Table 6.2 with the third harmonics."""
    rows = [(f, a, *_one(case, fit, sine_drive(case.car, f, a * INCH))) for f, a in HEAVE_SINES]
    _draw_sine_times([row for row in rows if row[0] in (1.0, 4.0, 8.0, 15.0)])
    print("\n| heave sine | " + " | ".join(f"{n} [{w}]" for n, _, w in SIGNALS) + " | third harmonic, tire, hub [%] |")
    print("|---|---|---|---|---|---|")
    figure, grid = figure_of(1, 4, (14.0, 3.4))
    for axes, (name, unit, word) in zip(grid[0], SIGNALS, strict=True):
        for place, style in (
            (2, {"color": "0.5", "marker": "o"}),
            (3, {"color": "tab:red", "marker": "s", "ls": "--"}),
        ):
            axes.plot([r[0] for r in rows], [r[place][name][-1250:].std() / unit for r in rows], **style)
        axes.set(title=name, xlabel="frequency [Hz]", ylabel=f"RMS [{word}]")
    save(figure, "eight_post_sines")
    for frequency, amplitude, t, y in rows:
        cells = [f"{t[n][-1250:].std() / u:.3g}, {y[n][-1250:].std() / u:.3g}" for n, u, _ in SIGNALS]
        thirds = [f"{100.0 * _third(t[n][-1250:], frequency):.0f}" for n in ("lf.tire_force", "lf.hub_acceleration")]
        print(f"| {frequency:g} Hz, {amplitude:g} in | {' | '.join(cells)} | {', '.join(thirds)} |")


def _third(values, frequency) -> float:
    """Return the ratio of the third harmonic to the first of 5 s at 250 Hz."""
    time = np.arange(values.size) * EVERY / RATE
    first, third = (abs(values @ np.exp(-2j * np.pi * k * frequency * time)) for k in (1, 3))
    return third / first


def _draw_sine_times(rows) -> None:
    figure, grid = figure_of(4, len(rows), (13.5, 9.0))
    for column, (frequency, amplitude, t, y) in zip(grid.T, rows, strict=True):
        size = round(2.0 / frequency * RATE / EVERY)
        time = np.arange(size) * EVERY / RATE
        for axes, (name, unit, word) in zip(column, SIGNALS, strict=True):
            for values, style in ((t, {"color": "0.5", "lw": 2}), (y, {"color": "tab:red", "lw": 1})):
                axes.plot(time, values[name][-1250:][:size] / unit, **style)
            axes.set(ylabel=f"{name} [{word}]")
        column[0].set(title=f"{frequency:g} Hz, {amplitude:g} in")
    save(figure, "eight_post_sine_times")


def _bump(case, fit) -> None:
    """Make Fig 6.31: an upward bump; the measured signals are low-passed at 60 Hz as in the dissertation."""
    t, y = _one(case, fit, bump_drive(case.car), cutoff=60.0)
    figure, grid = figure_of(1, 4, (14.0, 3.4))
    for axes, (name, unit, word) in zip(grid[0], SIGNALS, strict=True):
        time = np.arange(t[name].size) * EVERY / RATE
        part = (time > 24.8) & (time < 26.0)
        axes.plot(time[part], t[name][part] / unit, color="0.5", lw=2)
        axes.plot(time[part], y[name][part] / unit, color="tab:red", lw=1)
        axes.set(title=name, xlabel="time [s]", ylabel=word)
    save(figure, "eight_post_bump")
    ranges = [f"{n} {np.ptp(t[n][5000:7500]) / u:.3g}, {np.ptp(y[n][5000:7500]) / u:.3g} {w}" for n, u, w in SIGNALS]
    print("\nbump, peak-to-peak values of truth and identified:", "; ".join(ranges))


def _one(case, fit, drivefile, cutoff=100.0):
    """Return the outputs by name of the truth and the identified car on a drive, at 250 Hz and without means."""
    lap, shocks = Actuators().follow(drivefile.series, case.car), case.shocks()
    names, rows = truth_of(case.car, next(iter(simulate_setups(case.car, lap, [(shocks[SINE_SHOCK],) * 4]))))
    low = butter(4, cutoff, fs=RATE, output="sos")
    true = dict(zip(names, sosfiltfilt(low, rows)[:, ::EVERY], strict=True))
    found = ManySetups(fit.vehicle, case.laws(), lap, EVERY).run([(SINE_SHOCK,) * 4])[0]
    model = dict(zip(fit.vehicle.state_space.output_names, found, strict=True))
    return tuple({n: values[n] - values[n].mean() for n, _, _ in SIGNALS} for values in (true, model))


if __name__ == "__main__":
    main()
