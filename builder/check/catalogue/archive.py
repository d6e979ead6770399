"""Rules for the content of an archive: files, binaries, sources and documents."""

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
    "archive-case",
    _D,
    "No two entries differ only in upper and lower case",
    _ANYWHERE,
    "rename one: on Windows and macOS one overwrites the other",
)
DATES = Rule(
    "archive-dates",
    _D,
    "The archive is reproducible: its entries have one fixed date",
    _ANYWHERE,
    "give all entries the same date when zipping",
)
STRAY = Rule(
    "archive-stray",
    _H,
    "There are no unknown files at the top of the archive",
    _ZIP,
    "remove the file, or move it to resources/ or extra/",
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
    "darwin-universal",
    _D,
    "The darwin64 library is universal",
    _ANYWHERE,
    "merge x86_64 and arm64: FMPy opens only darwin64",
)
OTHER_EXPORTS = Rule(
    "exports-only",
    _D,
    "Only FMI functions are exported",
    _ANYWHERE,
    "hide the other symbols: two FMUs in a process may use each other's symbols",
)
ALL_EXPORTS = Rule(
    "exports-all",
    _D,
    "Every FMI function of co-simulation is exported",
    _ANYWHERE,
    "export the function and return fmi2Error: some importers load all functions",
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
    "source-files", _E, "The files listed in SourceFiles exist", "FMI 4.3.1", "add the files or correct the list"
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
    "include the sources that the binary was built from, and compile with -ffp-contract=off",
)
DOCUMENTATION = Rule(
    "documentation",
    _D,
    "There is a documentation/index.html that is not empty",
    _PACKAGE,
    "describe the model, its equations and its limits there",
)
LICENSE = Rule(
    "license",
    _D,
    "There is a licence in documentation/licenses, and no file there is empty",
    _PACKAGE,
    "add the licence text",
)
ICON = Rule("icon", _H, "There is a model.png", _PACKAGE, "add a PNG of about 100 x 100")
ICON_FORMAT = Rule("icon-format", _D, "model.png is a complete PNG", _ZIP, "write the file again as PNG")
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
    "Terminals are well-formed and refer to existing variables",
    "FMI 2.0.4, terminals of FMI 3.0 2.4.9",
    "correct terminalsAndIcons.xml",
)
TERMINALS_FIT = Rule(
    "terminals-consistent",
    _D,
    "Terminals match the causality of their variables: none is local; forces flow out of shocks and into vehicles",
    "FMI 2.2.7, FMI 3.0 2.4.9",
    "correct the variableKind or the name of the variable",
)
REFERENCE = Rule(
    "reference-results",
    _D,
    "The binary reproduces the reference results in the archive",
    _COUPLING,
    "compute the reference results again with this binary",
)
REFERENCE_GIVEN = Rule(
    "reference-given",
    _H,
    "There are reference results",
    _COUPLING,
    "add inputs, outputs and options in the format of the FMI cross-check to extra/",
)
