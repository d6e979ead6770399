"""Rules of the verdict on a dynamometer record: what is implausible about it, how far it matters, and what to do."""

from __future__ import annotations

from eightpost.verdict import Grade, Rules

ABOUT = "dynamometer record"

RULES = Rules()

CONTRADICTORY_UNITS = RULES.add("contradictory units", ABOUT, Grade.NOT_USABLE,
    condition="the slope of displacement and the measured velocity differ by the ratio of two units (25.4, 1000, 10 or "
    "60, within 8 %)",
    why="one of the labels is wrong, so damping and stroke are wrong by the same factor",
    remedy="correct the label, or override it in a channel map: unit = 'in' (docs/reference/signs_and_units.md)",
)  # fmt: skip
UNLIKELY_UNITS = RULES.add("unlikely units", ABOUT, Grade.UNKNOWN,
    condition="the damping rate is outside 1000 to 30,000 N.s/m (2500 to 12,000 if the file has newtons beside inches, "
    "or pounds beside millimetres), or the sample rate is outside 20 Hz to 200 kHz, or the stated gas pressure and the "
    "force at standstill give a rod under 8 mm, or the stated gas force is 4.45 times the force at standstill, or work "
    "and warming give a heat capacity under 350 J/K",
    why="the measured records and the virtual shocks have 1300 to 11,000 N.s/m; pounds labelled N give 4.4 times less, "
    "inches labelled mm 25 times more, ms labelled s 1000 times more",
    remedy="compare peak force, stroke and peak velocity with the test sheet; if a label is wrong, override it in a "
    "channel map: unit = 'lbf'. If they are right, ignore this reason",
)  # fmt: skip
RECTIFIED = RULES.add("rectified force", ABOUT, Grade.NOT_USABLE,
    condition="the force is nowhere negative by more than noise (six standard deviations, or its mean at a velocity), "
    "and either rises with speed in both strokes (correlations of 0.3 or more), or falls to zero in rebound and rises "
    "again at higher speeds",
    why="a magnitude does not show which stroke a force belongs to",
    remedy="export the signed force, or another force column (--channel force=NAME)",
)  # fmt: skip
NEGATIVE_REST = RULES.add("negative force at standstill", ABOUT, Grade.LIMITED,
    condition="the force at standstill is below minus 1 % of the force's range, after compression as well as after "
    "rebound",
    why="gas pushes, so either the load cell was zeroed with the gas force on it, or all signs are reversed and "
    "compression and rebound are swapped",
    remedy="check which stroke is compression; if all signs are reversed, flip them (--flip force with --flip "
    "displacement or --flip velocity); otherwise zero the load cell without the shock",
)  # fmt: skip
TWO_SETTINGS = RULES.add("the shock changed", ABOUT, Grade.NOT_USABLE,
    condition="the force of a stroke at the same velocity (at all, at low or at high speeds) changes by a step of 8 % "
    "or more, six times the scatter, while the motion stays the same",
    why="a fit to both parts is a shock that exists at no setting",
    remedy="cut the record where the setting changes (--segment), and fit each part alone",
)  # fmt: skip
SMALL_CHANGE = RULES.add("the shock changed a little", ABOUT, Grade.LIMITED,
    condition="the same, by 3 to 8 %",
    why="one or two clicks have such an effect, and also a shim that settles: a fit is between both states",
    remedy="check whether a setting was changed during the test; if it was, cut the record there (--segment)",
)  # fmt: skip
CHANGED_COLUMN = RULES.add("another column changes", ABOUT, Grade.LIMITED,
    condition="a column that is not read (a voltage, clicks) changes from one part of the record to the next",
    why="it may be a setting of the shock: a fit would then mix several states",
    remedy="fit the parts with a constant value alone (--segment), or ignore this if the column does not act on the "
    "shock",
)  # fmt: skip
RUN_DOWN = RULES.add("run-down of the machine", ABOUT, Grade.LIMITED,
    condition="after a steady sine, the motion slows down or stops within the fitted seconds",
    why="a law is fitted to the whole segment, so low speeds after the test get weight, and speed correlates with time",
    remedy="fit the part before it (--segment)",
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
CHOSEN_COLUMN = RULES.add("one of several columns", ABOUT, Grade.USABLE,
    condition="several columns could be the same channel, and one of them was chosen",
    why="another column may be the one that is calibrated",
    remedy="name the column with --channel",
)  # fmt: skip
COMMANDED = RULES.add("a command instead of a measurement", ABOUT, Grade.LIMITED,
    condition="a channel is read from a column that its name calls a command, a target or a reference, because there "
    "is no other",
    why="the machine follows its command late and with another size, and what the force lags behind the command is not "
    "a lag of the shock",
    remedy="export the measured channel, or confirm the column with --channel",
)  # fmt: skip
LEFT_OUT = RULES.add("a column that was not read", ABOUT, Grade.USABLE,
    condition="a column could be a channel but has no unit, another quantity's unit, words, one value only, no sign, "
    "or is a command, and the record is complete without it",
    why="an unneeded column must not prevent reading a file",
    remedy="correct the column, or ignore this",
)  # fmt: skip
DEAD = RULES.add("a dead channel", ABOUT, Grade.LIMITED,
    condition="the only column of the displacement or the velocity is constant or empty, and the other one is read",
    why="a sensor failed or its cable is loose, so the other channels of the test may be affected; without a "
    "displacement no gas stiffness is known",
    remedy="check the sensor and its cable, and measure again if the displacement matters",
)  # fmt: skip


#: Names of the rules about changes during a record; they apply to each run on its own.
PART_RULES = frozenset((TWO_SETTINGS.name, SMALL_CHANGE.name, RUN_DOWN.name))
