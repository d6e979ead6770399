"""Chapter 6.3: estimates and fits of the 8-post stand-in."""

from __future__ import annotations

import numpy as np

from dissertation.chapter_6_setup import inputs_of_table, zeroed_table
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import COHERENCE, LINEAR_FREQUENCY, Line, Plot, decibel_axis, decibels, figure_of
from dissertation.rig_bench import EIGHT_POST, identified
from eightpost.array_types import Array
from eightpost.ident.vehicle.boggs import CHAPTER_6
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, ZeroPhaseSmoothing, response_of
from eightpost.report.charts import Axis, Figure
from eightpost.units import si_factor

_BAND = (0.3, 20.0)
_US = {"velocity": "in/s", "tire_force": "lbf", "ride_height": "in", "hub_acceleration": "g_0", "road": "in",
       "aero": "lbf", "force": "lbf"}  # fmt: skip

#: Response below this level under the peak of its path is small [dB].
_LARGE = 20.0


def _estimate(effort: Effort) -> FrequencyResponse:
    return identified(EIGHT_POST, effort.rig_seconds).response.band(*_BAND)


def _quantity(name: str) -> str:
    return name.rpartition(".")[2]


def _levels(response: FrequencyResponse, output: str, source: str) -> Array:
    """Return a path (K,) in decibels, in US customary units."""
    scale = si_factor(_US[_quantity(output)]) / si_factor(_US[_quantity(source)])
    return decibels(response.between(output, source), scale)


def figure_6_19(effort: Effort) -> Findings:
    """Total coherence."""
    estimate = _estimate(effort)
    coherence, f = estimate.coherence, estimate.frequency
    assert coherence is not None
    outputs = ("rf.velocity", "lr.velocity", "rf.tire_force", "lr.tire_force", "front.ride_height", "rear.ride_height")
    rows = {name: coherence[estimate.output_names.index(name)] for name in outputs}
    means = {name: float(row.mean()) for name, row in rows.items()}
    tire = rows["rf.tire_force"]
    inside = (f >= 4.0) & (f <= 6.0)
    dip, rest = float(tire[inside].mean()), float(tire[~inside].mean())
    plots = [Plot(name, LINEAR_FREQUENCY, COHERENCE, [Line("coherence", f, row)]) for name, row in rows.items()]
    return Findings(
        claims={
            "high": (min(means.values()) > 0.9, ", ".join(f"{name} {mean:.3f}" for name, mean in means.items())),
            "dip": (dip < rest, f"right front tire force: {dip:.3f} from 4 to 6 Hz, {rest:.3f} elsewhere"),
        },
        blocks=[figure_of("Total coherence.", plots)],
    )


def _modified(effort: Effort, outputs: tuple[str, ...]) -> Findings:
    """Compare estimates with smoothed estimates over the wheelloader and the shock of the same corner."""
    estimate = _estimate(effort)
    f, plots, rough = estimate.frequency, [], []
    for output in outputs:
        corner = output.partition(".")[0] if output[2] == "." else "rf"
        for source in (f"{corner}.road", f"{corner}.force"):
            level = _levels(estimate, output, source)
            smooth = ZeroPhaseSmoothing().apply(f, estimate.between(output, source))
            scale = si_factor(_US[_quantity(output)]) / si_factor(_US[_quantity(source)])
            changed = decibels(smooth, scale)
            rough.append([float(np.std(np.diff(row, 2))) for row in (level, changed)])
            unit = f"{_US[_quantity(output)]}/{_US[_quantity(source)]}"
            lines = [Line("estimate", f, level), Line("modified", f, changed)]
            plots.append(Plot(f"{output} over {source}", LINEAR_FREQUENCY, decibel_axis(unit), lines))
    smoother = all(after <= before for before, after in rough)
    text = ", ".join(f"{before:.2g} to {after:.2g} dB" for before, after in rough)
    return Findings(
        claims={"smooth": (smoother, f"standard deviation of second differences: {text}")},
        blocks=[figure_of("Estimate, and estimate smoothed over 0.6 Hz.", plots, columns=4)],
    )


