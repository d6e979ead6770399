"""Tire force over road

Response of the left-front tire force to the left-front wheelloader, for the seven-DOF car of Table 5.1 with linear
dampers. The peaks are the modes of chassis and wheel.
"""

import numpy as np
from matplotlib.figure import Figure

from eightpost.vehicle import read_vehicle

car = read_vehicle("examples/car.toml")
frequency = np.geomspace(0.3, 30.0, 400)
paths = car.with_damper().select(inputs=["lf.road"], outputs=["lf.tire_force", "rf.tire_force"])
response = paths.frequency_response(frequency)
figure = Figure(figsize=(7, 4), layout="constrained")
axes = figure.add_subplot(xlabel="frequency [Hz]", ylabel="tire force over road [N/mm]", xscale="log", yscale="log")
for output, line in zip(paths.output_names, response[:, 0], strict=True):
    axes.plot(frequency, np.abs(line) / 1e3, label=output)
axes.grid(alpha=0.3, which="both")
axes.legend()
