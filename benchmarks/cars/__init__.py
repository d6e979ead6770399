"""True cars of a third kind, by which the identification of cars is judged.

They share no code with the virtual rig (`eightpost.rig`) or with any model that is identified. Friction acts in links
and in series with rubber, not at the shock ports; top mounts yield in series with the shocks; motion ratios rise;
tires stiffen with load and lift off; an engine stands on mounts; the chassis bends and twists; sensors have delays and
errors of gain. Seeds below 100 are for tuning, seeds 1000 to 1099 for reports.

    car = draw("rubber", 3)
    write_tests(car, folder, seconds=60.0, seed=3)  # five .mat or .csv files, and the channel map
    lap = lap_drive(car, seconds=30.0, seed=3)
    measures(run(car, [car.bank[k] for k in (0, 3, 6, 2)], lap))  # of a setup

`python -m benchmarks.cars --help` identifies cars and prints tables.
"""
