"""A shock on the virtual dynamometer

A physical damper with shims, gas and fluid compressibility on sines of 1 in at two speeds: the loop is what no static
curve describes. The data are SYNTHETIC.
"""

from matplotlib.figure import Figure

from eightpost.virtual import shim_build, sine_test

damper = shim_build("C/B")
figure = Figure(figsize=(7, 4), layout="constrained")
axes = figure.add_subplot(xlabel="velocity [m/s]", ylabel="force [N]")
for speed in (0.1, 0.25):
    test = sine_test(0.0254, speed, cycles=2)
    record = damper.respond(test.drivefile.series, rate=1000.0)
    last = record.time > record.time[-1] - 2.0 / test.frequency
    axes.plot(record["velocity"][last], record["force"][last], label=f"{speed:g} m/s")
axes.grid(alpha=0.3)
axes.legend(title="peak velocity")
