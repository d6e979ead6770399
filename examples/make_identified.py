"""Create the shipped identified car: the 8-post stand-in with friction, tested on the virtual rig and identified.

All data are computed; they contain no measurements and no data of third parties. Run it from the project's root:

    python examples/make_identified.py [--duration SECONDS] [--folder FOLDER]

It writes to examples/identified/: the vehicle file (car.json), which states its own uncertainty, and the measured roads
and loads of a lap (lap.parquet). examples/identified/study.toml is the study of this car.
"""

import argparse
from pathlib import Path

from eightpost.corners import CORNERS
from eightpost.files import sha256_of
from eightpost.ident.preparation import Preparation, prepare
from eightpost.ident.vehicle.experiment import find_baseline
from eightpost.ident.vehicle.plan import recipe
from eightpost.ident.vehicle.vehicle_fit import with_validity, write_fit
from eightpost.signals import TimeSeries, write_parquet
from eightpost.signals.filters import lowpass
from eightpost.virtual import program
from eightpost.virtual.program import Bench

FOLDER = Path(__file__).parent / "identified"

#: Duration of each of the five tests of 6.1.5 [s], which are 800 s long there.
DURATION = 400.0

#: Shocks of the tests: everywhere, and at one corner after the other.
BASELINE, ALTERNATE = "build:B/B", "build:AA/AA"

#: Seeds of the identification's drive file and its runs, of the lap, and of the recorded run of the lap.
DRIVE, RUNS, LAP, LAP_RUN = 31, 3100, 78, 3200

#: Rate of the shipped lap and edge of the low-pass before it [Hz]; the car is identified up to 25 Hz.
RATE, EDGE = 250.0, 80.0


def identify(folder: Path, duration: float) -> None:
    """Test the car with physical dampers, with sensor noise and drift, identify it, and write its files."""
    bench = Bench.of("eight_post", run=RUNS, seed=DRIVE)
    shocks = bench.shocks([BASELINE])
    planned = program("identification", bench.car, DRIVE, duration=duration)
    tests = (bench.record_planned(test, number, shocks, ALTERNATE) for number, test in enumerate(planned))
    prepared = prepare(tests, Preparation())
    reference = find_baseline(prepared.records, prepared.corners)
    experiment = reference.experiment(prepared, name="identified stand-in (synthetic data)")
    fit = recipe("common-poles").identify([prepared.records[k] for k in reference.order], experiment)
    fit = with_validity(fit, prepared.reasons)
    vehicle, *others = write_fit(folder / "car.json", fit)
    for path in others:  # response and summary, which the study does not need
        path.unlink()
    print(f"car: {fit.seconds:.0f} s of processor time, {vehicle.stat().st_size / 1000:.0f} kB")


def record_lap(folder: Path) -> None:
    """Record a lap with the baseline and write its measured roads and loads."""
    bench = Bench.of("eight_post", run=LAP_RUN, seed=LAP)
    series = bench.record(bench.drivefile("track", LAP), bench.shocks([BASELINE]), "track").series
    names = [f"{corner}.{what}" for what in ("road", "aero") for corner in CORNERS]
    smooth = {name: (series.unit(name), lowpass(series[name], series.sample_rate, EDGE)) for name in names}
    lap = TimeSeries.from_channels(series.time, smooth).resample(RATE)
    path = folder / "lap.parquet"
    note = f"SYNTHETIC lap of the 8-post stand-in, seeds {LAP} and {LAP_RUN}, examples/make_identified.py"
    write_parquet(lap, path, note=note, storage="float32")
    print(f"lap: {path.stat().st_size / 1000:.0f} kB, {sha256_of(path)[:8]}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--duration", type=float, default=DURATION, help="duration of each rig test [s]")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="output folder")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    identify(options.folder, options.duration)
    record_lap(options.folder)
