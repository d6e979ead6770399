"""Groups of checks. A probe calls the FMU in a process of its own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Group:
    """A group of checks: its description, and for probes the module and the rule that a crash breaks.

    The probe of a group is the function `probe_<group>` of `builder.check.probes.<module>`.
    """

    title: str
    module: str = ""
    crash: str = "crash"


def _misuse(title: str, module: str) -> Group:
    return Group(title, module, "crash-misuse")


GROUPS = {
    "static": Group("archive, description, units, model structure, capabilities, binaries, documents"),
    "tools": Group("fmpy validate and fmutool -check: schema and semantic rules"),
    "simulation": Group(
        "simulation: start values, constant inputs, then a sine on every input, twice, with and without logs",
        "simulation",
    ),
    "state_machine": _misuse("calls in the wrong order, invalid steps, stop time, locked variables, GUID", "misuse"),
    "values": _misuse("unknown references, NaN, infinity and out-of-range values", "misuse"),
    "null": _misuse("NULL arguments", "misuse"),
    "first_outputs": Group("outputs before the first step compared with those after a tiny step", "simulation"),
    "model_exchange": Group(
        "model exchange, if it is declared: modes, states, derivatives, dependencies, FMU states, the results of "
        "co-simulation",
        "exchange",
    ),
    "reset": Group(
        "reset after changed parameters and inputs, and after twice the default experiment, then the same run again",
        "instances",
    ),
    "state": Group("FMU state: rollback; serialized, restored in another instance and another process", "states"),
    "corrupt_state": _misuse("damaged serialized states", "states"),
    "initial_dependencies": Group("dependencies at initialization: every known variable perturbed", "dependencies"),
    "dependencies": Group("dependencies over a tiny step: every input perturbed", "dependencies"),
    "derivatives": Group(
        "directional derivatives compared with central differences; input and output derivatives", "derivatives"
    ),
    "version_3": Group(
        "FMI 3.0: results of steps, intermediate updates, arrays, numbers of states and values, adjoint derivatives",
        "version3",
    ),
    "steps": Group("steps from 1e-7 s to 0.05 s in irregular order, from another start time", "simulation"),
    "instances": Group("instances: two interleaved, fifty at once, four threads, 300 created and freed", "instances"),
    "footprint": Group("effects of steps on the process: locale, standard output, memory", "instances"),
    "surroundings": Group("an empty environment, a read-only folder, a path with special characters"),
    "ports": Group("signs and energy of shocks and vehicles with velocity/force ports", "ports"),
    "reference": Group("reference results in extra/, computed again", "reference"),
    "rebuild": Group("sources compiled with `fmpy compile`, and outputs compared"),
}
