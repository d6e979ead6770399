"""Rules for the behaviour of an FMU when its functions are called."""

from __future__ import annotations

from builder.check.rules import Level, Rule

_E = Level.ERROR
_D = Level.DROP_IN
_H = Level.HINT
_VARIABLES = "FMI 2.2.7"
_STRUCTURE = "FMI 2.2.8"
_CAPABILITIES = "FMI 4.3.1"
_ORDER = "FMI 4.2.4"
_VALUES = "FMI 2.1.7"
_STATE = "FMI 2.1.8"
_ANYWHERE = "drop-in: runs anywhere"
_COUPLING = "drop-in: couples correctly"
_ROBUST = "drop-in: robust"
_HONEST = "drop-in: honest capabilities"

# Behaviour in a valid run
CRASH = Rule(
    "crash", _E, "Valid calls neither crash nor hang", "FMI 2.1.3",
    "run the FMU in a debugger up to the call in the message",
)  # fmt: skip
CRASH_MISUSE = Rule(
    "crash-misuse", _D, "Invalid calls neither crash nor hang", _ROBUST, "check the arguments and the order of calls"
)
LOADS = Rule("loads", _E, "The binary of this platform can be loaded", "FMI 2.1.2", "check the libraries that it needs")
SIMULATES = Rule(
    "simulates", _E, "It simulates from start values with constant inputs", _ORDER, "read its log messages"
)
EXCITED = Rule(
    "simulates-excited", _D, "It simulates with varying inputs", _COUPLING,
    "accept all inputs between min and max, or state the range",
)  # fmt: skip
FINITE = Rule("finite-outputs", _D, "Outputs are finite", _COUPLING, "look for a division by zero or an unstable step")
DETERMINISM = Rule(
    "deterministic", _D, "Repeated runs give bit-identical results", _ROBUST,
    "look for uninitialized memory and for state outside the instance",
)  # fmt: skip
START_AGREES = Rule(
    "start-agrees", _E, "Start values in the XML and in the binary are equal", _VARIABLES,
    "generate both from one source",
)  # fmt: skip
LOGGED_ERROR = Rule(
    "error-logged-while-fine", _D, "A run that succeeds logs no error", "drop-in: log",
    "return fmi2Error, or log a warning",
)  # fmt: skip
LOG_CATEGORY = Rule(
    "log-undeclared", _D, "Messages are logged in declared categories", "FMI 2.2.4", "declare the category"
)
LOG_TEXT = Rule(
    "log-text", _D, "Messages are formatted UTF-8 text", "drop-in: log",
    "format the message before logging it: many hosts cannot",
)  # fmt: skip
TIME = Rule(
    "time-variable", _E, "The time variable equals the communication point", _VARIABLES, "update it in fmi2DoStep"
)

FIRST_OUTPUTS = Rule(
    "first-outputs", _D, "Outputs before the first step are valid at its start", _COUPLING,
    "calculate the outputs from the start values and inputs when initialization mode is left",
)  # fmt: skip
MODEL_EXCHANGE = Rule(
    "model-exchange", _E, "The functions that ModelExchange declares can be called", "FMI 3.2",
    "implement the functions of model exchange, or remove the element ModelExchange",
)  # fmt: skip

