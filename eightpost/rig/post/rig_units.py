"""Units of rig records that contradict each other: a wrong label of displacement, velocity or time."""

from __future__ import annotations

import numpy as np

from eightpost.corners import channel
from eightpost.errors import UnknownUnitError
from eightpost.rig.motion import cause_of, slope_ratio
from eightpost.rig.plausibility import LOWEST_SAMPLING
from eightpost.signals.faults import Origin
from eightpost.signals.timeseries import TimeSeries

#: Minimum correlation of the slope of displacement with velocity, below which their sizes are not compared.
SAME = 0.8


def check_rig_units(series: TimeSeries, corners: tuple[str, ...], *, origin: Origin) -> None:
    """Check the sample rate, and the slope of each shock's displacement against its measured velocity.

    Args:
        series: Rig record with its measured channels.
        corners: Corners of the record, or an empty text for a rig with one corner.
        origin: File of the record.

    Raises:
        UnknownUnitError: The sample rate is below 20 Hz, or slope and velocity differ by the ratio of two units.
    """
    if series.sample_rate < LOWEST_SAMPLING:
        what = (
            f"the file has {series.sample_rate:.4g} samples per second, and a rig records {LOWEST_SAMPLING:g} or more: "
            "time is probably in ms but labelled s; correct its unit, or set it in a channel map"
        )
        raise origin.header_fault(UnknownUnitError, what, channel="time")
    for corner in corners:
        names = [channel(corner, name) for name in ("displacement", "velocity")]
        if any(name not in series for name in names):
            continue
        pair = TimeSeries(series.time, series.select(names).values, ("displacement", "velocity"), ("m", "m/s"))
        cause = cause_of(ratio := slope_ratio(pair))
        if cause and np.corrcoef(np.gradient(pair["displacement"]), pair["velocity"])[0, 1] > SAME:
            what = (
                f"its slope is {ratio:.4g} times {names[1]}, the ratio of two units: {cause}; correct the unit in the "
                "header, or set it in a channel map"
            )
            raise origin.header_fault(UnknownUnitError, what, channel=names[0])
