"""Common part of the objects that give a host the forces of shock FMUs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cosim.components.fmu_component import FmuComponent
from cosim.force_ports import Corners, Parameters, PortName


class ForceLoop:
    """Shock FMUs at the corners of a host's vehicle; see `ForceLaw` for the arguments and errors."""

    def __init__(
        self,
        fmu: str | Path | Sequence[str | Path],
        *,
        corners: Sequence[str] | None = None,
        ports: Mapping[str, PortName] | None = None,
        parameters: Parameters | None = None,
        engine: str = "auto",
    ) -> None:
        self._scalar = corners is None and isinstance(fmu, (str, Path))
        self._corners = Corners(fmu, corners=corners, ports=ports or {}, parameters=parameters or {}, engine=engine)
        for component in self._corners.components:
            self._check(component)
        motion = self._corners.motion
        self._clock, self._force = motion.clock, motion.force
        self._velocity, self._displacement = motion.trial[:, 0], motion.trial[:, 1]

    def _check(self, component: FmuComponent) -> None:
        """Raise an error if the loop needs what the FMU of a corner does not offer."""

    @property
    def corners(self) -> tuple[str, ...]:
        """Names of the corners, in the order of all arrays."""
        return tuple(self._corners.names)

    @property
    def time(self) -> float:
        """Time of the accepted point [s], up to which the FMUs have stepped."""
        return float(self._clock[0])

    @property
    def messages(self) -> tuple[str, ...]:
        """Warnings of all FMUs since the start, each once, with the name of the corner."""
        return tuple(f"{c._name}: {text}" for c in self._corners.components for text in c.messages)

    def start(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Start in equilibrium: the shock has moved at this velocity for a long time. A second call starts again.

        Args:
            time: Start time [s].
            velocity: Shock velocity [m/s], positive in compression, float or (N,).
            displacement: Shock displacement [m], float or (N,).

        Returns:
            Shock force [N], float or (N,).

        Raises:
            StepError: An FMU cannot be loaded, or refuses a value or the start.
            InputError: An input is not finite.
        """
        self._corners.start(time, velocity, displacement)
        return self._forces()

    def close(self) -> None:
        """End the run and unload the FMUs."""
        self._corners.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _operate(self, operation: int, time: float, velocity: Any, displacement: Any) -> None:
        self._clock[1] = time
        self._velocity[:] = velocity
        self._displacement[:] = displacement
        reason = self._corners.operate(operation)
        if reason:
            raise self._corners.error(reason)

    def _forces(self) -> Any:
        return self._force.item(0) if self._scalar else self._force.copy()
