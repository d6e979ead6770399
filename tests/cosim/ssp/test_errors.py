"""Errors in a package are reported with their place."""

import re
import tempfile
from pathlib import Path

import pytest

from eightpost.errors import InputError, WiringError

from .corner import corner, read_as_it_is
from .document import EXPERIMENT, binding, bindings, link, parameter

VELOCITY = re.escape(link("car.velocity", "shock.velocity"))
TABLE = '<ssc:BooleanMappingTransformation><ssc:MapEntry source="0" target="1"/></ssc:BooleanMappingTransformation>'
BUS = '<ssd:SignalDictionaryReference name="bus" dictionary="b"/>'
TOO_LOW = bindings(binding(parameter("friction_velocity", -1.0)))
#: Pattern (a regular expression, replaced once), replacement, error class and pattern of its message.
BROKEN = {
    "no XML": ("ption>$", "", InputError, "not a readable XML file"),
    "entities": (r"\?>\n", '?>\n<!DOCTYPE x [<!ENTITY a "aa">]>', InputError, "declares a document type"),
    "another root": ("SSP1/SystemStructureDescription", "Draft", InputError, r"root element is \{http.*/Draft\}"),
    "version 3": ('"1.0">', '"3.0">', InputError, r"is SSP 3\.0; only SSP 1\.0 and 2\.0 are supported"),
    "no system": ("<ssd:System .*</ssd:System>", "", InputError, "it contains no System"),
    "no component": ("<ssd:Elements>.*</ssd:Connections>", "", WiringError, "contains no component"),
    "missing FMU": ("lpnl2.fmu", "lpnl3.fmu", InputError,
                    r"component 'shock': there is no file 'resources/lpnl3\.fmu'; add it, or correct the source"),
    "drive letter": ("resources/lpnl2", "C:/lpnl2", InputError, "'C:/lpnl2.fmu' is neither relative"),
    "another scheme": ("resources/lpnl2", "https://a.b/lpnl2", InputError, "put the file into the package"),
    "another computer": ("resources/lpnl2", "file://host/lpnl2", InputError, "is neither relative"),
    "no address": ("resources/lpnl2", "http://[lpnl2", InputError, r"there is no file 'http://\[lpnl2\.fmu'"),
    "backslash": ("resources/lpnl2", r"resources\\lpnl2", InputError, "with forward slashes"),
    "no source": (' source="resources/lpnl2.fmu"', "", InputError, "component 'shock': a Component has no .*'source'"),
    "model exchange": ('name="shock"', 'name="shock" implementation="ModelExchange"', WiringError,
                       "component 'shock': requires model exchange"),
    "unknown kind of component": ('name="shock"', 'name="shock" type="application/x-dll"', WiringError,
                                  "component 'shock': the type 'application/x-dll' is not supported; export it"),
    "signal dictionary": ("</ssd:Elements>", f"{BUS}</ssd:Elements>", WiringError,
                          "system 'corner': 'bus' is a signal dictionary, which is not supported; connect"),
    "same name": ('name="shock"', 'name="car"', WiringError, "two elements are named 'car'"),
    "two outputs": ('"shock" endConnector="velocity"', '"shock" endConnector="force"', WiringError,
                    r"car\.velocity -> shock\.force joins car\.velocity \(output\) and shock\.force \(output\)"),
    "unknown element": ('endElement="shock"', 'endElement="damper"', WiringError,
                        "there is no element 'damper'; there are car, shock"),
    "unknown connector": ('endConnector="velocity"', 'endConnector="speed"', WiringError,
                          r"there is no connector shock\.speed"),
    "connector without a variable": ('name="velocity" kind="input"(.*)endConnector="velocity"',
                                     r'name="speed" kind="input"\1endConnector="speed"', WiringError,
                                     r"shock\.speed: the FMU has no such variable"),
    "two sources": ("</ssd:Connections>", link("car.displacement", "shock.velocity") + "</ssd:Connections>",
                    WiringError, r"shock\.velocity has two sources"),
    "unknown kind": ('kind="input"', 'kind="inlet"', InputError, "connector 'force' has the kind 'inlet'"),
    "wrong type": ('(name="velocity" kind="input"><ssc:)Real unit="m/s"', r"\1Integer", WiringError,
                   "is a Integer, but the FMU's variable is a Real"),
    "contradicting unit": ('kind="input"><ssc:Real unit="m/s"', 'kind="input"><ssc:Real unit="swift"', WiringError,
                           r"connector 'velocity' is in \[swift\] and the FMU's variable in \[m/s\]"),
    "other dimension": ('endConnector="velocity"(.*)endConnector="displacement"',
                        r'endConnector="displacement"\1endConnector="velocity"', WiringError, "dimensions differ"),
    "table on a connection": (VELOCITY, link("car.velocity", "shock.velocity", TABLE), WiringError,
                              "Boolean tables are not supported"),
    "crooked factor": (VELOCITY, link("car.velocity", "shock.velocity", '<ssc:LinearTransformation factor="two"/>'),
                       InputError, "factor='two' is not a number"),
    "crooked unit": ('s="-1"', 's="-1.5"', InputError, r"unit 'm/s': BaseUnit s='-1\.5' is not a whole number"),
    "missing values": ("</ssd:Connectors></ssd:Component>",
                       f"</ssd:Connectors>{bindings(binding(source='none.ssv'))}</ssd:Component>", InputError,
                       r"component 'shock': parameter binding: there is no file 'none\.ssv'"),
    "unknown sort of values": ("<ssd:ParameterBinding>", '<ssd:ParameterBinding type="application/x-cdf">', InputError,
                               "the type 'application/x-cdf' cannot be read"),
    "value of the wrong type": ('Real value="100.0"', 'Boolean value="true"', WiringError,
                                r"car\.aero_force = True is given as Boolean, but the variable is a Real"),
    "value that is no number": ('value="100.0"', 'value="much"', InputError, "value='much' is not a number"),
    "value out of range": ("</ssd:Connectors></ssd:Component>", f"</ssd:Connectors>{TOO_LOW}</ssd:Component>",
                           WiringError, r"friction_velocity = -1\.0 m/s is outside its range"),
    "no stop time": (EXPERIMENT, "", InputError, "has no DefaultExperiment with a stopTime; give the length"),
}  # fmt: skip


@pytest.mark.parametrize("fault", BROKEN)
def test_the_error_names_the_fault_in_a_package_and_its_place(folder, fault):
    old, new, error, message = BROKEN[fault]
    broken, count = re.subn(old, new, corner().decode(), count=1, flags=re.DOTALL)
    assert count == 1
    with pytest.raises(error, match=message) as caught:
        read_as_it_is(folder, broken.encode())
    assert str(folder / "corner.ssd") in str(caught.value)
    for unpacked in ("ssp_", "fmu_"):
        assert str(Path(tempfile.gettempdir(), unpacked)) not in str(caught.value)