# State machine
GUID_CHECKED = Rule(
    "guid-checked", _E, "A wrong GUID is rejected", "FMI 2.1.5", "compare the argument with the binary's own GUID"
)
STOP_TIME = Rule("stop-time", _E, "A step past the stop time is rejected", "FMI 2.1.6", "return fmi2Error")
ORDER = Rule(
    "call-order", _D, "Calls in the wrong order are rejected", _ORDER, "track the instance's state and return fmi2Error"
)
STEP = Rule(
    "step-arguments", _D, "Steps from a wrong point, of zero, negative or NaN length are rejected", "FMI 4.2.2",
    "compare the arguments with the instance's time",
)  # fmt: skip
LOCKED = Rule(
    "locked", _D, "Outputs cannot be set, nor fixed parameters after initialization", _VALUES, "return fmi2Error"
)
REFUSAL_LOGGED = Rule(
    "refusal-logged", _D, "A rejected call logs the reason", "drop-in: log",
    "log an error, even if debug logging is off",
)  # fmt: skip
USABLE = Rule(
    "usable-after-refusal", _D, "After a rejected call the instance runs again after fmi2Reset", _ROBUST,
    "reject the call before anything is changed",
)  # fmt: skip
NEVER_FATAL = Rule(
    "never-fatal", _D, "No rejection is fatal", _ROBUST, "return fmi2Error: fmi2Fatal ends all instances"
)
TUNABLE = Rule(
    "tunable", _E, "Tunable parameters and inputs can be set between steps", _VALUES,
    "accept them, or declare them fixed",
)  # fmt: skip

# Values
BAD_REFERENCE = Rule(
    "bad-reference", _D, "Unknown value references are rejected", _ROBUST, "validate the reference before using it"
)
NOT_FINITE = Rule("not-finite", _D, "NaN and infinity are rejected", _ROBUST, "check the values that are set")
OUT_OF_RANGE = Rule(
    "out-of-range", _D, "Values outside min and max are rejected", _ROBUST, "check the values that are set"
)
OLD_VALUE = Rule(
    "old-value", _D, "After a rejected value the old value remains and the next step succeeds", _ROBUST,
    "check all values before setting any",
)  # fmt: skip
NULL_ARGUMENT = Rule("null-argument", _D, "NULL arrays are rejected", _ROBUST, "check pointers")
FREE_NULL = Rule("free-null", _E, "fmi2FreeInstance(NULL) does nothing", "FMI 2.1.5", "return immediately")

# Reset, states
RESET = Rule(
    "reset", _E, "fmi2Reset restores the state after fmi2Instantiate", "FMI 2.1.6",
    "set all variables, including parameters, to their start values",
)  # fmt: skip
RESET_BITS = Rule(
    "reset-bits", _D, "A run after fmi2Reset gives bit-identical results", _ROBUST, "also reset internal memory"
)
RESET_ENDED = Rule(
    "reset-ended", _D, "An FMU that has ended the simulation itself runs again after fmi2Reset", _ROBUST,
    "reset the condition that ended the simulation",
)  # fmt: skip
ROLLBACK = Rule("rollback", _E, "An FMU state restores the instance", _STATE, "save everything that a step depends on")
ROLLBACK_BITS = Rule(
    "rollback-bits", _D, "An FMU state restores the instance exactly", _HONEST, "save everything that a step depends on"
)
STATE_FREED = Rule(
    "state-freed", _E, "fmi2FreeFMUstate sets the pointer to NULL and ignores NULL", _STATE, "set it to NULL"
)
SERIALIZED = Rule(
    "serialized-state", _E, "Serialized bytes restore another instance", _STATE, "write values, not pointers"
)
OTHER_PROCESS = Rule(
    "serialized-process", _E, "Serialized bytes restore an instance in another process", _STATE,
    "write values, not pointers",
)  # fmt: skip
SAME_BYTES = Rule(
    "serialized-same", _D, "A state always serializes to the same bytes", _HONEST, "write no padding and no pointers"
)
CORRUPT = Rule("serialized-corrupt", _D, "Damaged bytes are rejected", _HONEST, "add a checksum and check the size")

