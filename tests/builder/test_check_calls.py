"""The calls that each probe makes, what it finds, and from which error on it finds one: none of it changes unseen."""

import ctypes
import importlib
import re
import zlib
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from builder.check import GROUPS
from builder.check.probes import instances
from builder.check.probes.bench import Bench, Instance, Measured, Result, Skip
from builder.check.probes.library import FmuLibrary
from eightpost.archive import read_archive

from .check_defects import foreign_fmu

#: FMUs that a group of probes calls here, those of FMI 3.0 with a 3 at the end.
PROBED = {
    "simulation": ["lpnl2", "bouncing_mass", "filter_bank"],
    "inputs": ["quarter_car", "quarter_car 3", "van_der_pol", "filter_bank"],
    "hosts": ["lpnl2", "mass_spring", "filter_bank"],
    "state_machine": ["lpnl2", "lpnl2 3", "mass_spring", "bouncing_mass", "filter_bank"],
    "values": ["lpnl2", "quarter_car 3", "bouncing_mass", "filter_bank"],
    "null": ["lpnl2", "lpnl2 3"],
    "first_outputs": ["quarter_car", "mass_spring"],
    "model_exchange": ["lpnl2", "quarter_car", "lpf1 3", "filter_bank"],
    "reset": ["bouncing_mass", "filter_bank"],
    "state": ["lpnl2", "lpf1 3", "bouncing_mass"],
    "corrupt_state": ["lpnl2", "quarter_car", "bouncing_mass"],
    "initial_dependencies": ["quarter_car", "bouncing_mass"],
    "dependencies": ["lpnl2", "quarter_car"],
    "derivatives": ["lpnl2", "quarter_car", "lpf1 3", "van_der_pol"],
    "version_3": ["lpnl2 3", "filter_bank"],
    "steps": ["quarter_car", "mass_spring"],
    "instances": ["quarter_car"],
    "surroundings": ["lpnl2", "filter_bank"],
    "ports": ["lpnl2", "quarter_car"],
    "reference": ["lpnl2"],
}


class Calls:
    """Calls of FMI functions by name: their arguments and results."""

    def __init__(self) -> None:
        self.made: defaultdict[str, list[tuple[list[Any], Any]]] = defaultdict(list)
        self.order = 0
        self.said: Counter[str] = Counter()

    def heard(self, log: Callable[..., None]) -> Callable[..., None]:
        """Return the logger of an instance, whose texts are kept."""

        def heard(instance: Instance, environment: int, name: bytes, status: int, category: bytes, text: bytes) -> None:
            self.said[
                re.sub(r"\S+ = \S+|least \S+|most \S+", "x", f"{status} {category.decode()}: {text.decode()}")
            ] += 1
            log(instance, environment, name, status, category, text)

        return heard

    def recorded(self, native: Callable[[FmuLibrary, str], Any]) -> Callable[[FmuLibrary, str], Any]:
        """Return FmuLibrary.native, whose functions are recorded."""

        def of(library: FmuLibrary, name: str) -> Any:
            function = native(library, name)

            def call(*arguments: Any) -> Any:
                result = function(*arguments)
                self.order = zlib.crc32(name.encode(), self.order)
                self.made[name].append(([*map(_plain, arguments)], result))
                return result

            return call

        return of

    def summary(self) -> dict[str, str]:
        """Return a line for each function: its results by number, and the numbers at each place of its arguments."""
        found = {}
        for name, made in sorted(self.made.items()):
            results = Counter(result for _, result in made if isinstance(result, int) and 0 <= result < 9)
            places = zip(*(arguments for arguments, _ in made), strict=True)
            words = (_kept(place, [*contents]) for place, contents in enumerate(places))
            found[name] = "; ".join([f"{len(made)} {sorted(results.items())}", *filter(None, words)])
        return found


def _plain(argument: Any) -> Any:
    while hasattr(argument, "_obj"):
        argument = argument._obj
    if isinstance(argument, ctypes.Array):
        return list(argument) if argument._type_ is not ctypes.c_char else None
    return getattr(argument, "value", argument)


def _kept(place: int, contents: list[Any]) -> str:
    """Return the range, the mean and the root mean square of the numbers at a place, which are no addresses."""
    flat = [one for content in contents for one in (content if isinstance(content, list) else [content])]
    numbers = np.array([one for one in flat if isinstance(one, int | float)], float)
    finite = numbers[np.abs(numbers) < 2.0**40]
    if not finite.any():
        return ""
    figures = finite.min(), finite.max(), finite.mean(), np.sqrt(np.mean(finite**2))
    return f"{place}: {finite.size} of {len(flat)}, " + " ".join(f"{figure:.8g}" for figure in figures)


def _said(result: Result) -> str:
    """Return what a probe found or left out; "" if it found no fault."""
    if isinstance(result, Skip):
        return f"{result.what or 'all'} is left out: {result.reason}"
    return f"{result.name} is measured" if isinstance(result, Measured) else ": ".join(result) if result[1] else ""


