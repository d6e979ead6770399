"""The static curve used by the tests of the laws."""

from eightpost.shock import StaticCurve


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
