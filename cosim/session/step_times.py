"""Times at which steps of a run end [s]; times that differ by rounding only are treated as equal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eightpost.errors import InputError

Times = NDArray[np.float64]

#: Largest number of coupling steps of a run: their times take 0.8 GB.
MOST_STEPS = 1e8

#: Times that differ by less than this share of the run are treated as equal.
ROUNDING = 1e-9


def coupling_times(stop: float, step: float) -> Times:
    """Return the communication points (K+1,) [s]: whole multiples of the step, which do not drift, and the stop time.

    Args:
        stop: Duration of the run [s].
        step: Coupling step [s].

    Raises:
        InputError: The step is not positive, longer than the run, or so short that the steps do not fit into memory.
    """
    if not (np.isfinite(step) and 0.0 < step <= stop):
        raise InputError(f"the coupling step must be positive and at most the run ({stop} s), not {step!r} s")
    if stop / step > MOST_STEPS:
        raise InputError(
            f"a run of {stop:g} s in steps of {step:g} s has {stop / step:.3g} steps, at most {MOST_STEPS:g}; use "
            "larger steps or a shorter run"
        )
    count = max(1, int(np.ceil(stop / step * (1.0 - 1e-12))))
    times: Times = np.arange(count + 1, dtype=np.float64) * step
    times[-1] = stop
    return times


def step_sizes(times: Times, step: float) -> Times:
    """Return the steps between communication points (K,) [s]: `step` to the bit, except a shorter last one.

    Differences of times contain rounding errors that change from step to step. Components that cache values for a step
    size, such as exponentials, would compute them again in every step.

    Args:
        times: Communication points (K+1,) [s].
        step: Coupling step [s].
    """
    steps: Times = np.full(times.size - 1, step)
    rest = times[-1] - times[-2]
    if abs(rest - step) > ROUNDING * step:
        steps[-1] = rest
    return steps


def joined(times: Times, others: Times) -> Times:
    """Return all times in order; of times that differ by rounding only, those of the first array, to the bit.

    Args:
        times: Times in order (T,) [s], from the run's start to its end.
        others: Times within them (N,) [s].
    """
    place = np.searchsorted(times, others)
    near = np.minimum(np.abs(others - times[np.maximum(place - 1, 0)]), np.abs(others - times[place]))
    new = others[near > ROUNDING * times[-1]]
    return np.union1d(times, new) if new.size else times


def merged(times: Times) -> Times:
    """Return times (T,) [s] sorted, without repetitions that differ by rounding only."""
    times = np.sort(times)
    kept: Times = times[np.append(np.diff(times) > ROUNDING * times[-1], True)]
    return kept


def among(times: Times, chosen: Times, stop: float) -> NDArray[np.bool_]:
    """Return whether each time (T,) [s] equals one of the chosen ones (R,) [s], except for rounding.

    Args:
        times: Times to check.
        chosen: Chosen times, in order.
        stop: Duration of the run [s].
    """
    place = np.searchsorted(chosen, times)
    after = np.abs(times - chosen[np.clip(place, 0, chosen.size - 1)])
    before = np.abs(times - chosen[np.clip(place - 1, 0, chosen.size - 1)])
    found: NDArray[np.bool_] = np.minimum(after, before) < ROUNDING * stop
    return found