@pytest.fixture(scope="module")
def folder_of(
    fmus: Mapping[str, Path], fmus3: Mapping[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], Path]:
    """Function that returns the folder of an unpacked FMU."""
    ours = {**fmus, **{f"{name} 3": path for name, path in fmus3.items()}}
    made: dict[str, Path] = {}

    def of(name: str) -> Path:
        if name not in made:
            made[name] = tmp_path_factory.mktemp("unpacked")
            path = ours[name] if name in ours else foreign_fmu(name, tmp_path_factory.mktemp("compiled"))
            for member, content in read_archive(path).items():
                (made[name] / member).parent.mkdir(parents=True, exist_ok=True)
                (made[name] / member).write_bytes(content)
        return made[name]

    return of


def _probed(group: str, folder: Path, progress: Path) -> list[Result]:
    progress.touch()
    module = importlib.import_module(f"builder.check.probes.{GROUPS[group].module}")
    return [*getattr(module, f"probe_{group}")(Bench(folder, progress))]


@pytest.mark.parametrize("group", PROBED)
def test_a_probe_makes_the_same_calls(
    group: str, folder_of: Callable[[str], Path], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None],
) -> None:  # fmt: skip
    monkeypatch.setattr(instances, "_RESET_PATIENCE", 1e9)
    monkeypatch.setattr(instances, "_resident", lambda: 0)  # that of this process depends on earlier tests
    results = {}
    for name in PROBED[group]:
        calls = Calls()
        with monkeypatch.context() as patch:
            patch.setattr(FmuLibrary, "native", calls.recorded(FmuLibrary.native))
            patch.setattr(Instance, "_log", calls.heard(Instance._log))
            found = _probed(group, folder_of(name), tmp_path / name)
        results[name] = {
            "found": [text for one in found if (text := _said(one))],
            "calls": calls.summary(),
            "said": [f"{count} times {text}" for text, count in sorted(calls.said.items())],
            "order": calls.order if group != "instances" else "that of threads",
        }
    unchanged(results)


@dataclass
class Wrong:
    """Calls of FMI functions, of which one returns numbers that are wrong by a share.

    `when` says of which instances: of `all`, of all but the `first`, of those with a `stop` time, or of those of which
    another function has been called, which it names.
    """

    function: str
    when: str
    share: float

    def __post_init__(self) -> None:
        self.seen: defaultdict[Any, set[str]] = defaultdict(set)

    def applied(self, native: Callable[[FmuLibrary, str], Any]) -> Callable[[FmuLibrary, str], Any]:
        """Return FmuLibrary.native, one of whose functions is wrong."""

        def of(library: FmuLibrary, name: str) -> Any:
            function = native(library, name)

            def call(*arguments: Any) -> Any:
                result = function(*arguments)
                if name.startswith("Instantiate"):
                    self.seen[result] = {"all", *(["first"] if self.seen else [])}
                    return result
                instance = self.seen[arguments[0]] if arguments else set()
                instance |= {name, "stop"} if name == "SetupExperiment" and arguments[4] else {name}
                if name == self.function and self.when in instance:
                    values = next(one for one in reversed(arguments) if isinstance(one, ctypes.Array))
                    values[:] = [value * (1.0 + self.share) for value in values]
                return result

            return call

        return of


#: Rules, and what breaks them: group of probes, FMU, function, when it is wrong, and the share it may be wrong by.
BROKEN = {
    "start-agrees": ("simulation", "bouncing_mass", "GetReal", "all", 1e-12),
    "stop-independent": ("simulation", "van_der_pol", "GetReal", "stop", 0.01),
    "inputs-kept": ("inputs", "van_der_pol", "GetReal", "all", 1e-6),
    "inputs-kept by the second run": ("inputs", "van_der_pol", "GetReal", "first", 1e-9),
    "reference-results": ("reference", "lpnl2", "GetReal", "all", 1e-9),
    "start-kept": ("hosts", "bouncing_mass", "GetReal", "all", 1e-6),
    "reset": ("reset", "bouncing_mass", "GetReal", "Reset", 1e-9),
    "rollback": ("state", "bouncing_mass", "GetReal", "SetFMUstate", 1e-9),
    "directional-derivative": ("derivatives", "quarter_car", "GetDirectionalDerivative", "all", 1e-3),
    "exchange-directional": ("model_exchange", "quarter_car", "GetDirectionalDerivative", "all", 1e-3),
    "exchange-agrees": ("model_exchange", "quarter_car", "GetReal", "DoStep", 0.02),
    "states-variables": ("model_exchange", "quarter_car", "GetDerivatives", "all", 1e-9),
    "nominals-agree": ("model_exchange", "quarter_car", "GetNominalsOfContinuousStates", "all", 1e-6),
    "adjoint-derivative": ("version_3", "lpnl2 3", "GetAdjointDerivative", "all", 1e-9),
    "array-start": ("version_3", "filter_bank", "GetFloat64", "all", 1e-6),
}


@pytest.mark.parametrize("rule", BROKEN)
def test_a_rule_is_broken_by_an_error_above_its_limit_and_by_no_smaller_one(
    rule: str, folder_of: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    group, fmu, function, when, limit = BROKEN[rule]

    def is_broken(share: float) -> bool:
        with monkeypatch.context() as patch:
            patch.setattr(FmuLibrary, "native", Wrong(function, when, share).applied(FmuLibrary.native))
            found = _probed(group, folder_of(fmu), tmp_path / "progress")
        return any(one[0] == rule.split(maxsplit=1)[0] and one[1] for one in found if isinstance(one, tuple))

    assert (is_broken(0.9 * limit), is_broken(1.1 * limit)) == (False, True)
