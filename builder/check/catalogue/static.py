"""Rules for the content of an archive and of its modelDescription.xml, which are checked without running the FMU."""

from __future__ import annotations

from builder.check.rules import Level, Rule

_E = Level.ERROR
_D = Level.DROP_IN
_H = Level.HINT
_ZIP = "FMI 2.3"
_ANYWHERE = "drop-in: runs anywhere"
_COUPLING = "drop-in: couples correctly"
_HONEST = "drop-in: honest capabilities"
_PACKAGE = "drop-in: packaging"
_XML = "FMI 2.2.1"
_UNITS = "FMI 2.2.2"
_VARIABLES = "FMI 2.2.7"
_STRUCTURE = "FMI 2.2.8"
_CAPABILITIES = "FMI 4.3.1"
_ROBUST = "drop-in: robust"

# Third-party checkers
FMPY = Rule("fmpy-validate", _E, "No finding of fmpy validate", "FMPy", "see the message")
FMUTOOL = Rule("fmutool-check", _E, "No finding of fmutool -check", "fmu-manipulation-toolbox", "see the message")

# Archive
ROOT = Rule(
    "archive-root", _E, "modelDescription.xml is at the top of the archive", _ZIP, "zip the content, not its folder"
)
PATHS = Rule("archive-path", _E, "Entries are relative, inside, with forward slashes", _ZIP, "write the archive again")
DUPLICATES = Rule("archive-duplicate", _E, "No entry occurs twice", _ZIP, "write each file once")
COMPRESSION = Rule("archive-compression", _E, "Entries are deflated or stored", _ZIP, "zip with deflate, unencrypted")
CASE = Rule(
    "archive-case", _D, "No two entries differ only in upper and lower case", _ANYWHERE,
    "rename one: on Windows and macOS one overwrites the other",
)  # fmt: skip
DATES = Rule(
    "archive-dates", _D, "The archive is reproducible: its entries have one fixed date", _ANYWHERE,
    "give all entries the same date when zipping",
)  # fmt: skip
STRAY = Rule(
    "archive-stray", _H, "There are no unknown files at the top of the archive", _ZIP,
    "remove the file, or move it to resources/ or extra/",
)  # fmt: skip

# Binaries
BINARY = Rule(
    "binary-present", _E, "There is a binary or there are sources", _ZIP,
    "add binaries/<platform>/<modelIdentifier>, or sources",
)  # fmt: skip
BINARY_NAME = Rule(
    "binary-name", _E, "A platform's folder has a binary named after the modelIdentifier", _ZIP, "rename it"
)
BINARY_FORMAT = Rule(
    "binary-format", _E, "Binaries are complete and in the format of their platform", _ZIP, "build the binary again"
)
BINARY_MACHINE = Rule(
    "binary-machine", _E, "Binaries are for the processor of their folder", _ZIP, "move the binary to its own folder"
)
PLATFORM_NAME = Rule(
    "platform-name", _H, "Platform folders have standard names", _ZIP, "use win32, win64, linux32, linux64, darwin64"
)
PLATFORMS = Rule("platforms", _D, "There are binaries for all common platforms", _ANYWHERE, "compile for them too")
UNIVERSAL = Rule(
    "darwin-universal", _D, "The darwin64 library is universal", _ANYWHERE,
    "merge x86_64 and arm64: FMPy opens only darwin64",
)  # fmt: skip
OTHER_EXPORTS = Rule(
    "exports-only", _D, "Only FMI functions are exported", _ANYWHERE,
    "hide the other symbols: two FMUs in a process may use each other's symbols",
)  # fmt: skip
ALL_EXPORTS = Rule(
    "exports-all", _D, "Every FMI function of co-simulation is exported", _ANYWHERE,
    "export the function and return fmi2Error: some importers load all functions",
)  # fmt: skip
NEEDED = Rule("needed-libraries", _D, "Only libc and libm are needed", _ANYWHERE, "link the others statically")
IMPORTS = Rule(
    "dll-imports", _D, "Only system and UCRT libraries are imported", _ANYWHERE, "link the runtime statically"
)
GLIBC = Rule("glibc", _D, "GLIBC 2.17 is enough", _ANYWHERE, "build against an older glibc")
UNDEFINED_PYTHON = Rule(
    "undefined-python", _D, "No symbol of a Python interpreter is undefined", _ANYWHERE,
    "hosts without Python cannot load it: export native code",
)  # fmt: skip

