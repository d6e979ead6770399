"""Run every tool that is installed on the four interface kinds of a shock and a car, and keep the results.

    python -m benchmarks.interface_matrix                  # minutes; results in docs/data/hosts/matrix.json
    python -m benchmarks.interface_matrix --tools FMPy CasADi --models shock

A tool that needs an environment of its own (CoFMUPy) is run from there; results of tools that are not installed stay as
they are. `python docs/make/make_hosts.py` writes the table of docs/evidence/hosts_tools.md from the results.
"""

from __future__ import annotations

import argparse
import datetime
import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.interface_matrix.direct import Subject, difference
from benchmarks.interface_matrix.programs import NotInstalledError, UnsuitableError
from benchmarks.interface_matrix.tools import KINDS, TOOLS, Run, Tool
from builder.build import build

FMI3 = 3
ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "docs" / "data" / "hosts" / "matrix.json"
MODELS = {"shock": ROOT / "examples" / "hosts" / "shock.json", "car": ROOT / "examples" / "car.toml"}


def subjects(folder: Path, models: list[str]) -> dict[tuple[str, int], Subject]:
    """Build the FMUs of models, and return them by model and FMI version."""
    build([MODELS[name] for name in models], folder, fmi="all")
    endings = {2: "", 3: "_fmi3"}
    return {(name, fmi): Subject(folder / f"{name}{end}.fmu", fmi) for name in models for fmi, end in endings.items()}


@cache
def _expected(run: Run, subject: Subject) -> Any:
    return run.expected(subject)


def cell(tool: Tool, kind: str, found: dict[tuple[str, int], Subject]) -> dict[str, Any]:
    """Return the difference from the direct result for each model (None: unsuitable), or why the tool does not run."""
    run = tool.run(kind)
    if isinstance(run, str):
        return {"not_run": run}
    differences: dict[str, Any] = {}
    for model in dict.fromkeys(name for name, _ in found):
        subject = found[model, KINDS[kind][0]]
        try:
            differences[model] = difference(run.outputs(subject), _expected(run, subject))
        except UnsuitableError:
            differences[model] = None
        except NotInstalledError as missing:
            return {"not_run": str(missing)}
        except Exception as error:  # any refusal of a tool is a result
            message = f"{type(error).__name__}: {error}".replace(str(subject.path), subject.path.name)[:200]
            return {"not_run": (subject.fmi == FMI3 and tool.fmi3) or message}
    return differences


def results_of(tool: Tool, found: dict[tuple[str, int], Subject]) -> dict[str, Any] | None:
    """Return the version and the cells of a tool, or None if it is not installed."""
    try:
        version = tool.version()
    except NotInstalledError as missing:
        print(f"{tool.name}: not run: {missing}", flush=True)
        return None
    cells = {kind: cell(tool, kind, found) for kind in KINDS}
    for kind, value in cells.items():
        print(f"{tool.name} {version}, {kind}: {value}", flush=True)
    today = datetime.datetime.now(tz=datetime.UTC).date()
    return {"name": tool.name, "version": version, "date": today.isoformat(), "by_hand": False, "cells": cells}


def missing_row(tool: Tool) -> dict[str, Any]:
    """Return the row of a tool that was never run."""
    cells = {kind: {"not_run": "not installed"} for kind in KINDS}
    return {"name": tool.name, "version": "-", "date": "", "by_hand": False, "cells": cells}


def main() -> None:
    """Run the tools and update the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tools", nargs="+", choices=[tool.name for tool in TOOLS], help="tools to run")
    parser.add_argument("--models", nargs="+", choices=list(MODELS), default=list(MODELS), help="models to run")
    parser.add_argument("--json", type=Path, default=RESULTS, help="file of results to update")
    options = parser.parse_args()
    kept = json.loads(options.json.read_text(encoding="utf-8")) if options.json.is_file() else []
    by_name = {row["name"]: row for row in kept}
    with tempfile.TemporaryDirectory() as folder:
        found = subjects(Path(folder), options.models)
        for tool in TOOLS:
            if options.tools is None or tool.name in options.tools:
                by_name[tool.name] = results_of(tool, found) or by_name.get(tool.name) or missing_row(tool)
    options.json.write_text(json.dumps(list(by_name.values()), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
