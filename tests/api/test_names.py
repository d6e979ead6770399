"""`import eightpost as ep` gives the public names, and loads nothing before they are used."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import eightpost as ep

PACKAGE = Path(ep.__file__).parent

#: Everything below the API in the order of imports.
BELOW = ("builder.build", "builder.ssp", "cosim", "cosim.study", "eightpost.ident", "eightpost.ident.vehicle",
         "eightpost.virtual", "eightpost.drivefile", "eightpost.report.page")  # fmt: skip


def loaded_after(code: str) -> set[str]:
    """Return the modules of a fresh interpreter after some code."""
    command = [sys.executable, "-c", f"{code}; import sys; print(*sorted(sys.modules))"]
    return set(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())


def test_the_import_loads_the_package_alone_and_a_name_no_numerical_library_before_it_is_called():
    package = (
        "import sys; before = {*sys.modules}; import eightpost as ep; assert {*sys.modules} - before == {'eightpost'}"
    )
    loaded = loaded_after(f"{package}; ep.fit, ep.build, ep.run, ep.sweep, ep.identify, ep.study, ep.read")
    assert not {"numpy", "scipy", "numba", "cosim", "builder", "matplotlib", "pandas"} & loaded


@pytest.mark.slow
def test_a_fit_loads_neither_of_the_libraries_that_take_half_a_second():
    loaded = loaded_after("import eightpost.app.fit, eightpost.ident.shock.hysteresis")
    assert "scipy.optimize" in loaded and not {"scipy.signal", "scipy.stats"} & loaded


@pytest.mark.nightly
def test_no_module_below_loads_the_api():
    loaded = loaded_after(f"import {', '.join(BELOW)}")
    assert set(BELOW) <= loaded
    assert not {name for name in loaded if name.startswith("eightpost.api")}


def test_dir_and_the_stub_list_exactly_the_public_names():
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text())
    homes = {a.asname: node.module for node in stub.body if isinstance(node, ast.ImportFrom) for a in node.names}
    (listed,) = [ast.literal_eval(node.value) for node in stub.body if isinstance(node, ast.Assign)]
    assert listed == sorted(homes) == sorted(ep.__all__)
    assert set(dir(ep)) == {*homes, "__version__"}
    assert homes == ep._HOME


def test_every_name_exists_and_is_documented():
    for name in ep.__all__:
        value = getattr(ep, name)
        assert value.__doc__, name
        if callable(value) and not isinstance(value, type):
            assert ">>> " in value.__doc__ and "return" in value.__annotations__, name


def test_a_wrong_name_is_reported_with_similar_ones():
    with pytest.raises(AttributeError, match=r"no attribute 'simulat'; did you mean simulate\?"):
        _ = ep.simulat
    assert not hasattr(ep, "_repr_html_")


def test_completion_in_a_notebook_offers_the_public_names():
    core = pytest.importorskip("IPython.core.completer")
    completer = core.IPCompleter(namespace={"ep": ep}, use_jedi=False)
    with core.provisionalcompleter():
        found = {one.text.removeprefix(".") for one in completer.completions("ep.", 3)}
    assert {name for name in found if not name.startswith("_")} == set(ep.__all__)


@pytest.mark.nightly
def test_a_type_checker_knows_what_every_call_returns(tmp_path):
    script = Path(__file__).with_name("typed_use.py")
    root = PACKAGE.parent
    command = [sys.executable, "-m", "pyrefly", "check", "--config", str(root / "pyproject.toml"), str(script)]
    command += ["--python-interpreter-path", sys.executable]
    checked = subprocess.run(command, capture_output=True, text=True, check=False, cwd=root)
    assert checked.returncode == 0, checked.stdout
