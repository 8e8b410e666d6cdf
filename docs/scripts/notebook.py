"""Runs docs/examples/kitchen.ipynb and stores its outputs in it.

Needs the extras experts and record, and the group notebook.

python docs/scripts/notebook.py

It runs in a temporary folder, with Minari's datasets in it. Outputs are stored so that readers see the pictures without
running it; those of progress bars are left out, and pictures are stored as PNG only.
"""

import os
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).resolve().parent.parent / "examples" / "kitchen.ipynb"


def run(path: Path, folder: Path) -> nbformat.NotebookNode:
    """Runs a notebook, and returns it with its outputs.

    Args:
      path: notebook.
      folder: working directory of the run.

    Raises:
      nbclient.exceptions.CellExecutionError: a cell failed.
    """
    notebook = nbformat.read(path, as_version=4)
    variables = {"MINARI_DATASETS_PATH": str(folder / "datasets"), "IPYTHONDIR": str(folder / "ipython")}
    client = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}})
    client.execute(env={**os.environ, **variables})
    for cell in client.nb.cells:
        cell.metadata.pop("execution", None)  # times
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
            for output in cell.outputs:
                output.get("data", {}).pop("image/jpeg", None)
                if output.output_type == "stream":
                    output.text = output.text.replace(f"{folder}{os.sep}", "")
    return client.nb


def printed(notebook: nbformat.NotebookNode) -> list[str]:
    """Returns the lines that a notebook printed, without speeds and digests, which differ between machines."""
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    lines = "".join(output.text for output in outputs if output.output_type == "stream").splitlines()
    return [line for line in lines if "per second" not in line and "digest" not in line]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        nbformat.write(run(NOTEBOOK, Path(temporary)), NOTEBOOK)
