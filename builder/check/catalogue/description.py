"""Rules for the content of modelDescription.xml."""

from __future__ import annotations

from builder.check.rules import Level, Rule

_E = Level.ERROR
_D = Level.DROP_IN
_H = Level.HINT
_XML = "FMI 2.2.1"
_UNITS = "FMI 2.2.2"
_VARIABLES = "FMI 2.2.7"
_STRUCTURE = "FMI 2.2.8"
_CAPABILITIES = "FMI 4.3.1"
_ANYWHERE = "drop-in: runs anywhere"
_COUPLING = "drop-in: couples correctly"
_ROBUST = "drop-in: robust"
_HONEST = "drop-in: honest capabilities"
_PACKAGE = "drop-in: packaging"

# Identity
WELL_FORMED = Rule("xml-wellformed", _E, "modelDescription.xml is well-formed", _XML, "correct the XML")
ENCODING = Rule(
    "xml-encoding",
    _E,
    "modelDescription.xml is UTF-8",
    "FMI 2.2",
    "encode it as UTF-8 and declare that in its first line",
)
VERSION = Rule("fmi-version", _E, "fmiVersion is 2.0", _XML, 'write fmiVersion="2.0", also for 2.0.1 to 2.0.4')
CO_SIMULATION = Rule("co-simulation", _D, "The FMU offers co-simulation", _CAPABILITIES, "export it for co-simulation")
GUID = Rule("guid-present", _E, "There is a GUID", _XML, "add the attribute guid")
GUID_PLAIN = Rule(
    "guid-plain",
    _D,
    "The GUID contains plain characters only",
    _XML,
    "use letters, digits, hyphens and braces: some importers escape other characters incorrectly",
)
IDENTIFIER = Rule(
    "model-identifier",
    _E,
    "modelIdentifier is a C name",
    _CAPABILITIES,
    "use letters, digits and underscores, and do not start with a digit",
)
FILE_NAME = Rule(
    "file-name",
    _H,
    "The file is named after its modelIdentifier",
    "drop-in: packaging",
    "rename the file: some importers look for that name",
)
DATE = Rule(
    "date-format",
    _D,
    "generationDateAndTime is YYYY-MM-DDThh:mm:ssZ",
    _XML,
    "write it in UTC with a Z, or omit it",
)
ABOUT = Rule(
    "about",
    _D,
    "Description, author, version, license and generationTool are present",
    _PACKAGE,
    "add the missing attributes",
)
EXPERIMENT = Rule(
    "default-experiment", _D, "There is a default experiment", "FMI 2.2.5", "add startTime, stopTime and stepSize"
)
EXPERIMENT_SENSE = Rule(
    "experiment-sense",
    _E,
    "The default experiment is valid",
    "FMI 2.2.5",
    "use a stop time after the start time, and a positive step size and tolerance",
)
CATEGORIES = Rule("log-categories", _E, "Names of log categories are unique", "FMI 2.2.4", "rename or remove one")

# Variables
NAMES = Rule("variable-unique", _E, "Variable names are unique", _VARIABLES, "rename one")
ALIASES = Rule(
    "alias-set",
    _E,
    "Variables with the same value reference have the same unit, and only one can be set",
    _VARIABLES,
    "give each variable its own value reference",
)
COMBINATION = Rule(
    "variable-combination",
    _E,
    "Causality, variability and initial are a valid combination",
    _VARIABLES,
    "see the tables of section 2.2.7",
)
INITIAL_INPUT = Rule(
    "initial-on-input", _E, "Inputs and time have no attribute initial", _VARIABLES, "remove the attribute initial"
)
CONTINUOUS = Rule(
    "continuous-real",
    _E,
    "Only Real variables are continuous",
    _VARIABLES,
    'write variability="discrete", fixed or tunable',
)
START_MISSING = Rule("start-required", _E, "Required start values are present", _VARIABLES, "add the start value")
START_FORBIDDEN = Rule(
    "start-forbidden", _E, "Calculated variables have no start value", _VARIABLES, "remove the start value"
)
START_VALUE = Rule(
    "start-value",
    _E,
    "Start values, min, max and nominal are finite values of their type",
    _VARIABLES,
    "write a finite value",
)
NOMINAL = Rule(
    "nominal",
    _D,
    "Nominal values are positive",
    _COUPLING,
    "write a typical magnitude of the variable: hosts divide by it, and use it for their tolerances",
)
START_RANGE = Rule("start-range", _E, "min <= start <= max", _VARIABLES, "correct the start value or the range")
DECLARED_TYPE = Rule(
    "declared-type", _E, "Declared types exist and match the variable's type", "FMI 2.2.3", "declare the type"
)
INDEPENDENT = Rule("independent", _E, "At most one variable is independent", _VARIABLES, "keep one")
DESCRIPTIONS = Rule(
    "variable-description",
    _H,
    "Every input, output and parameter has a description",
    _PACKAGE,
    "add a short description",
)

