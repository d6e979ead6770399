"""Mutation testing of the product.

    python -m benchmarks.mutants [--count N] [--seed S] [--areas NAMES] [--workers N] [--folder FOLDER] [--least SHARE]

A mutant is a source with one operator, sign, bound or constant changed. Mutants are sampled at random in the sources of
all areas, and the tests of the area (areas.toml) are run on a copy of the checkout: a mutant is killed if one of them
fails. Mutants of equivalent.toml give the same results as the source, so no test can detect them; they are counted
separately. Records are kept in the folder: the same command resumes the campaign, and tries survivors again if the
tests have changed. Prints Markdown, which is also written to FOLDER/report.md. The exit code is 1 if fewer than SHARE
of the mutants are killed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.mutants.areas import read_areas, read_equivalents
from benchmarks.mutants.campaign import Campaign
from benchmarks.mutants.report import killed_share, report


def main() -> int:
    """Run a campaign."""
    areas = read_areas()
    options = _options([area.name for area in areas])
    chosen = [area for area in areas if area.name in options.areas]
    found = Campaign(chosen, read_equivalents(), options.folder, options.seed, options.workers, _print).run(
        options.count
    )
    text = report(found, options.seed)
    (options.folder / "report.md").write_text(text, encoding="utf-8")
    print(text)
    return 0 if killed_share(found) >= options.least else 1


def _options(names: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="number of mutants in all areas (default 200)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the sample (default 1)")
    parser.add_argument("--areas", nargs="+", choices=names, default=names, help="areas to sample (default all)")
    parser.add_argument("--workers", type=int, default=2, help="number of parallel trials (default 2)")
    parser.add_argument(
        "--folder", type=Path, default=Path("out/mutants"), help="folder of the records (default out/mutants)"
    )
    parser.add_argument("--least", type=float, default=0.9, help="required share of killed mutants (default 0.9)")
    return parser.parse_args()


def _print(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
