"""Reproduce all items and write their results: `python docs/make/make_reproduce.py [FOLDER]`.

It writes docs/data/reproduced.json, and the page of `eightpost reproduce --all` in the folder (default out).
"""

import json
import sys
import time
from pathlib import Path

from dissertation import FULL, inventory, reproduce
from dissertation.page import write_reproduction

RESULTS = Path(__file__).resolve().parents[1] / "data" / "reproduced.json"


def main() -> None:
    """Reproduce everything."""
    started, used = time.perf_counter(), time.process_time()
    outcomes = []
    for outcome in reproduce(inventory(), FULL):
        outcomes.append(outcome)
        print(f"{outcome.item.label}: {outcome.state.value} ({outcome.seconds:.1f} s)", flush=True)
    wall, processor = time.perf_counter() - started, time.process_time() - used
    results = {
        "wall_seconds": round(wall),
        "processor_seconds": round(processor),
        "items": {one.item.name: [one.state.value, one.words] for one in outcomes},
    }
    RESULTS.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(write_reproduction(Path(sys.argv[1] if len(sys.argv) > 1 else "out") / "reproduce.html", outcomes, FULL))
    print(f"{wall:.0f} s, {processor:.0f} s of processor time")


if __name__ == "__main__":
    main()