# Sources and documents
SOURCE_FILES = Rule(
    "source-files", _E, "The files listed in SourceFiles exist", "FMI 4.3.1", "add the files or correct the list"
)
SOURCES = Rule(
    "sources", _H, "There are sources, so that the FMU can be built for other platforms", _HONEST,
    "add sources/ and SourceFiles",
)  # fmt: skip
REBUILD = Rule("sources-compile", _D, "The sources compile", _HONEST, "make `fmpy compile` work")
REBUILT_SAME = Rule(
    "rebuilt-same", _D, "The rebuilt FMU gives the same outputs", _HONEST,
    "include the sources that the binary was built from, and compile with -ffp-contract=off",
)  # fmt: skip
DOCUMENTATION = Rule(
    "documentation", _D, "There is a documentation/index.html that is not empty", _PACKAGE,
    "describe the model, its equations and its limits there",
)  # fmt: skip
LICENSE = Rule(
    "license", _D, "There is a licence in documentation/licenses, and no file there is empty", _PACKAGE,
    "add the licence text",
)  # fmt: skip
ICON = Rule("icon", _H, "There is a model.png", _PACKAGE, "add a PNG of about 100 x 100")
ICON_FORMAT = Rule("icon-format", _D, "model.png is a complete PNG", _ZIP, "write the file again as PNG")
TERMINALS = Rule(
    "terminals", _H, "There are terminals", _PACKAGE,
    "group the variables of a port in terminalsAndIcons/terminalsAndIcons.xml",
)  # fmt: skip
TERMINALS_VALID = Rule(
    "terminals-valid", _D, "Terminals are well-formed and refer to existing variables",
    "FMI 2.0.4, terminals of FMI 3.0 2.4.9", "correct terminalsAndIcons.xml",
)  # fmt: skip
TERMINALS_FIT = Rule(
    "terminals-consistent",
    _D,
    "Terminals match the causality of their variables: none is local; forces flow out of shocks and into vehicles",
    "FMI 2.2.7, FMI 3.0 2.4.9",
    "correct the variableKind or the name of the variable",
)
REFERENCE = Rule(
    "reference-results", _D, "The binary reproduces the reference results in the archive", _COUPLING,
    "compute the reference results again with this binary",
)  # fmt: skip
REFERENCE_GIVEN = Rule(
    "reference-given", _H, "There are reference results", _COUPLING,
    "add inputs, outputs and options in the format of the FMI cross-check to extra/",
)  # fmt: skip

