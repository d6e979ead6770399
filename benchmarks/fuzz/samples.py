"""Small valid files of every kind, from which mutants are created."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from benchmarks.fuzz.damage import members_of, packed
from builder.build import build
from cosim.study.choice.compare import Comparison, write_comparisons
from cosim.study.choice.rig_day import select, write_selection
from cosim.study.definition import Build, Drive, Study, Vehicle
from cosim.study.measures import Measure
from cosim.study.table import Provenance, StudyResult, result_table, study_schema
from eightpost.corners import CORNERS
from eightpost.drivefile import IterationFolder, Problem, Target, start_response, target_names
from eightpost.drivefile import Settings as IterationSettings
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of, write_response
from eightpost.ident.vehicle.vehicle_fit import VehicleFit, write_fit
from eightpost.shock import Lpnl2, Port, Shock, StaticCurve, write_shock
from eightpost.signals import TimeSeries, write_series
from eightpost.vehicle import Friction, IdentifiedVehicle, read_vehicle, shipped, write_vehicle
from eightpost.verdict import Verdict

_ROOT = Path(__file__).parents[2]
_CORNERS, _BUILDS = ("lf", "rf"), ("soft", "firm", "stiff")


def make_samples(folder: Path) -> None:
    """Write every sample into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    _records(folder)
    _models(folder)
    _fmus(folder)
    _settings(folder)
    _states(folder)
    _study(folder)


def _records(folder: Path) -> None:
    time = np.arange(0.0, 2.0, 0.002)
    speed, travel = 0.3 * np.sin(12.0 * time), -0.025 * np.cos(12.0 * time)
    series = TimeSeries.from_channels(
        time, {"velocity": ("m/s", speed), "displacement": ("m", travel), "force": ("N", 2000.0 * speed + 30.0)}
    )
    for suffix in ("csv", "parquet", "mat"):
        write_series(series, folder / f"record.{suffix}")
    rows = "\n".join(
        f"{t:.3f};{v:.4f};{f:.2f}".replace(".", ",") for t, v, f in zip(time, speed, series["force"], strict=True)
    )
    (folder / "german.csv").write_text(
        f"Run;7\nGas;50 psi\n\nZeit;v_mm_s;Kraft\ns;mm/s;N\n{rows}\n", encoding="latin-1"
    )
    (folder / "peaks.csv").write_text(
        "clicks,speed [in/s],compression [lbf],rebound [lbf]\n"
        + "".join(f"{c},{v},{20 * v + c},{-30 * v - c}\n" for c in (1, 3) for v in (1, 2, 5, 10)), encoding="utf-8"
    )  # fmt: skip
    units = {"road": "m", "force": "N", "tire_force": "N", "displacement": "m"}
    road = {
        f"{corner}.{name}": (unit, 0.01 * np.sin((10 + k) * time + j))
        for k, corner in enumerate(CORNERS)
        for j, (name, unit) in enumerate(units.items())
    }
    write_series(TimeSeries.from_channels(2.5 * time, road), folder / "rig.parquet")
    write_series(TimeSeries.from_channels(time, {"lf.road": ("m", travel)}), folder / "drive.parquet")
    if importlib.util.find_spec("asammdf"):
        _mdf(folder, time, speed)
    _loggers(folder, series)
    run = folder / "run"
    run.mkdir(exist_ok=True)
    write_series(series, run / "series.parquet")
    result = {
        "schema": 1,
        "kind": "result",
        "settling": 0.5,
        "sources": {"lf": "a.fmu"},
        "parameters": {"lf": {"g": 1.0}},
    }
    (run / "result.json").write_text(json.dumps(result), encoding="utf-8")


