"""What modelDescription.xml says."""

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
WELL_FORMED = Rule("xml-wellformed", _E, "modelDescription.xml is well-formed", _XML, "mend the XML")
ENCODING = Rule(
    "xml-encoding", _E, "modelDescription.xml is UTF-8", "FMI 2.2", "encode it as UTF-8 and say so in its first line"
)
VERSION = Rule("fmi-version", _E, "fmiVersion is 2.0", _XML, 'write fmiVersion="2.0", also for 2.0.1 to 2.0.4')
CO_SIMULATION = Rule("co-simulation", _D, "The FMU offers co-simulation", _CAPABILITIES, "export it for co-simulation")
GUID = Rule("guid-present", _E, "There is a GUID", _XML, "give the attribute guid")
GUID_PLAIN = Rule(
    "guid-plain",
    _D,
    "The GUID has plain characters only",
    _XML,
    "use letters, digits, hyphens and braces: some importers escape the rest wrongly",
)
IDENTIFIER = Rule(
    "model-identifier",
    _E,
    "modelIdentifier is a C name",
    _CAPABILITIES,
    "use letters, digits and underscores, no digit first",
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
    "write it in UTC with a Z, or leave it out",
)
ABOUT = Rule(
    "about",
    _D,
    "Description, author, version, license and generationTool are given",
    _PACKAGE,
    "give the missing attributes",
)
EXPERIMENT = Rule(
    "default-experiment", _D, "A default experiment is given", "FMI 2.2.5", "give startTime, stopTime and stepSize"
)
EXPERIMENT_SENSE = Rule(
    "experiment-sense",
    _E,
    "The default experiment makes sense",
    "FMI 2.2.5",
    "stop after the start, with positive step and tolerance",
)
CATEGORIES = Rule("log-categories", _E, "Log categories are named once each", "FMI 2.2.4", "rename or remove one")

# Variables
NAMES = Rule("variable-unique", _E, "Variable names are unique", _VARIABLES, "rename one")
ALIASES = Rule(
    "alias-set",
    _E,
    "Variables with one value reference agree in unit, and only one can be set",
    _VARIABLES,
    "give them value references of their own",
)
COMBINATION = Rule(
    "variable-combination",
    _E,
    "Causality, variability and initial fit each other",
    _VARIABLES,
    "see the tables of section 2.2.7",
)
INITIAL_INPUT = Rule(
    "initial-on-input", _E, "No initial on inputs and on time", _VARIABLES, "remove the attribute initial"
)
CONTINUOUS = Rule(
    "continuous-real",
    _E,
    "Only Real variables are continuous",
    _VARIABLES,
    'write variability="discrete", fixed or tunable',
)
START_MISSING = Rule(
    "start-required", _E, "There is a start value where one is required", _VARIABLES, "give the start value"
)
START_FORBIDDEN = Rule(
    "start-forbidden", _E, "No start value on what is calculated", _VARIABLES, "remove the start value"
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
    "Nominal values are above zero",
    _COUPLING,
    "write the size that the variable usually has: hosts divide by it, and take it for their tolerances",
)
START_RANGE = Rule("start-range", _E, "min <= start <= max", _VARIABLES, "mend the start value or the range")
DECLARED_TYPE = Rule(
    "declared-type", _E, "Declared types exist and are of the variable's type", "FMI 2.2.3", "declare the type"
)
INDEPENDENT = Rule("independent", _E, "At most one variable is the independent one", _VARIABLES, "keep one")
DESCRIPTIONS = Rule(
    "variable-description",
    _H,
    "Every input, output and parameter is described",
    _PACKAGE,
    "say in a few words what it is",
)

# Units
UNIT_DEFINED = Rule(
    "unit-defined", _E, "Units and display units that are used are defined", _UNITS, "define them in UnitDefinitions"
)
UNIT_TWICE = Rule("unit-unique", _E, "Units and display units are defined once", _UNITS, "keep one")
UNIT_MISSING = Rule(
    "unit-missing", _D, "Every Real has a unit", _COUPLING, 'give a unit ("1" where there is no dimension)'
)
UNIT_BASE = Rule(
    "unit-base", _D, "Every unit has its SI exponents", _COUPLING, "give a BaseUnit, so that importers can convert"
)
UNIT_EXPONENTS = Rule(
    "unit-exponents", _D, "SI exponents are those of the unit's name", _COUPLING, "mend the exponents of the BaseUnit"
)
UNIT_FACTOR = Rule(
    "unit-factor",
    _D,
    "Factor and offset are those of the unit's name",
    _COUPLING,
    "mend factor or offset: SI value = factor * value + offset",
)
DISPLAY_FACTOR = Rule(
    "display-factor",
    _D,
    "Display units convert rightly",
    _COUPLING,
    "mend factor or offset: display value = factor * value + offset",
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
    "list outputs and states that are calculated or approx, and calculated parameters",
)
INITIAL_ORDER = Rule("initial-unknowns-order", _E, "InitialUnknowns are ordered by index", _STRUCTURE, "sort them")
INDEX = Rule(
    "unknown-index",
    _E,
    "Unknowns and dependencies are indices of variables",
    _STRUCTURE,
    "indices count from 1 in the order of ModelVariables",
)
KINDS = Rule(
    "dependencies-kind",
    _E,
    "dependenciesKind has one known word per dependency",
    _STRUCTURE,
    "give as many words as dependencies",
)
DEPENDENCY_TWICE = Rule("dependency-unique", _E, "A dependency is named once", _STRUCTURE, "name each index once")
DERIVATIVES = Rule(
    "derivatives-complete",
    _E,
    "Derivatives lists variables that are derivatives",
    _STRUCTURE,
    "give them the attribute derivative",
)
DEPENDENCIES = Rule(
    "dependencies-declared",
    _D,
    "Dependencies are declared",
    _COUPLING,
    "declare them: without, importers assume that everything depends on everything, and find algebraic loops",
)
KNOWNS = Rule(
    "dependency-known",
    _D,
    "Outputs depend on inputs, states and time, not on parameters or outputs",
    _STRUCTURE,
    "name inputs and states only",
)

# Capabilities
SERIALIZE = Rule(
    "serialize-needs-state",
    _E,
    "canSerializeFMUstate comes with canGetAndSetFMUstate",
    _CAPABILITIES,
    "declare both or none",
)
EXPORTS = Rule(
    "exports",
    _E,
    "Every function that the flags and ModelExchange promise is exported",
    "FMI 2.1, 3.2, 4.3.1",
    "export it, or remove the flag or the element ModelExchange",
)
RUNS_ALONE = Rule(
    "execution-tool", _D, "The FMU needs no execution tool", _ANYWHERE, "export it with all that it needs inside"
)
TOOL_HONEST = Rule(
    "execution-tool-honest",
    _D,
    "A binary that needs another program says needsExecutionTool",
    _ANYWHERE,
    'write needsExecutionTool="true", or link the runtime into it',
)
VARIABLE_STEP = Rule(
    "variable-step",
    _D,
    "Any communication step is accepted",
    _COUPLING,
    "support it: canHandleVariableCommunicationStepSize",
)
MANY = Rule(
    "instantiate-many", _D, "There may be several instances in a process", _ROBUST, "keep all data in the instance"
)
OFFERED = Rule(
    "capabilities-offered",
    _H,
    "FMU state, input derivatives and directional derivatives are offered",
    _HONEST,
    "offer them: masters couple stiff systems better",
)
