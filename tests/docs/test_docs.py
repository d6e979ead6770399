"""The documentation agrees with the code: names resolve, tables are up to date, links lead to files."""

from __future__ import annotations

import dataclasses
import importlib
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from cosim import system_file
from dissertation import inventory
from eightpost.signals import ChannelMap, read_series
from eightpost.signals.table_text import split_header
from eightpost.units import convert
from eightpost.vehicle import QuarterCar, SevenDof

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]

CODE = re.compile(r"`((?:eightpost|builder|cosim)\.[\w.]+)`")
#: Path of a page, a picture or a script of the documentation, as texts name it; not a part of an address.
PAGE_NAME = re.compile(r"(?<![\w/])docs/[\w/]+\.(?:md|png|py)\b")
LINK = re.compile(r"\]\(([^)\s]+)\)")
OUTSIDE = "../" + "shared"  # written in two parts, so that this file does not mention it

NAMES = sorted(set(CODE.findall((ROOT / "docs" / "evidence" / "equations.md").read_text(encoding="utf-8"))))


def resolve(name: str) -> object:
    """Import the longest module of a dotted name and look up the rest."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            value: object = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError as error:
            if error.name is None or not name.startswith(error.name):
                raise
            continue
        for attribute in parts[count:]:
            value = getattr(value, attribute)
        return value
    raise ModuleNotFoundError(name)


@pytest.fixture(scope="module")
def make_tables():
    return importlib.import_module("docs.make.make_tables")


def test_every_name_in_the_map_of_equations_exists():
    assert len(NAMES) > 30
    missing = []
    for name in NAMES:
        try:
            resolve(name)
        except (AttributeError, ModuleNotFoundError) as error:
            missing.append(f"{name}: {error}")
    assert missing == []


def test_a_name_that_does_not_exist_does_not_resolve():
    with pytest.raises(AttributeError):
        resolve("eightpost.shock.lpnl2.Lpnl3")
    with pytest.raises(AttributeError):
        resolve("eightpost.shock.lpnl3.Lpnl3")


@pytest.mark.parametrize(
    "name", ["reference/check.md", "reference/ports.md", "reference/verdict.md", "evidence/equations.md"]
)
def test_the_tables_that_come_from_the_code_are_up_to_date(make_tables, name):
    page = (ROOT / "docs" / name).read_text(encoding="utf-8")
    assert make_tables.rewrite(page) == page, "run: python docs/make/make_tables.py"


def test_the_index_has_a_result_for_every_item_of_the_inventory():
    results = json.loads((ROOT / "docs" / "data" / "reproduced.json").read_text(encoding="utf-8"))["items"]
    assert list(results) == [item.name for item in inventory()], "run: python docs/make/make_reproduce.py"


def test_the_page_lists_every_rule_of_a_verdict():
    """The rules are searched in the sources, so that a module missing from the page is found."""
    page = (ROOT / "docs" / "reference" / "verdict.md").read_text(encoding="utf-8")
    stated = {
        path.relative_to(ROOT)
        for package in ("eightpost", "cosim", "builder", "dissertation")
        for path in (ROOT / package).rglob("*.py")
        if re.search(r"^RULES = (?:Rules\b|rules_of)", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert {f"<!-- rules {'.'.join(path.with_suffix('').parts)} -->" for path in stated} == set(
        re.findall(r"<!-- rules .*? -->", page)
    )


def test_the_page_of_ports_lists_every_variable_with_its_reference():
    """The test reads the page, not the output of the script, so that a missing table is found."""
    page = (ROOT / "docs" / "reference" / "ports.md").read_text(encoding="utf-8")
    rows = [
        (source, row)
        for source in sorted((ROOT / "fmus").glob("*/*.toml"))
        for row in tomllib.loads(source.read_text(encoding="utf-8")).get("variable", [])
    ]
    assert len(rows) > 80
    for source, row in rows:
        first = re.escape(f"| `{row['name']}") + r"(\[1\] to \[\d+\])?` \| " + str(row["reference"])
        listed = rf"^{first}( to \d+)? \| [^|]*\| {re.escape(row.get('unit', ''))} \|"
        assert re.search(listed, page, re.MULTILINE), f"{source.relative_to(ROOT)}: {row}"


def test_every_relative_link_leads_to_a_file():
    links = [
        (page, number, target)
        for page in PAGES
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1)
        for target in LINK.findall(line)
        if not re.match(r"[a-z]+:|#", target)
    ]
    assert len(links) > 500
    assert [
        f"{page.relative_to(ROOT)}:{number}: {target}"
        for page, number, target in links
        if not (page.parent / target.partition("#")[0]).exists()
    ] == []


def test_the_channel_map_of_the_page_is_read(tmp_path):
    page = (ROOT / "docs" / "reference" / "signs_and_units.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "map.toml").write_text(block, encoding="utf-8")
    (tmp_path / "run.csv").write_text("Time;Pot;Load cell 2;v_mm_s\n0,000;1,0;100;5\n0,001;1,1;110;6\n")
    series = read_series(tmp_path / "run.csv", channel_map=ChannelMap.read(tmp_path / "map.toml"))
    assert series["force"][0] == pytest.approx(convert(-100.0 + 12.5, "lbf", "N"))
    assert series["displacement"][1] == pytest.approx(1.1e-3)
    assert series["velocity"][1] == pytest.approx(6e-3)


def test_the_headers_of_the_page_are_split_as_it_says():
    headers = {
        "velocity [in/s]": ("velocity", "in/s"), "velocity (in/s)": ("velocity", "in/s"), "x_mm": ("x", "mm"),
        "v_mm_s": ("v", "mm/s"), "F_lbf": ("F", "lbf"), "T_degC": ("T", "degC"), "t_ms": ("t", "ms"),
        "disp_in": ("disp", "in"), "temp_F": ("temp", "degF"), "max_s": ("max_s", None),
        "sensor_in": ("sensor_in", None), "lf_force": ("lf_force", None),
    }  # fmt: skip
    page = (ROOT / "docs" / "reference" / "signs_and_units.md").read_text(encoding="utf-8")
    for header, expected in headers.items():
        assert f"`{header}`" in page
        assert split_header(header) == expected


def test_nothing_in_the_repository_points_outside_it_and_every_page_that_a_text_names_exists():
    """Help texts, messages and comments name pages by their path from the root, such as docs/reference/ports.md."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    contents = {name: (ROOT / name).read_bytes() for name in listed.split("\0") if (ROOT / name).is_file()}
    # make test looks for measured records in a folder outside the checkout; no other file refers to it.
    assert [name for name, content in contents.items() if OUTSIDE.encode() in content and name != "Makefile"] == []
    named = {
        (name, path)
        for name, content in contents.items()
        if Path(name).suffix in (".py", ".md", ".toml", ".c", ".h") or name == "Makefile"
        for path in PAGE_NAME.findall(content.decode())
    }
    assert len({path for _, path in named}) > 40
    assert [f"{name}: {path}" for name, path in sorted(named) if not (ROOT / path).is_file()] == []


