"""Rules of the verdict on a rig record: channels that contradict the mechanics of the car."""

from __future__ import annotations

from eightpost.verdict import Grade, Rules

ABOUT = "rig record"

RULES = Rules()

WRONG_SCALE = RULES.add("a channel has the wrong scale", ABOUT, Grade.NOT_USABLE,
    condition="the gain of one channel, or of one quantity at all corners, explains why laws of mechanics are violated "
    "by more than their tolerance and four standard deviations (docs/how_to/rig_data.md)",
    why="responses with this channel are wrong by the same factor, and shock forces that do not match the tire forces "
    "become false stiffness and damping",
    remedy="check its calibration and its unit",
)  # fmt: skip
WRONG_SIGN = RULES.add("a channel has the wrong sign", ABOUT, Grade.NOT_USABLE,
    condition="a ratio of a law of mechanics is negative, and reversing this channel removes most violations of its "
    "laws (docs/how_to/rig_data.md)",
    why="responses with this channel have a false phase of 180 degrees",
    remedy="set gain = -1 in the channel map, or pass --flip with the channel",
)  # fmt: skip
WRONG_DELAY = RULES.add("a channel is out of step", ABOUT, Grade.NOT_USABLE,
    condition="the delay of one channel, or of one quantity at all corners, explains why laws of mechanics are "
    "violated by more than their tolerance and four standard deviations (docs/how_to/rig_data.md)",
    why="a delay of 5 ms is a phase of 27 degrees at 15 Hz",
    remedy="correct it with delays (docs/how_to/rig_data.md)",
)  # fmt: skip
SWAPPED = RULES.add("channels of two corners are swapped", ABOUT, Grade.NOT_USABLE,
    condition="potentiometers match the accelerometers of each other's corner better than those of their own",
    why="the ports of the vehicle would be at the wrong corners",
    remedy="exchange the columns in the channel map",
)  # fmt: skip
DISCONNECTED = RULES.add("a channel is disconnected", ABOUT, Grade.NOT_USABLE,
    condition="the other channels explain less than 30 % of a channel's power from 0.7 to 15 Hz, and they explain most "
    "channels well",
    why="noise in an input hides the response to it; noise in an output has no response",
    remedy="check its cable and connector, or remove it from the channel map",
)  # fmt: skip
SPIKES = RULES.add("a channel has spikes", ABOUT, Grade.UNKNOWN,
    condition="samples deviate from their neighbours by 12 times the usual deviation and by half the channel's "
    "standard deviation, while no other channel does",
    why="a few spikes of 8 standard deviations add as much power as 1 % of noise; bumps are seen by several channels",
    remedy="check its connector, and cut out this part of the record",
)  # fmt: skip
CONTRADICTION = RULES.add("channels contradict each other", ABOUT, Grade.UNKNOWN,
    condition="a law of mechanics is violated, but no single channel explains it",
    why="one of the channels of the law is wrong, or the car has a part that the law does not describe",
    remedy="check the calibration and the units of these channels",
)  # fmt: skip
