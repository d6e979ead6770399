"""The archive of open and confidential native FMUs, and the agreement of its sources with its binaries."""

import re
import shutil
import struct
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fmpy import simulate_fmu
from fmpy.build import build_platform_binary

from builder.build import build, fmu_identifier
from builder.native_fmu import _c_sources
from builder.product import shock_product
from builder.reference import Disclosure
from builder.toolchain import (
    BROWSER,
    PLATFORMS,
    SystemCompiler,
    Toolchain,
    Zig,
    find_toolchain,
    this_platform,
    universal,
)
from eightpost.__main__ import main
from eightpost.archive import extract_archive, read_archive, write_archive
from eightpost.errors import FmuError
from eightpost.shock import LAWS, Shock, write_shock

from .shock_over_settings import shock_of

ALL = (*LAWS, "seven_dof", "quarter_car")


@pytest.mark.repeated("lpnl2", "quarter_car")
@pytest.mark.parametrize("name", ALL)
def test_an_archive_contains_binaries_sources_documents_and_reference_results(universal_fmus, name):
    members = set(read_archive(universal_fmus[name]))
    assert members >= {
        "modelDescription.xml",
        "model.png",
        "documentation/index.html",
        "documentation/licenses/license.txt",
        "terminalsAndIcons/terminalsAndIcons.xml",
        f"extra/eightpost/{name}_ref.csv",
        "sources/model.c",
        "sources/interface.c",
        this_platform().member(name),
    }
    if isinstance(find_toolchain(), Zig):
        assert {m for m in members if m.startswith("binaries/")} == {p.member(name) for p in PLATFORMS.values()}


@pytest.mark.parametrize("name", ALL)
def test_the_binary_contains_its_guid_which_is_a_digest_of_the_content(fmus, name):
    members = read_archive(fmus[name])
    guid = ET.fromstring(members["modelDescription.xml"]).get("guid")
    assert guid.encode() in members[this_platform().member(name)]
    assert guid.encode() in members["sources/interface.h"]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["lpnl2", pytest.param("seven_dof", marks=pytest.mark.nightly)])
def test_fmpy_compile_rebuilds_the_fmu_and_the_rebuilt_one_gives_the_same_outputs(fmus, tmp_path, name):
    if shutil.which("cmake") is None or shutil.which("cc") is None:
        pytest.skip("no cmake or no C compiler on this machine")
    extract_archive(fmus[name], tmp_path / "fmu")
    shutil.rmtree(tmp_path / "fmu" / "binaries")
    with tempfile.TemporaryDirectory() as folder:
        build_platform_binary(tmp_path / "fmu", folder, cmake_options={}, all_warnings=True)
    rebuilt = {
        str(p.relative_to(tmp_path / "fmu")): p.read_bytes() for p in (tmp_path / "fmu").rglob("*") if p.is_file()
    }
    write_archive(tmp_path / "rebuilt.fmu", rebuilt)
    time = np.arange(0.0, 0.5, 1e-3)
    first = "velocity" if name == "lpnl2" else "lf.road"
    signals = np.zeros(time.size, dtype=[("time", "f8"), (first, "f8")])
    signals["time"], signals[first] = time, 0.05 * np.sin(30.0 * time)
    found = [
        simulate_fmu(str(path), stop_time=0.4, output_interval=1e-3, input=signals)
        for path in (fmus[name], tmp_path / "rebuilt.fmu")
    ]
    assert found[0].dtype == found[1].dtype
    assert found[0].tobytes() == found[1].tobytes()


def is_disclosed(value, content):
    """Return whether a double is in a text file, with six or more of its digits."""
    return any(f"{value:.{digits}g}".encode() in content for digits in (6, 9, 12, 17))


