"""Functions shared by the scripts that make the plots of docs/explanation/identification.md."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eightpost.ident.response import response_of
from eightpost.units import convert

PICTURES = Path(__file__).resolve().parents[1] / "pictures"
DAMPING, INCH, POUND = (convert(1.0, unit, si) for unit, si in (("lbf.s/in", "N.s/m"), ("in", "m"), ("lbf", "N")))
GRAVITY = convert(1.0, "g_0", "m/s2")


def path_of(model, output, source, frequency):
    """Return the response (K,) of one path of a state space."""
    return model.select(inputs=[source], outputs=[output]).frequency_response(frequency)[0, 0]


def draw_path(axes, fit, path, *, ideal=None, band=(0.3, 20.0)) -> None:
    """Draw estimate, ideal and model of a path (output, input) in dB."""
    estimate = fit.response.band(*band)
    output, source = path
    lines = [(estimate.between(output, source), {"color": "0.7", "lw": 2.4, "label": "estimate"})]
    if ideal is not None:
        lines.append((path_of(ideal, output, source, estimate.frequency), {"color": "k", "lw": 1.0, "label": "ideal"}))
    model = response_of(fit.vehicle.state_space, estimate.frequency).between(output, source)
    lines.append((model, {"color": "tab:red", "lw": 1.0, "ls": "--", "label": "model"}))
    for values, style in lines:
        axes.plot(estimate.frequency, 20.0 * np.log10(np.maximum(np.abs(values), 1e-300)), **style)
    top = 20.0 * np.log10(np.abs(model).max())
    axes.set(title=f"{output} / {source}", xlabel="frequency [Hz]", ylabel="dB", ylim=(top - 70.0, top + 8.0))
    axes.legend(fontsize="x-small")


def draw_pairs(axes, pairs, unit: str) -> None:
    """Draw identified over true measures of setups, pairs (S, 2), and the line of equality."""
    axes.plot(*np.array(pairs).T, "o")
    axes.axline(pairs[0][:1] * 2, slope=1.0, color="0.6")
    axes.set(xlabel=f"truth [{unit}]", ylabel=f"identified [{unit}]")


def figure_of(rows, columns, size):
    """Return a figure and its axes (rows, columns)."""
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.ravel():
        axes.grid(visible=True, color="0.92")
    return figure, grid


def save(figure, name) -> None:
    """Write docs/identification_<name>.png."""
    figure.savefig(PICTURES / f"identification_{name}.png", dpi=80)


def numbers(values) -> str:
    """Return numbers with three significant digits, separated by commas."""
    return ", ".join(f"{value:.3g}" for value in values)