def _loggers(folder: Path, series: TimeSeries) -> None:
    write_series(series, folder / "record.rsp")
    rows = "".join(f"{k / 100:.2f} {100 + k % 30}\n" for k in range(300))
    (folder / "lap.vbo").write_text(
        f"File created on 1/2/2026\n\n[header]\ntime\nvelocity kmh\n\n[column names]\ntime velocity\n\n[data]\n{rows}",
        encoding="utf-8",
    )
    columns = {"Time [s]": series.time.tolist(), "Force [N]": series["force"].tolist()}
    (folder / "record.json").write_text(json.dumps(columns), encoding="utf-8")


def _mdf(folder: Path, time: np.ndarray, speed: np.ndarray) -> None:
    import asammdf  # noqa: PLC0415

    for suffix, version in (("mf4", "4.10"), ("mdf", "3.30")):
        with asammdf.MDF(version=version) as mdf:
            channels = (("velocity", "m/s", speed), ("force", "N", (2000.0 * speed).astype(np.int16)))
            mdf.append([asammdf.Signal(v, time, name=name, unit=unit) for name, unit, v in channels])
            mdf.header.comment = "Shock ID: A"
            mdf.save(folder / f"record.{suffix}", overwrite=True)


def _models(folder: Path) -> None:
    curve = StaticCurve(
        inner=(1800.0, 60.0, -400.0, *[0.0] * 11, 30.0), compression=(1490.0, 900.0, 40.0, 5.0),
        rebound=(-1400.0, -1100.0, -20.0, 3.0), transition_speed=0.381, transition_width=0.0127,
        compression_speed=1.2, rebound_speed=1.1, compression_slope=3000.0, rebound_slope=3500.0,
    )  # fmt: skip
    law = Lpnl2(curve, 0.0013, 800.0, 1600.0, port=Port(gas_preload=50.0, gas_stiffness=700.0, seal_friction=15.0))
    conditions = {"build": "Build 1", "clicks": "1", "velocity [m/s]": [-0.5, 0.5]}
    write_shock(
        Shock("soft", law, conditions, {"rms [N]": 3.0}, ({"name": "a.csv", "sha256": "0" * 64},)),
        folder / "shock.json",
    )
    for name in ("seven_dof", "quarter_car"):
        shutil.copy(shipped(name), folder / f"{name}.toml")
    structural = read_vehicle(shipped("quarter_car"))
    model = structural.coupled()
    damping = {"": 1000.0}
    friction = {"": Friction(20.0, 0.01)}
    identified = IdentifiedVehicle("car", model, damping, {}, {"rig.parquet": "0" * 64}, friction)
    write_vehicle(folder / "vehicle.json", identified)
    exact = response_of(model, np.linspace(0.5, 20.0, 40))
    response = FrequencyResponse(exact.frequency, exact.H, exact.inputs, exact.outputs,
                                 np.full((len(exact.outputs), 40), 0.99), variance=np.abs(exact.H) * 1e-4)  # fmt: skip
    write_response(folder / "response.npz", response)
    write_fit(folder / "fitted.json", VehicleFit(identified, "boggs", response, {"lf.force": 0.02}, ("a note",), 1.5))


def _fmus(folder: Path) -> None:
    shutil.copy(folder / "seven_dof.toml", folder / "car.toml")
    made = build([folder / "shock.json", folder / "car.toml"], folder / "fmus", target="python")
    for item in made:
        # Without the documents, a mutant is written in a hundredth of the time, and the checked content is the same.
        members = members_of(item.path.read_bytes())
        kept = {
            n: c for n, c in members.items() if n.startswith(("model", "terminals", "resources", "binaries/linux64"))
        }
        item.path.write_bytes(packed(kept))
    description = members_of((folder / "fmus/shock.fmu").read_bytes())["modelDescription.xml"]
    (folder / "package.ssp").write_bytes(packed({
        "SystemStructure.ssd": _SSD.encode(), "resources/shock.ssv": _SSV.encode(),
        "resources/shock.ssm": _SSM.encode(),
        "resources/shock.fmu": (folder / "fmus/shock.fmu").read_bytes(),
    }))  # fmt: skip
    (folder / "plain.fmu").write_bytes(packed({
        "modelDescription.xml": description, "binaries/linux64/shock.so": b"\x7fELF" + bytes(200),
        "extra/org.example/a.txt": b"a",
    }))  # fmt: skip
    (folder / "arrays.fmu").write_bytes(packed({
        "modelDescription.xml": _ARRAYS.encode(), "binaries/x86_64-linux/arrays.so": b"\x7fELF" + bytes(200),
        "sources/buildDescription.xml": _BUILD.encode(), "sources/arrays.c": b"",
        "terminalsAndIcons/terminalsAndIcons.xml": _TERMINALS.encode(),
    }))  # fmt: skip