# Identity
WELL_FORMED = Rule("xml-wellformed", _E, "modelDescription.xml is well-formed", _XML, "correct the XML")
ENCODING = Rule(
    "xml-encoding", _E, "modelDescription.xml is UTF-8", "FMI 2.2",
    "encode it as UTF-8 and declare that in its first line",
)  # fmt: skip
VERSION = Rule("fmi-version", _E, "fmiVersion is 2.0", _XML, 'write fmiVersion="2.0", also for 2.0.1 to 2.0.4')
CO_SIMULATION = Rule("co-simulation", _D, "The FMU offers co-simulation", _CAPABILITIES, "export it for co-simulation")
GUID = Rule("guid-present", _E, "There is a GUID", _XML, "add the attribute guid")
GUID_PLAIN = Rule(
    "guid-plain", _D, "The GUID contains plain characters only", _XML,
    "use letters, digits, hyphens and braces: some importers escape other characters incorrectly",
)  # fmt: skip
IDENTIFIER = Rule(
    "model-identifier", _E, "modelIdentifier is a C name", _CAPABILITIES,
    "use letters, digits and underscores, and do not start with a digit",
)  # fmt: skip
FILE_NAME = Rule(
    "file-name", _H, "The file is named after its modelIdentifier", "drop-in: packaging",
    "rename the file: some importers look for that name",
)  # fmt: skip
DATE = Rule(
    "date-format", _D, "generationDateAndTime is YYYY-MM-DDThh:mm:ssZ", _XML, "write it in UTC with a Z, or omit it",
)  # fmt: skip
ABOUT = Rule(
    "about", _D, "Description, author, version, license and generationTool are present", _PACKAGE,
    "add the missing attributes",
)  # fmt: skip
EXPERIMENT = Rule(
    "default-experiment", _D, "There is a default experiment", "FMI 2.2.5", "add startTime, stopTime and stepSize"
)
EXPERIMENT_SENSE = Rule(
    "experiment-sense", _E, "The default experiment is valid", "FMI 2.2.5",
    "use a stop time after the start time, and a positive step size and tolerance",
)  # fmt: skip
CATEGORIES = Rule("log-categories", _E, "Names of log categories are unique", "FMI 2.2.4", "rename or remove one")

# Variables
NAMES = Rule("variable-unique", _E, "Variable names are unique", _VARIABLES, "rename one")
ALIASES = Rule(
    "alias-set", _E, "Variables with the same value reference have the same unit, and only one can be set", _VARIABLES,
    "give each variable its own value reference",
)  # fmt: skip
COMBINATION = Rule(
    "variable-combination", _E, "Causality, variability and initial are a valid combination", _VARIABLES,
    "see the tables of section 2.2.7",
)  # fmt: skip
INITIAL_INPUT = Rule(
    "initial-on-input", _E, "Inputs and time have no attribute initial", _VARIABLES, "remove the attribute initial"
)
CONTINUOUS = Rule(
    "continuous-real", _E, "Only Real variables are continuous", _VARIABLES,
    'write variability="discrete", fixed or tunable',
)  # fmt: skip
START_MISSING = Rule("start-required", _E, "Required start values are present", _VARIABLES, "add the start value")
START_FORBIDDEN = Rule(
    "start-forbidden", _E, "Calculated variables have no start value", _VARIABLES, "remove the start value"
)
START_VALUE = Rule(
    "start-value", _E, "Start values, min, max and nominal are finite values of their type", _VARIABLES,
    "write a finite value that the type holds",
)  # fmt: skip
NOMINAL = Rule(
    "nominal", _D, "Nominal values are positive", _COUPLING,
    "write a typical magnitude of the variable: hosts divide by it, and use it for their tolerances",
)  # fmt: skip
START_RANGE = Rule("start-range", _E, "min <= start <= max", _VARIABLES, "correct the start value or the range")
DECLARED_TYPE = Rule(
    "declared-type", _E, "Declared types exist and match the variable's type", "FMI 2.2.3", "declare the type"
)
INDEPENDENT = Rule("independent", _E, "At most one variable is independent", _VARIABLES, "keep one")
DESCRIPTIONS = Rule(
    "variable-description", _H, "Every input, output and parameter has a description", _PACKAGE,
    "add a short description",
)  # fmt: skip

