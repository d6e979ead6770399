"""Plots and tables of linearity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath

import numpy as np

from eightpost.cells import write_rows
from eightpost.files import atomic_path
from eightpost.ident.linearity.linearity import Condition, Linearity, Path
from eightpost.report.pictures import Axes, color_cells, new_figure, save

# ---- CSV tables of linearity, with a line per path ------------------------------------------------------------------

_PATHS = (
    "input", "output", "test", "condition", "coherence [1]", "level [dB]",
    *(f"share {kind.name} [%]" for kind in Condition), "low [Hz]", "high [Hz]",
)  # fmt: skip
_EFFECTS = ("input", "output", "unit", "small", "large", "change [%]", "by chance [%]", "notable")


def write_paths(path: str | FilePath, found: Linearity, *, sources: Mapping[str, str] | None = None) -> None:
    """Write the verdicts on all paths, after comment lines with thresholds and sources.

    Args:
        path: Path of the .csv file.
        found: Linearity of the car.
        sources: SHA-256 digest of each file by name.
    """
    limits = found.thresholds
    comments = [f"# high: coherence from {limits.coherence:g}, level from {limits.level:g} dB"]
    comments += [f"# {name}: {digest}" for name, digest in (sources or {}).items()]
    rows = []
    for estimate, verdict in zip(found.paths, found.verdicts, strict=True):
        shares = [f"{100.0 * verdict.shares[kind]:.2f}" for kind in Condition]
        band = (f"{estimate.frequency[0]:.4g}", f"{estimate.frequency[-1]:.4g}")
        numbers = (verdict.condition.name, f"{verdict.coherence:.4f}", f"{verdict.level:.2f}")
        rows.append((verdict.input, verdict.output, estimate.test, *numbers, *shares, *band))
    _write(FilePath(path), comments, _PATHS, rows)


def write_effects(path: str | FilePath, found: Linearity) -> None:
    """Write the effects of the amplitude to a .csv file, with a line per input, output and amplitude."""
    units = {estimate.input.name: estimate.input.unit for estimate in found.paths}
    rows = [
        (
            *(each.input, each.output, units[each.input], f"{each.small:.5g}", f"{each.large:.5g}"),
            *(f"{100.0 * each.change:.3f}", f"{100.0 * each.chance:.3f}", "yes" if each.is_notable else "no"),
        )
        for each in found.effects
    ]
    comment = "# change: relative error of the output in the small test, predicted with the response of the large test"
    _write(FilePath(path), [comment], _EFFECTS, rows)


def _write(path: FilePath, comments: Sequence[str], head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        stream.writelines(f"{line}\n" for line in comments)
        write_rows(stream, (head, *rows))


# ---- Plots of linearity ---------------------------------------------------------------------------------------------

#: Colors of Conditions I to IV: predicted, predicted as low, not predicted, not significant.
_COLORS = {Condition.I: "#9bd4a5", Condition.II: "#d9eedd", Condition.III: "#f2a08e", Condition.IV: "#e6e6e6"}


def plot_output(found: Linearity, output: str, path: str | FilePath) -> None:
    """Write a PNG of one output as in Fig 6.9, with a column per type of input and a line per input.

    The coherence is a thin line if the response is low, because it is not significant there (Table 6.4).

    Args:
        found: Linearity of the car.
        output: Name of the output.
        path: Path of the PNG file; it is replaced completely or not at all.
    """
    columns = _columns(found, output)
    figure = new_figure(5.2 * len(columns), 8.6)
    panels = figure.subplots(3, len(columns), squeeze=False)
    for column, (title, chosen) in enumerate(columns):
        _traces(panels[0, column], chosen, title)
        _magnitudes(panels[1, column], chosen)
        _coherences(panels[2, column], found, chosen)
    figure.suptitle(f"{output} (coherence: bold where the response is high)")
    save(figure, path, format="png")


def plot_conditions(found: Linearity, path: str | FilePath) -> None:
    """Write a PNG with the condition of every path (Table 6.4), and its coherence and level."""
    inputs, outputs = found.inputs, found.outputs
    verdicts = {(each.output, each.input): each for each in found.verdicts}
    cells = np.array([[verdicts[output, name].condition.value for name in inputs] for output in outputs])
    figure = new_figure(2.4 + 1.05 * len(inputs), 1.9 + 0.55 * len(outputs))
    axes = figure.subplots()
    color_cells(axes, cells, list(_COLORS.values()))
    for i, output in enumerate(outputs):
        for j, name in enumerate(inputs):
            each = verdicts[output, name]
            text = f"{each.condition.name}\n{each.coherence:.2f}, {each.level:.0f} dB"
            axes.text(j, i, text, ha="center", va="center", fontsize=8)
    axes.set_xticks(range(len(inputs)), inputs, rotation=35, ha="right")
    axes.set_yticks(range(len(outputs)), outputs)
    lines = "\n".join(f"{kind.name}: {kind.meaning}" for kind in Condition)
    axes.set_title(f"{lines}\nmean coherence, level relative to the output's largest", fontsize=8, loc="left")
    save(figure, path, format="png")


def _columns(found: Linearity, output: str) -> list[tuple[str, list[Path]]]:
    """Return the paths of an output, grouped by the type of their input."""
    types = {"wheelloaders": "road", "aeroloaders": "aero", "shocks": "force"}
    chosen = [path for path in found.paths if path.output.name == output]
    columns = [(title, [p for p in chosen if _kind(p) == kind]) for title, kind in types.items()]
    rest = [p for p in chosen if _kind(p) not in types.values()]
    return [(title, group) for title, group in (*columns, ("loads", rest)) if group]


def _kind(path: Path) -> str:
    return path.input.name.rpartition(".")[2]


def _traces(axes: Axes, chosen: Sequence[Path], title: str) -> None:
    for path in chosen:
        axes.plot(np.arange(path.trace.size) / path.rate, path.trace, linewidth=1.0, label=path.input.name)
    axes.set(title=title, xlabel="time [s]", ylabel=f"response [{chosen[0].output.unit}]")
    axes.grid(alpha=0.3)


def _magnitudes(axes: Axes, chosen: Sequence[Path]) -> None:
    for path in chosen:
        axes.plot(path.frequency, 20.0 * np.log10(np.maximum(np.abs(path.H), 1e-300)), linewidth=1.2)
    unit = f"{chosen[0].output.unit} per {chosen[0].input.unit}"
    axes.set(xlabel="frequency [Hz]", ylabel=f"magnitude [dB re {unit}]")
    axes.grid(alpha=0.3)


def _coherences(axes: Axes, found: Linearity, chosen: Sequence[Path]) -> None:
    for i, path in enumerate(chosen):
        high = found.levels(path) >= found.thresholds.level
        color = f"C{i}"
        axes.plot(path.frequency, path.coherence, linewidth=0.6, color=color, alpha=0.45)
        shown = np.where(high, path.coherence, np.nan)
        axes.plot(path.frequency, shown, linewidth=1.8, color=color, label=path.input.name)
    axes.axhline(chosen[0].chance, color="0.5", linestyle=":", label="noise alone (5 %)")
    axes.set(xlabel="frequency [Hz]", ylabel="coherence", ylim=(0.0, 1.02))
    axes.legend(fontsize=7)
    axes.grid(alpha=0.3)