@pytest.mark.slow
def test_a_confidential_fmu_discloses_neither_the_curve_nor_its_sources(shocks, tmp_path):
    law = shocks["lpnl2"].law
    inner = (1812.34567, *law.curve.inner[1:14], 31.4159265)
    curve = replace(law.curve, inner=inner, compression=(1487.65432, 900.123456, 40.0, 5.0))
    source = {"file": "records/tuesday_17.csv"}
    secret = Shock("the Tuesday damper", replace(law, curve=curve), {"source": source, "build": "tuesday_17"})
    write_shock(secret, tmp_path / "front.json")
    (built,) = build([tmp_path / "front.json"], tmp_path, disclosure=Disclosure.CONFIDENTIAL)
    members = read_archive(built.path)
    assert not [m for m in members if m.startswith("sources/")]
    for name, content in members.items():
        for word in (b"uesday", b"records/", b"model.c", b"shock.c", b"front.json", str(tmp_path).encode()):
            assert word not in content, (name, word)
        if not name.startswith("binaries/"):
            if name.endswith((".xml", ".csv")):  # the page may contain the names of coefficients
                assert b"curve." not in content, name
            for value in (*inner[:1], *inner[14:], *curve.compression[:2]):
                assert not is_disclosed(value, content), (name, value)


def test_a_confidential_fmu_gives_the_same_output_as_the_open_one(shocks, fmus, tmp_path):
    write_shock(shocks["lpnl2"], tmp_path / "front.json")
    (built,) = build([tmp_path / "front.json"], tmp_path, disclosure=Disclosure.CONFIDENTIAL)
    time = np.arange(0.0, 0.3, 1e-3)
    signals = np.zeros(time.size, dtype=[("time", "f8"), ("velocity", "f8")])
    signals["time"], signals["velocity"] = time, 0.6 * np.sin(30.0 * time)
    found = [
        simulate_fmu(str(path), stop_time=0.2, output_interval=1e-3, input=signals, output=["force", "lagged_force"])
        for path in (fmus["lpnl2"], built.path)
    ]
    assert found[0].tobytes() == found[1].tobytes()


@pytest.mark.nightly
def test_without_zig_the_build_is_for_this_platform_and_reports_that(shocks, tmp_path, monkeypatch):
    system = SystemCompiler(shutil.which("cc") or pytest.skip("no system compiler"))
    monkeypatch.setattr("builder.build.find_toolchain", lambda: system)
    write_shock(shocks["lpf1"], tmp_path / "front.json")
    done = CliRunner().invoke(main, ["build", str(tmp_path / "front.json"), "-o", str(tmp_path)])
    assert f"built for {this_platform().name} only" in " ".join(done.output.split())
    assert [m for m in read_archive(tmp_path / "front.fmu") if "binaries/" in m] == [this_platform().member("front")]
    assert len(simulate_fmu(str(tmp_path / "front.fmu"), stop_time=0.01, output_interval=1e-3)) == 11


@pytest.mark.slow
def test_the_target_all_writes_native_and_python_fmus(shocks, tmp_path):
    write_shock(shocks["lpf1"], tmp_path / "front.json")
    built = build([tmp_path / "front.json"], tmp_path / "out", target="all")
    assert [(item.path.name, item.target) for item in built] == [
        ("front.fmu", "native"),
        ("front_python.fmu", "python"),
    ]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"front.fmu", "front_python.fmu"}


def test_nothing_is_written_if_one_of_several_fmus_cannot_be_built(shocks, tmp_path):
    write_shock(shocks["lpf1"], tmp_path / "good.json")
    (tmp_path / "bad.json").write_text("{}")
    with pytest.raises(ValueError, match="bad"):
        build([tmp_path / "good.json", tmp_path / "bad.json"], tmp_path / "out")
    assert not list(Path(tmp_path).glob("out/*.fmu"))


def test_names_that_differ_only_in_case_are_rejected(shocks, tmp_path):
    for name in ("A", "a"):
        write_shock(shocks["lpf1"], tmp_path / f"{name}.json")
    with pytest.raises(FmuError, match="several sources would be written to"):
        build([tmp_path / "A.json", tmp_path / "a.json"], tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "advice"),
    [
        ("record.csv", "time [s]\n", "eightpost fit"),
        ("car_system.toml", "[components.car]\nfmu = 'car.fmu'\n", "eightpost run"),
        ("gone.json", None, "the file does not exist"),
    ],
)
def test_files_that_cannot_be_built_are_rejected_with_the_remedy(tmp_path, name, content, advice):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(FmuError, match=advice):
        build([tmp_path / name], tmp_path)