def test_every_entry_of_a_system_file_is_documented():
    page = (ROOT / "docs" / "reference" / "system_file.md").read_text()
    for model in (system_file._File, system_file._Component, system_file._Bond, system_file._Scenario):
        for name, field in model.model_fields.items():
            assert re.search(rf"[`\[.]{field.alias or name}\b", page), name


@pytest.mark.parametrize("kind", [QuarterCar, SevenDof])
def test_every_parameter_of_a_vehicle_file_is_documented(kind):
    page = (ROOT / "docs" / "reference" / "vehicle_file.md").read_text()
    for field in dataclasses.fields(kind):
        assert f"`{field.name}`" in page, field.name


# ==== docs/reference/dropin.md has every line once, and the tests that it names exist ================================

PAGE = (ROOT / "docs" / "reference" / "dropin.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`((?:tests|benchmarks)/[\w/]+\.py)(?:::(\w+))?`", PAGE)))


def test_the_table_has_every_line_once():
    assert [int(n) for n in re.findall(r"^\| (\d+) \|", PAGE, flags=re.MULTILINE)] == list(range(1, 28))


def test_every_named_test_exists():
    assert len(NAMED) > 50
    files = {path: (ROOT / path).read_text(encoding="utf-8") for path, _ in NAMED if (ROOT / path).is_file()}
    assert [
        f"{path}::{test}"
        for path, test in NAMED
        if path not in files or (test and not re.search(rf"^def {test}\(", files[path], flags=re.MULTILINE))
    ] == []
