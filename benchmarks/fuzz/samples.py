"""Small valid files of every kind, from which mutants are created: those of the folder `valid`, and written ones."""

from __future__ import annotations

import importlib.util
import json
import shutil
import struct
from pathlib import Path

import numpy as np
import xlsxwriter

from benchmarks.fuzz.damage import members_of, packed
from builder.build import build
from cosim.study.choice.assess import Knowledge, certainty_of
from cosim.study.choice.certainty import write_certainty
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
from eightpost.signals.logger_files import write_rpc
from eightpost.signals.parquet_file import write_table
from eightpost.vehicle import Friction, IdentifiedVehicle, read_vehicle, shipped, write_vehicle
from eightpost.verdict import Verdict

_VALID = Path(__file__).with_name("valid")
_CORNERS, _BUILDS = ("lf", "rf"), ("soft", "firm", "stiff")


def make_samples(folder: Path) -> None:
    """Write every sample into a folder."""
    shutil.copytree(_VALID, folder, dirs_exist_ok=True)
    _records(folder)
    _models(folder)
    _fmus(folder)
    _states(folder)
    _study(folder)


def _records(folder: Path) -> None:
    time = np.arange(0.0, 2.0, 0.002)
    speed, travel = 0.3 * np.sin(12.0 * time), -0.025 * np.cos(12.0 * time)
    series = TimeSeries.from_channels(
        time, {"velocity": ("m/s", speed), "displacement": ("m", travel), "force": ("N", 2000.0 * speed + 30.0)}
    )
    for suffix in ("csv", "parquet", "mat", "rsp"):
        write_series(series, folder / f"record.{suffix}")
    columns = {"Time [s]": series.time.tolist(), "Force [N]": series["force"].tolist()}
    _write_json(folder / "record.json", columns)
    (folder / "words.txt").write_text("--channel\nforce=+\n--channel\nvelocity=velocity", encoding="utf-8")
    rows = "".join(f"{t:.3f};{v:.4f};{2000 * v:.2f}\n".replace(".", ",") for t, v in zip(time, speed, strict=True))
    head = "Run;7\nGas;50 psi\n\nZeit;v_mm_s;Kraft\ns;mm/s;N\n"
    (folder / "german.csv").write_text(head + rows, encoding="latin-1")
    rows = "".join(f"{k / 100:.2f} {100 + k % 30}\n" for k in range(300))
    head = "File created on 1/2/2026\n\n[header]\ntime\nvelocity kmh\n\n[column names]\ntime velocity\n\n[data]\n"
    (folder / "lap.vbo").write_text(head + rows, encoding="utf-8")
    units = {"road": "m", "force": "N", "tire_force": "N", "displacement": "m"}
    road = {
        f"{corner}.{name}": (unit, (-1) ** (j == 3) * 0.01 * np.sin((10 + k) * time + j))
        for k, corner in enumerate(CORNERS)
        for j, (name, unit) in enumerate(units.items())
    }
    write_series(TimeSeries.from_channels(2.5 * time, road), folder / "rig.parquet")
    write_series(TimeSeries.from_channels(time, {"lf.road": ("m", travel)}), folder / "drive.parquet")
    write_rpc(series, folder / "integers.drv", as_integers=True)
    _motec(folder / "run.ld", speed)
    _labview(folder, time, speed)
    with xlsxwriter.Workbook(folder / "record.xlsx") as book:
        for k, column in enumerate((("Time [s]", *time[:200]), ("Force [N]", *speed[:200]))):
            book.worksheets()[0].write_column(0, k, column) if k else book.add_worksheet().write_column(0, k, column)
    columns = (("Time_s", time), ("Force_N", speed))
    texts = (f"{name} = [{' '.join(f'{x:.4f}' for x in values)}];\n" for name, values in columns)
    (folder / "record.m").write_text("".join(texts), encoding="utf-8")
    if importlib.util.find_spec("asammdf"):
        _mdf(folder, time, speed)
    write_series(series, folder / "run/series.parquet")
    run = {"settling": 0.5, "sources": {"lf": "a.fmu"}, "parameters": {"lf": {"g": 1.0}}}
    _write_json(folder / "run/result.json", {"schema": 1, "kind": "result"} | run)


