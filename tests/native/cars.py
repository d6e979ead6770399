"""Random runs of a car's FMU, and their comparison."""

import numpy as np

from eightpost.vehicle import read_vehicle, shipped


def model_of(name):
    return read_vehicle(shipped(name)).coupled()


def scale_of(model):
    return np.where([n.endswith("road") for n in model.input_names], 0.01, 300.0)


def drive(fmu, model, moves, time=0.0):
    """Return the outputs after each (step, inputs at its start, inputs at its end)."""
    rows = []
    for step, start, end in moves:
        fmu.set(model.input_names, start)
        if (end != start).any():
            fmu.set_derivatives(model.input_names, (end - start) / step)
        fmu.step(time, step)
        time += step
        rows.append(fmu.get(model.output_names))
    return np.array(rows)


def random_moves(model, count, seed, *, held):
    rng, scale = np.random.default_rng(seed), scale_of(model)
    moves = []
    for step in 10.0 ** rng.uniform(-7, -1.3, count):
        start, end = scale * rng.standard_normal((2, len(scale)))
        moves.append((step, start, start if held else end))
    return moves


def close(found, expected, relative):
    """Compare outputs relative to each output's size over the run."""
    worst = (np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)).max()
    assert worst < relative, worst
