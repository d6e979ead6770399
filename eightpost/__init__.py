"""Shock laws, vehicle models, signals and identification: the numerical part of the project, without FMI.

The package itself also gives the names of the API for notebooks (docs/reference/api/eightpost.md), each loaded when it
is first used: `import eightpost as ep`, then `ep.read`, `ep.fit`, `ep.run`. Type checkers read them in `__init__.pyi`.
"""

__version__ = "0.2.0"

#: Modules of the public names, in the order of the work. They are above this package in the order of imports
#: (pyproject.toml), so that they are named, not imported: no module below loads them by loading this package.
_HOMES = {
    "eightpost.api.reading": ("read", "examples"),
    "eightpost.api.models": ("fit", "simulate", "build", "identify"),
    "eightpost.api.runs": ("run", "sweep", "compare", "study"),
    "eightpost.errors": ("EightpostError",),
    "eightpost.signals": ("Drivefile", "TimeSeries"),
    "cosim": ("Bond", "Scenario", "System"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [  # noqa: PLE0604 -- the literal list is in __init__.pyi
    *_HOME
]


def __getattr__(name: str) -> object:
    """Load a public name."""
    if name not in _HOME:
        from difflib import get_close_matches

        close = get_close_matches(name, _HOME, n=3)
        advice = f"did you mean {', '.join(close)}?" if close else f"there are: {', '.join(__all__)}"
        raise AttributeError(f"eightpost has no attribute {name!r}; {advice}", name=None)
    from importlib import import_module

    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return [*__all__, "__version__"]
