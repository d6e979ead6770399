"""What an FMU that is opened as a component tells of itself, wherever it runs."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.component import Capabilities, Variable
from cosim.fmu_failure import Place, failure_text
from cosim.fmu_file import FmuFile
from cosim.fmu_log import Messages
from eightpost.errors import StepError
from eightpost.validity import Validity


class OpenedFmu:
    """An FMU's file, where its run stands, and the report of a call that failed there.

    Args:
        fmu: The unpacked file.
        name: Name of the component.
        messages: Takes what the FMU says.
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
        """What modelDescription.xml says it can do."""
        return self._fmu.capabilities

    @property
    def is_ours(self) -> bool:
        """Whether this project built the FMU: what it keeps from run to run is known."""
        return self._fmu.is_ours

    @property
    def validity(self) -> Validity | None:
        """How far its model can be used; None where it does not say."""
        return self._fmu.validity

    @property
    def identity(self) -> str:
        """The FMU's GUID."""
        return str(self._fmu.description.guid)

    @property
    def source(self) -> str:
        """The FMU's file name."""
        return self._fmu.path.name

    @property
    def messages(self) -> tuple[str, ...]:
        """What it logged as warnings or worse since it began, each once; what its results hang on, what it changed."""
        return (*self._fmu.conditions, *self._changed, *self._messages.all)

    def _stand(self, time: float, inputs: Mapping[str, float]) -> None:
        """Note where the run stands: the time [s], and inputs in their own units."""
        self._time, self._inputs = time, dict(inputs)

    def _failure(self, failed: str, why: str, to_do: str = "") -> StepError:
        """Return the error for a call that failed: what it did not do, why, and what to do about it."""
        place = Place(self._name, self.source, self._time, self._inputs)
        said = self._messages.last
        return StepError(failure_text(place, self.variables, failed=failed, why=why, said=said, to_do=to_do))
