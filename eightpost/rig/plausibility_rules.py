"""Rules of the check of a dynamometer record: what is found, how far it matters, and what to do.

A rule with the grade *usable* gives a note: it asks for attention, and does not lower the verdict.
"""

from __future__ import annotations

from eightpost.verdict import Grade, Rules

ABOUT = "dynamometer record"

RULES = Rules()

# ---- Units and signs ------------------------------------------------------------------------------------------------

CONTRADICTORY_UNITS = RULES.add("contradictory units", ABOUT, Grade.NOT_USABLE,
    condition="the slope of displacement and the measured velocity differ by the ratio of two units (25.4, 1000, 10 or "
    "60, within 8 %), or the stated gas force is 4.45 times the force at standstill, or the reverse",
    why="one of the labels is wrong, so damping and stroke are wrong by the same factor",
    remedy="correct the label, or override it in a channel map: unit = 'in' (docs/reference/signs_and_units.md)",
)  # fmt: skip
UNLIKELY_UNITS = RULES.add("unlikely units", ABOUT, Grade.UNKNOWN,
    condition="the sample rate is outside 20 Hz to 200 kHz, or a channel's largest value outside 1 mm/s to 10 m/s, "
    "0.1 mm to 0.6 m, 1 N to 100 kN",
    why="no dynamometer test of a shock has such values: the label of a unit is wrong",
    remedy="compare peak force, stroke and peak velocity with the test sheet, and override the wrong label in a "
    "channel map: unit = 'lbf'",
)  # fmt: skip
RECTIFIED = RULES.add("rectified force", ABOUT, Grade.NOT_USABLE,
    condition="the force is nowhere negative by more than noise (six standard deviations, or its mean at a velocity), "
    "and either rises with speed in both strokes (correlations of 0.3 or more), or falls to zero in rebound and rises "
    "again at higher speeds",
    why="a magnitude does not show which stroke a force belongs to",
    remedy="export the signed force, or another force column (--channel force=NAME)",
)  # fmt: skip
NEGATIVE_REST = RULES.add("negative force at standstill", ABOUT, Grade.LIMITED,
    condition="the force at standstill is below minus 1.5 % of the force's range, and below minus 3 % by a fit "
    "with lag and gas stiffness",
    why="gas pushes, so either the load cell was zeroed with the gas force on it, or all signs are reversed and "
    "compression and rebound are swapped",
    remedy="check which stroke is compression; if all signs are reversed, flip them (--flip force with --flip "
    "displacement or --flip velocity); otherwise zero the load cell without the shock",
)  # fmt: skip

# ---- One state of the shock -----------------------------------------------------------------------------------------

TWO_SETTINGS = RULES.add("the shock changed", ABOUT, Grade.NOT_USABLE,
    condition="the force of a stroke at the same velocity (at all, at low or at high speeds) changes by a step of 8 % "
    "or more, six times the scatter, while the motion stays the same",
    why="a fit to both parts is a shock that exists at no setting",
    remedy="cut the record where the setting changes (--segment), and fit each part alone",
)  # fmt: skip
SMALL_CHANGE = RULES.add("the shock changed a little", ABOUT, Grade.USABLE,
    condition="the same, by 3 to 8 %",
    why="one or two clicks have such an effect, and also a shim that settles: a fit is between both states",
    remedy="check whether a setting was changed during the test; if it was, cut the record there (--segment)",
)  # fmt: skip
DRIFT = RULES.add("drift", ABOUT, Grade.LIMITED,
    condition="the force at the same motion, its level, or the displacement beside the velocity drifts by 5 % or more "
    "from the start to the end, six standard errors",
    why="a shock that warms, a load cell or a displacement sensor that drifts: a fit is between all states",
    remedy="warm the shock up first, or fit parts of the record (--segment) and compare them",
)  # fmt: skip
CHANGED_COLUMN = RULES.add("another column changes", ABOUT, Grade.LIMITED,
    condition="a column that is not read (a voltage, a current, clicks) changes during the record",
    why="it may be a setting of the shock: a fit would then mix several states",
    remedy="fit the parts with a constant value alone (--segment), or ignore this if the column does not act on the "
    "shock",
)  # fmt: skip
RUN_DOWN = RULES.add("run-down of the machine", ABOUT, Grade.LIMITED,
    condition="after a steady sine, the motion slows down or stops within the fitted seconds",
    why="a law is fitted to the whole segment, so low speeds after the test get weight, and speed correlates with time",
    remedy="fit the part before it (--segment)",
)  # fmt: skip

# ---- Instruments ----------------------------------------------------------------------------------------------------

