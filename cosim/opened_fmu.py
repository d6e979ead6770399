"""Common part of components that are FMUs, in this process or another."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.component import Capabilities, Variable
from cosim.fmu_failure import Place, failure_text
from cosim.fmu_file import FmuFile
from cosim.fmu_log import Messages
from eightpost.errors import StepError
from eightpost.validity import Validity


class OpenedFmu:
    """File of an FMU, the state of its run, and the error report of a failed call.

    Args:
        fmu: Unpacked FMU.
        name: Name of the component.
        messages: Messages of the FMU.
    """

    def __init__(self, fmu: FmuFile, name: str, messages: Messages) -> None:
        self._fmu, self._name, self._messages = fmu, name, messages
        self._inputs: dict[str, float] = {}
        self._time = 0.0
        self._changed: dict[str, None] = {}

    @property
    def variables(self) -> Mapping[str, Variable]:
        """All variables by name."""
        return self._fmu.variables

    @property
    def capabilities(self) -> Capabilities:
        """Abilities declared in modelDescription.xml."""
        return self._fmu.capabilities

    @property
    def is_ours(self) -> bool:
        """Whether this project built the FMU, so that the state it keeps from run to run is known."""
        return self._fmu.is_ours

    @property
    def validity(self) -> Validity | None:
        """Range of validity of its model; None if the FMU has none."""
        return self._fmu.validity

    @property
    def identity(self) -> str:
        """GUID of the FMU."""
        return str(self._fmu.description.guid)

    @property
    def source(self) -> str:
        """File name of the FMU."""
        return self._fmu.path.name

    @property
    def messages(self) -> tuple[str, ...]:
        """Conditions of its results, changes to shared state, and its warnings and errors since it began, each once."""
        return (*self._fmu.conditions, *self._changed, *self._messages.all)

    def _stand(self, time: float, inputs: Mapping[str, float]) -> None:
        """Record the state of the run: the time [s], and inputs in their own units."""
        self._time, self._inputs = time, dict(inputs)

    def _failure(self, failed: str, why: str, to_do: str = "") -> StepError:
        """Return the error for a failed call: the failure, its cause, and the advice."""
        place = Place(self._name, self.source, self._time, self._inputs)
        messages = self._messages.last
        return StepError(failure_text(place, self.variables, failed=failed, why=why, messages=messages, to_do=to_do))
