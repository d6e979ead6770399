"""The notebooks of examples/notebooks run, and their kept outputs are what they give."""

import importlib
import re
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = ROOT / "examples" / "notebooks"

#: The others take longer.
QUICK = {"shock"}

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def marked(path):
    return pytest.param(path, id=path.stem, marks=() if path.stem in QUICK else (pytest.mark.nightly,))


def script():
    return importlib.import_module("docs.make.make_notebooks")


def texts(notebook):
    """Return the texts that each cell shows; pictures and HTML repeat them or depend on the version of matplotlib."""
    for number, cell in enumerate(notebook.cells):
        for output in cell.get("outputs", ()):
            text = output.get("text") or output.get("data", {}).get("text/plain", "")
            if "image/png" not in output.get("data", {}):
                yield number, text


@pytest.mark.nightly
@pytest.mark.parametrize("path", [marked(path) for path in sorted(NOTEBOOKS.glob("*.ipynb"))])
def test_a_notebook_gives_its_kept_outputs(path):
    kept, new = (list(texts(one)) for one in (nbformat.read(path, 4), script().executed(path)))
    for (cell, before), (_, after) in zip(kept, new, strict=True):
        assert NUMBER.sub("#", before) == NUMBER.sub("#", after), f"cell {cell}"
        for one, other in zip(NUMBER.findall(before), NUMBER.findall(after), strict=True):
            assert float(one) == pytest.approx(float(other), rel=0.02, abs=1e-9), f"cell {cell}"


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_kept_outputs_are_small_and_name_no_folder_of_this_machine(path):
    assert path.stat().st_size < 200_000
    notebook = nbformat.read(path, 4)
    assert any("image/png" in o.get("data", {}) for c in notebook.cells for o in c.get("outputs", ()))
    assert not [text for _, text in texts(notebook) if re.search(r"(?<![\w.])/(home|root|tmp|work|Users)/", text)]
