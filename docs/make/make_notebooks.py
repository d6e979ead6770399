"""Execute the notebooks of examples/notebooks and keep their outputs: `python docs/make/make_notebooks.py [NAME...]`.

Outputs are texts, tables and small pictures. What differs from run to run (times, counts of executions) is not kept.
tests/docs/test_notebooks.py executes them too and compares the texts.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples" / "notebooks"

#: Time that a cell may take [s]: the first run on a machine compiles.
_PATIENCE = 600


def executed(path: Path) -> nbformat.NotebookNode:
    """Return a notebook as it is after its execution in an empty folder, with this checkout."""
    notebook = nbformat.read(path, 4)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYDEVD_DISABLE_FILE_VALIDATION": "1"}
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(
            notebook, timeout=_PATIENCE, resources={"metadata": {"path": folder}}, kernel_name="python3"
        )
        client.execute(env=environment)
    for cell in notebook.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":
            cell.execution_count = None
            # Warnings about this machine, such as a cache that cannot be written, belong to no reader.
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
            for output in cell.outputs:
                output.pop("execution_count", None)
                if output.output_type == "execute_result":
                    output["output_type"] = "display_data"
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"], "language_info": {"name": "python"}}
    return notebook


def main(names: list[str]) -> None:
    """Execute notebooks, by default all, and write them."""
    for path in sorted(FOLDER.glob("*.ipynb")):
        if not names or path.stem in names:
            nbformat.write(executed(path), path)
            print(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1024} KB")


if __name__ == "__main__":
    main(sys.argv[1:])
