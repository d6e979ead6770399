"""CSV tables of linearity, with a line per path."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from eightpost.cells import write_rows
from eightpost.files import atomic_path
from eightpost.ident.linearity.conditions import Condition

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eightpost.ident.linearity.linearity import Linearity

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
