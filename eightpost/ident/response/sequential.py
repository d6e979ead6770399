"""Sequential estimators: the responses to the rig first, then those to the shock forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Complex
from eightpost.errors import InputError
from eightpost.ident.response.averaged import POWER_FLOOR, Recipe, regress, response_from
from eightpost.ident.response.frequency_response import FrequencyResponse
from eightpost.ident.response.records import Blocks, Record, Records, Spectra

#: Relative difference of two measured drives below which they are the same drive [1].
_SAME_DRIVE = 0.1


@dataclass(frozen=True, slots=True)
class Sequential:
    """Estimator of Eq 5.42 to 5.45 with H1: first the baseline, then the part of the rest that each force explains.

    The records are the baseline and one alternate test per force, in the order of `forces`. The baseline's shocks must
    be linear (with force differences of zero); nonlinear forces cause errors that are not detected. The global H1 does
    not need linear shocks.
    """

    blocks: Blocks  #: Division of the records into blocks.
    forces: tuple[str, ...]  #: Names of the inputs that are shock-force differences.
    power_floor: float = POWER_FLOOR  #: Relative amplitude below which an input is dropped [1]; see `H1`.

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate the responses to the rig's inputs from the first record, and to each force from its own record."""
        rig, forces = _split(records, self.forces)
        baseline = self._rig(records.only([0], rig))
        parts = [baseline]
        for test, force in enumerate(forces, start=1):
            spectra = self.blocks.spectra(records.only([test], [*rig, force]))
            rest = _unexplained(spectra, baseline.H)
            alone = records.only([test], [force])
            parts.append(self._solve(alone, Spectra(spectra.frequency, spectra.U[..., -1:], rest, *spectra[3:])))
        return _joined(records, parts)

    def _rig(self, records: Records) -> FrequencyResponse:
        return self._solve(records, self.blocks.spectra(records))

    def _solve(self, records: Records, spectra: Spectra) -> FrequencyResponse:
        names = [channel.name for channel in records.inputs]
        solved = regress(spectra.U, spectra.Y, power_floor=self.power_floor, names=names)
        return response_from(records, spectra, solved, solved.H)


@dataclass(frozen=True, slots=True)
class SameDrive:
    """Estimator of Eq 4.24 to 4.26 for tests with one drive file: force differences explain changes of the outputs.

    The records are the baseline and one alternate test per force, in the order of `forces`, with the same drive sample
    by sample. With one force it is the dissertation's two-experiment method for the quarter car.
    """

    recipe: Recipe  #: Estimator of both steps.
    forces: tuple[str, ...]  #: Names of the inputs that are shock-force differences.

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate the responses to the rig's inputs from the first record, and to each force from its own record."""
        rig, forces = _split(records, self.forces)
        parts = [self.recipe.estimate(records.only([0], rig))]
        for test, force in enumerate(forces, start=1):
            parts.append(self.recipe.estimate(_change(records, test, rig, force)))
        return _joined(records, parts)


def _split(records: Records, forces: Sequence[str]) -> tuple[list[int], list[int]]:
    """Return the positions of the rig's inputs and of the forces."""
    names = [channel.name for channel in records.inputs]
    for force in forces:
        if force not in names:
            raise InputError(f"the force {force!r} is not an input; the inputs are {', '.join(names)}")
    if len(records.tests) != 1 + len(forces):
        raise InputError(
            f"{len(records.tests)} records given, but {len(forces)} forces need {1 + len(forces)}: the baseline and "
            "one alternate test per force, in the order of the forces"
        )
    columns = [names.index(force) for force in forces]
    for test, force in enumerate(forces, start=1):
        sizes = [float(np.abs(records.tests[test].u[j]).max()) for j in columns]
        if sizes[test - 1] < max(sizes):
            other = forces[int(np.argmax(sizes))]
            what = f"record {test + 1} changes {other} more than {force}; give the alternate tests in order"
            raise InputError(what)
    return [j for j in range(len(names)) if j not in columns], columns


def _unexplained(spectra: Spectra, H: Complex) -> Complex:
    """Return the part of the outputs that the rig's inputs do not explain (K, R, p), Eq 5.44."""
    explained = spectra.U[..., :-1] @ H.transpose(2, 1, 0)
    return np.asarray(spectra.Y - explained, dtype=np.complex128)


def _change(records: Records, test: int, rig: Sequence[int], force: int) -> Records:
    """Return the change of the outputs (Eq 4.26) with one force as the input."""
    before, after = records.tests[0], records.tests[test]
    columns = list(rig)
    if before.u.shape != after.u.shape or not _alike(before.u[columns], after.u[columns]):
        raise InputError(f"the drive of record {test + 1} differs from that of the first one; use Sequential")
    changed = Record(after.u[[force]] - before.u[[force]], after.y - before.y)
    return Records((changed,), records.rate, (records.inputs[force],), records.outputs)


def _alike(before: NDArray[np.float64], after: NDArray[np.float64]) -> bool:
    """Return whether two drives (m, N) differ by no more than sensor errors."""
    return bool((np.std(after - before, axis=1) <= _SAME_DRIVE * np.std(before, axis=1)).all())


def _joined(records: Records, parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Return one response with the columns of all parts, in the order of the records' inputs."""
    names = [name for part in parts for name in part.input_names]
    order = [names.index(channel.name) for channel in records.inputs]
    partial = [_column_coherence(part) for part in parts]
    variance = [part.variance for part in parts if part.variance is not None]
    return FrequencyResponse(
        parts[0].frequency,
        np.concatenate([part.H for part in parts], axis=1)[:, order],
        records.inputs,
        records.outputs,
        parts[0].coherence,
        np.concatenate(partial, axis=1)[:, order],
        np.concatenate(variance, axis=1)[:, order] if len(variance) == len(parts) else None,
    )


def _column_coherence(part: FrequencyResponse) -> NDArray[np.float64]:
    """Return the partial coherence (p, m, K), which for a single force is the ordinary coherence."""
    if part.partial_coherence is not None:
        return part.partial_coherence
    if len(part.inputs) == 1 and part.coherence is not None:
        return part.coherence[:, None, :]
    return np.full(part.H.shape, np.nan)
