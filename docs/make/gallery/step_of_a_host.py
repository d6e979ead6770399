"""How small a step?

Error of the shock velocity of a car that a simulator integrates itself, over the step at which it exchanges values with
the shock FMUs: held force (A), extrapolated force (B), force law (C). The figures are those of examples/hosts.
"""

import json
from pathlib import Path

from matplotlib.figure import Figure

rows = json.loads(Path("docs/data/hosts/python_host.json").read_text(encoding="utf-8"))["rows"]
names = {"A": "held force", "B": "extrapolated force", "C": "force law"}
figure = Figure(figsize=(7, 4), layout="constrained")
axes = figure.add_subplot(xlabel="step [ms]", ylabel="error [% of the standard deviation]", xscale="log", yscale="log")
for loop, name in names.items():
    points = sorted((1e3 * row["step"], row["velocity"]) for row in rows if row["loop"] == loop)
    axes.plot(*zip(*points, strict=True), marker="o", label=f"{loop}: {name}")
axes.set_xticks([1, 2, 4, 8], ["1", "2", "4", "8"])
axes.grid(alpha=0.3, which="both")
axes.legend()
