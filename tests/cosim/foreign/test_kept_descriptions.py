"""What descriptions of FMUs and their messages become, kept part by part, and what is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cosim.components.component import Variable, named_unit
from cosim.components.fmu_description import Rows, internal_step, only_step, read_description, units_of
from cosim.components.watch import LEVELS, ComponentLog, Messages, OpenedFmu, returned
from eightpost.errors import StepError
from eightpost.fmi import DISCARD, ERROR, FATAL, PENDING
from tests.unchanged import refusals

UNITS = """<UnitDefinitions>
<Unit name="m/s"><BaseUnit m="1" s="-1"/></Unit><Unit name="in"><BaseUnit m="1" factor="0.0254"/></Unit>
<Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit><Unit name="own"/></UnitDefinitions>"""

TWO = f"""<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g"><CoSimulation modelIdentifier="m"/>{UNITS}
<TypeDefinitions><SimpleType name="Mode"><Enumeration><Item name="off" value="1"/><Item name="on" value="3"/>
</Enumeration></SimpleType></TypeDefinitions><DefaultExperiment stepSize="0.002"/><ModelVariables>
<ScalarVariable name="v" valueReference="0" causality="input" variability="continuous"><Real unit="m/s" start="0.5"/>
</ScalarVariable><ScalarVariable name="x" valueReference="1" causality="input"><Real unit="in"/></ScalarVariable>
<ScalarVariable name="f" valueReference="4294967295" causality="output"><Real unit="?"/></ScalarVariable>
<ScalarVariable name="g" valueReference="3" causality="output"><Real unit="own"/></ScalarVariable>
<ScalarVariable name="t" valueReference="4" causality="parameter" variability="fixed">
<Real unit="degC" min="-40" max="80.5" start="20"/></ScalarVariable>
<ScalarVariable name="mode" valueReference="5" causality="input" variability="discrete">
<Enumeration declaredType="Mode" start="1"/></ScalarVariable></ModelVariables>
<ModelStructure><Outputs><Unknown index="3" dependencies="1 6"/><Unknown index="4"/></Outputs></ModelStructure>
</fmiModelDescription>"""

THREE = f"""<fmiModelDescription fmiVersion="3.0" modelName="m" instantiationToken="g">
<CoSimulation modelIdentifier="m" fixedInternalStepSize="0.0005"/>{UNITS}<ModelVariables>
<UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed" start="2"/>
<Float64 name="u" valueReference="2" causality="input" unit="in" start="1 2 3 4 5 6" intermediateUpdate="true">
<Dimension valueReference="1"/><Dimension start="3"/></Float64>
<Float64 name="w" valueReference="3" causality="input" start="7" intermediateUpdate="false">
<Alias name="other"/></Float64>
<Float32 name="y" valueReference="4" causality="output"><Dimension valueReference="1"/></Float32>
<Float64 name="z" valueReference="5" causality="output"/><Clock name="c" valueReference="6" causality="input"/>
<String name="s" valueReference="7" causality="parameter"><Start value="a b"/></String></ModelVariables>
<ModelStructure><Output valueReference="4" dependencies="2"/><Output valueReference="5" dependencies=""/>
</ModelStructure></fmiModelDescription>"""


@pytest.fixture
def read(tmp_path: Path) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        (tmp_path / "modelDescription.xml").write_text(text)
        return read_description(Path("x.fmu"), tmp_path)

    return read


def _variables(description: Any) -> dict[str, Variable]:
    return Rows.of(description).variables(description)


def _lines(variables: dict[str, Variable]) -> list[str]:
    return [
        f"{v.name} {v.causality} {v.variability} {v.type} {v.unit} {v.start} {v.minimum} {v.maximum} "
        f"{sorted(v.direct)} {dict(v.items)}" for v in variables.values()
    ]  # fmt: skip


@pytest.mark.parametrize(("version", "text"), [(2, TWO), (3, THREE)], ids=["2", "3"])
def test_a_description_is_unchanged(version: int, text: str, read: Any, unchanged: Callable[..., None]) -> None:
    description = read(text)
    rows = Rows.of(description)
    unchanged({
        "variables": _lines(rows.variables(description)), "references": dict(rows.references),
        "elements": rows.elements,
        "shapes": [f"{row.names} {row.reference} {row.shape} {row.size} {row.start} {row.type}" for row in rows.rows],
        "units": {name: str(unit) for name, unit in units_of(description).items()}, "numbered": rows.are_numbered,
        "ramped": [row.names[0] for row in rows.ramped], "ramps all": rows.ramps_all, "derives all": rows.derives_all,
        "only step": only_step(description), "internal step": internal_step(description),
    })  # fmt: skip
    assert description.fmi == version


WRONG = {
    2: [
        ('fmiVersion="2.0"', 'fmiVersion="1.0"'), ('valueReference="4"', 'valueReference="4294967296"'),
        ('valueReference="4"', 'valueReference="-1"'), ('index="3"', 'index="7"'),
        ('dependencies="1 6"', 'dependencies="1 7"'), ('factor="0.0254"', 'factor="x"'),
        ('stepSize="0.002"', 'stepSize="fast"'), ('modelIdentifier="m"', 'modelIdentifier="../m"'),
        ('<CoSimulation modelIdentifier="m"/>', '<ModelExchange modelIdentifier="m"/>'), ('min="-40"', 'min="low"'),
    ],
    3: [
        ('start="1 2 3 4 5 6"', 'start="1 2 3 4 5"'), ('start="1 2 3 4 5 6"', 'start="1 2 x 4 5 6"'),
        ('<Dimension start="3"/>', '<Dimension start="500001"/>'),
        ('<Dimension start="3"/>', '<Dimension valueReference="9"/>'), ('name="z"', 'name="y"'),
        ('name="z"', 'name=""'), ('dependencies="2"', 'dependencies="two"'), ('name="z"', 'name="z" min="low"'),
        ("<Float64", "<<Float64"), ('valueReference="2"', 'valueReference="x"'),
        ('"parameter"><Start value="a b"/></String>', '"parameter" start="1"/>'),
        ('fixedInternalStepSize="0.0005"', 'fixedInternalStepSize="some"'), ("<CoSimulation", "<ModelExchange"),
        ("<CoSimulation", "<ScheduledExecution"),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("version", "text"), [(2, TWO), (3, THREE)], ids=["2", "3"])
def test_a_description_that_cannot_be_used_is_refused(
    version: int, text: str, read: Any, unchanged: Callable[..., None]
) -> None:
    assert all(old in text for old, _ in WRONG[version])
    unchanged(refusals({f"{old} -> {new}": lambda old=old, new=new: _variables(read(text.replace(old, new, 1)))
                        for old, new in WRONG[version]}))  # fmt: skip


@pytest.mark.parametrize(("step", "found"), [("0.0", None), ("-1", None), ("inf", None), ("1e-4", 1e-4)])
def test_a_step_that_is_none_is_not_stated(step: str, found: float | None, read: Any) -> None:
    assert only_step(read(TWO.replace('stepSize="0.002"', f'stepSize="{step}"'))) == found


# ---- Messages -------------------------------------------------------------------------------------------------------


def test_the_first_hundred_messages_are_kept_and_the_last_three_are_named() -> None:
    messages = Messages()
    assert (messages.last, messages.all) == ("none", ())
    for k in (*range(100), 5, 99):
        messages.add(f"m{k}")
    assert len(messages.all) == 100 and messages.last == "m99; m5"
    for k in (100, 101, 100):
        messages.add(f"m{k}")
    assert messages.all[-1] == "and 3 more messages" and messages.last == "m100; m101"
    messages.clear()
    assert (messages.last, messages.all) == ("none", ())


def test_warnings_and_worse_are_kept(caplog: pytest.LogCaptureFixture) -> None:
    log = ComponentLog("lf")
    with caplog.at_level("DEBUG", "cosim.fmu.lf"):
        for status, level in enumerate(LEVELS):
            log.write(level, f"status {status}")
    assert log.messages.all == ("status 1", "status 2", "status 3", "status 4")
    assert [record.levelname for record in caplog.records] == [
        "DEBUG",
        "WARNING",
        "WARNING",
        "ERROR",
        "CRITICAL",
        "DEBUG",
    ]


def test_a_status_is_named_as_in_its_version_of_fmi() -> None:
    statuses = (DISCARD, ERROR, FATAL, PENDING, 9)
    assert [returned(one, "doStep", version) for version in (2, 3) for one in statuses] == [
        "doStep returned fmi2Discard.", "doStep returned fmi2Error.", "doStep returned fmi2Fatal.",
        "doStep returned fmi2Pending.", "doStep returned 9, which is no status of FMI.", "doStep returned fmi3Discard.",
        "doStep returned fmi3Error.", "doStep returned fmi3Fatal.", "doStep returned 5, which is no status of FMI.",
        "doStep returned 9, which is no status of FMI.",
    ]  # fmt: skip


@pytest.mark.parametrize(("count", "more"), [(12, ""), (13, " and 1 more"), (20, " and 8 more")])
def test_a_failed_call_states_time_messages_and_the_first_twelve_inputs(count: int, more: str) -> None:
    variables = {f"u{k}": Variable(f"u{k}", "input", unit=named_unit("m/s" if k else "1")) for k in range(count)}
    file = SimpleNamespace(validity=None, variables=variables, path=Path("shock.fmu"), conditions=())
    messages = Messages()
    messages.add("too fast.")
    opened = OpenedFmu(file, "lf", messages)
    opened._stand(1.25, {name: 0.5 * k for k, name in enumerate(variables)})
    error = opened._failure("failed to step", "it refused.", "use a smaller step.")
    assert isinstance(error, StepError)
    assert str(error).startswith(
        "component 'lf' (shock.fmu) failed to step at 1.25 s: it refused. Last messages: too fast."
    )
    assert "Its inputs: u0 = 0, u1 = 0.5 m/s" in str(error) and f"u11 = 5.5 m/s{more}. What to do: use" in str(error)
    assert "failed to step from 1 to 2 s: why." in str(opened._failure("failed to step from 1 to 2 s", "why."))
