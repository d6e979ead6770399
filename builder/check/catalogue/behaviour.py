"""What an FMU does when it is called."""

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

# What a legal run must do
CRASH = Rule(
    "crash",
    _E,
    "Legal calls neither crash nor hang",
    "FMI 2.1.3",
    "run the FMU in a debugger up to the call named here",
)
CRASH_MISUSE = Rule(
    "crash-misuse", _D, "Wrong calls neither crash nor hang", _ROBUST, "check the arguments and the order of calls"
)
LOADS = Rule(
    "loads", _E, "The binary of this platform can be loaded", "FMI 2.1.2", "look at the libraries that it needs"
)
SIMULATES = Rule("simulates", _E, "It simulates from start values with inputs held", _ORDER, "look at its log messages")
EXCITED = Rule(
    "simulates-excited",
    _D,
    "It simulates with moving inputs",
    _COUPLING,
    "accept all inputs between min and max, or state the range",
)
FINITE = Rule("finite-outputs", _D, "Outputs are finite", _COUPLING, "look for a division by zero or an unstable step")
DETERMINISM = Rule(
    "deterministic",
    _D,
    "The same run gives the same bits",
    _ROBUST,
    "look for uninitialized memory and for state outside the instance",
)
START_AGREES = Rule(
    "start-agrees", _E, "Start values in the XML are those in the binary", _VARIABLES, "generate both from one source"
)
LOGGED_ERROR = Rule(
    "error-logged-while-fine",
    _D,
    "A run that succeeds logs no error",
    "drop-in: log",
    "return fmi2Error, or log a warning",
)
LOG_CATEGORY = Rule(
    "log-undeclared", _D, "Messages are logged in declared categories", "FMI 2.2.4", "declare the category"
)
LOG_TEXT = Rule(
    "log-text",
    _D,
    "Messages are finished UTF-8 text",
    "drop-in: log",
    "fill the format in before logging: many hosts cannot",
)
TIME = Rule("time-variable", _E, "The time variable is at the communication point", _VARIABLES, "carry it with doStep")

FIRST_OUTPUTS = Rule(
    "first-outputs",
    _D,
    "Outputs before the first step are those at its beginning",
    _COUPLING,
    "calculate the outputs from the start values and inputs when initialization mode is left",
)
MODEL_EXCHANGE = Rule(
    "model-exchange",
    _E,
    "What ModelExchange declares can be called",
    "FMI 3.2",
    "implement the functions of model exchange, or remove the element ModelExchange",
)

# State machine
GUID_CHECKED = Rule(
    "guid-checked", _E, "A wrong GUID is refused", "FMI 2.1.5", "compare the argument with the binary's own GUID"
)
STOP_TIME = Rule("stop-time", _E, "A step past the stop time is refused", "FMI 2.1.6", "return fmi2Error")
ORDER = Rule(
    "call-order", _D, "Calls out of order are refused", _ORDER, "keep the state of the instance and return fmi2Error"
)
STEP = Rule(
    "step-arguments",
    _D,
    "Steps from another point, of no length, backwards or of NaN are refused",
    "FMI 4.2.2",
    "compare the arguments with the instance's time",
)
LOCKED = Rule("locked", _D, "Outputs and, once it runs, fixed parameters cannot be set", _VALUES, "return fmi2Error")
REFUSAL_LOGGED = Rule(
    "refusal-logged", _D, "A refused call says why", "drop-in: log", "log an error, with debug logging off too"
)
USABLE = Rule(
    "usable-after-refusal",
    _D,
    "After a refused call the instance runs again after fmi2Reset",
    _ROBUST,
    "refuse before anything is changed",
)
NEVER_FATAL = Rule("never-fatal", _D, "No refusal is fatal", _ROBUST, "return fmi2Error: fmi2Fatal ends all instances")
TUNABLE = Rule(
    "tunable",
    _E,
    "Tunable parameters and inputs can be set between steps",
    _VALUES,
    "accept them, or declare them fixed",
)

# Values
BAD_REFERENCE = Rule(
    "bad-reference", _D, "Unknown value references are refused", _ROBUST, "look the reference up before using it"
)
NOT_FINITE = Rule("not-finite", _D, "NaN and infinity are refused", _ROBUST, "check what is set")
OUT_OF_RANGE = Rule("out-of-range", _D, "Values outside min and max are refused", _ROBUST, "check what is set")
OLD_VALUE = Rule(
    "old-value",
    _D,
    "After a refused value the old one stays and the next step is fine",
    _ROBUST,
    "check all before setting any",
)
NULL_ARGUMENT = Rule("null-argument", _D, "NULL arrays are refused", _ROBUST, "check pointers")
FREE_NULL = Rule("free-null", _E, "fmi2FreeInstance(NULL) does nothing", "FMI 2.1.5", "return at once")

