"""Plots of responses with coherence and confidence interval, and of error spectra."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.report.figure import COLORS, MEASURED, Axis, Figure, Panel, grid

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from eightpost.ident.vehicle_validation.responses import Path
    from eightpost.ident.vehicle_validation.study import Case

    Array = NDArray[np.float64]

#: Number of outputs per figure; points per line; lowest density that is plotted, below the largest [dB].
_OUTPUTS, _POINTS, _DEEP = 4, 400, 80.0


def response_figures(paths: Sequence[Path]) -> Iterator[Figure]:
    """Yield plots of the responses of every judged output to its strongest road and shock force, with coherence."""
    rows = [tuple(found) for _, found in groupby(paths, key=lambda path: path.output)]
    for start in range(0, len(rows), _OUTPUTS):
        yield _responses(rows[start : start + _OUTPUTS])


def _responses(rows: Sequence[Sequence[Path]]) -> Figure:
    places = grid(3 * len(rows), 3, gap=(0.07, 0.27 / len(rows)))
    panels: list[Panel] = []
    for k, paths in enumerate(rows):
        x = Axis("frequency [Hz]" if k == len(rows) - 1 else "", kind="log")
        for i in range(2):
            path = paths[min(i, len(paths) - 1)]
            title = f"{path.output} from {path.input}"
            panels.append(Panel(x, Axis(f"dB re 1 {path.unit}"), *places[3 * k + i], title=title))
        title = f"{paths[0].output}: multiple coherence"
        panels.append(Panel(x, Axis("", span=(0.0, 1.05)), *places[3 * k + 2], title=title))
    figure = Figure(
        "Responses of the model and of the estimate that it was fitted to, with the estimate's 95 % band. Coherence "
        "near 1 does not exclude friction.",
        110 + 170 * len(rows),
        panels,
    )
    for k, paths in enumerate(rows):
        for i, path in enumerate(paths[:2]):
            _response(figure, 3 * k + i, path)
        if paths[0].coherence is not None:
            kept = _kept(paths[0].frequency)
            figure.line(
                3 * k + 2, paths[0].frequency[kept], paths[0].coherence[kept], name="coherence", color=COLORS[2]
            )
    return figure


def _coherence(figure: Figure, panel: int, frequency: Array, coherence: Array) -> None:
    kept = _kept(frequency)
    figure.line(panel, frequency[kept], coherence[kept], name="coherence", color=COLORS[2])


def _response(figure: Figure, panel: int, path: Path) -> None:
    kept = _kept(path.frequency)
    frequency = path.frequency[kept]
    figure.line(panel, frequency, _db(path.estimate)[kept], name="estimate", color=MEASURED)
    if path.band is not None:
        floor = 0.05 * np.abs(path.estimate)  # zero would be minus infinity in dB
        for end in path.band:
            values = _db(np.maximum(end, floor))[kept]
            figure.line(panel, frequency, values, name="95 % band", color=COLORS[4], dash="dot")
    figure.line(panel, frequency, _db(path.model)[kept], name="model", color=COLORS[0])


def spectrum_figure(case: Case) -> Figure:
    """Return a plot of the spectra of a record's outputs and errors, and of the coherence of error and prediction."""
    names = sorted(case.spectra, key=lambda name: -next(o.error for o in case.judged if o.name == name))[:3]
    places = grid(2 * len(names), len(names), gap=(0.07, 0.2))
    x = Axis("frequency [Hz]", kind="log")
    panels = [Panel(x, Axis("dB re largest"), *places[k], title=name) for k, name in enumerate(names)]
    panels += [Panel(x, Axis("coherence", span=(0.0, 1.05)), *place) for place in places[len(names) :]]
    caption = (
        f"{case.record.name}: the three outputs with the largest errors. Above: spectra of output and error; below: "
        "coherence of error and prediction, near 1 if another gain or phase would have predicted the error."
    )
    figure = Figure(caption, 480, panels)
    for k, name in enumerate(names):
        spectrum = case.spectra[name]
        largest = spectrum.measured.max()
        for values, title, color in ((spectrum.measured, "measured", MEASURED), (spectrum.error, "error", COLORS[1])):
            decibels = 10.0 * np.log10(np.maximum(values / largest, 10.0 ** (-_DEEP / 10.0)))
            figure.line(k, spectrum.frequency, decibels, name=title, color=color)
        figure.line(len(names) + k, spectrum.frequency, spectrum.coherence, name="coherence", color=COLORS[2])
    return figure


def _kept(frequency: Array) -> NDArray[np.intp]:
    """Return the indices of the points that are plotted, spaced logarithmically; long estimates have thousands."""
    if frequency.size <= _POINTS:
        return np.arange(frequency.size)
    wanted = np.geomspace(frequency[0] or frequency[1], frequency[-1], _POINTS)
    return np.unique(np.clip(np.searchsorted(frequency, wanted), 0, frequency.size - 1))


def _db(values: NDArray[np.complex128] | Array) -> Array:
    return np.asarray(20.0 * np.log10(np.maximum(np.abs(values), 1e-300)))
