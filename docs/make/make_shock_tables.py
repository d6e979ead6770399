"""Rewrite the tables and the picture of docs/evidence/shock_models.md and measured_shocks.md.

Run it by `python docs/make/make_shock_tables.py`.

The script runs `benchmarks/shock_fit.py --quick` with both recipes, which takes some minutes. The page of the measured
records is not changed if EIGHTPOST_DATA does not name their folder.
"""

import os
import re
import statistics
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

from benchmarks.measured_tables import fit_errors_table, held_out_table, lag_table
from benchmarks.shock_picture import draw
from benchmarks.shock_records import BOUC_WEN, LAWS
from benchmarks.shock_rows import Bench, FitErrors, results
from benchmarks.shock_tables import gains_table, grid, summary, table_3_4, table_3_5, virtual
from benchmarks.table import number
from eightpost.ident.shock.plots import law_title

DOCS = Path(__file__).resolve().parents[1]
ALL = tuple(range(1, 13))


def main() -> None:
    """Run everything and rewrite both pages."""
    ours = list(results(Bench(ALL, (*LAWS, BOUC_WEN), quick=True)))
    virtual_ones = [one for one in ours if not one.case.about_mean]
    boggs = list(results(Bench(ALL, LAWS, quick=True, recipe="boggs", measured=())))
    errors = virtual(virtual_ones)
    draw(virtual_ones, DOCS / "pictures" / "shock_models.png")
    regions = {
        "fits": table_3_4(virtual_ones),
        "errors": table_3_5(errors),
        "gains": gains_table(errors),
        "summary": "\n".join(summary(errors)),
        "boggs": table_3_5(virtual(boggs)),
        "boggs_gains": gains_table(virtual(boggs)),
        "times": times(virtual_ones),
    }
    rewrite(DOCS / "evidence" / "shock_models.md", regions)
    measured = [one for one in ours if one.case.about_mean]
    if measured:
        tables = {"held_out": held_out_table, "fitted": fit_errors_table, "lags": lag_table}
        rewrite(DOCS / "evidence" / "measured_shocks.md", {name: table(measured) for name, table in tables.items()})


def times(found: list) -> str:
    """Return the computing times of fits over the configurations."""
    lines = []
    for law in LAWS:
        seconds = [one.seconds for one in found if isinstance(one, FitErrors) and one.law == law]
        if seconds:
            lines.append([law_title(law), *(number(f(seconds)) for f in (min, statistics.median, max))])
    return grid(("law", "minimum [s]", "median [s]", "maximum [s]"), lines)


def rewrite(path: Path, regions: dict) -> None:
    """Put each text between its markers, `<!-- table NAME -->` and `<!-- end -->`."""
    page = path.read_text(encoding="utf-8")
    for name, text in regions.items():
        pattern = re.compile(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        page = pattern.sub(lambda match, text=text: f"{match[1]}{text}\n{match[2]}", page)
    path.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
