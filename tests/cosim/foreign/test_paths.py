"""Names in the description of an FMU lead to no file outside the folder that it is unpacked into."""

import fmpy
import pytest

from builder.check.probes.library import binary_members, binary_path
from cosim import FmuComponent
from eightpost.archive import write_archive
from eightpost.errors import FmuError

from . import lag_fmus, version_2
from .conftest import VARIABLES

NAMES = ["../../../x", "../x", "/tmp/x", "a/b", "a\\b", "..", "", "a b", "1a", "é"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("version", [2, 3])
def test_a_model_identifier_that_is_no_c_name_is_refused(name, version, tmp_path):
    known, xml = b"lag", lag_fmus.description() if version == 3 else version_2.description("lag", VARIABLES)
    xml = xml.replace(b'modelIdentifier="' + known, b'modelIdentifier="' + name.encode())
    platform = fmpy.platform if version == 2 else fmpy.platform_tuple
    write_archive(tmp_path / "odd.fmu", {"modelDescription.xml": xml, f"binaries/{platform}/x.txt": b""})
    with pytest.raises(FmuError, match=r"modelIdentifier is .* which is not a C name"):
        FmuComponent(tmp_path / "odd.fmu", "odd")


@pytest.mark.parametrize("name", ["../../x.c", "/etc/x.c"])
def test_a_listed_source_outside_the_fmu_is_refused(name, source_fmu):
    with pytest.raises(FmuError, match=f"names '{name}', outside the FMU"):
        FmuComponent(source_fmu(listed=name, all="int x;"), "odd", compile_missing=True)


@pytest.mark.parametrize(("name", "inside"), [("../../x", False), ("/etc", False), ("../resources", True), ("a", True)])
def test_a_folder_of_headers_outside_the_fmu_is_refused(name, inside, tmp_path):
    build = f"""<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="lag"><SourceFileSet>
      <SourceFile name="lag.c"/><IncludeDirectory name="{name}"/>
      </SourceFileSet></BuildConfiguration></fmiBuildDescription>"""
    members = {
        "modelDescription.xml": lag_fmus.description(),
        "sources/buildDescription.xml": build.encode(),
        "sources/lag.c": b"int x;",
    }
    write_archive(tmp_path / "odd.fmu", members)
    if inside:
        FmuComponent(tmp_path / "odd.fmu", "odd", compile_missing=True).close()
        return
    with pytest.raises(FmuError, match=f"names '{name}', outside the FMU"):
        FmuComponent(tmp_path / "odd.fmu", "odd", compile_missing=True)


@pytest.mark.parametrize("version", [2, 3])
def test_the_checks_load_no_library_outside_the_fmu(version, tmp_path):
    for name in ("x", "../../../x"):
        path = tmp_path / "fmu" / binary_members(name, version)[0]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    assert binary_path(tmp_path / "fmu", "x", version) is not None
    assert binary_path(tmp_path / "fmu", "../../../x", version) is None
