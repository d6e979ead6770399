"""Command that restores a state: `python -m builder.check.probes.restore UNPACKED_FMU PROGRESS_FILE STATE STEPS`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from builder.check.probes.__main__ import open_bench
from builder.check.probes.state import restored


def main(folder: Path, progress: Path, saved: Path, reach: int) -> None:
    """Restore the state in a new instance, continue the run, and print the outputs in hexadecimal, a line per point."""
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    bench = open_bench(folder, progress, reach)
    with bench.running() as instance:
        for row in restored(bench, instance, saved.read_bytes()):
            channel.write(" ".join(value.hex() for value in row) + "\n")
    channel.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
    os._exit(0)
