"""The loop that a lag opens

Force over velocity on sines of 1, 4 and 16 Hz with the same peak velocity. A Polylinear shock would follow one curve;
LPNL2 opens a loop that grows with the frequency and closes at high force.
"""

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from eightpost.shock import read_shock

law = read_shock("examples/hosts/shock.json").law
figure = Figure(figsize=(7, 4), layout="constrained")
axes = figure.add_subplot(xlabel="velocity [m/s]", ylabel="force [N]")
for frequency in (1.0, 4.0, 16.0):
    time = np.linspace(0.0, 2.0 / frequency, 801)
    velocity = 0.2 * np.sin(2.0 * np.pi * frequency * time)
    state, force = law.start(0.0), [0.0]
    for start, end in pairwise(velocity):
        state = law.advance(state, start, end, time[1])
        force.append(law.valve_force(state, end))
    axes.plot(velocity[400:], force[400:], label=f"{frequency:g} Hz")
axes.grid(alpha=0.3)
axes.legend()
