"""What an archive holds: files, binaries, sources and documents."""

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

# Other makers' checkers
FMPY = Rule("fmpy-validate", _E, "No finding of fmpy validate", "FMPy", "see the message")
FMUTOOL = Rule("fmutool-check", _E, "No finding of fmutool -check", "fmu-manipulation-toolbox", "see the message")

# Archive
ROOT = Rule(
    "archive-root", _E, "modelDescription.xml is at the top of the archive", _ZIP, "zip the content, not its folder"
)
PATHS = Rule("archive-path", _E, "Entries are relative, inside, with forward slashes", _ZIP, "write the archive anew")
DUPLICATES = Rule("archive-duplicate", _E, "No entry is there twice", _ZIP, "write each file once")
COMPRESSION = Rule("archive-compression", _E, "Entries are deflated or stored", _ZIP, "zip with deflate, unencrypted")
CASE = Rule(
    "archive-case",
    _D,
    "No two entries differ only by upper and lower case",
    _ANYWHERE,
    "rename one: Windows and macOS lose one of them",
)
DATES = Rule(
    "archive-dates",
    _D,
    "The archive is reproducible: its entries carry one fixed date",
    _ANYWHERE,
    "give all entries the same date when zipping",
)
STRAY = Rule(
    "archive-stray",
    _H,
    "Nothing foreign lies at the top of the archive",
    _ZIP,
    "remove it, or put it in resources/ or extra/",
)

# Binaries
BINARY = Rule(
    "binary-present",
    _E,
    "There is a binary or there are sources",
    _ZIP,
    "add binaries/<platform>/<modelIdentifier>, or sources",
)
BINARY_NAME = Rule(
    "binary-name", _E, "A platform's folder has a binary named after the modelIdentifier", _ZIP, "rename it"
)
BINARY_FORMAT = Rule(
    "binary-format", _E, "Binaries are whole and of their platform's format", _ZIP, "build the binary again"
)
BINARY_MACHINE = Rule(
    "binary-machine", _E, "Binaries are of their folder's processor", _ZIP, "put it in its own folder"
)
PLATFORM_NAME = Rule(
    "platform-name", _H, "Platform folders have known names", _ZIP, "use win32, win64, linux32, linux64, darwin64"
)
PLATFORMS = Rule("platforms", _D, "There are binaries for all common platforms", _ANYWHERE, "compile for them too")
UNIVERSAL = Rule(
    "darwin-universal",
    _D,
    "The darwin64 library is universal",
    _ANYWHERE,
    "merge x86_64 and arm64: FMPy opens only darwin64",
)
OTHER_EXPORTS = Rule(
    "exports-only",
    _D,
    "Nothing but FMI functions is exported",
    _ANYWHERE,
    "hide the other symbols: two FMUs in a process may take each other's",
)
ALL_EXPORTS = Rule(
    "exports-all",
    _D,
    "Every FMI function of co-simulation is exported",
    _ANYWHERE,
    "export it returning fmi2Error: some importers load all",
)
NEEDED = Rule("needed-libraries", _D, "Only libc and libm are needed", _ANYWHERE, "link the others statically")
IMPORTS = Rule(
    "dll-imports", _D, "Only system and UCRT libraries are imported", _ANYWHERE, "link the runtime statically"
)
GLIBC = Rule("glibc", _D, "GLIBC 2.17 is enough", _ANYWHERE, "build against an older glibc")
UNDEFINED_PYTHON = Rule(
    "undefined-python",
    _D,
    "No symbol of a Python interpreter is undefined",
    _ANYWHERE,
    "hosts without Python cannot load it: export native code",
)

# Sources and documents
SOURCE_FILES = Rule(
    "source-files", _E, "The files that SourceFiles lists are there", "FMI 4.3.1", "add them or mend the list"
)
SOURCES = Rule(
    "sources",
    _H,
    "There are sources, so that the FMU can be built for other platforms",
    _HONEST,
    "add sources/ and SourceFiles",
)
REBUILD = Rule("sources-compile", _D, "The sources compile", _HONEST, "make `fmpy compile` work")
REBUILT_SAME = Rule(
    "rebuilt-same",
    _D,
    "The rebuilt FMU gives the same outputs",
    _HONEST,
    "ship the sources of this very binary, and compile with -ffp-contract=off",
)
DOCUMENTATION = Rule(
    "documentation",
    _D,
    "There is documentation/index.html, with something in it",
    _PACKAGE,
    "say there what the model is, its equations and limits",
)
LICENSE = Rule(
    "license", _D, "There is a licence in documentation/licenses, and no empty file", _PACKAGE, "add its text"
)
ICON = Rule("icon", _H, "There is a model.png", _PACKAGE, "add a PNG of about 100 x 100")
ICON_FORMAT = Rule("icon-format", _D, "model.png is a whole PNG", _ZIP, "write it again as PNG")
TERMINALS = Rule(
    "terminals",
    _H,
    "There are terminals",
    _PACKAGE,
    "group the variables of a port in terminalsAndIcons/terminalsAndIcons.xml",
)
TERMINALS_VALID = Rule(
    "terminals-valid",
    _D,
    "Terminals are well-formed and name existing variables",
    "FMI 2.0.4, terminals of FMI 3.0 2.4.9",
    "mend terminalsAndIcons.xml",
)
TERMINALS_FIT = Rule(
    "terminals-consistent",
    _D,
    "Terminals fit the causality of their variables: none is local; forces flow out of shocks and into vehicles",
    "FMI 2.2.7, FMI 3.0 2.4.9",
    "mend the variableKind, or name the variable that is meant",
)
REFERENCE = Rule(
    "reference-results",
    _D,
    "The reference results in the archive are reproduced",
    _COUPLING,
    "compute them again with this binary",
)
REFERENCE_GIVEN = Rule(
    "reference-given",
    _H,
    "There are reference results",
    _COUPLING,
    "ship inputs, outputs and options as the FMI cross-check does, in extra/",
)
