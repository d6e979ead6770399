"""Errors in a package are reported with their place."""

import re
from functools import partial

from tests.unchanged import refusals

from .corner import corner, read_as_it_is
from .document import EXPERIMENT, binding, bindings, link, parameter

VELOCITY = re.escape(link("car.velocity", "shock.velocity"))
TABLE = '<ssc:BooleanMappingTransformation><ssc:MapEntry source="0" target="1"/></ssc:BooleanMappingTransformation>'
BUS = '<ssd:SignalDictionaryReference name="bus" dictionary="b"/>'
TOO_LOW = bindings(binding(parameter("friction_velocity", -1.0)))
#: Pattern (a regular expression, replaced once) and replacement.
BROKEN = {
    "no XML": ("ption>$", ""), "entities": (r"\?>\n", '?>\n<!DOCTYPE x [<!ENTITY a "aa">]>'),
    "another root": ("SSP1/SystemStructureDescription", "Draft"), "version 3": ('"1.0">', '"3.0">'),
    "no system": ("<ssd:System .*</ssd:System>", ""), "no component": ("<ssd:Elements>.*</ssd:Connections>", ""),
    "missing FMU": ("lpnl2.fmu", "lpnl3.fmu"), "drive letter": ("resources/lpnl2", "C:/lpnl2"),
    "another scheme": ("resources/lpnl2", "https://a.b/lpnl2"),
    "another computer": ("resources/lpnl2", "file://host/lpnl2"), "no address": ("resources/lpnl2", "http://[lpnl2"),
    "backslash": ("resources/lpnl2", r"resources\\lpnl2"), "no source": (' source="resources/lpnl2.fmu"', ""),
    "model exchange": ('name="shock"', 'name="shock" implementation="ModelExchange"'),
    "unknown kind of component": ('name="shock"', 'name="shock" type="application/x-dll"'),
    "signal dictionary": ("</ssd:Elements>", f"{BUS}</ssd:Elements>"), "same name": ('name="shock"', 'name="car"'),
    "two outputs": ('"shock" endConnector="velocity"', '"shock" endConnector="force"'),
    "unknown element": ('endElement="shock"', 'endElement="damper"'),
    "unknown connector": ('endConnector="velocity"', 'endConnector="speed"'),
    "connector without a variable": ('name="velocity" kind="input"(.*)endConnector="velocity"',
                                     r'name="speed" kind="input"\1endConnector="speed"'),
    "two sources": ("</ssd:Connections>", link("car.displacement", "shock.velocity") + "</ssd:Connections>"),
    "unknown kind": ('kind="input"', 'kind="inlet"'),
    "wrong type": ('(name="velocity" kind="input"><ssc:)Real unit="m/s"', r"\1Integer"),
    "contradicting unit": ('kind="input"><ssc:Real unit="m/s"', 'kind="input"><ssc:Real unit="swift"'),
    "other dimension": ('endConnector="velocity"(.*)endConnector="displacement"',
                        r'endConnector="displacement"\1endConnector="velocity"'),
    "table on a connection": (VELOCITY, link("car.velocity", "shock.velocity", TABLE)),
    "crooked factor": (VELOCITY, link("car.velocity", "shock.velocity", '<ssc:LinearTransformation factor="two"/>')),
    "crooked unit": ('s="-1"', 's="-1.5"'),
    "missing values": ("</ssd:Connectors></ssd:Component>",
                       f"</ssd:Connectors>{bindings(binding(source='none.ssv'))}</ssd:Component>"),
    "unknown sort of values": ("<ssd:ParameterBinding>", '<ssd:ParameterBinding type="application/x-cdf">'),
    "value of the wrong type": ('Real value="100.0"', 'Boolean value="true"'),
    "value that is no number": ('value="100.0"', 'value="much"'),
    "value out of range": ("</ssd:Connectors></ssd:Component>", f"</ssd:Connectors>{TOO_LOW}</ssd:Component>"),
    "no stop time": (EXPERIMENT, ""),
}  # fmt: skip


def test_the_error_names_the_fault_in_a_package_and_its_place(folder, unchanged):
    def broken(old, new):
        changed, count = re.subn(old, new, corner().decode(), count=1, flags=re.DOTALL)
        assert count == 1
        return read_as_it_is(folder, changed.encode())

    unchanged(refusals({name: partial(broken, *change) for name, change in BROKEN.items()}))
