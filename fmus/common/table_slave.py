"""A PythonFMU slave whose variables come from a table: names, references and start values of interface.toml.

The builder copies this file into a separately named package for each FMU, so that two FMUs in one process never share
code. Standard library and pythonfmu only.
"""

import json
from math import isfinite
from pathlib import Path
from xml.etree.ElementTree import Element

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Status

_KINDS = {"Real": Real, "Boolean": Boolean}


class TableSlave(Fmi2Slave):
    """Slave that keeps every variable in `self.values`; a model reads inputs and parameters there and writes outputs.

    No exception may leave a slave, because pythonfmu answers one with fmi2Fatal and damages the interpreter's memory.
    So errors are logged with their reason, the old values are kept, and the next step is rejected (fmi2Discard); the
    step after that is accepted again. Parameters that contradict each other make every step fail until they are
    corrected, and a failed initialization makes all steps fail.

    A model defines three methods: `initialise` (a consistent start from inputs and parameters), `advance` (one step)
    and `refresh` (the parameters have changed).
    """

    def __init__(self, table_file, **kwargs):
        super().__init__(**kwargs)
        # Not next to __file__: Python keeps the module of the first instance, whose folder may have been deleted.
        table = json.loads(Path(kwargs["resources"], table_file).read_text(encoding="utf-8"))
        self.modelName = table["identifier"]
        self.description = table["description"]
        self.model = table["model"]
        self.values = {}
        self.state = []
        self.initialising = True
        self.stale = True
        self.refused = None
        self.started = False
        for row in table["variables"]:
            self._register(row)

    def to_xml(self, model_options=None):
        """Return an empty element: the builder writes modelDescription.xml, and pythonfmu would evaluate the model."""
        return Element("fmiModelDescription")

    def initialise(self):
        """Set outputs and state from inputs and parameters."""
        raise NotImplementedError

    def advance(self, step):
        """Advance state and outputs by `step` [s] with the inputs held."""
        raise NotImplementedError

    def refresh(self):
        """Read the parameters again after a change."""

    def _register(self, row):
        name, reference = row["name"], row["reference"]
        variable = _KINDS[row["type"]](
            name,
            causality=Fmi2Causality[row["causality"]],
            variability=Fmi2Variability[row["variability"]],
            getter=lambda: self._get(name),
            setter=lambda value: self._set(row, value),
        )
        variable.value_reference = reference
        self.vars[reference] = variable
        self.values[name] = row["start"] if row["start"] is not None else 0.0

    def _get(self, name):
        if self.initialising and self.stale:
            refused = self.refused
            self._guarded(self._start)
            # Not again until something is set; the end of initialization tries again in any case.
            self.refused, self.stale = refused, False
        return self.values[name]

    def _set(self, row, value):
        if reason := self._reason_to_refuse(row, value):
            self._refuse(reason)
            return
        self.values[row["name"]] = value
        if self.initialising or row["causality"] == "parameter":
            self.stale = True

    def _reason_to_refuse(self, row, value):
        name, low, high = row["name"], row["min"], row["max"]
        if row["causality"] not in ("input", "parameter"):
            return f"{name} is an {row['causality']} variable and cannot be set"
        if row["variability"] == "fixed" and not self.initialising:
            return f"{name} is fixed: set it before initialization ends"
        if row["type"] == "Real" and not isfinite(value):
            return f"{name} = {value!r} is not finite"
        if (low is not None and value < low) or (high is not None and value > high):
            return f"{name} = {value!r} is not between {low} and {high} [{row['unit']}]"
        return None

    def _refuse(self, reason):
        self.refused = reason
        self.log(reason, Fmi2Status.error, "logStatusError")

    def _guarded(self, action, *arguments):
        """Call a function that may fail; return whether it succeeded."""
        try:
            action(*arguments)
        except Exception as error:
            self._refuse(str(error) or type(error).__name__)
            return False
        return True

    def _update(self):
        self.refresh()
        self.stale = False

    def _start(self):
        self._update()
        self.initialise()

    def exit_initialization_mode(self):
        self.started = self._guarded(self._start)
        self.initialising = False

    def do_step(self, current_time, step_size):
        if not self.started:
            self._refuse("initialization failed; reset, correct the errors logged before, and initialize again")
        elif not (isfinite(step_size) and step_size > 0.0):
            self._refuse(f"a step of {step_size!r} s from {current_time!r} s: it must be positive")
        elif self.stale:
            self._guarded(self._update)
        if self.refused:
            self.refused = None
            return False
        done = self._guarded(self.advance, step_size)
        self.refused = None
        return done

    # All names and the internal state, so that a restored state continues bit for bit (pythonfmu saves names only).
    def _get_fmu_state(self):
        return {
            "values": dict(self.values),
            "state": list(self.state),
            "initialising": self.initialising,
            "started": self.started,
        }

    @staticmethod
    def _fmu_state_from_bytes(state):
        try:
            return json.loads(state)
        except ValueError:
            return {}

    def _set_fmu_state(self, state):
        self._guarded(self._restore, state)

    def _restore(self, state):
        self.values = dict(state["values"])
        self.state = list(state["state"])
        self.initialising, self.started = state["initialising"], state["started"]
        self.stale = True

    def get_real(self, vrs):
        return [float(self._read(vr, Real)) for vr in vrs]

    def get_boolean(self, vrs):
        return [bool(self._read(vr, Boolean)) for vr in vrs]

    def set_real(self, vrs, values):
        self._write(vrs, values, Real)

    def set_boolean(self, vrs, values):
        self._write(vrs, values, Boolean)

    def get_integer(self, vrs):
        return [int(self._read(vr, None)) for vr in vrs]

    def get_string(self, vrs):
        return [str(self._read(vr, None)) for vr in vrs]

    def set_integer(self, vrs, values):
        self._write(vrs, values, None)

    def set_string(self, vrs, values):
        self._write(vrs, values, None)

    def _known(self, reference, kind):
        variable = self.vars.get(reference)
        if kind is None or not isinstance(variable, kind):
            self._refuse(f"value reference {reference} is not a {kind.__name__ if kind else 'known'} variable")
            return None
        return variable

    def _read(self, reference, kind):
        variable = self._known(reference, kind)
        return variable.getter() if variable else 0.0

    def _write(self, references, values, kind):
        for reference, value in zip(references, values, strict=True):
            if variable := self._known(reference, kind):
                variable.setter(value)