#: An FMU of FMI 3.0 with arrays, clocks and states.
_ARRAYS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Arrays" instantiationToken="{0}">
<ModelExchange modelIdentifier="arrays" canGetAndSetFMUState="true"/>
<CoSimulation modelIdentifier="arrays" hasEventMode="true" providesIntermediateUpdate="true"/>
<UnitDefinitions><Unit name="m"><BaseUnit m="1"/><DisplayUnit name="mm" factor="1000"/></Unit></UnitDefinitions>
<TypeDefinitions><EnumerationType name="Mode"><Item name="on" value="1"/></EnumerationType></TypeDefinitions>
<DefaultExperiment startTime="0" stopTime="1" stepSize="0.01"/>
<ModelVariables>
<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
<UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed" start="2"/>
<Float64 name="k" valueReference="2" causality="parameter" variability="tunable" start="1 2">
<Dimension valueReference="1"/></Float64>
<Enumeration name="mode" valueReference="3" causality="parameter" variability="fixed" declaredType="Mode" start="1"/>
<Float64 name="u" valueReference="4" causality="input" unit="m" start="0" intermediateUpdate="true">
<Alias name="w" displayUnit="mm"/></Float64>
<Clock name="c" valueReference="5" causality="input" intervalVariability="constant" intervalDecimal="0.1"/>
<Int32 name="i" valueReference="6" causality="output" clocks="5" previous="7"/>
<Int32 name="j" valueReference="7" causality="local" clocks="5"/>
<String name="s" valueReference="8" causality="parameter" variability="fixed"><Start value="a"/></String>
<Float64 name="x" valueReference="9" causality="output" initial="exact" start="0 0"><Dimension start="2"/></Float64>
<Float64 name="v" valueReference="10" derivative="9"><Dimension start="2"/></Float64>
</ModelVariables>
<ModelStructure><Output valueReference="6"/><Output valueReference="9" dependencies="9" dependenciesKind="constant"/>
<ContinuousStateDerivative valueReference="10" dependencies="4"/><ClockedState valueReference="6"/>
<InitialUnknown valueReference="10"/></ModelStructure></fmiModelDescription>"""
_BUILD = """<?xml version="1.0" encoding="UTF-8"?><fmiBuildDescription fmiVersion="3.0">
<BuildConfiguration modelIdentifier="arrays"><SourceFileSet language="C99"><SourceFile name="arrays.c"/></SourceFileSet>
</BuildConfiguration></fmiBuildDescription>"""
_TERMINALS = """<?xml version="1.0" encoding="UTF-8"?><fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>
<Terminal name="port" matchingRule="plug"><TerminalMemberVariable variableName="u" variableKind="signal"/></Terminal>
</Terminals></fmiTerminalsAndIcons>"""

_NAMESPACES = "".join(
    f' xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for prefix, name in {
        "ssd": "Description",
        "ssc": "Common",
        "ssv": "ParameterValues",
        "ssm": "ParameterMapping",
    }.items()
)
_SSV = f"""<?xml version="1.0"?><ssv:ParameterSet{_NAMESPACES} version="1.0" name="set"><ssv:Parameters>
<ssv:Parameter name="gas"><ssv:Real value="60" unit="N"/></ssv:Parameter></ssv:Parameters>
<ssv:Units><ssc:Unit name="N"><ssc:BaseUnit kg="1" m="1" s="-2"/></ssc:Unit></ssv:Units></ssv:ParameterSet>"""
_SSM = f"""<?xml version="1.0"?><ssm:ParameterMapping{_NAMESPACES} version="1.0">
<ssm:MappingEntry source="gas" target="gas_preload"><ssc:LinearTransformation factor="2" offset="0"/></ssm:MappingEntry>
</ssm:ParameterMapping>"""
_SSD = f"""<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription{_NAMESPACES} name="corner" version="1.0">
<ssd:System name="top"><ssd:Connectors><ssd:Connector name="v" kind="input"><ssc:Real unit="mm/s"/></ssd:Connector>
<ssd:Connector name="x" kind="input"><ssc:Real unit="m"/></ssd:Connector>
</ssd:Connectors><ssd:Elements>
<ssd:Component name="a" source="resources/shock.fmu"><ssd:Connectors>
<ssd:Connector name="velocity" kind="input"><ssc:Real unit="m/s"/></ssd:Connector>
<ssd:Connector name="displacement" kind="input"><ssc:Real unit="m"/></ssd:Connector>
<ssd:Connector name="force" kind="output"><ssc:Real unit="N"/></ssd:Connector></ssd:Connectors>
<ssd:ParameterBindings><ssd:ParameterBinding source="resources/shock.ssv">
<ssd:ParameterMapping source="resources/shock.ssm"/></ssd:ParameterBinding></ssd:ParameterBindings></ssd:Component>
</ssd:Elements><ssd:Connections>
<ssd:Connection startConnector="v" endElement="a" endConnector="velocity"><ssc:LinearTransformation factor="1"/>
</ssd:Connection>
<ssd:Connection startConnector="x" endElement="a" endConnector="displacement"/></ssd:Connections></ssd:System>
<ssd:Units><ssc:Unit name="mm/s"><ssc:BaseUnit m="1" s="-1" factor="0.001"/></ssc:Unit></ssd:Units>
<ssd:DefaultExperiment startTime="0" stopTime="0.3"/></ssd:SystemStructureDescription>"""

_MAP = '[time]\nsource = "time"\nunit = "s"\n[channels.velocity]\nsource = "velocity"\ngain = -1.0\noffset = 0.5\n'
_PREPARATION = """rate = "125 Hz"
pot_cutoff = "50 Hz"
settling = "2 s"
same_start = "lf.road"
[delays]
"lf.force" = "4.2 ms"
"""
_SYSTEM = """schema = 1
name = "corner"
sums = []
[components.car]
fmu = "fmus/car.fmu"
inputs = { heave_force = "10 lbf" }
[components.lf]
fmu = "fmus/shock.fmu"
parameters = { gas_preload = "30 lbf", rebound_scale = 1.1 }
[[bond]]
between = ["car.lf", "lf"]
[[connection]]
from = "lf.force"
to = "car.rf.force"
gain = 2.0
[scenario]
drivefile = "drive.parquet"
stop = "1 s"
settling = 0.1
coupling_step = "1 ms"
algorithm = "gauss-seidel"
sequence = ["car", "lf"]
record = ["car.lf.velocity"]
record_step = "2 ms"
[scenario.targets]
"lf.road" = "car.lf.road"
"""
_STUDY = """schema = 1
name = "bank"
families = ["tires"]
settling = "1 s"
accuracy = 0.3
[vehicle]
fmu = "fmus/car.fmu"
parameters = {}
[bank]
soft = "fmus/shock.fmu"
firm = { fmu = "fmus/shock.fmu", parameters = { compression_scale = 1.2 } }
[corners]
lf = ["soft", "firm"]
rf = ["soft", "firm"]
lr = ["soft"]
rr = ["soft"]
[[drive]]
file = "drive.parquet"
stop = "2 s"
targets = { "lf.road" = "car.lf.road" }
[[measure]]
name = "front"
channels = ["car.lf.velocity"]
statistic = "rms"
display = "in/s"
band = ["1 Hz", "5 Hz"]
[[objective]]
measure = "front"
weight = 2.0
[[constraint]]
measure = "front"
at_most = "10 in/s"
"""
_UNCERTAIN = """schema = 1
runs = 3
[fits]
soft = "shock.json"
[run_to_run]
ride = "0.1 mm/s"
[[uncertain]]
part = "car"
correlation = [[1.0, 0.2], [0.2, 1.0]]
[uncertain.parameters]
lf_tire = { value = 1.0, deviation = 0.1, lowest = 0.5 }
rf_tire = { value = 2.0, deviation = 0.2 }
"""


def _settings(folder: Path) -> None:
    texts = {"map": _MAP, "preparation": _PREPARATION, "system": _SYSTEM, "study": _STUDY, "uncertain": _UNCERTAIN}
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")


def _states(folder: Path) -> None:
    """Write the states that commands and the window keep in their folders."""
    car, rng = read_vehicle(shipped("quarter_car")), np.random.default_rng(1)
    names = target_names(car.with_damper().output_names)
    units = tuple("m/s2" if name.endswith("acceleration") else "m" for name in names)
    series = TimeSeries(np.arange(2000) / 100.0, rng.standard_normal((len(names), 2000)), names, units)
    target = Target(series, 10.0)
    IterationFolder.start(folder / "lap", Problem(target, start_response(car, target), IterationSettings()))
    (folder / "window").mkdir()
    readings = {"dyno/a.csv": {"flip": ["force"], "map": "dyno/a.map.toml"}}
    (folder / "window/window.json").write_text(json.dumps({"readings": readings}), encoding="utf-8")
    files = "".join(f"[[file]]\npath = 'record.csv'\nclicks = {{ rebound = {k} }}\n" for k in (1, 2))
    (folder / "table.toml").write_text(f"schema = 1\n[adjuster.rebound]\nlowest = 0\n{files}", encoding="utf-8")


def study() -> Study:
    """Return a study of nine setups and two measures, without an FMU."""
    return Study(
        name="constructed", vehicle=Vehicle(Path("car.fmu")), bank={b: Build(Path(f"{b}.fmu")) for b in _BUILDS},
        corners=dict.fromkeys(_CORNERS, _BUILDS), drives=(Drive("lap", Path("lap.parquet"), 30.0),),
        measures=tuple(Measure(name, ("car.lf.velocity",), display="mm/s") for name in ("ride", "grip")),
        baseline=dict.fromkeys(_CORNERS, "soft"),
    )  # fmt: skip


def _study(folder: Path) -> None:
    made, units = study(), {"ride": "m/s", "grip": "m/s"}
    rows = [
        {"setup": int(index), **made.space.setup(int(index)).builds, "ride": 0.1 + 0.01 * index,
         "grip": 0.2 - 0.01 * index,
         "status": "done", "message": "", "marks": "", "coupling_error_percent": 0.1, "seconds": 0.03}
        for index in made.space.indices
    ]  # fmt: skip
    result = StudyResult(made, result_table(rows, study_schema(made, units)), Provenance("0" * 64, {}, {}, {}, units))
    result.save(folder / "results.parquet")
    write_selection(select(result, total=4), result, folder / "selection.csv")
    numbers = np.arange(5)
    levels = np.linspace(0.1, 0.2, 5)
    comparison = Comparison("ride", numbers, levels, levels * 1.1, np.full(5, 2), 0.01)
    write_comparisons([comparison], units, folder / "comparison.json", Verdict())
    chunks = folder / "chunks" / ("0" * 16)
    chunks.mkdir(parents=True, exist_ok=True)
    pa.parquet.write_table(result.table.slice(0, 3), chunks / "chunk_0000000_3.parquet")
    coupling = {"scheme": "gauss-seidel", "step": 1e-3, "share": 0.5, "stated_error": 0.1, "notes": ["tried 1 ms"]}
    (chunks / "coupling.json").write_text(json.dumps(coupling), encoding="utf-8")