# Dependencies, derivatives, steps
HIDDEN = Rule("dependency-hidden", _E, "Every observed dependency is declared", _STRUCTURE, "declare it")
FALSE = Rule(
    "dependency-false", _H, "Every declared dependency is observed", _COUPLING,
    "remove it if it never occurs: importers would detect algebraic loops",
)  # fmt: skip
FALSE_VELOCITY = Rule(
    "dependency-velocity", _D, "A velocity does not declare feedthrough that does not exist", _COUPLING,
    "remove it: the coupling with a shock would look like an algebraic loop",
)  # fmt: skip
DIRECTIONAL = Rule(
    "directional-derivative", _E, "Directional derivatives match finite differences", "FMI 2.1.9",
    "correct them, or clear providesDirectionalDerivative",
)  # fmt: skip
OUTPUT_DERIVATIVES = Rule(
    "output-derivatives", _E, "Output derivatives are available up to maxOutputDerivativeOrder", "FMI 4.2.1",
    "return them, or set maxOutputDerivativeOrder to 0",
)  # fmt: skip
INPUT_DERIVATIVES = Rule(
    "input-derivatives", _E, "Input derivatives are accepted if canInterpolateInputs is true", "FMI 4.2.1",
    "accept order 1 for every continuous Real input, or clear the flag",
)  # fmt: skip
INTERPOLATES = Rule(
    "interpolates", _D, "Input derivatives change the result", _HONEST,
    "use them in the step, or clear canInterpolateInputs",
)  # fmt: skip
STEPS = Rule(
    "irregular-steps", _E, "Steps of any length are accepted if canHandleVariableCommunicationStepSize is true",
    _CAPABILITIES, "accept them, or clear the flag",
)  # fmt: skip
STEPS_DISCARDED = Rule(
    "irregular-discarded", _D, "Irregular steps are not discarded, from any start time", _COUPLING,
    "reach t+h for any h > 0",
)  # fmt: skip

# Instances, environment
INSTANCES = Rule(
    "instances", _E, "Two instances in a process do not affect each other", _CAPABILITIES,
    "keep all data in the instance, or declare canBeInstantiatedOnlyOncePerProcess",
)  # fmt: skip
FIFTY = Rule("fifty-instances", _D, "Fifty simultaneous instances work", _ROBUST, "allocate per instance")
THREADS = Rule(
    "threads", _D, "Instances in four threads give the same results as one alone", _ROBUST, "share no writable data"
)
GROWTH = Rule(
    "growth", _D, "Creating and freeing instances leaks no memory", _ROBUST, "free everything in fmi2FreeInstance"
)
STEP_GROWTH = Rule(
    "step-growth", _D, "Steps leak no memory", _ROBUST,
    "free in fmi2DoStep what it allocates, or allocate it once per instance",
)  # fmt: skip
FILES = Rule(
    "working-folder", _D, "It leaves no files in the working folder", _ANYWHERE,
    "write no files: the folder belongs to the host, and many instances share it",
)  # fmt: skip
LOCALE = Rule(
    "locale", _D, "It does not change the locale", _ROBUST, "set no locale: the host reads and writes files with it"
)
PRINTS = Rule(
    "standard-output", _D, "It prints nothing to standard output", "drop-in: log",
    "use the logger: a host may write its results to standard output",
)  # fmt: skip
BARE = Rule(
    "bare-environment", _D, "It runs with an empty environment in a read-only folder", _ANYWHERE,
    "read no environment variable, write no file",
)  # fmt: skip
ODD_PATH = Rule(
    "odd-path", _D, "It runs from a path with spaces, umlauts, %, # and +", _ROBUST,
    "decode the resource location as a URI, or do not use it",
)  # fmt: skip

# Shocks and vehicles
SIGN = Rule(
    "shock-sign", _D, "A positive velocity gives a more positive force than a negative one", "drop-in: ports",
    "change the sign of velocity or force",
)  # fmt: skip
PASSIVE = Rule(
    "passive", _D, "A closed cycle dissipates energy", "drop-in: ports",
    "look for a curve with a wrong slope, or for a wrong sign of the lag",
)  # fmt: skip
RECIPROCAL = Rule(
    "vehicle-sign", _D, "A positive shock force extends the suspension", "drop-in: ports",
    "change the sign of velocity or force",
)  # fmt: skip
