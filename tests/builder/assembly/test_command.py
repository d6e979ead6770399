"""`eightpost build --assemble`."""

import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from builder.toolchain import this_platform
from eightpost.app.exchange import build as command
from eightpost.errors import InputError


@pytest.mark.nightly
def test_the_command_reports_the_assembled_parts(system_file, tmp_path, toolchain, monkeypatch):
    monkeypatch.setattr("builder.assembly.assembled_fmu.find_toolchain", lambda: toolchain)
    output = tmp_path / "dist" / "car_with_shocks.fmu"
    ran = CliRunner().invoke(command, [str(system_file), "-o", str(output)], env={"COLUMNS": "200"})
    assert ran.exit_code == 0, ran.output
    for text in ("lpf1.fmu", "car.lf.velocity", "0.5 ms", "coupling_step", this_platform().name):
        assert text in ran.output
    assert output.is_file()


def test_the_command_takes_a_system_file_or_sources(system_file):
    both = CliRunner().invoke(command, [str(system_file), "shock.json"])
    assert both.exit_code == 2 and "omit other SOURCES" in both.output
    neither = CliRunner().invoke(command, [])
    assert neither.exit_code == 2 and "Missing argument" in neither.output


def test_an_assembly_never_replaces_a_part_of_it_and_compiles_nothing(system_file, monkeypatch):
    monkeypatch.setattr("builder.assembly.assembled_fmu.compiled", None)
    part = Path(tomllib.loads(system_file.read_text())["components"]["car"]["fmu"])
    before = part.read_bytes()
    ran = CliRunner().invoke(command, [str(system_file), "-o", str(part)])
    assert isinstance(ran.exception, InputError) and f"{part} is an input of this command" in str(ran.exception)
    assert part.read_bytes() == before