# ---- Descriptions, C data and compilers ------------------------------------------------------------------------------


FILES = ["a.c", "b.c"]
#: What differs with every change of the sources, and the lines of arrays.
_OWN = r'(guid|instantiationToken|version|generationTool)="[^"]*"|\{[0-9a-f-]{36}\}|0x[0-9a-f]+|\d{15,}'


def _lines(content: bytes) -> list[str]:
    text = re.sub(_OWN, "", content.decode())
    return [line.strip() for line in text.splitlines() if line.strip() and not re.match(r"\s*(<File name|</)", line)]


@pytest.mark.parametrize("version", ["2", "3"])
def test_the_description_of_a_car_is_the_same(
    version: str, fmus: Mapping[str, Path], fmus3: Mapping[str, Path], unchanged: Callable[..., None]
) -> None:
    unchanged(_lines(read_archive((fmus if version == "2" else fmus3)["quarter_car"])["modelDescription.xml"]))


@pytest.mark.parametrize("name", ["interface.c", "interface.h", "vehicle_data.h"])
def test_the_c_data_of_a_car_are_the_same(name: str, fmus: Mapping[str, Path], unchanged: Callable[..., None]) -> None:
    unchanged(_lines(read_archive(fmus["quarter_car"])[f"sources/{name}"]))


def test_the_c_data_of_a_shock_over_settings_are_the_same(unchanged: Callable[..., None]) -> None:
    product = shock_product(shock_of("hysteresis_lagged"), "shock", temperature_input=True)
    sources = _c_sources(product, product.interface, "0")
    unchanged([line for line in _lines(sources["settings_data.h"]) if not line.startswith("{0.0, 0.0, 0.0, 0.0")])


@pytest.mark.parametrize("compiler", [Zig, SystemCompiler])
def test_a_library_is_compiled_with_the_same_command(compiler: type[Toolchain], unchanged: Callable[..., None]) -> None:
    toolchain = compiler(sys.executable)
    platforms = [*PLATFORMS.values(), BROWSER] if compiler is Zig else [PLATFORMS["linux64"]]
    unchanged({
        f"{platform.name}, {platform.name_3}, {target}": [
            platform.member("car"), platform.member("car", 3),
            " ".join(re.sub(r"^/.*/", "", word) for word in toolchain.command("car", platform, target, FILES)[1:]),
        ]
        for platform in platforms for target in platform.targets
    })  # fmt: skip


def test_a_universal_library_has_aligned_slices_and_their_processors() -> None:
    slices = [struct.pack("<IiI", 0xFEEDFACF, kind, 3) + bytes(size) for kind, size in ((7, 100), (12, 40_000), (7, 1))]
    made = universal(slices)
    assert struct.unpack_from(">II", made) == (0xCAFEBABE, 3)
    entries = [struct.unpack_from(">iIIII", made, 8 + 20 * k) for k in range(3)]
    assert [entry[:2] for entry in entries] == [(7, 3), (12, 3), (7, 3)]
    assert [entry[2] for entry in entries] == [1 << 14, 2 << 14, 5 << 14]
    assert [entry[4] for entry in entries] == [14, 14, 14]
    assert [made[start : start + size] for _, _, start, size, _ in entries] == slices
    assert len(made) == (5 << 14) + len(slices[2])


@pytest.mark.parametrize(
    ("name", "identifier"),
    [
        ("A b-c", "A_b_c"),
        ("3 inch", "_3_inch"),
        ("Ä", "_"),
        ("", "_"),
        ("_x_", "_x_"),
        ("if", "if_"),
        ("Con", "Con_"),
        ("LPT1", "LPT1_"),
    ],
)
def test_an_identifier_of_an_fmu_is_one_of_c(name: str, identifier: str) -> None:
    assert fmu_identifier(name) == identifier
