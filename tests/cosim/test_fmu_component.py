"""An unusable FMU is refused with the reason before anything is loaded or left on disk."""

import re
import struct
import zipfile

import fmpy
import pytest

from cosim import FmuComponent
from cosim.components.component import Conversion, to_si
from cosim.components.fmu_file import FmuFile
from eightpost.archive import read_archive, write_archive
from eightpost.errors import FmuError, StepError


def changed(source, target, **members):
    """Copy an FMU with members replaced (None removes one)."""
    content = read_archive(source)
    for name, value in members.items():
        content.pop(name) if value is None else content.update({name: value})
    write_archive(target, content)
    return target


def test_a_missing_file_and_one_that_is_no_whole_zip_are_refused(tmp_path, fmus):
    whole = fmus["lpf1"].read_bytes()
    with zipfile.ZipFile(fmus["lpf1"]) as archive:
        entry = archive.getinfo("modelDescription.xml")
    name, extra = struct.unpack("<HH", whole[entry.header_offset + 26 : entry.header_offset + 30])
    start = entry.header_offset + 30 + name + extra
    damaged = whole[: start + 20] + bytes(40) + whole[start + 60 :]
    for content in (b"not a zip", whole[: len(whole) // 2], damaged):
        (tmp_path / "bad.fmu").write_bytes(content)
        with pytest.raises(FmuError, match="not a readable zip"):
            FmuComponent(tmp_path / "bad.fmu", "x")
    with pytest.raises(FmuError, match="no such file"):
        FmuComponent(tmp_path / "none.fmu", "x")
    with pytest.raises(FmuError, match="embedded null byte"):
        FmuComponent(tmp_path / "a\0b.fmu", "x")


def test_an_fmu_without_a_binary_for_this_platform_is_refused_and_its_platforms_are_listed(tmp_path, fmus):
    content = read_archive(fmus["lpf1"])
    kept = {name: data for name, data in content.items() if not name.startswith(f"binaries/{fmpy.platform}")}
    write_archive(tmp_path / "other.fmu", kept)
    with pytest.raises(FmuError, match=rf"no binary for this platform \({fmpy.platform}\), only for: \w+"):
        FmuComponent(tmp_path / "other.fmu", "x")


@pytest.mark.parametrize(("member", "value", "message"), [
    ("modelDescription.xml", None, "no modelDescription.xml"), ("modelDescription.xml", b"<fmiModel", "cannot be read"),
    ("modelDescription.xml", b'<fmiModelDescription fmiVersion="3.0"/>', "cannot be read|FMI 3.0"),
])  # fmt: skip
def test_a_zip_that_is_not_an_fmi_2_fmu_is_refused(tmp_path, fmus, member, value, message):
    with pytest.raises(FmuError, match=message):
        FmuComponent(changed(fmus["lpf1"], tmp_path / "bad.fmu", **{member: value}), "x")


def test_a_patch_version_is_read_a_declared_type_limits_its_variables_and_one_without_type_is_left_out(tmp_path, fmus):
    xml = read_archive(fmus["lpf1"])["modelDescription.xml"].replace(b'fmiVersion="2.0"', b'fmiVersion="2.0.4"')
    kind = b'<TypeDefinitions><SimpleType name="Speed"><Real max="3"/></SimpleType></TypeDefinitions><LogCategories>'
    xml = xml.replace(b"<LogCategories>", kind)
    xml = re.sub(rb'(name="velocity".*?<Real )', rb'\1declaredType="Speed" ', xml, count=1, flags=re.DOTALL)
    xml = re.sub(rb'(name="motion_ratio".*?>\s*)<Real [^>]*/>', rb"\1", xml, count=1, flags=re.DOTALL)
    part = FmuComponent(changed(fmus["lpf1"], tmp_path / "typed.fmu", **{"modelDescription.xml": xml}), "x")
    assert (part.variables["velocity"].maximum, part.variables["displacement"].maximum) == (3.0, None)
    assert part.variables.keys() == FmuComponent(fmus["lpf1"], "y").variables.keys() - {"motion_ratio"}


def test_an_error_names_the_component_the_step_and_the_components_message(fmus):
    part = FmuComponent(fmus["lpf1"], "left front")
    part.begin(0.0, 1.0, {})
    part.end_initialization()
    with pytest.raises(StepError, match=r"'left front' \(lpf1.fmu\) failed to set inputs.*velocity = infinity"):
        part.set(("velocity",), (float("inf"),))
    with pytest.raises(StepError, match=r"failed to step from 0.25 s by 0.001 s.*the last one ended at 0 s"):
        part.step(0.25, 1e-3)
    part.finish()
    part.finish()


def test_an_undefined_unit_keeps_its_name(tmp_path, fmus):
    xml = read_archive(fmus["lpf1"])["modelDescription.xml"]
    start = xml.index(b'<Unit name="m/s">')
    xml = xml[:start] + xml[xml.index(b"</Unit>", start) + 7 :]
    part = FmuComponent(changed(fmus["lpf1"], tmp_path / "odd.fmu", **{"modelDescription.xml": xml}), "x")
    assert part.variables["velocity"].unit.name == "m/s"
    assert to_si(part.variables["velocity"]) == (Conversion(), "m/s")


def test_a_run_unpacks_neither_documentation_nor_sources_nor_binaries_of_other_platforms(fmus, tmp_path):
    path, folder = changed(fmus["lpnl2"], tmp_path / "a.fmu", **{"binaries/amiga/a.so": b""}), tmp_path / "out"
    fmu = FmuFile.unpack(path, folder)
    assert [path.name for path in (folder / "binaries").iterdir()] == [fmu.library.parent.name]
    assert not (folder / "documentation").exists() and not list((folder / "sources").glob("*.[ch]"))