# Units
UNIT_DEFINED = Rule(
    "unit-defined", _E, "All used units and display units are defined", _UNITS, "define them in UnitDefinitions"
)
UNIT_TWICE = Rule("unit-unique", _E, "Units and display units are defined once", _UNITS, "keep one")
UNIT_MISSING = Rule(
    "unit-missing", _D, "Every Real has a unit", _COUPLING, 'add a unit ("1" for dimensionless variables)'
)
UNIT_BASE = Rule(
    "unit-base",
    _D,
    "Every unit has its SI exponents",
    _COUPLING,
    "add a BaseUnit, so that importers can convert the unit",
)
UNIT_EXPONENTS = Rule(
    "unit-exponents", _D, "SI exponents match the unit's name", _COUPLING, "correct the exponents of the BaseUnit"
)
UNIT_FACTOR = Rule(
    "unit-factor",
    _D,
    "Factor and offset match the unit's name",
    _COUPLING,
    "correct factor or offset: SI value = factor * value + offset",
)
DISPLAY_FACTOR = Rule(
    "display-factor",
    _D,
    "Factors and offsets of display units are correct",
    _COUPLING,
    "correct factor or offset: display value = factor * value + offset",
)

# Structure
OUTPUTS = Rule(
    "outputs-complete", _E, "ModelStructure/Outputs lists every output once", _STRUCTURE, "list exactly the outputs"
)
INITIAL_UNKNOWNS = Rule(
    "initial-unknowns",
    _E,
    "InitialUnknowns lists every unknown of initialization once",
    _STRUCTURE,
    "list outputs and states with initial calculated or approx, and calculated parameters",
)
INITIAL_ORDER = Rule("initial-unknowns-order", _E, "InitialUnknowns are ordered by index", _STRUCTURE, "sort them")
INDEX = Rule(
    "unknown-index",
    _E,
    "Unknowns and dependencies are indices of variables",
    _STRUCTURE,
    "use indices that count from 1 in the order of ModelVariables",
)
KINDS = Rule(
    "dependencies-kind",
    _E,
    "dependenciesKind has one valid keyword per dependency",
    _STRUCTURE,
    "write as many keywords as dependencies",
)
DEPENDENCY_TWICE = Rule("dependency-unique", _E, "Each dependency is listed once", _STRUCTURE, "list each index once")
DERIVATIVES = Rule(
    "derivatives-complete",
    _E,
    "Derivatives lists variables that are derivatives",
    _STRUCTURE,
    "add the attribute derivative to them",
)
DEPENDENCIES = Rule(
    "dependencies-declared",
    _D,
    "Dependencies are declared",
    _COUPLING,
    "declare them: otherwise importers assume that every output depends on every input, and detect algebraic loops",
)
KNOWNS = Rule(
    "dependency-known",
    _D,
    "Outputs depend on inputs, states and time, not on parameters or outputs",
    _STRUCTURE,
    "list inputs and states only",
)

# Capabilities
SERIALIZE = Rule(
    "serialize-needs-state",
    _E,
    "canSerializeFMUstate is only declared with canGetAndSetFMUstate",
    _CAPABILITIES,
    "declare both or neither",
)
EXPORTS = Rule(
    "exports",
    _E,
    "Every function that the flags and ModelExchange require is exported",
    "FMI 2.1, 3.2, 4.3.1",
    "export it, or remove the flag or the element ModelExchange",
)
RUNS_ALONE = Rule(
    "execution-tool", _D, "The FMU needs no execution tool", _ANYWHERE, "export it as a self-contained FMU"
)
TOOL_HONEST = Rule(
    "execution-tool-honest",
    _D,
    "A binary that needs another program declares needsExecutionTool",
    _ANYWHERE,
    'write needsExecutionTool="true", or link the runtime into it',
)
VARIABLE_STEP = Rule(
    "variable-step",
    _D,
    "Any communication step size is accepted",
    _COUPLING,
    "support variable step sizes and declare canHandleVariableCommunicationStepSize",
)
MANY = Rule(
    "instantiate-many", _D, "Several instances in a process are allowed", _ROBUST, "keep all data in the instance"
)
OFFERED = Rule(
    "capabilities-offered",
    _H,
    "FMU state, input derivatives and directional derivatives are supported",
    _HONEST,
    "support them: masters can then couple stiff systems better",
)
