"""FMUs of FMI 3.0 and 2.0 with the same equations (lag_fmu.c), with configurable descriptions."""

import math
from pathlib import Path

import fmpy

from eightpost.archive import write_archive

from . import version_2

SOURCE = Path(__file__).with_name("lag_fmu.c")
FLAGS = (
    'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUState="true" providesIntermediateUpdate="true" '
    'hasEventMode="true" providesDirectionalDerivatives="true"'
)

VARIABLES = """
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
    <Float64 name="u" valueReference="1" causality="input" start="0" unit="mm/s" {during}/>
    <Float64 name="x" valueReference="2" causality="output"/>
    <Float64 name="y" valueReference="3" causality="output" declaredType="Speed"><Alias name="y again"/></Float64>
    <Float64 name="w" valueReference="4" causality="input" start="1 2" {during}>
      <Dimension valueReference="11"/>
    </Float64>
    <Float64 name="v" valueReference="5" causality="output"><Dimension start="2"/></Float64>
    <Float32 name="f" valueReference="6" causality="input" start="0" {during}/>
    <Float32 name="s" valueReference="7" causality="output"/>
    <Int32 name="gear" valueReference="8" causality="input" start="4" min="-9" max="50"/>
    <Int32 name="seen" valueReference="9" causality="output"/>
    <Boolean name="flag" valueReference="10" causality="input" start="false"/>
    <UInt64 name="count" valueReference="11" causality="structuralParameter" variability="fixed" start="2"/>
    <Float64 name="m" valueReference="12" causality="parameter" variability="fixed" start="1 2 3 4">
      <Dimension start="2"/><Dimension valueReference="11"/>
    </Float64>
    <Float64 name="sum" valueReference="13" causality="output"/>
    <String name="manner" valueReference="14" causality="parameter" variability="fixed"><Start value=""/></String>
    <Int64 name="big" valueReference="15" causality="local"/>
    <Float64 name="required" valueReference="16" causality="local"/>
    <Binary name="raw" valueReference="17" causality="input" declaredType="Raw"/>
    <Clock name="tick" valueReference="18" causality="input" intervalVariability="triggered"/>
"""

THREE = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="lag" instantiationToken="{token}">
  {interface}
  <UnitDefinitions><Unit name="mm/s"><BaseUnit m="1" s="-1" factor="0.001"/></Unit></UnitDefinitions>
  <TypeDefinitions>
    <Float64Type name="Speed" unit="mm/s"/><BinaryType name="Raw" mimeType="text/plain" maxSize="9"/>
  </TypeDefinitions>
  <ModelVariables>{variables}</ModelVariables>
  <ModelStructure>
    <Output valueReference="2" dependencies=""/><Output valueReference="3" dependencies="1  2"/>
    <Output valueReference="5" dependencies="4"/><Output valueReference="7" dependencies=""/>
    <Output valueReference="9"/><Output valueReference="13" dependencies=""/>
  </ModelStructure>
</fmiModelDescription>
"""

VARIABLES_2 = (
    ("u", 1, "input", 'Real start="0" unit="mm/s"'), ("x", 2, "output", "Real"),
    ("y", 3, "output", 'Real unit="mm/s"', "1"),
)  # fmt: skip


def description(*, token="lag 3", flags=FLAGS, ramps=True, interface="CoSimulation", variables=VARIABLES):
    """Return modelDescription.xml of the FMI 3.0 FMU."""
    rows = variables.format(during='intermediateUpdate="true"' if ramps else "")
    return THREE.format(token=token, interface=f'<{interface} modelIdentifier="lag" {flags}/>', variables=rows).encode()


def write_three(path, library, **declared):
    """Write the FMI 3.0 FMU."""
    binary = f"binaries/{fmpy.platform_tuple}/lag{fmpy.sharedLibraryExtension}"
    write_archive(path, {"modelDescription.xml": description(**declared), binary: library})
    return path


def write_two(path, library, *, ramps=True, any_step=True, experiment=""):
    """Write the FMI 2.0 FMU."""
    flags = {"HandleVariableCommunicationStepSize": any_step, "GetAndSetFMUstate": True, "InterpolateInputs": ramps}
    words = " ".join(f'can{name}="{str(value).lower()}"' for name, value in flags.items())
    return version_2.write(path, library, "lag", VARIABLES_2, guid="lag 2", flags=words, more=experiment)


def begun(part, **parameters):
    part.begin(0.0, 2.0, parameters)
    part.end_initialization()
    return part


def exact(x, h, start, slope):
    """Return the solution of x' = u - x after h, for an input that starts at `start`."""
    return x * math.exp(-h) + (start - slope) * (1.0 - math.exp(-h)) + slope * h