def _write_json(path: Path, document: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document), encoding="utf-8")


def _motec(path: Path, speed: np.ndarray) -> None:
    """Write a log of two channels, of floating point numbers and of scaled integers."""
    head, places = bytearray(500), (500, 624)
    struct.pack_into("<I4xII", head, 0, 0x40, places[0], 748)
    kinds = ((7, "<f4", b"Load FL", b"N"), (3, "<i2", b"Pos FL", b"mm"))
    samples = [(1e3 * speed).astype(kind).tobytes() for _, kind, *_ in kinds]
    metas = b""
    for k, (code, kind, name, unit) in enumerate(kinds):
        place = 748 + len(samples[0]) * k
        numbers = (0, (places[1], 0)[k], place, speed.size, k, code, np.dtype(kind).itemsize, 500, 0, 1, 1, k)
        metas += struct.pack("<IIIIHHHHhhhh32s8s12s40x", *numbers, name, name, unit)
    path.write_bytes(bytes(head) + metas + b"".join(samples))


def _labview(folder: Path, time: np.ndarray, speed: np.ndarray) -> None:
    head = ("LabVIEW Measurement", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Decimal_Separator\t.",
            "Multi_Headings\tYes", "X_Columns\tOne", "Time_Pref\tRelative", "***End_of_Header***", "", "Channels\t1",
            "Samples\t1000", "Date\t2026/01/02", "Time\t10:00:00", "Y_Unit_Label\tN", "X_Dimension\tTime",
            "X0\t0", "Delta_X\t0.002", "***End_of_Header***", "X_Value\tForce\tComment")  # fmt: skip
    rows = (f"{t:.3f}\t{v:.5f}" for t, v in zip(time, speed, strict=True))
    (folder / "record.lvm").write_text("\r\n".join((*head, *rows, "")), encoding="utf-8")
    if importlib.util.find_spec("nptdms"):
        from nptdms import ChannelObject, TdmsWriter  # noqa: PLC0415

        waveform = {"wf_increment": 0.002, "wf_start_offset": 0.0, "unit_string": "N"}
        with TdmsWriter(folder / "record.tdms") as writer:
            writer.write_segment([ChannelObject("test", name, speed, waveform) for name in ("Force", "Velocity")])


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
    shock = Shock("soft", law, conditions, {"rms [N]": 3.0}, ({"name": "a.csv", "sha256": "0" * 64},))
    write_shock(shock, folder / "shock.json")
    for name in ("seven_dof", "quarter_car"):
        shutil.copy(shipped(name), folder / f"{name}.toml")
    model = read_vehicle(shipped("quarter_car")).coupled()
    origin, friction = {"rig.parquet": "0" * 64}, {"": Friction(20.0, 0.01)}
    identified = IdentifiedVehicle("car", model, {"": 1000.0}, {}, origin, friction)
    write_vehicle(folder / "vehicle.json", identified)
    exact = response_of(model, np.linspace(0.5, 20.0, 40))
    response = FrequencyResponse(exact.frequency, exact.H, exact.inputs, exact.outputs,
                                 np.full((len(exact.outputs), 40), 0.99), variance=np.abs(exact.H) * 1e-4)  # fmt: skip
    write_response(folder / "response.npz", response)
    write_fit(folder / "fitted.json", VehicleFit(identified, "boggs", response, {"lf.force": 0.02}, ("a note",), 1.5))


