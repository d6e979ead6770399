"""The static curve used by the tests of the laws, and effects of settings on it."""

from dataclasses import replace

import numpy as np

from eightpost.shock import Axis, Settings, StaticCurve, Term


def curve(**changes):
    """Return a curve of the size of a stock-car shock: digressive, stiffer in rebound, rising everywhere."""
    values = {
        "inner": (1800.0, 60.0, -400.0, *[0.0] * 11, 30.0),
        "compression": (1490.0, 900.0, 40.0, 5.0),
        "rebound": (-1400.0, -1100.0, -20.0, 3.0),
        "transition_speed": 0.381,
        "transition_width": 0.0127,
        "compression_speed": 1.2,
        "rebound_speed": 1.1,
        "compression_slope": 3000.0,
        "rebound_slope": 3500.0,
    }
    return StaticCurve(**(values | changes))


def knot_curve(**changes):
    """Return a curve through knots of the same size, with quadratic cells and asymmetric noses, rising everywhere."""
    velocity = [-1.1 * (k / 12) ** 1.8 for k in range(12, 0, -1)] + [1.2 * (k / 12) ** 1.8 for k in range(13)]
    slope = [1500.0 + 5000.0 / (1.0 + (v / (0.12 if v > 0.0 else 0.09)) ** 2) + 400.0 * v for v in velocity]
    force = [0.0] * 25
    for k in range(12, 24):
        force[k + 1] = force[k] + 0.5 * (slope[k] + slope[k + 1]) * (velocity[k + 1] - velocity[k])
    for k in range(12, 0, -1):
        force[k - 1] = force[k] - 0.5 * (slope[k] + slope[k - 1]) * (velocity[k] - velocity[k - 1])
    made = StaticCurve.through_knots(tuple(velocity), tuple(force), tuple(slope))
    return replace(made, **changes)


def example_settings(varied, parts, *, seed, deviation):
    """Return two adjusters and the temperature with random effects, measured one at a time and in two combinations.

    `parts` are the sizes of effects and how many values each has, the slopes of the knots first.
    """
    random = np.random.default_rng(seed)
    axes = (
        Axis("rebound", (0.0, 5.0, 12.0, 20.0), 5.0, counted="from full hard", lowest=0.0, highest=25.0),
        Axis("compression", (0.0, 3.0), 0.0),
        Axis("temperature", (300.0, 320.0, 345.0), 320.0, unit="K"),
    )

    def rows(count, kept):
        found = np.hstack([random.normal(0.0, size, (count, width)) for size, width in parts])
        found[[k for k in range(count) if k not in kept]] = 0.0
        return tuple(map(tuple, found.tolist()))

    terms = (
        Term(("rebound",), rows(4, (0, 2, 3))),
        Term(("compression",), rows(2, (1,))),
        Term(("temperature",), rows(3, (0, 2))),
        Term(("rebound", "compression"), rows(8, (5, 7))),
    )
    single = [(r, 0.0, 320.0) for r in axes[0].nodes] + [(5.0, 3.0, 320.0), (5.0, 0.0, 300.0), (5.0, 0.0, 345.0)]
    tested = (*single, (12.0, 3.0, 320.0), (20.0, 3.0, 320.0))
    return Settings(axes, varied, terms, tested, ((deviation,) * 25,) * len(tested))
