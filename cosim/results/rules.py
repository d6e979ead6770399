"""Rules by which a run is judged: its coupling, energies, convergence and limits."""

from __future__ import annotations

from cosim.results.validity import LARGEST_SHARE, NOTABLE_SHARE
from eightpost.verdict import Grade, Rules

#: Largest coupling error of a result that can be used [% of the scale].
LARGEST_ERROR = 5.0

#: Residual, as a share of the energy transferred, above which a second run at half the step is recommended.
DOUBTFUL_RESIDUAL = 1e-2

#: Largest residual, as a share of the energy transferred, of a result that can be used. With ramped values the residual
#: was about the error of the shock velocity: 0.25 % at 1 ms, 0.9 % at 2 ms, 3.4 % at 4 ms
#: (docs/explanation/coupling.md).
LARGEST_RESIDUAL = 0.05

#: Coupling error up to which a run without a tolerance of its own is good [% of the scale].
GOOD_ERROR = 1.0

RULES = Rules()

COUPLING_ERROR = RULES.add("coupling error too large", "coupling", Grade.NOT_USABLE,
    condition=f"stated error of a bond's velocity or force or of a tire force above {LARGEST_ERROR:g} % of its "
    "scale (its standard deviation, with a floor)",
    why="setups of one car differ by a few percent in these signals: a larger error ranks the scheme, not the setups",
    remedy="give a smaller coupling step, or use the default algorithm",
)  # fmt: skip
COUPLING_TOLERANCE = RULES.add("coupling tolerance not met", "coupling", Grade.LIMITED,
    condition="the same error above the tolerance (default 0.2 %); for a run at a given step above "
    f"{GOOD_ERROR:g} %",
    why="the error is known, but it is larger than requested",
    remedy="compare only differences of several times this error, or give a smaller step",
)  # fmt: skip
COUPLING_GOOD = RULES.add("coupling error small", "coupling", Grade.USABLE,
    condition="the same error within the tolerance",
    why="the error is known and as small as requested",
)  # fmt: skip
COUPLING_UNKNOWN = RULES.add("coupling error not stated", "coupling", Grade.UNKNOWN,
    condition="the run states no error",
    why="a single run at one step does not show the error of the coupling",
    remedy="leave out --no-comparison (compared=False), or use the default algorithm; both state the error",
)  # fmt: skip
COUPLING_NONE = RULES.add("nothing is coupled", "coupling", Grade.USABLE,
    condition="the system has no bonds and no error is stated",
    why="components that only follow a drive, or feed each other one way, have no coupling loop",
)  # fmt: skip
LOCAL_ERROR = RULES.add("local error of a bond", "coupling", Grade.NOT_USABLE,
    condition=f"the values that the ends of a bond assume of each other are wrong by more than {LARGEST_ERROR:g} % of "
    "their scale in each step",
    why="two runs that alternate from step to step can agree at the recorded points; the error within the steps shows "
    "this, and therefore overrides the stated error",
    remedy="give a smaller coupling step, or use the implicit algorithm",
)  # fmt: skip
CHANNEL_ERROR = RULES.add("coupling error of other channels", "coupling", Grade.LIMITED,
    condition=f"stated error of any other recorded channel above {LARGEST_ERROR:g} %",
    why="accelerations have higher frequencies than forces and velocities, and larger errors",
    remedy="do not use these channels, or give a smaller coupling step",
)  # fmt: skip
ENERGY_RESIDUAL = RULES.add("energy residual too large", "energy", Grade.NOT_USABLE,
    condition=f"the coupling adds or loses more than {100 * LARGEST_RESIDUAL:g} % of the energy through a bond",
    why="the residual was about the error of the shock velocity: 0.25 % at 1 ms, 3.4 % at 4 ms "
        "(docs/explanation/coupling.md)",
    remedy="give a smaller coupling step",
)  # fmt: skip
ENERGY_DOUBTFUL = RULES.add("energy residual notable", "energy", Grade.LIMITED,
    condition=f"the coupling adds or loses more than {100 * DOUBTFUL_RESIDUAL:g} % of the energy through a bond",
    why="sound runs stay under 1 % (docs/explanation/coupling.md)",
    remedy="halve the coupling step and compare",
)  # fmt: skip
ENERGY_GOOD = RULES.add("energy residual small", "energy", Grade.USABLE,
    condition=f"no bond adds or loses more than {100 * DOUBTFUL_RESIDUAL:g} % of its energy",
    why="sound runs stay under 1 % (docs/explanation/coupling.md)",
)  # fmt: skip
NOT_CONVERGED = RULES.add("not converged", "convergence", Grade.NOT_USABLE,
    condition="the equilibrium start was not found, or steps did not converge",
    why="the result starts from, or contains, values that do not satisfy the equations of the system",
    remedy="give a smaller coupling step; the notes say which part did not converge",
)  # fmt: skip
ENDED_EARLY = RULES.add("ended early", "convergence", Grade.NOT_USABLE,
    condition="the run was interrupted, or could not continue",
    why="means, RMS values and spectra are those of a shorter part of the drive than requested",
    remedy="run it again; if the step became too small, allow a smaller step or a larger tolerance",
)  # fmt: skip
CONVERGED = RULES.add("converged", "convergence", Grade.USABLE,
    condition="the equilibrium start was found, every step converged, and the run reached its stop time",
    why="the run is complete",
)  # fmt: skip
MOSTLY_BEYOND_FIT = RULES.add("mostly outside the fitted velocities", "range of the models", Grade.NOT_USABLE,
    condition=f"a shock spends more than {100 * LARGEST_SHARE:g} % of the time outside the velocities that it was "
    "fitted on, or dissipates that share of its energy there",
    why="outside the record the curve is a straight continuation that no measurement supports: if the forces there are "
    "wrong by half, a tenth of the dissipated energy is wrong, which is more than setups of one car differ by",
    remedy="measure the shock at the velocities of this drive and fit it again",
)  # fmt: skip
BEYOND_FIT = RULES.add("outside the fitted velocities", "range of the models", Grade.LIMITED,
    condition=f"the same, above {100 * NOTABLE_SHARE:g} %",
    why="peaks depend on the continuation of the curve; below 1 %, forces that are wrong by half there change the "
    "dissipated energy by less than 0.5 %, which is about how far two runs of one shock on a rig differ",
    remedy="do not use peak forces; measure the shock at the velocities of this drive for more",
)  # fmt: skip
WITHIN_FIT = RULES.add("within the fitted velocities", "range of the models", Grade.USABLE,
    condition=f"at most {100 * NOTABLE_SHARE:g} % of the time and of the energy is outside",
    why="see above",
)  # fmt: skip
UNTESTED_SETTINGS = RULES.add("untested settings of a shock", "settings of the shocks", Grade.UNKNOWN,
    condition="`untested_settings` of a shock is 1 at any time: two or more adjusters, or an adjuster and the "
    "temperature, differ from the reference in a combination that was not measured",
    why="the effects of the adjusters are added there; whether one changes the effect of another is not known",
    remedy="measure the shock at this combination, or run it at a measured one",
)  # fmt: skip
FAR_BEYOND_SETTINGS = RULES.add("far beyond the settings of a shock", "settings of the shocks", Grade.UNKNOWN,
    condition="`beyond_settings` of a shock exceeds 1 at any time: a setting is beyond the measured ones by more than "
    "the nearest interval between them",
    why="adjusters act progressively near their stops; the continuation is a straight line",
    remedy="measure the shock at this setting, or run it at a measured one",
)  # fmt: skip
BEYOND_SETTINGS = RULES.add("beyond the settings of a shock", "settings of the shocks", Grade.LIMITED,
    condition="the same, above 0",
    why="there is no measurement beyond; the curve is continued in a straight line over the setting",
    remedy="measure the shock at this setting for more",
)  # fmt: skip
WITHIN_SETTINGS = RULES.add("within the settings of a shock", "settings of the shocks", Grade.USABLE,
    condition="both stay 0",
    why="the curve is interpolated between measured curves",
)  # fmt: skip
MOSTLY_TIRE_OFF = RULES.add("tire mostly off the ground", "range of the models", Grade.NOT_USABLE,
    condition=f"a tire is below zero load for more than {100 * LARGEST_SHARE:g} % of the time",
    why="a linear car pulls on the road there: the motion of that corner is not real meanwhile",
    remedy="use a smaller drive, or a car model whose tires can lift off",
)  # fmt: skip
TIRE_OFF = RULES.add("tire off the ground", "range of the models", Grade.LIMITED,
    condition="a tire is below zero load at all",
    why="a linear car pulls on the road there",
    remedy="do not use tire forces and motions near these times",
)  # fmt: skip
STATIC_LOAD_UNKNOWN = RULES.add("static tire force not given", "range of the models", Grade.LIMITED,
    condition="a car states no static tire force",
    why="lift-off of a tire cannot be detected, and tire forces are changes about an unknown load",
    remedy="give the car's static tire forces (parameter static_tire_force)",
)  # fmt: skip
