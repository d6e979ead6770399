"""Seven builds of one shock

The static curves of the shipped bank: seven valvings of a virtual shock (Table 7.3), each fitted to a dynamometer
record. All data are SYNTHETIC.
"""

import numpy as np
from matplotlib.figure import Figure

from eightpost.shock import read_shock

velocity = np.linspace(-0.5, 0.5, 201)
figure = Figure(figsize=(7, 4), layout="constrained")
axes = figure.add_subplot(xlabel="velocity [m/s]", ylabel="force [N]")
for build in ("AA_AA", "AA_B", "B_AA", "B_B", "B_C", "C_B", "C_C"):
    law = read_shock(f"examples/bank/{build}.json").law
    axes.plot(velocity, [law.static_force(v) for v in velocity], label=build.replace("_", "/"))
axes.grid(alpha=0.3)
axes.legend(title="compression / rebound", ncols=2)
