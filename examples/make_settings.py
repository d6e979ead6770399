"""Create the shipped files of a shock at five settings of its rebound adjuster, with the table that lists them.

All data are computed on the virtual dynamometer; they contain no measurements. Run it from the project's root:

    python examples/make_settings.py
"""

from dataclasses import replace
from pathlib import Path

from eightpost.signals import write_csv
from eightpost.virtual import SHIMS_OF_BUILD, PhysicalDamper, configuration
from eightpost.virtual.dynamometer import Actuator, measure, random_multisine
from eightpost.virtual.valves import open_passage

FOLDER = Path(__file__).parent / "settings"

#: Clicks from full hard, and area that a click opens [m2].
CLICKS, AREA = (0, 7, 14, 21, 28), 0.12e-6

COLUMNS = {
    "time": ("Time", "s", 4),
    "displacement": ("Position", "mm", 3),
    "velocity": ("Velocity", "mm/s", 1),
    "force": ("Force", "N", 1),
    "temperature": ("Temperature", "degC", 1),
}


def damper(clicks: int) -> PhysicalDamper:
    """Return the shock of row 1 of Table 3.1 with its rebound bleed a number of clicks from full hard."""
    shock = configuration(1)
    rebound = shock.main_valve.backward._replace(orifice=open_passage(SHIMS_OF_BUILD[1].jet + clicks * AREA).orifice)
    return replace(shock, main_valve=shock.main_valve._replace(backward=rebound))


def dynamometer_test(clicks: int, seed: int) -> Path:
    """Measure build C/B at a setting for 10 s at 400 Hz and write the record."""
    command = random_multisine(seed, duration=10.0, rate=2000.0)
    series = measure(damper(clicks), command, rate=400.0, actuator=Actuator(), seed=seed)
    path = FOLDER / f"rebound_{clicks:02d}.csv"
    write_csv(
        series,
        path,
        titles={name: title for name, (title, _, _) in COLUMNS.items()},
        units={name: unit for name, (_, unit, _) in COLUMNS.items()},
        decimals={name: digits for name, (_, _, digits) in COLUMNS.items()},
        preamble=(
            f"SYNTHETIC data: configuration 1, rebound {clicks} clicks from full hard, examples/make_settings.py",
            f"Random multisine of Table 3.2, seed {seed}; 50 psi gas; positive in compression",
        ),
    )
    return path


if __name__ == "__main__":
    for number, setting in enumerate(CLICKS, start=1):
        file = dynamometer_test(setting, number)
        print(f"{file.relative_to(FOLDER.parent)}: {file.stat().st_size / 1000:.0f} kB")
