"""Comparison of the coupling errors and marks that a study states with true errors, for setups drawn at random.

    python -m benchmarks.study_errors [--setups 20] [--seed 0] [--stop 30]

Three studies are drawn from: examples/study.toml (seven builds at any corner), the same bank with two different builds
at each corner, and a bank of scaled shocks with lags from 0.1 to 3 ms. The true error is that of a run at an eighth of
the study's step. Prints Markdown: for the worst channel of each setup the stated over the true error; the number of
setups marked for their coupling error and the number whose true error is above the study's accuracy; the same two
numbers, and that of both, if the accuracy were the median of the true errors; and quantiles (0, 10, 50, 90, 100 %) of
the stated over the true error of the measures (root mean squares over the setups) and of single measures.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.study import shipped_study
from cosim.results.error_estimate import difference
from cosim.study import Build, Setup, Study
from cosim.study.running.choose_coupling import choose_coupling
from cosim.study.running.evaluator import Coupling, Evaluator
from cosim.study.table import error_column

#: The step of the reference run is the study's step divided by this.
_FINER = 8
_PARTS = (0.0, 0.1, 0.5, 0.9, 1.0)


@dataclass(frozen=True)
class Checked:
    """One setup, as stated and as computed at a finer step."""

    stated: float  #: Stated error of the worst channel [%].
    true: float  #: True error of the worst channel [%].
    marked: bool  #: Whether the setup is marked for its coupling error.
    measures: Mapping[str, tuple[float, float]]  #: Stated and true error of each measure, in its SI unit.


def main() -> None:
    """Check the studies and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--setups", type=int, default=20, help="number of setups of each study (default 20)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the setups (default 0)")
    parser.add_argument("--stop", type=float, default=30.0, help="length of the drive [s] (default 30)")
    options = parser.parse_args()
    print("| study | step [ms] | worst channel | marked, above | at the median | measures | single | within 2 [%] |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, study in _studies(Path(folder), options.stop).items():
            evaluator = Evaluator(study)
            coupling = choose_coupling(evaluator)
            count = min(options.setups, len(study.space))
            drawn = np.random.default_rng(options.seed).choice(study.space.indices, count, replace=False)
            checked = [_checked(evaluator, coupling, study.space.setup(int(index))) for index in drawn]
            print(_row(name, coupling, study.accuracy, checked), flush=True)


def _studies(folder: Path, stop: float) -> dict[str, Study]:
    study = shipped_study(folder, builds=7)
    study = replace(study, drives=(replace(study.drives[0], stop=stop),))
    names = list(study.bank)
    pairs = {"lf": names[:2], "rf": names[5:7], "lr": names[2:4], "rr": names[4:6]}
    bank = {
        "soft": _scaled(study.bank[names[0]], 0.4),
        "mid": _scaled(study.bank[names[3]], 1.0, time_constant=3e-3),
        "stiff": _scaled(study.bank[names[6]], 2.0),
        "hard": _scaled(study.bank[names[6]], 3.0, time_constant=1e-4),
    }
    mixed = {corner: tuple(builds) for corner, builds in pairs.items()}
    return {
        "examples/study.toml": study,
        "other builds at each corner": replace(study, corners=mixed, baseline={}),
        "scaled bank": replace(study, bank=bank, corners=dict.fromkeys(study.corners, tuple(bank)), baseline={}),
    }


def _scaled(build: Build, scale: float, **own: float) -> Build:
    changed = {"compression_scale": scale, "rebound_scale": scale, **own}
    return replace(build, parameters={**build.parameters, **changed})


def _checked(evaluator: Evaluator, coupling: Coupling, setup: Setup) -> Checked:
    drive = evaluator.study.drives[0]
    decisive = sorted(evaluator.decisive(setup))
    row = evaluator.row(setup, coupling)
    run = evaluator.run(setup, drive, coupling, extra=decisive)
    finer = evaluator.run(setup, drive, replace(coupling, step=coupling.step / _FINER), extra=decisive)
    errors = difference(run.settled(), finer.settled())
    at_step, at_finer = evaluator.measured(run, drive), evaluator.measured(finer, drive)
    measures = {name: (row[error_column(name)], abs(at_step[name] - at_finer[name])) for name in at_step}
    worst = max(errors[name] for name in decisive)
    return Checked(row["coupling_error_percent"], worst, "coupling error" in row["marks"], measures)


def _row(name: str, coupling: Coupling, accuracy: float, checked: list[Checked]) -> str:
    ratios = np.array([one.stated / one.true for one in checked])
    errors = np.array([list(one.measures.values()) for one in checked])  # (setups, measures, 2)
    stated, true = np.sqrt(np.mean(errors**2, axis=0)).T
    single = (errors[..., 0] / errors[..., 1])[errors[..., 1] > 0.0]
    cells = (
        name,
        f"{coupling.step * 1e3:.3g}",
        f"{ratios.min():.2f} to {ratios.max():.2f}, median {np.median(ratios):.2f}",
        f"{sum(one.marked for one in checked)}, {sum(one.true > accuracy for one in checked)} of {len(checked)}",
        _marks_at(float(np.median([one.true for one in checked])), checked),
        _quantiles(stated[true > 0.0] / true[true > 0.0]),
        _quantiles(single),
        f"{100.0 * np.mean((single > 0.5) & (single < 2.0)):.0f}",
    )
    return f"| {' | '.join(cells)} |"


def _marks_at(accuracy: float, checked: list[Checked]) -> str:
    marked, above = (np.array([getattr(one, name) for one in checked]) > accuracy for name in ("stated", "true"))
    return f"{marked.sum()}, {above.sum()}, both {(marked & above).sum()}"


def _quantiles(values: np.ndarray) -> str:
    return " ".join(f"{value:.2f}" for value in np.quantile(values, _PARTS))


if __name__ == "__main__":
    main()
