"""An FMI 2.0 co-simulation FMU as a component, through fmpy."""

from __future__ import annotations

import ctypes
import logging
import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import fmpy
from fmpy import fmi2

from cosim.component import Capabilities, UnitDefinition, Variable
from eightpost.archive import extract_archive
from eightpost.errors import FmuError, StepError

logger = logging.getLogger(__name__)

_EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_REASONS = {"logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"}
_ERROR = 3  # fmi2Error
_LEVELS = (logging.DEBUG, logging.WARNING, logging.WARNING, logging.ERROR, logging.CRITICAL)


class FmuComponent:
    """One instance of an FMU; names are resolved once per set of names, so that stepping costs little.

    Raises:
        FmuError: The file is missing, damaged or unsafe, is not an FMI 2.0 co-simulation FMU, or has no binary for
            this platform.
    """

    def __init__(self, path: str | Path, name: str) -> None:
        self._path, self._name = Path(path), name
        self._folder = tempfile.mkdtemp(prefix="fmu_")
        # With the component, or with the interpreter: a component may begin more than once.
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        extract_archive(path, self._folder)
        self._description = _read_description(self._path, Path(self._folder))
        _check_platform(self._path, Path(self._folder))
        self._variables = _variables(self._description)
        self._capabilities = _capabilities(self._description)
        self._references = {v.name: v.valueReference for v in self._description.modelVariables}
        self._arrays: dict[tuple[str, ...], tuple[Any, Any]] = {}
        self._slave: Any = None
        self._messages: list[str] = []
        self._errors = 0

    @property
    def variables(self) -> Mapping[str, Variable]:
        """All variables by name."""
        return self._variables

    @property
    def capabilities(self) -> Capabilities:
        """What modelDescription.xml says it can do."""
        return self._capabilities

    @property
    def identity(self) -> str:
        """The FMU's GUID."""
        return str(self._description.guid)

    @property
    def source(self) -> str:
        """The FMU's file name."""
        return self._path.name

    @property
    def messages(self) -> tuple[str, ...]:
        """What it logged as warnings or worse since it began, each once."""
        return tuple(dict.fromkeys(self._messages))

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """Instantiate, set parameters, set up the experiment and enter initialization."""
        self._messages.clear()
        self._call("instantiate", self._instantiate)
        for name, value in parameters.items():
            self._call_without_error(f"set {name} = {value!r}", self._set_parameter, name, value)
        self._call("set up the experiment", self._slave.setupExperiment, startTime=start, stopTime=stop)
        self._call("enter initialization", self._slave.enterInitializationMode)

    def end_initialization(self) -> None:
        """Leave initialization mode."""
        self._call_without_error("leave initialization", self._slave.exitInitializationMode)
        self._call("limit its log", self._limit_log)

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set real inputs."""
        references, buffer = self._buffers(names)
        buffer[:] = values
        self._call("set inputs", self._slave.fmi2SetReal, self._slave.component, references, len(buffer), buffer)

    def set_derivatives(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set first derivatives of real inputs."""
        references, _ = self._buffers(names)
        count = len(names)
        orders, slopes = (ctypes.c_int * count)(*[1] * count), (ctypes.c_double * count)(*values)
        arguments = (self._slave.component, references, count, orders, slopes)
        self._call("set input derivatives", self._slave.fmi2SetRealInputDerivatives, *arguments)

    def get(self, names: Sequence[str]) -> list[float]:
        """Return real variables."""
        references, buffer = self._buffers(names)
        self._call("get outputs", self._slave.fmi2GetReal, self._slave.component, references, len(buffer), buffer)
        return list(buffer)

    def step(self, time: float, step: float) -> None:
        """Do one step; its end is a point of no return."""
        self._call(
            f"step from {time:g} s by {step:g} s",
            self._slave.fmi2DoStep,
            self._slave.component,
            time,
            step,
            1,
        )

    def finish(self) -> None:
        """Terminate and free the instance; the component may begin again."""
        slave, self._slave = self._slave, None
        if slave is not None:
            try:
                slave.terminate()
            except Exception as error:  # an FMU that failed may refuse to terminate; it is freed all the same
                logger.debug("%s: terminate: %s", self._name, error)
            slave.freeInstance()

    def _instantiate(self) -> None:
        self._slave = fmi2.FMU2Slave(
            guid=self._description.guid,
            unzipDirectory=self._folder,
            modelIdentifier=self._description.coSimulation.modelIdentifier,
            instanceName=self._name,
        )
        self._callbacks = fmi2.fmi2CallbackFunctions()
        self._callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._log)
        self._callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        self._callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        self._slave.instantiate(callbacks=self._callbacks, loggingOn=True)

    def _limit_log(self) -> None:
        """From here on log only what goes wrong: a debug message in every step would cost more than the step."""
        declared = {category.name for category in self._description.logCategories}
        wanted = sorted(declared & _REASONS)
        self._slave.setDebugLogging(bool(wanted), wanted)

    def _log(self, _environment: Any, _instance: Any, status: int, _category: Any, message: Any) -> None:
        text = message.decode("utf-8", "replace") if isinstance(message, bytes) else str(message)
        logger.log(_LEVELS[min(max(status, 0), 4)], "%s: %s", self._name, text)
        self._errors += status >= _ERROR
        if status > 0:
            self._messages.append(text.strip())

    def _set_parameter(self, name: str, value: float | bool | str) -> None:
        kind, references = self._variables[name].type, [self._references[name]]
        if kind == "Real":
            self._slave.setReal(references, [value])
        elif kind == "Boolean":
            self._slave.setBoolean(references, [bool(value)])
        elif kind == "String":
            self._slave.setString(references, [str(value)])
        else:
            self._slave.setInteger(references, [int(value)])

    def _buffers(self, names: Sequence[str]) -> tuple[Any, Any]:
        key = tuple(names)
        if key not in self._arrays:
            references = (ctypes.c_uint * len(key))(*[self._references[name] for name in key])
            self._arrays[key] = references, (ctypes.c_double * len(key))()
        return self._arrays[key]

    def _call(self, what: str, function: Any, *arguments: Any, **options: Any) -> None:
        try:
            function(*arguments, **options)
        except (fmpy.fmi1.FMICallException, OSError, AttributeError) as error:
            raise self._failure(what, str(error)) from error

    def _failure(self, what: str, error: str) -> StepError:
        said = "; ".join(dict.fromkeys(self._messages[-3:])) or "it gave no reason"
        return StepError(f"component {self._name!r} ({self._path.name}) failed to {what}: {error} It said: {said}")

    def _call_without_error(self, what: str, function: Any, *arguments: Any) -> None:
        """Call where an error in the log counts too: some FMUs (PythonFMU's) can say it nowhere else."""
        errors = self._errors
        self._call(what, function, *arguments)
        if self._errors > errors:
            raise self._failure(what, "it logged an error.")