DISAGREE = RULES.add("velocity and displacement disagree", ABOUT, Grade.LIMITED,
    condition="the measured velocity differs from the slope of displacement: in size by 5 %, in time by 1.5 samples, "
    "in its mean by 2 % of its standard deviation, or at a sample by 20 % of its range",
    why="one of the two channels has a wrong calibration, an offset, a delay or lost samples",
    remedy="correct the channel in a channel map (gain, offset), or leave the velocity out: it is then derived from "
    "the displacement",
)  # fmt: skip
LATE = RULES.add("late force", ABOUT, Grade.LIMITED,
    condition="the force follows velocity by more than 10 ms, gas and friction excluded (the whole 95 % interval)",
    why="a shock itself has less, so the rest is a filter of the force channel, channels sampled one after the other, "
    "or strong hysteresis: at wheel hop a delay turns damping into stiffness",
    remedy="find the delay or the filter of the force channel (docs/reference/dyno_files.md), and export again",
)  # fmt: skip
EARLY = RULES.add("early force", ABOUT, Grade.LIMITED,
    condition="the force leads velocity by more than 0.5 ms and 0.6 samples (the whole 95 % interval)",
    why="compressibility, friction and gas make a force late, never early, so velocity is late: filtered, or sampled "
    "after the force; the lag of the shock is too small by that",
    remedy="find which channel has a filter or is sampled later, and export again",
)  # fmt: skip
JUMP = RULES.add("jump of a channel", ABOUT, Grade.LIMITED,
    condition="two successive samples differ by 20 % of the range (displacement 3 %) and ten times the changes around "
    "them; velocity and force then return",
    why="a spike, a drop-out, lost samples or joined records",
    remedy="cut this part out (--segment)",
)  # fmt: skip
HELD = RULES.add("clipped displacement", ABOUT, Grade.LIMITED,
    condition="the displacement stays at its highest or lowest value while the force moves",
    why="the stroke, and the velocity derived from it, are wrong there",
    remedy="record again with a larger range, or use a part without clipping",
)  # fmt: skip
HUM = RULES.add("hum", ABOUT, Grade.LIMITED,
    condition="a line at 50 or 60 Hz has 0.2 % of a channel's range, and four times anything within 12 Hz",
    why="the mains couple into the cable: at 1 % of the range it is larger than the residual of a good fit",
    remedy="ground the sensor and its cable and record again; the low-pass of a fit (50 Hz) leaves it in",
)  # fmt: skip
SMOOTHED = RULES.add("smoothed force", ABOUT, Grade.LIMITED,
    condition="the spectrum of the force has gaps at the multiples of one frequency, as a moving average over 10 ms or "
    "more leaves them",
    why="an average over T rounds the corners of the curve, and takes away a third of the force at 0.7 / T",
    remedy="export the force without smoothing",
)  # fmt: skip
UNRELATED = RULES.add("force without velocity", ABOUT, Grade.NOT_USABLE,
    condition="the correlation of force and velocity is below 0.3",
    why="a wrong column, a spring on the dynamometer, or channels sampled at different times",
    remedy="check the columns (--channel), and take the spring off",
)  # fmt: skip
COMMANDED = RULES.add("a command instead of a measurement", ABOUT, Grade.LIMITED,
    condition="a channel is read from a column that its name calls a command, a target or a reference, because there "
    "is no other",
    why="the machine follows its command late and with another size, and what the force lags behind the command is not "
    "a lag of the shock",
    remedy="export the measured channel, or confirm the column with --channel",
)  # fmt: skip
DEAD = RULES.add("a dead channel", ABOUT, Grade.LIMITED,
    condition="the only column of the displacement or the velocity is constant or empty, and the other one is read",
    why="a sensor failed or its cable is loose, so the other channels of the test may be affected; without a "
    "displacement no gas stiffness is known",
    remedy="check the sensor and its cable, and measure again if the displacement matters",
)  # fmt: skip

# ---- Notes ----------------------------------------------------------------------------------------------------------

CHOSEN_COLUMN = RULES.add("one of several columns", ABOUT, Grade.USABLE,
    condition="several columns could be the same channel, and one of them was chosen",
    why="another column may be the one that is calibrated",
    remedy="name the column with --channel",
)  # fmt: skip
LEFT_OUT = RULES.add("a column that was not read", ABOUT, Grade.USABLE,
    condition="a column could be a channel but has no unit, another quantity's unit, words, one value only, no sign, "
    "or is a command, and the record is complete without it",
    why="an unneeded column must not prevent reading a file",
    remedy="correct the column, or ignore this",
)  # fmt: skip
REPEATED = RULES.add("repeated samples", ABOUT, Grade.USABLE,
    condition="more than 2 % of the samples repeat the one before while the shock moves",
    why="the logger is slower than the file",
    remedy="export at the rate of the logger",
)  # fmt: skip
LARGE_REST = RULES.add("large force at standstill", ABOUT, Grade.USABLE,
    condition="the force at standstill is more than half of its range, and 1000 N",
    why="few gas springs reach this: it may be an offset of the load cell",
    remedy="check the load cell's zero",
)  # fmt: skip


#: Names of the rules about a part of a record; they apply to each run on its own.
PART_RULES = frozenset(rule.name for rule in (TWO_SETTINGS, SMALL_CHANGE, DRIFT, RUN_DOWN, JUMP, HELD, REPEATED))
