"""Sequential estimators: the rig's inputs from a baseline test, then each shock force from a test of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import InputError
from eightpost.ident.response.averaged import POWER_FLOOR, answer
from eightpost.ident.response.blocks import Blocks, Spectra
from eightpost.ident.response.frequency_response import FrequencyResponse
from eightpost.ident.response.records import Record, Records
from eightpost.ident.response.regression import regress

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.response.estimate import Recipe

    Complex = NDArray[np.complex128]

#: Two measured drives that differ by less than this part of their size are the same drive.
_SAME_DRIVE = 0.1


@dataclass(frozen=True, slots=True)
class Sequential:
    """Eq 5.42 to 5.45 by H1: baseline first, then what each shock force explains of the rest.

    The records are the baseline and one alternate test per force, in the order of `forces`. The baseline's shocks must
    be linear (its force differences zero): what else they do goes wrong unnoticed; the global H1 has no such need.

    Attributes:
        blocks: How the records are cut up.
        forces: The inputs that are shock-force differences.
        power_floor: As in `H1`.
    """

    blocks: Blocks
    forces: tuple[str, ...]
    power_floor: float = POWER_FLOOR

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate the rig's inputs from the first record and each force from its own."""
        rig, forces = _split(records, self.forces)
        baseline = self._rig(records.only([0], rig))
        parts = [baseline]
        for test, force in enumerate(forces, start=1):
            spectra = self.blocks.spectra(records.only([test], [*rig, force]))
            left = _unexplained(spectra, baseline.H)
            alone = records.only([test], [force])
            parts.append(self._answer(alone, Spectra(spectra.frequency, spectra.U[..., -1:], left, *spectra[3:])))
        return _joined(records, parts)

    def _rig(self, records: Records) -> FrequencyResponse:
        return self._answer(records, self.blocks.spectra(records))

    def _answer(self, records: Records, spectra: Spectra) -> FrequencyResponse:
        names = [channel.name for channel in records.inputs]
        solved = regress(spectra.U, spectra.Y, power_floor=self.power_floor, names=names)
        return answer(records, spectra, solved, solved.H)


@dataclass(frozen=True, slots=True)
class SameDrive:
    """Eq 4.24 to 4.26: every test has the same drivefile, so the force differences explain the change of the outputs.

    The records are the baseline and one alternate test per force, in the order of `forces`, sample by sample the same
    drive. With one force it is the dissertation's two-experiment way for the quarter car.

    Attributes:
        recipe: How each of the two steps estimates.
        forces: The inputs that are shock-force differences.
    """

    recipe: Recipe
    forces: tuple[str, ...]

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate the rig's inputs from the first record and each force from its own."""
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
            raise InputError(f"the force {force!r} is no input; the inputs are {', '.join(names)}")
    if len(records.tests) != 1 + len(forces):
        raise InputError(
            f"{len(records.tests)} records given; {len(forces)} forces take {1 + len(forces)}: the baseline and one "
            "alternate test per force, in their order"
        )
    columns = [names.index(force) for force in forces]
    for test, force in enumerate(forces, start=1):
        sizes = [float(np.abs(records.tests[test].u[j]).max()) for j in columns]
        if sizes[test - 1] < max(sizes):
            other = forces[int(np.argmax(sizes))]
            raise InputError(f"record {test + 1} moves {other} more than {force}; give the alternate tests in order")
    return [j for j in range(len(names)) if j not in columns], columns


def _unexplained(spectra: Spectra, H: Complex) -> Complex:
    """Return what the rig's inputs leave of the outputs (K, R, p), Eq 5.44."""
    explained = spectra.U[..., :-1] @ H.transpose(2, 1, 0)
    return np.asarray(spectra.Y - explained, dtype=np.complex128)


def _change(records: Records, test: int, rig: Sequence[int], force: int) -> Records:
    """Return the change of the outputs (Eq 4.26) with one force as the input."""
    before, after = records.tests[0], records.tests[test]
    columns = list(rig)
    if before.u.shape != after.u.shape or not _alike(before.u[columns], after.u[columns]):
        raise InputError(f"record {test + 1} has not the drive of the first; take Sequential, which does not need that")
    changed = Record(after.u[[force]] - before.u[[force]], after.y - before.y)
    return Records((changed,), records.rate, (records.inputs[force],), records.outputs)


def _alike(before: NDArray[np.float64], after: NDArray[np.float64]) -> bool:
    """Say whether two drives (m, N) differ by no more than sensors do."""
    return bool((np.std(after - before, axis=1) <= _SAME_DRIVE * np.std(before, axis=1)).all())


def _joined(records: Records, parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Put the columns of all parts in the order of the records' inputs."""
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
    """Return (p, m, K): the partial coherence, which for a force alone is the ordinary one."""
    if part.partial_coherence is not None:
        return part.partial_coherence
    if len(part.inputs) == 1 and part.coherence is not None:
        return part.coherence[:, None, :]
    return np.full(part.H.shape, np.nan)