def _fmus(folder: Path) -> None:
    shutil.copy(folder / "seven_dof.toml", folder / "car.toml")
    parts = ("model", "terminals", "resources", "binaries/linux64")
    for item in build([folder / "shock.json", folder / "car.toml"], folder / "fmus", target="python"):
        # Without the documents, a mutant is written in a hundredth of the time, and the checked content is the same.
        members = members_of(item.path.read_bytes())
        item.path.write_bytes(packed({name: c for name, c in members.items() if name.startswith(parts)}))
    shock = (folder / "fmus/shock.fmu").read_bytes()

    def valid(*names: str) -> dict[str, bytes]:
        return {name: (folder / Path(name).name).read_bytes() for name in names}

    package = valid("SystemStructure.ssd", "resources/shock.ssv", "resources/shock.ssm")
    (folder / "package.ssp").write_bytes(packed({**package, "resources/shock.fmu": shock}))
    library = b"\x7fELF" + bytes(200)
    (folder / "plain.fmu").write_bytes(packed({
        "modelDescription.xml": members_of(shock)["modelDescription.xml"], "binaries/linux64/shock.so": library,
        "extra/org.example/a.txt": b"a",
    }))  # fmt: skip
    (folder / "arrays.fmu").write_bytes(packed({
        "modelDescription.xml": (folder / "arrays.xml").read_bytes(), "binaries/x86_64-linux/arrays.so": library,
        "sources/arrays.c": b"",
        **valid("sources/buildDescription.xml", "terminalsAndIcons/terminalsAndIcons.xml"),
    }))  # fmt: skip


def _states(folder: Path) -> None:
    """Write the states that commands and the window keep in their folders."""
    car, rng = read_vehicle(shipped("quarter_car")), np.random.default_rng(1)
    names = target_names(car.with_damper().output_names)
    units = tuple("m/s2" if name.endswith("acceleration") else "m" for name in names)
    series = TimeSeries(np.arange(2000) / 100.0, rng.standard_normal((len(names), 2000)), names, units)
    target = Target(series, 10.0)
    IterationFolder.start(folder / "lap", Problem(target, start_response(car, target), IterationSettings()))
    reading = {"flip": ["force"], "map": "dyno/a.map.toml"}
    _write_json(folder / "window/window.json", {"readings": {"dyno/a.csv": reading}})


def _study(folder: Path) -> None:
    """Write the files of a study of nine setups and two measures, without an FMU."""
    made = Study(
        name="constructed", vehicle=Vehicle(Path("car.fmu")), bank={b: Build(Path(f"{b}.fmu")) for b in _BUILDS},
        corners=dict.fromkeys(_CORNERS, _BUILDS), drives=(Drive("lap", Path("lap.parquet"), 30.0),),
        measures=tuple(Measure(name, ("car.lf.velocity",), display="mm/s") for name in ("ride", "grip")),
        baseline=dict.fromkeys(_CORNERS, "soft"),
    )  # fmt: skip
    units = {"ride": "m/s", "grip": "m/s"}
    rest = {"status": "done", "message": "", "marks": "", "coupling_error_percent": 0.1, "seconds": 0.03}
    rows = [
        {"setup": k, **made.space.setup(k).builds, "ride": 0.1 + 0.01 * k, "grip": 0.2 - 0.01 * k, **rest}
        for k in map(int, made.space.indices)
    ]
    result = StudyResult(made, result_table(rows, study_schema(made, units)), Provenance("0" * 64, {}, {}, {}, units))
    result.save(folder / "results.parquet")
    write_certainty(certainty_of(result, Knowledge(()), draws=64), folder / "certainty.parquet")
    write_selection(select(result, total=4), result, folder / "selection.csv")
    levels = np.linspace(0.1, 0.2, 5)
    comparison = Comparison("ride", np.arange(5), levels, levels * 1.1, np.full(5, 2), 0.01)
    write_comparisons([comparison], units, folder / "comparison.json", Verdict())
    chunks = folder / "chunks" / ("0" * 16)
    coupling = {"scheme": "gauss-seidel", "step": 1e-3, "share": 0.5, "stated_error": 0.1, "notes": ["tried 1 ms"]}
    _write_json(chunks / "coupling.json", coupling)
    write_table(result.table.take(np.arange(3)), chunks / "chunk_0000000_3.parquet")
