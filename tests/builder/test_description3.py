"""modelDescription.xml and the archive of FMI 3.0 are valid and say what those of FMI 2.0 say."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fmpy import read_model_description, simulate_fmu

from builder.build import build
from builder.reference import Disclosure
from builder.toolchain import PLATFORMS, this_platform
from eightpost.__main__ import main
from eightpost.archive import read_archive
from eightpost.errors import FmuError, ParameterError
from eightpost.shock import LAWS, write_shock

ALL = (*LAWS, "seven_dof", "quarter_car")
TYPES = {"Real": "Float64", "Boolean": "Boolean"}


def xml_of(path):
    return ET.fromstring(read_archive(path)["modelDescription.xml"])


@pytest.fixture
def both(fmus, fmus3):
    """Return the descriptions of FMI 2.0 and 3.0 of a model, as FMPy reads them."""
    return lambda name: tuple(read_model_description(str(found[name])) for found in (fmus, fmus3))


@pytest.mark.parametrize("name", ALL)
def test_every_variable_is_that_of_fmi_2_and_time_is_added(both, fmus3, name):
    old, new = both(name)
    time, *variables = new.modelVariables
    assert (time.name, time.valueReference, time.type, time.causality) == ("time", 1000000, "Float64", "independent")
    assert (time.variability, time.unit, time.start) == ("continuous", "s", None)
    references = [v.valueReference for v in new.modelVariables]
    assert len(set(references)) == len(references)
    for before, after in zip(old.modelVariables, variables, strict=True):
        for attribute in ("name", "valueReference", "causality", "variability", "initial", "description", "unit",
                          "displayUnit", "min", "max", "nominal", "start"):  # fmt: skip
            assert getattr(after, attribute) == getattr(before, attribute), (before.name, attribute)
        assert after.type == TYPES[before.type]
        assert getattr(after.derivative, "name", None) == getattr(before.derivative, "name", None)

    updated = {
        v.get("name") for v in xml_of(fmus3[name]).find("ModelVariables") if v.get("intermediateUpdate") == "true"
    }
    assert updated == {v.name for v in variables if v.causality == "input"}


@pytest.mark.parametrize("name", ["lpnl2", "quarter_car"])
def test_fmpy_simulates_both_kinds_of_instance_with_the_results_of_fmi_2(fmus, fmus3, name):
    first = "velocity" if name == "lpnl2" else "road"
    time = np.arange(0.0, 0.3, 1e-3)
    signals = np.zeros(time.size, dtype=[("time", "f8"), (first, "f8")])
    signals["time"], signals[first] = time, 0.05 * np.sin(30.0 * time)
    for kind in ("CoSimulation", "ModelExchange"):
        found = [
            simulate_fmu(str(archives[name]), stop_time=0.2, output_interval=1e-3, input=signals, fmi_type=kind)
            for archives in (fmus, fmus3)
        ]
        assert np.ptp(found[0][found[0].dtype.names[1]]) > 0.0
        assert found[1].dtype == found[0].dtype
        for column in found[0].dtype.names:
            assert found[1][column].tolist() == pytest.approx(found[0][column].tolist(), rel=1e-9, abs=1e-12)
            if kind == "CoSimulation":
                assert found[1][column].tolist() == found[0][column].tolist()


@pytest.mark.parametrize("name", ALL)
def test_the_archive_has_the_members_of_fmi_2_at_their_places_in_fmi_3(fmus, fmus3, name):
    old, new = (read_archive(found[name]) for found in (fmus, fmus3))
    moved = {"model.png": "documentation/diagram.png"}
    binaries = {p.member(name) for p in PLATFORMS.values()} | {this_platform().member(name)}
    expected = {moved.get(member, member) for member in old if member not in binaries}
    added = set(new) - expected
    assert expected <= set(new)
    assert {m for m in added if not m.startswith("sources/fmi3")} == {this_platform().member(name, 3)}
    assert new["documentation/diagram.png"] == old["model.png"]
    for page, version in ((old, b"FMI 2.0"), (new, b"FMI 3.0")):
        assert version in page["documentation/index.html"]
    token = xml_of(fmus3[name]).get("instantiationToken").encode()
    assert token in new[this_platform().member(name, 3)] and token in new["sources/interface.h"]
    assert token != xml_of(fmus[name]).get("guid").encode()


# ---- eightpost build --fmi ------------------------------------------------------------------------------------------


@pytest.fixture
def run(monkeypatch):
    """Run `eightpost build` for this platform; return the exit code and the output."""

    def command(*arguments):
        monkeypatch.setenv("COLUMNS", "200")
        result = CliRunner().invoke(main, ["build", *map(str, arguments)])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result.exit_code, " ".join(result.output.split())

    return command


@pytest.fixture
def shock(shocks, tmp_path):
    """The file of a shock."""
    write_shock(shocks["lpnl2"], path := tmp_path / "lpnl2.json")
    return path


def versions(folder):
    return {path.name: xml_of(path).get("fmiVersion") for path in Path(folder).glob("*.fmu")}


@pytest.mark.nightly
def test_build_writes_the_versions_that_are_asked_for_with_the_same_bytes_each_time(run, shock, fmus3, tmp_path):
    usual = run(shock, "-o", tmp_path / "usual")[0]
    assert run(shock, "--fmi", "3", "-o", tmp_path / "three")[0] == usual
    code, output = run(shock, "--fmi", "all", "-o", tmp_path / "all")
    assert code == usual and "2.0" in output and "3.0" in output
    assert versions(tmp_path / "usual") == {"lpnl2.fmu": "2.0"}
    assert versions(tmp_path / "three") == {"lpnl2.fmu": "3.0"}
    assert versions(tmp_path / "all") == {"lpnl2.fmu": "2.0", "lpnl2_fmi3.fmu": "3.0"}
    assert (tmp_path / "three" / "lpnl2.fmu").read_bytes() == fmus3["lpnl2"].read_bytes()
    # Beside the FMU of FMI 2.0 it has an identifier of its own, so that a program can link both.
    assert xml_of(tmp_path / "all" / "lpnl2_fmi3.fmu").find("CoSimulation").get("modelIdentifier") == "lpnl2_fmi3"


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--target", "python", "--fmi", "3"), "python FMUs are of FMI 2.0"),
        (("--target", "all", "--fmi", "all"), "python FMUs are of FMI 2.0"),
        (("--fmi", "1"), "unknown value '1'; it must be one of 2, 3, all"),
    ],
)
def test_an_fmi_version_that_cannot_be_built_is_a_usage_error(run, shock, tmp_path, options, reason):
    code, output = run(shock, *options, "-o", tmp_path / "out")
    assert code == 2 and reason in output
    assert not (tmp_path / "out").exists()


def test_build_refuses_the_same_from_python(shock, tmp_path):
    for options in ({"target": "python", "fmi": "3"}, {"fmi": "4"}):
        with pytest.raises((FmuError, ParameterError), match="FMI"):
            build([shock], tmp_path, **options)
    with pytest.raises(FmuError, match="must be native"):
        build([shock], tmp_path, target="python", disclosure=Disclosure.CONFIDENTIAL)
