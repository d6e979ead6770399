"""The files of a package are found in archives, in folders and by URI; files that cannot be opened are reported."""

import gc
import shutil

import pytest

import cosim
from cosim.ssp import Given
from cosim.system_file import read_case
from eightpost.archive import write_archive
from eightpost.errors import FmuError, InputError, WiringError

from .corner import by_hand, corner, read, resources, run, same


def test_a_description_in_a_folder_and_in_an_archive_give_the_same_result(folder):
    case = read(folder, corner())
    write_archive(folder / "corner.ssp", {**resources(folder), "SystemStructure.ssd": corner()})
    packed = read_case(folder / "corner.ssp", given=Given(folder / "road.csv"))
    expected = by_hand(folder)
    same(run(case), expected)
    same(run(packed), expected)
    assert case.system.bonds == packed.system.bonds == (cosim.Bond.between("car", "shock"),)


def test_an_unpacked_package_is_removed_with_the_last_of_its_components(folder):
    write_archive(folder / "corner.ssp", {**resources(folder), "SystemStructure.ssd": corner()})
    case = read_case(folder / "corner.ssp", given=Given(folder / "road.csv"))
    file = case.fmus["shock"]
    assert file.is_file()
    del case
    gc.collect()
    assert not file.exists()


@pytest.mark.parametrize("source", ["../lpnl2.fmu", "%2e%2e/lpnl2.fmu", "/lpnl2.fmu"])
def test_a_source_outside_the_archive_is_refused(folder, source):
    shutil.copy(folder / "resources" / "lpnl2.fmu", folder / "lpnl2.fmu")
    content = corner().replace(b"resources/lpnl2.fmu", source.encode())
    write_archive(folder / "corner.ssp", {"SystemStructure.ssd": content, **resources(folder)})
    with pytest.raises(InputError, match=r"corner\.ssp.* component 'shock': the source '.*' is outside the package"):
        read_case(folder / "corner.ssp")


def test_a_description_file_may_refer_to_files_outside_its_folder_and_by_uri(folder):
    (folder / "systems").mkdir()
    car, shock = folder / "resources" / "quarter_car.fmu", folder / "resources" / "lpnl2.fmu"
    content = corner().replace(b"resources/lpnl2", b"../resources/lpnl2")
    content = content.replace(b"resources/quarter_car.fmu", car.as_uri().encode())
    (folder / "systems" / "corner.ssd").write_bytes(content)
    case = read_case(folder / "systems" / "corner.ssd", given=Given(folder / "road.csv"))
    assert {name: path.resolve() for name, path in case.fmus.items()} == {
        "car": car.resolve(),
        "shock": shock.resolve(),
    }


def test_errors_name_unreadable_archives_and_archives_without_a_description(folder):
    (folder / "text.ssp").write_text("no zip")
    with pytest.raises(FmuError, match=r"text\.ssp: is not a readable zip"):
        read_case(folder / "text.ssp")
    with pytest.raises(FmuError, match="there is no such file"):
        read_case(folder / "none.ssp")
    with pytest.raises(InputError, match="there is no such file"):
        read_case(folder / "none.ssd")
    write_archive(folder / "other.ssp", {"A.ssd": b"<x/>", "b.txt": b""})
    with pytest.raises(InputError, match=r"no SystemStructure\.ssd in the archive; it contains A\.ssd"):
        read_case(folder / "other.ssp")
    write_archive(folder / "evil.ssp", {"../x.ssd": b"<x/>"})
    with pytest.raises(FmuError, match="would be written outside"):
        read_case(folder / "evil.ssp")


def test_an_error_names_an_unusable_fmu_by_its_place_in_the_package(folder):
    write_archive(folder / "bad.ssp", {"SystemStructure.ssd": corner(), "resources/quarter_car.fmu": b"no zip",
                                       "resources/lpnl2.fmu": b"no zip"})  # fmt: skip
    with pytest.raises(
        FmuError, match=r"bad\.ssp: SystemStructure\.ssd: component 'car' \(resources/quarter_car\.fmu\): is not"
    ):
        read_case(folder / "bad.ssp")


def test_a_shock_of_a_package_is_replaced_by_its_flattened_name(folder, fmus):
    (folder / "corner.ssd").write_bytes(corner())
    given = Given(folder / "road.csv")
    case = read_case(folder / "corner.ssd", fmus={"shock": fmus["polylinear"]}, given=given)
    assert case.fmus["shock"] == fmus["polylinear"]
    assert "time_constant" not in case.system.components["shock"].variables
    with pytest.raises(WiringError, match="no component 'damper' to swap; there are car, shock"):
        read_case(folder / "corner.ssd", fmus={"damper": fmus["polylinear"]}, given=given)
