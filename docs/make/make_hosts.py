"""Run the host programs of examples/hosts, and write table and picture of docs/how_to/hosts.md from their results.

    python docs/make/make_hosts.py                  # from the results in docs/data/hosts/
    python docs/make/make_hosts.py --run            # run every program whose packages are installed first (minutes)
    python docs/make/make_hosts.py --run mujoco_host

A program is one file, examples/hosts/NAME_host.py; its result is docs/data/hosts/NAME_host.json.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent
PROGRAMS, RESULTS = ROOT / "examples" / "hosts", DOCS / "data" / "hosts"
PAGE, PICTURE = DOCS / "how_to" / "hosts.md", DOCS / "pictures" / "hosts.png"
#: The place of each table on the page.
TABLE, VEHICLE = "table", "vehicle"
STEPS = (8e-3, 4e-3, 2e-3, 1e-3)


def run(program: Path) -> str:
    """Run a program and store its result; return what happened."""
    line = [sys.executable, str(program), "--json", str(RESULTS / f"{program.stem}.json")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    ran = subprocess.run(line, capture_output=True, text=True, check=False, env=environment)
    if ran.returncode == 0:
        return ran.stdout
    last = (ran.stderr.strip().splitlines() or ["no message"])[-1]
    return f"{program.name} was not run: {last}\n"


def results() -> list[dict[str, Any]]:
    """Return the results of all programs, in the order of their names; a diverged run has infinite errors."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(RESULTS.glob("*_host.json"))]
    for row in (row for one in found for row in one["rows"]):
        for name in ("velocity", "tire_force"):
            row[name] = math.inf if row[name] is None else row[name]
    return found


def table(found: list[dict[str, Any]]) -> str:
    """Return a Markdown table, one row for all hosts with the same errors in a loop, and a list of programs."""
    head = " | ".join(f"{1e3 * step:g} ms" for step in STEPS)
    lines = [f"| loop | host | {head} |", "|---|---|" + "---|" * len(STEPS)]
    hosts: dict[tuple[str, ...], list[str]] = {}
    for one in found:
        for loop in dict.fromkeys(row["loop"] for row in one["rows"]):
            rows = {round(row["step"], 9): row for row in one["rows"] if row["loop"] == loop}
            cells = (loop[:2].rstrip(","), *(errors_of(rows.get(step)) for step in STEPS))
            detail = loop[2:].strip(", ")
            hosts.setdefault(cells, []).append(f"{one['host']} ({detail})" if detail else one["host"])
    lines += [f"| {key[0]} | {'; '.join(hosts[key])} | {' | '.join(key[1:])} |" for key in sorted(hosts)]
    return "\n".join([*lines, "", f"Programs: {'; '.join(map(program, found))}."])


def program(one: dict[str, Any]) -> str:
    """Return the link to a program, with the version of its host, its lines and its cost."""
    costs = [row["microseconds"] for row in one["rows"] if row["step"] == min(r["step"] for r in one["rows"])]
    cost = f"{min(costs):.3g} to {max(costs):.3g} us per step" if len(costs) > 1 else f"{costs[0]:.3g} us per step"
    version = f"{one['version']}, " if one["version"] else ""
    name = f"[{one['program']}](../../examples/hosts/{one['program']})"
    return f"{name} ({version}{one['lines']} lines, {cost})"


def vehicle_table() -> str:
    """Return a Markdown table of the full vehicle: errors of each loop, and what it says of the swapped corner."""
    result = json.loads((RESULTS / "full_vehicle.json").read_text(encoding="utf-8"))
    rows = [dict(zip(result["columns"], row, strict=True)) for row in result["rows"]]
    steps = [step for step in STEPS if any(row["step"] == step for row in rows)]
    head = " | ".join(f"{1e3 * step:g} ms" for step in steps)
    title = f"change of tire force by the swap at {1e3 * steps[-1]:g} ms"
    lines = [f"| loop | {head} | {title} |", "|---|" + "---|" * (len(steps) + 1)]
    for loop in dict.fromkeys(row["loop"] for row in rows):
        own = {row["step"]: row for row in rows if row["loop"] == loop}
        cells = [f"{own[step]['velocity']:.2g} / {own[step]['tire_force']:.2g}" for step in steps]
        lines.append(f"| {loop} | {' | '.join(cells)} | {own[steps[-1]]['lf_change']:.1f} N |")
    deviation, change = result["reference"]
    return "\n".join([*lines, f"| reference, {deviation:.0f} N before |" + " |" * len(steps) + f" {change:.1f} N |"])


def put(page: str, place: str, text: str) -> str:
    """Return a page with a text at a place."""
    begin, end = f"<!-- {place}: begin -->", f"<!-- {place}: end -->"
    before, rest = page.split(begin)
    return f"{before}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}"


def errors_of(row: dict[str, Any] | None) -> str:
    """Return the cell of a row: errors of shock velocity and tire force."""
    if row is None:
        return ""
    pair = (row["velocity"], row["tire_force"])
    return " / ".join(f"{x:.2g}" for x in pair) if all(map(math.isfinite, pair)) else "diverges"


def draw(found: list[dict[str, Any]], path: Path) -> None:
    """Draw the error of the shock velocity over the step: a color for each loop, a marker for each host."""
    import matplotlib as mpl  # noqa: PLC0415

    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    colors = {"J": "C3", "A": "C1", "B": "C0", "C": "C2", "M": "0.5"}
    figure, axes = plt.subplots(figsize=(7.5, 5.4), layout="constrained")
    for marker, one in zip("osv^Dp*XPh<>d" * 9, found, strict=False):
        for loop in dict.fromkeys(row["loop"] for row in one["rows"]):
            rows = [row for row in one["rows"] if row["loop"] == loop and math.isfinite(row["velocity"])]
            x, y = [1e3 * row["step"] for row in rows], [row["velocity"] for row in rows]
            color = colors.get(loop[:1], "0.5")
            axes.loglog(x, y, marker=marker, color=color, linewidth=1.0, markersize=6, fillstyle="none")
        axes.plot([], [], marker=marker, color="0.3", linestyle="none", fillstyle="none", label=one["host"])
    texts = {
        "J": "J: in parallel",
        "A": "A: held",
        "B": "B: extrapolated",
        "C": "C: force law",
        "M": "ME: model exchange",
    }
    for loop, text in texts.items():
        axes.plot([], [], color=colors[loop], label=text)
    ticks = [1e3 * step for step in STEPS]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("step of the host [ms]")
    axes.set_ylabel("error of the shock velocity\n[% of standard deviation, worst corner]")
    axes.grid(visible=True, alpha=0.3)
    figure.legend(loc="outside lower center", fontsize=8, ncols=4)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main() -> None:
    """Write the table and the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", nargs="*", metavar="PROGRAM", help="programs to run first; without names: all")
    options = parser.parse_args()
    if options.run is not None:
        RESULTS.mkdir(exist_ok=True)
        for program in (*sorted(PROGRAMS.glob("*_host.py")), PROGRAMS / "full_vehicle.py"):
            if not options.run or program.stem in options.run:
                print(run(program))
    page = put(PAGE.read_text(encoding="utf-8"), TABLE, table(results()))
    PAGE.write_text(put(page, VEHICLE, vehicle_table()), encoding="utf-8")
    draw(results(), PICTURE)


if __name__ == "__main__":
    main()
