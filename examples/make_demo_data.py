"""Create the shipped demonstration data: three synthetic dynamometer tests and a synthetic track drivefile.

All data are computed; they contain no measurements and no data of third parties. Run it from the project's root:

    python examples/make_demo_data.py
"""

from pathlib import Path

from eightpost.signals import write_csv, write_parquet
from eightpost.virtual.drivefiles import track_drivefile
from eightpost.virtual.dynamometer import measure, random_multisine
from eightpost.virtual.shocks import demo_damper

FOLDER = Path(__file__).parent / "data"

#: Title, unit and decimals of each channel; the decimals match the resolution of the sensors.
COLUMNS = {
    "time": ("Time", "s", 4),
    "displacement": ("Position", "in", 4),
    "velocity": ("Velocity", "in/s", 2),
    "force": ("Force", "lbf", 1),
    "temperature": ("Temperature", "degF", 1),
}


def dynamometer_test(build: str, seed: int) -> None:
    """Measure a build for 12 s at 2 kHz, with its own random phases, and write the record in US units."""
    drivefile = random_multisine(seed, duration=12.0, rate=2000.0)
    series = measure(demo_damper(build), drivefile, rate=2000.0, seed=seed)
    write_csv(
        series,
        FOLDER / f"dyno_{build}.csv",
        titles={name: title for name, (title, _, _) in COLUMNS.items()},
        units={name: unit for name, (_, unit, _) in COLUMNS.items()},
        decimals={name: digits for name, (_, _, digits) in COLUMNS.items()},
        preamble=(
            f"SYNTHETIC data: build {build} on eightpost's virtual dynamometer, examples/make_demo_data.py",
            f"Random multisine of Table 3.2, seed {seed}; 1 in peak; 150 psi gas; positive in compression",
            "Truth: digressive valve, stiffening fluid spring, gas spring and seal drag; with sensor noise",
        ),
    )


def track(seed: int) -> None:
    """Write a track of 30 s at 500 Hz."""
    write_parquet(
        track_drivefile(seed, duration=30.0, rate=500.0).series,
        FOLDER / "track.parquet",
        note=f"SYNTHETIC track drivefile, seed {seed}: noise of Table 6.3, examples/make_demo_data.py",
        storage="float32",
    )


if __name__ == "__main__":
    for number, name in enumerate("ABC", start=1):
        dynamometer_test(name, number)
    track(seed=11)
    for file in sorted(FOLDER.iterdir()):
        print(f"{file.relative_to(FOLDER.parent)}: {file.stat().st_size / 1000:.0f} kB")
