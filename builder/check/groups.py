"""The groups of checks: `static` and `tools` read the file, `rebuild` compiles it, the others call it."""

from __future__ import annotations

from dataclasses import dataclass

from builder.check.catalogue import behaviour as rules
from builder.check.rules import Rule


@dataclass(frozen=True)
class Group:
    """A group of checks: its description, and for probes the module and the rule that a crash breaks.

    A probe is the function `probe` of the module `builder.check.probes.<module>` and runs in a separate process.
    """

    title: str
    module: str = ""
    crash: Rule = rules.CRASH


def _misuse(title: str, module: str) -> Group:
    return Group(title, module, rules.CRASH_MISUSE)


GROUPS = {
    "static": Group("archive, description, units, model structure, capabilities, binaries, documents"),
    "tools": Group("fmpy validate and fmutool -check: schema and semantic rules"),
    "simulation": Group(
        "simulation: start values, constant inputs, then a sine on every input, twice, with and without logs",
        "simulation",
    ),
    "state_machine": _misuse(
        "calls in the wrong order, invalid steps, stop time, locked variables, GUID", "state_machine"
    ),
    "values": _misuse("unknown references, NaN, infinity and out-of-range values", "values"),
    "null": _misuse("NULL arguments", "null"),
    "first_outputs": Group("outputs before the first step compared with those after a tiny step", "first_outputs"),
    "model_exchange": Group("a few steps of model exchange, if it is declared", "model_exchange"),
    "reset": Group(
        "reset after changed parameters and inputs, and after twice the default experiment, then the same run again",
        "reset",
    ),
    "state": Group("FMU state: rollback; serialized, restored in another instance and another process", "state"),
    "corrupt_state": _misuse("damaged serialized states", "corrupt_state"),
    "initial_dependencies": Group(
        "dependencies at initialization: every known variable perturbed", "initial_dependencies"
    ),
    "dependencies": Group("dependencies over a tiny step: every input perturbed", "dependencies"),
    "derivatives": Group(
        "directional derivatives compared with central differences; input and output derivatives", "derivatives"
    ),
    "steps": Group("steps from 1e-7 s to 0.05 s in irregular order, from another start time", "steps"),
    "instances": Group("instances: two interleaved, fifty at once, four threads, 300 created and freed", "instances"),
    "footprint": Group("effects of steps on the process: locale, standard output, memory", "footprint"),
    "surroundings": Group("an empty environment, a read-only folder, a path with special characters"),
    "ports": Group("signs and energy of shocks and vehicles with velocity/force ports", "ports"),
    "reference": Group("reference results in extra/, computed again", "reference"),
    "rebuild": Group("sources compiled with `fmpy compile`, and outputs compared"),
}