# Units
UNIT_DEFINED = Rule(
    "unit-defined", _E, "All used units and display units are defined", _UNITS, "define them in UnitDefinitions"
)
UNIT_TWICE = Rule("unit-unique", _E, "Units and display units are defined once", _UNITS, "keep one")
UNIT_MISSING = Rule(
    "unit-missing", _D, "Every Real has a unit", _COUPLING, 'add a unit ("1" for dimensionless variables)'
)
UNIT_BASE = Rule(
    "unit-base", _D, "Every unit has its SI exponents", _COUPLING,
    "add a BaseUnit, so that importers can convert the unit",
)  # fmt: skip
UNIT_EXPONENTS = Rule(
    "unit-exponents", _D, "SI exponents match the unit's name", _COUPLING, "correct the exponents of the BaseUnit"
)
UNIT_FACTOR = Rule(
    "unit-factor", _D, "Factor and offset match the unit's name", _COUPLING,
    "correct factor or offset: SI value = factor * value + offset",
)  # fmt: skip
DISPLAY_FACTOR = Rule(
    "display-factor", _D, "Factors and offsets of display units are correct", _COUPLING,
    "correct factor or offset: display value = factor * value + offset",
)  # fmt: skip

# Structure
OUTPUTS = Rule(
    "outputs-complete", _E, "ModelStructure/Outputs lists every output once", _STRUCTURE, "list exactly the outputs"
)
INITIAL_UNKNOWNS = Rule(
    "initial-unknowns", _E, "InitialUnknowns lists every unknown of initialization once", _STRUCTURE,
    "list outputs and states with initial calculated or approx, and calculated parameters",
)  # fmt: skip
INITIAL_ORDER = Rule("initial-unknowns-order", _E, "InitialUnknowns are ordered by index", _STRUCTURE, "sort them")
INDEX = Rule(
    "unknown-index", _E, "Unknowns and dependencies are indices of variables", _STRUCTURE,
    "use indices that count from 1 in the order of ModelVariables",
)  # fmt: skip
KINDS = Rule(
    "dependencies-kind", _E, "dependenciesKind has one valid keyword per dependency", _STRUCTURE,
    "write as many keywords as dependencies",
)  # fmt: skip
DEPENDENCY_TWICE = Rule("dependency-unique", _E, "Each dependency is listed once", _STRUCTURE, "list each index once")
DERIVATIVES = Rule(
    "derivatives-complete", _E, "Derivatives lists variables that are derivatives", _STRUCTURE,
    "add the attribute derivative to them",
)  # fmt: skip
DEPENDENCIES = Rule(
    "dependencies-declared", _D, "Dependencies are declared", _COUPLING,
    "declare them: otherwise importers assume that every output depends on every input, and detect algebraic loops",
)  # fmt: skip
KNOWNS = Rule(
    "dependency-known", _D, "Outputs depend on inputs, states and time, not on parameters or outputs", _STRUCTURE,
    "list inputs and states only",
)  # fmt: skip

# Capabilities
SERIALIZE = Rule(
    "serialize-needs-state", _E, "canSerializeFMUstate is only declared with canGetAndSetFMUstate", _CAPABILITIES,
    "declare both or neither",
)  # fmt: skip
EXPORTS = Rule(
    "exports", _E, "Every function that the flags and ModelExchange require is exported", "FMI 2.1, 3.2, 4.3.1",
    "export it, or remove the flag or the element ModelExchange",
)  # fmt: skip
RUNS_ALONE = Rule(
    "execution-tool", _D, "The FMU needs no execution tool", _ANYWHERE, "export it as a self-contained FMU"
)
TOOL_HONEST = Rule(
    "execution-tool-honest", _D, "A binary that needs another program declares needsExecutionTool", _ANYWHERE,
    'write needsExecutionTool="true", or link the runtime into it',
)  # fmt: skip
VARIABLE_STEP = Rule(
    "variable-step", _D, "Any communication step size is accepted", _COUPLING,
    "support variable step sizes and declare canHandleVariableCommunicationStepSize",
)  # fmt: skip
MANY = Rule(
    "instantiate-many", _D, "Several instances in a process are allowed", _ROBUST, "keep all data in the instance"
)
OFFERED = Rule(
    "capabilities-offered", _H, "FMU state, input derivatives and directional derivatives are supported", _HONEST,
    "support them: masters can then couple stiff systems better",
)  # fmt: skip