def figure_6_20(effort: Effort) -> Findings:
    """Shock velocities."""
    return _modified(effort, ("rf.velocity", "lr.velocity"))


def figure_6_21(effort: Effort) -> Findings:
    """Tire forces."""
    return _modified(effort, ("rf.tire_force", "lr.tire_force"))


def figure_6_22(effort: Effort) -> Findings:
    """Ride heights."""
    return _modified(effort, ("front.ride_height", "rear.ride_height"))


def figure_6_23(effort: Effort) -> Findings:
    """Hub accelerations."""
    return _modified(effort, ("rf.hub_acceleration", "lr.hub_acceleration"))


def figure_6_24(effort: Effort) -> Findings:
    """Fits of the shock velocities."""
    estimate = _estimate(effort)
    model = response_of(identified(EIGHT_POST, effort.rig_seconds).vehicle.state_space, estimate.frequency)
    plots, errors = [], []
    inside = estimate.frequency < 15.0  # the weights of Eq 6.9 are small above
    for output, corner in (("rf.velocity", "rf"), ("lr.velocity", "lr")):
        for kind in ("road", "force"):
            source = f"{corner}.{kind}"
            rows = {"estimate": _levels(estimate, output, source), "fit": _levels(model, output, source)}
            large = inside & (rows["estimate"] > rows["estimate"].max() - _LARGE)
            errors.append(float(np.sqrt(np.mean((rows["fit"] - rows["estimate"])[large] ** 2))))
            lines = [Line(name, estimate.frequency, row) for name, row in rows.items()]
            axis = decibel_axis(f"in/s/{_US[kind]}")
            plots.append(Plot(f"{output} over {source}", LINEAR_FREQUENCY, axis, lines))
    text = ", ".join(f"{error:.2g}" for error in errors)
    return Findings(
        {"lowest": min(CHAPTER_6.orders), "highest": max(CHAPTER_6.orders)},
        claims={"fit": (max(errors) < 3.0, f"RMS difference up to 15 Hz: {text} dB")},
        blocks=[figure_of("Estimate and fit.", plots, columns=4)],
        note=" ".join(identified(EIGHT_POST, effort.rig_seconds).notes),
    )


def table_6_5(effort: Effort) -> Findings:
    """Levels of the stand-in's paths that are zeroed in print."""
    names, mask = zeroed_table()
    estimate, sources = _estimate(effort).band(0.5, 15.0), inputs_of_table()
    zeroed: list[float] = []
    kept: list[float] = []
    for i, output in enumerate(names):
        energy = {source: float(np.mean(np.abs(estimate.between(output, source)) ** 2)) for source in sources}
        for j, source in enumerate(sources):
            same = [value for other, value in energy.items() if _quantity(other) == _quantity(source)]
            level = 10.0 * np.log10(max(energy[source], 1e-300) / max(same))
            (kept if mask[i, j] else zeroed).append(level)
    medians = [float(np.median(row)) for row in (zeroed, kept)]
    return Findings(
        claims={
            "low": (
                medians[0] < medians[1],
                f"zeroed {medians[0]:.0f} dB, others {medians[1]:.0f} dB below the largest of their kind",
            )
        },
        blocks=[_bars(zeroed, kept)],
        note="Levels are mean squares from 0.5 to 15 Hz relative to the output's largest path from the same kind of "
        f"input. The table zeroes {len(zeroed)} paths.",
    )


def _bars(zeroed: list[float], kept: list[float]) -> Figure:
    """Return the levels in order."""
    lines = [
        Line(name, np.linspace(0.0, 100.0, len(row)), np.sort(np.array(row)))
        for name, row in (("zeroed in print", zeroed), ("kept in print", kept))
    ]
    return figure_of(
        "Levels of the stand-in's paths, sorted.",
        [Plot("", Axis("share of the paths [%]"), Axis("level [dB]"), lines)],
        columns=1,
    )


COMPUTATIONS = {
    "figure-6.19": figure_6_19,
    "figure-6.20": figure_6_20,
    "figure-6.21": figure_6_21,
    "figure-6.22": figure_6_22,
    "figure-6.23": figure_6_23,
    "figure-6.24": figure_6_24,
    "table-6.5": table_6_5,
}
