"""Create the shipped files of a shock at five settings of its rebound adjuster, with the table that lists them.

All data are computed on the virtual dynamometer; they contain no measurements. Run it from the project's root:

    python examples/make_settings.py
"""

from pathlib import Path

from eightpost.rig.damper import shim_build
from eightpost.rig.dynamometer import Actuator, measure
from eightpost.rig.excitations import random_multisine
from eightpost.signals import write_csv

FOLDER = Path(__file__).parent / "settings"

#: Clicks from full hard; the bleed of the virtual shock counts 28 clicks from fully open.
CLICKS, MOST = (0, 7, 14, 21, 28), 28

COLUMNS = {
    "time": ("Time", "s", 4),
    "displacement": ("Position", "mm", 3),
    "velocity": ("Velocity", "mm/s", 1),
    "force": ("Force", "N", 1),
    "temperature": ("Temperature", "degC", 1),
}


def dynamometer_test(clicks: int, seed: int) -> Path:
    """Measure build C/B at a setting for 10 s at 400 Hz and write the record."""
    command = random_multisine(seed, duration=10.0, rate=2000.0)
    damper = shim_build("C/B", clicks=MOST - clicks)
    series = measure(damper, command, rate=400.0, actuator=Actuator(), seed=seed)
    path = FOLDER / f"rebound_{clicks:02d}.csv"
    write_csv(
        series,
        path,
        titles={name: title for name, (title, _, _) in COLUMNS.items()},
        units={name: unit for name, (_, unit, _) in COLUMNS.items()},
        decimals={name: digits for name, (_, _, digits) in COLUMNS.items()},
        preamble=(
            f"SYNTHETIC data: build C/B, rebound {clicks} clicks from full hard, examples/make_settings.py",
            f"Random multisine of Table 3.2, seed {seed}; 150 psi gas; positive in compression",
        ),
    )
    return path


if __name__ == "__main__":
    for number, setting in enumerate(CLICKS, start=1):
        file = dynamometer_test(setting, number)
        print(f"{file.relative_to(FOLDER.parent)}: {file.stat().st_size / 1000:.0f} kB")
