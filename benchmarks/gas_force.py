"""Benchmark of the fitted gas force: the virtual configurations of Table 3.1, whose true gas force is known.

    python benchmarks/gas_force.py [--configurations 1,5]

A law that is at rest has the gas force alone, so an error of the preload is an error of the level at rest. Prints the
true gas force at the mean position, pressure of the charge times area of the rod, and the error of each law's preload.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from benchmarks.shock_records import configurations
from benchmarks.shock_tables import grid
from eightpost.ident import fit_shock
from eightpost.rig import configuration
from eightpost.rig.damper.valves import ATMOSPHERE
from eightpost.shock import law_title

#: Laws of the columns.
COLUMNS = ("lpnl2", "hysteresis")


def gas_force(number: int) -> float:
    """Return the true gas force of a configuration at mid-travel [N]."""
    shock = configuration(number)
    return shock.cylinder.rod_area * (shock.gas.charge - ATMOSPHERE)


def main() -> None:
    """Fit all configurations and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configurations", default=",".join(map(str, range(1, 13))), help="separated by commas")
    lines, sizes = [], []
    for case in configurations([int(n) for n in parser.parse_args().configurations.split(",")], quick=True):
        true = gas_force(case.configuration)
        fits = [fit_shock(case.fitted, law) for law in COLUMNS]
        errors = [fit.parameter("gas_preload").value - true for fit in fits]
        sizes.append(np.abs(errors))
        lines.append([case.record, f"{true:.0f}", *(f"{error:+.0f}" for error in errors)])
    lines.append(["median of the magnitude", "", *(f"{size:.0f}" for size in np.median(sizes, axis=0))])
    print(grid(("shock", "true gas force [N]", *map(law_title, COLUMNS)), lines))


if __name__ == "__main__":
    main()