# Reset, states
RESET = Rule(
    "reset",
    _E,
    "fmi2Reset restores the state after fmi2Instantiate",
    "FMI 2.1.6",
    "set all variables, parameters too, to their start values",
)
RESET_BITS = Rule("reset-bits", _D, "A run after fmi2Reset gives the same bits", _ROBUST, "restore internal memory too")
RESET_ENDED = Rule(
    "reset-ended",
    _D,
    "After fmi2Reset an FMU that has ended the simulation by itself runs again",
    _ROBUST,
    "clear what ended the simulation",
)
ROLLBACK = Rule("rollback", _E, "An FMU state restores the instance", _STATE, "save all that a step depends on")
ROLLBACK_BITS = Rule(
    "rollback-bits", _D, "An FMU state restores the instance to the bit", _HONEST, "save all that a step depends on"
)
STATE_FREED = Rule(
    "state-freed", _E, "fmi2FreeFMUstate sets the pointer to NULL and ignores NULL", _STATE, "set it to NULL"
)
SERIALIZED = Rule(
    "serialized-state", _E, "Serialized bytes restore another instance", _STATE, "write values, not pointers"
)
OTHER_PROCESS = Rule(
    "serialized-process",
    _E,
    "Serialized bytes restore an instance in another process",
    _STATE,
    "write values, not pointers",
)
SAME_BYTES = Rule(
    "serialized-same", _D, "One state gives the same bytes each time", _HONEST, "write no padding and no pointers"
)
CORRUPT = Rule("serialized-corrupt", _D, "Damaged bytes are refused", _HONEST, "add a checksum and check the size")

# Dependencies, derivatives, steps
HIDDEN = Rule("dependency-hidden", _E, "Every dependency that shows is declared", _STRUCTURE, "declare it")
FALSE = Rule(
    "dependency-false",
    _H,
    "Every declared dependency shows",
    _COUPLING,
    "remove it if it is never there: importers find algebraic loops",
)
FALSE_VELOCITY = Rule(
    "dependency-velocity",
    _D,
    "A velocity does not claim a direct dependency that is not there",
    _COUPLING,
    "remove it: coupled with a shock it looks like an algebraic loop",
)
DIRECTIONAL = Rule(
    "directional-derivative",
    _E,
    "Directional derivatives equal differences",
    "FMI 2.1.9",
    "mend them, or clear providesDirectionalDerivative",
)
OUTPUT_DERIVATIVES = Rule(
    "output-derivatives",
    _E,
    "Output derivatives are given up to maxOutputDerivativeOrder",
    "FMI 4.2.1",
    "return them, or set maxOutputDerivativeOrder to 0",
)
INPUT_DERIVATIVES = Rule(
    "input-derivatives",
    _E,
    "Input derivatives are accepted where canInterpolateInputs",
    "FMI 4.2.1",
    "accept order 1 for every continuous Real input, or clear the flag",
)
INTERPOLATES = Rule(
    "interpolates",
    _D,
    "Input derivatives change the result",
    _HONEST,
    "use them in the step, or clear canInterpolateInputs",
)
STEPS = Rule(
    "irregular-steps",
    _E,
    "Steps of any length are taken where canHandleVariableCommunicationStepSize",
    _CAPABILITIES,
    "mend it, or clear the flag",
)
STEPS_DISCARDED = Rule(
    "irregular-discarded",
    _D,
    "Irregular steps are not discarded, from any start time",
    _COUPLING,
    "land on t+h for any h > 0",
)

# Instances, surroundings
INSTANCES = Rule(
    "instances",
    _E,
    "Two instances in a process do not disturb each other",
    _CAPABILITIES,
    "keep all data in the instance, or declare canBeInstantiatedOnlyOncePerProcess",
)
FIFTY = Rule("fifty-instances", _D, "Fifty instances at once work", _ROBUST, "allocate per instance")
THREADS = Rule(
    "threads", _D, "Instances in four threads give the same as alone", _ROBUST, "share nothing that is written"
)
GROWTH = Rule(
    "growth", _D, "Creating and freeing instances does not grow the process", _ROBUST, "free all in fmi2FreeInstance"
)
STEP_GROWTH = Rule(
    "step-growth",
    _D,
    "Steps do not grow the process",
    _ROBUST,
    "free in fmi2DoStep what it allocates, or allocate it once per instance",
)
FILES = Rule(
    "working-folder",
    _D,
    "It leaves no file in the working folder",
    _ANYWHERE,
    "write no file: the folder is the host's, and many instances share it",
)
LOCALE = Rule(
    "locale", _D, "It leaves the locale as it is", _ROBUST, "set no locale: the host reads and writes its files by it"
)
PRINTS = Rule(
    "standard-output",
    _D,
    "It prints nothing on standard output",
    "drop-in: log",
    "say it through the logger: a host may write its results there",
)
BARE = Rule(
    "bare-environment",
    _D,
    "It runs with an empty environment in a read-only folder",
    _ANYWHERE,
    "read no variable, write no file",
)
ODD_PATH = Rule(
    "odd-path",
    _D,
    "It runs from a path with spaces, umlauts, %, # and +",
    _ROBUST,
    "decode the resource location as a URI, or do not read it",
)

# Shocks and vehicles
SIGN = Rule(
    "shock-sign",
    _D,
    "A positive velocity gives a more positive force than a negative one",
    "drop-in: ports",
    "turn the sign of velocity or of force",
)
PASSIVE = Rule(
    "passive",
    _D,
    "A closed cycle dissipates energy",
    "drop-in: ports",
    "look for a curve that turns over, or for a wrong sign of the lag",
)
RECIPROCAL = Rule(
    "vehicle-sign",
    _D,
    "A positive shock force extends the suspension",
    "drop-in: ports",
    "turn the sign of velocity or of force",
)
