"""Create the picture of docs/how_to/validation.md from the synthetic damper A.

Run it by `python docs/make/make_validation_pictures.py`.
"""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eightpost.ident import fit_shock
from eightpost.ident.validation.records import dyno_record
from eightpost.ident.validation.shocks import validate_shocks
from eightpost.rig import DynoTest
from eightpost.signals import Drivefile, TimeSeries
from eightpost.units import convert
from eightpost.virtual import demo_damper, measure, random_multisine

ROOT = Path(__file__).resolve().parents[2]
LAWS = ("polylinear", "lpnl2", "hysteresis")

#: Table 3.3: amplitude [in] and peak velocity [in/s].
SINES = (
    (1.0, 1.0), (1.0, 3.0), (1.0, 6.0), (1.0, 10.0), (1.0, 20.0), (1.0, 30.0), (0.5, 5.0), (0.5, 10.0), (0.5, 20.0),
    (0.25, 10.0), (0.25, 20.0), (0.1, 2.5), (0.1, 5.0), (0.1, 10.0),
)  # fmt: skip


def main() -> None:
    """Fit three laws to one random record, validate them on another record and on sines, and draw the residuals."""
    fitted = _measured(random_multisine(1, duration=10.5))
    shocks = [fit_shock(fitted, law, name="A").shock for law in LAWS]
    records = [dyno_record(_measured(random_multisine(2, duration=10.5)), name="random")]
    records += [dyno_record(_measured(_sine(*sine))) for sine in SINES]
    study = validate_shocks(shocks, records)
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    for law, color in zip(LAWS, ("tab:blue", "tab:orange", "tab:green"), strict=True):
        cases = [case for case in study.cases if case.shock.law_name == law]
        residual = cases[0].outcome.residual
        left.plot(residual.frequency, residual.coherence, color=color, label=law)
        frequency = [case.outcome.frequency for case in cases[1:]]
        errors = [convert(case.outcome.rms, "N", "lbf") for case in cases[1:]]
        right.loglog(frequency, errors, "o", color=color, label=law)
    left.axhline(residual.threshold, color="0.5", linestyle=":", label="chance (5 %)")
    left.set(xlabel="frequency [Hz]", ylabel="coherence of error and velocity", title="random record", ylim=(0, 1))
    right.set(xlabel="frequency [Hz]", ylabel="RMS error [lbf]", title="sines of Table 3.3")
    for axes in (left, right):
        axes.legend()
        axes.grid(visible=True, color="0.92")
    figure.savefig(ROOT / "docs" / "pictures" / "validation.png", dpi=100)


def _measured(drive: Drivefile) -> DynoTest:
    return DynoTest(measure(demo_damper("A"), drive))


def _sine(amplitude: float, velocity: float) -> Drivefile:
    frequency = velocity / (2.0 * np.pi * amplitude)
    time = np.arange(round(2000.0 * max(4.0 / frequency, 1.5)) + 1) / 2000.0
    displacement = convert(amplitude, "in", "m") * np.sin(2.0 * np.pi * frequency * time)
    return Drivefile(TimeSeries.from_channels(time, {"displacement": ("m", displacement)}))


if __name__ == "__main__":
    main()