def _read_description(path: Path, folder: Path) -> Any:
    if not (folder / "modelDescription.xml").is_file():
        raise FmuError(f"{path}: is not an FMU: there is no modelDescription.xml at its top")
    try:
        description = fmpy.read_model_description(str(folder), validate=False)
    except Exception as error:  # fmpy lets through whatever its XML reader raises
        raise FmuError(f"{path}: its modelDescription.xml cannot be read ({error})") from error
    if not str(description.fmiVersion).startswith("2."):
        raise FmuError(f"{path}: is an FMI {description.fmiVersion} FMU; export it as FMI 2.0 for co-simulation")
    if description.coSimulation is None:
        raise FmuError(f"{path}: is for model exchange only; export it for co-simulation")
    return description


def _check_platform(path: Path, folder: Path) -> None:
    binaries = folder / "binaries"
    platforms = sorted(p.name for p in binaries.iterdir() if p.is_dir()) if binaries.is_dir() else []
    if fmpy.platform not in platforms:
        raise FmuError(
            f"{path}: has no binary for this platform ({fmpy.platform}), only for: {', '.join(platforms) or 'none'}; "
            "ask for one that does or compile it from its sources"
        )


def _capabilities(description: Any) -> Capabilities:
    flags = description.coSimulation
    return Capabilities(
        interpolates_inputs=bool(flags.canInterpolateInputs),
        variable_step=bool(flags.canHandleVariableCommunicationStepSize),
        state=bool(flags.canGetAndSetFMUstate),
    )


def _variables(description: Any) -> dict[str, Variable]:
    units = {unit.name: _unit(unit) for unit in description.unitDefinitions}
    direct = {unknown.variable.name: unknown.dependencies for unknown in description.outputs}
    inputs = frozenset(v.name for v in description.modelVariables if v.causality == "input")
    return {v.name: _variable(v, units, direct, inputs) for v in description.modelVariables}


def _variable(
    v: Any, units: Mapping[str, UnitDefinition], direct: Mapping[str, Any], inputs: frozenset[str]
) -> Variable:
    declared = v.unit or (v.declaredType.unit if v.declaredType is not None else None)
    depends = direct.get(v.name)
    # Where a model states no dependencies, FMI lets it depend on everything.
    known = inputs if depends is None else frozenset(other.name for other in depends)
    return Variable(
        name=v.name,
        causality=v.causality or "local",
        variability=v.variability or "continuous",
        type=v.type,
        unit=units.get(declared, UnitDefinition(declared, {"?": 1})) if declared else None,
        start=v.start,
        minimum=_limit(v, v.min),
        maximum=_limit(v, v.max),
        direct=known & inputs if v.causality == "output" else frozenset(),
    )


def _limit(v: Any, text: Any) -> float | None:
    return float(text) if text is not None and v.type in ("Real", "Integer") else None


def _unit(unit: Any) -> UnitDefinition:
    base = unit.baseUnit
    if base is None:
        return UnitDefinition(unit.name, {"?": 1})
    exponents = {name: getattr(base, name) for name in _EXPONENTS if getattr(base, name)}
    return UnitDefinition(unit.name, exponents, base.factor, base.offset)
